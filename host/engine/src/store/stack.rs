//! Tables under one another, with a column that says where each row comes from.

use super::gather::{make, make_texts, scaled};
use super::object::{ColumnData, Object, Stored};
use super::region::Region;
use puncta_documents::{ColumnInfo, ColumnType, Element, Failure, Header, Kind, Report, number};

/// One column of the result: what it is, and the column of each table that has it.
struct Stack {
    info: ColumnInfo,
    parts: Vec<Option<ColumnData>>,
}

/// Tables under one another, in order. `name` is the first column; it holds the text that stands
/// beside each table. A number that a table lacks is NaN, a text empty.
///
/// # Errors
/// When something is no table, a column has several units, or there is no memory.
pub fn stack(name: &str, tables: &[(String, Object)]) -> Result<Object, Failure> {
    let mut stacks: Vec<Stack> = Vec::new();
    for (at, (label, object)) in tables.iter().enumerate() {
        let header = object.header();
        if header.kind != Kind::Table {
            let message = format!("{label} is a {} and no table", header.kind);
            return Err(Failure::bad_input(message).remedy("collect tables or reports"));
        }
        let columns = header.parts.first().map_or(&[][..], |part| &part.columns);
        for (info, stored) in columns.iter().zip(object.columns(0)) {
            if info.name == name {
                let message = format!("{label} has a column {name} already");
                return Err(Failure::bad_input(message).remedy("rename it"));
            }
            let found = stacks.iter().position(|stack| stack.info.name == info.name);
            let found = found.unwrap_or_else(|| {
                let parts = vec![None; tables.len()];
                let info = info.clone();
                stacks.push(Stack { info, parts });
                stacks.len() - 1
            });
            let Some(stack) = stacks.get_mut(found) else {
                continue;
            };
            if stack.info.unit != info.unit {
                let message = format!(
                    "the column {} is in {} in one file and in {} in {label}",
                    info.name, stack.info.unit, info.unit
                );
                return Err(Failure::bad_input(message).remedy("convert it to one unit first"));
            }
            if let Some(part) = stack.parts.get_mut(at) {
                *part = Some(stored.column()?.clone());
            }
        }
    }
    let rows: Vec<u64> = tables
        .iter()
        .map(|(_, object)| object.header().rows())
        .collect();
    let mut infos = vec![ColumnInfo::new(name, Element::Utf8, "1")];
    let mut columns = vec![Stored::whole(labels(tables, &rows)?)];
    for mut stack in stacks {
        let column = stack.join(&rows)?;
        stack.info.type_ = column.type_;
        stack.info.text_bytes = None;
        stack.info.entries = None;
        infos.push(stack.info);
        columns.push(Stored::whole(column));
    }
    let header = Header::table("collected", rows.iter().sum(), infos);
    Object::new(header, vec![columns])
}

fn labels(tables: &[(String, Object)], rows: &[u64]) -> Result<ColumnData, Failure> {
    let ends = ends(rows);
    make_texts(ends.last().copied().unwrap_or(0), |row| {
        let at = ends.partition_point(|end| *end <= row);
        tables
            .get(at)
            .map_or(&[][..], |(label, _)| label.as_bytes())
    })
}

/// Where each table ends.
fn ends(rows: &[u64]) -> Vec<usize> {
    let counts = rows.iter().map(|rows| usize::try_from(*rows).unwrap_or(0));
    counts
        .scan(0, |end, rows| {
            *end += rows;
            Some(*end)
        })
        .collect()
}

impl Stack {
    fn join(&self, rows: &[u64]) -> Result<ColumnData, Failure> {
        let there = || self.parts.iter().flatten();
        if there().any(|part| part.type_.element.is_text()) {
            return self.join_texts(rows);
        }
        let first = there().next().map(|part| part.type_);
        let one = self
            .parts
            .iter()
            .all(|part| part.as_ref().map(|part| part.type_) == first);
        match first {
            Some(type_) if one => match type_.element.bytes() {
                1 => join::<u8>(type_, rows, &self.parts, 0),
                2 => join::<u16>(type_, rows, &self.parts, 0),
                4 => join::<u32>(type_, rows, &self.parts, 0),
                _ => join::<u64>(type_, rows, &self.parts, 0),
            },
            Some(type_) => {
                let type_ = ColumnType {
                    element: Element::F64,
                    ..type_
                };
                let float = |part: &Option<ColumnData>| {
                    let scaled = part.as_ref().map(|part| scaled(part, 1.0)).transpose()?;
                    Ok(scaled.filter(|part| part.type_ == type_))
                };
                let parts: Result<Vec<_>, Failure> = self.parts.iter().map(float).collect();
                join::<u64>(type_, rows, &parts?, f64::NAN.to_bits())
            }
            None => Err(Failure::internal("a column of no table")),
        }
    }

    fn join_texts(&self, rows: &[u64]) -> Result<ColumnData, Failure> {
        let ends = ends(rows);
        make_texts(ends.last().copied().unwrap_or(0), |row| {
            let at = ends.partition_point(|end| *end <= row);
            let begin = at.checked_sub(1).and_then(|before| ends.get(before));
            let row = row - begin.copied().unwrap_or(0);
            let part = self.parts.get(at).and_then(Option::as_ref);
            part.map_or(&[][..], |part| text(part, row))
        })
    }
}

fn text(column: &ColumnData, row: usize) -> &[u8] {
    let place = match column.type_.element {
        Element::Utf8 => row,
        Element::Dictionary => {
            let codes: &[u32] = column.data.as_ref().map_or(&[], Region::slice);
            codes.get(row).map_or(usize::MAX - 1, |code| *code as usize)
        }
        _ => return &[],
    };
    let offsets: &[u64] = column.offsets.as_ref().map_or(&[], Region::slice);
    let bytes: &[u8] = column.text.as_ref().map_or(&[], Region::slice);
    let end = |at: usize| offsets.get(at).map(|end| *end as usize);
    match (end(place), end(place + 1)) {
        (Some(from), Some(to)) => bytes.get(from..to).unwrap_or(&[]),
        _ => &[],
    }
}

fn join<T: super::region::Number>(
    type_: ColumnType,
    rows: &[u64],
    parts: &[Option<ColumnData>],
    missing: T,
) -> Result<ColumnData, Failure> {
    make::<T>(type_, rows.iter().sum(), |mut out| {
        for (rows, part) in rows.iter().zip(parts) {
            let count = usize::try_from(*rows).unwrap_or(0) * type_.width as usize;
            let (here, rest) = out.split_at_mut(count.min(out.len()));
            let from = part.as_ref().and_then(|part| part.data.as_ref());
            match from.map(Region::slice::<T>) {
                Some(from) if from.len() == here.len() => here.copy_from_slice(from),
                _ => here.fill(missing),
            }
            out = rest;
        }
    })
}

/// A report as a table of one row: a column for each value, and two for each interval.
///
/// # Errors
/// When it is no report, or there is no memory.
pub fn row_of(report: &Report) -> Result<Object, Failure> {
    let (mut infos, mut columns) = (Vec::new(), Vec::new());
    let mut add = |name: String, value: &serde_json::Value, unit: &str| {
        let column = match (number::from_value(value), value.as_str()) {
            (Some(value), _) => {
                make::<f64>(ColumnType::scalar(Element::F64), 1, |out| out.fill(value))?
            }
            (None, Some(text)) => make_texts(1, |_| text.as_bytes())?,
            (None, None) => return Ok(()),
        };
        let mut info = ColumnInfo::new(name, column.type_.element, unit);
        info.type_ = column.type_;
        infos.push(info);
        columns.push(Stored::whole(column));
        Ok::<(), Failure>(())
    };
    for one in &report.values {
        add(one.name.clone(), &one.value, &one.unit)?;
        if let Some([low, high]) = &one.interval {
            add(format!("{}_low", one.name), low, &one.unit)?;
            add(format!("{}_high", one.name), high, &one.unit)?;
        }
    }
    Object::new(Header::table(&report.output, 1, infos), vec![columns])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::store::gather::numbers;

    fn table(columns: Vec<(&str, &str, ColumnData)>) -> Object {
        let rows = columns.first().map_or(0, |(.., column)| column.rows);
        let info = |(name, unit, column): &(&str, &str, ColumnData)| {
            ColumnInfo::new(*name, column.type_.element, *unit)
        };
        let infos = columns.iter().map(info).collect();
        let stored = columns
            .into_iter()
            .map(|(.., column)| Stored::whole(column));
        Object::new(Header::table("t", rows, infos), vec![stored.collect()]).unwrap()
    }

    fn counts(values: &[u32]) -> ColumnData {
        let type_ = ColumnType::scalar(Element::U32);
        make::<u32>(type_, values.len() as u64, |out| {
            out.copy_from_slice(values)
        })
        .unwrap()
    }

    fn floats(object: &Object, name: &str) -> Vec<f64> {
        object
            .column(0, name)
            .unwrap()
            .data
            .unwrap()
            .slice::<f64>()
            .to_vec()
    }

    fn words(object: &Object, name: &str) -> Vec<String> {
        let column = object.column(0, name).unwrap();
        let rows = 0..usize::try_from(column.rows).unwrap();
        let word = |row| String::from_utf8(text(&column, row).to_vec()).unwrap();
        rows.map(word).collect()
    }

    #[test]
    fn rows_keep_their_values_and_know_their_file() {
        let one = table(vec![
            ("x", "nm", numbers(&[1.0, 2.0])),
            ("n", "1", counts(&[7, 8])),
            ("w", "1", make_texts(2, |i| [&b"a"[..], b"bc"][i]).unwrap()),
        ]);
        let two = table(vec![
            ("x", "nm", numbers(&[3.0])),
            ("y", "s", numbers(&[9.0])),
        ]);
        let none = table(vec![("x", "nm", numbers(&[]))]);
        let all = [
            ("1".to_owned(), one),
            ("0".to_owned(), none),
            ("2".to_owned(), two),
        ];
        let out = stack("file", &all).unwrap();
        assert_eq!(words(&out, "file"), ["1", "1", "2"]);
        assert_eq!(floats(&out, "x"), [1.0, 2.0, 3.0]);
        assert_eq!(words(&out, "w"), ["a", "bc", ""]);
        let y = floats(&out, "y");
        assert!(y[0].is_nan() && y[1].is_nan() && y[2] == 9.0);
        // Whole numbers that one table lacks need a value for missing.
        assert_eq!(floats(&out, "n")[..2], [7.0, 8.0]);
        let units: Vec<&str> = out.header().parts[0]
            .columns
            .iter()
            .map(|c| &*c.unit)
            .collect();
        assert_eq!(units, ["1", "nm", "1", "1", "s"]);
    }

    #[test]
    fn equal_types_are_kept_and_units_must_agree() {
        let one = || table(vec![("n", "1", counts(&[7]))]);
        let two = [("a".to_owned(), one()), ("b".to_owned(), one())];
        let out = stack("file", &two).unwrap();
        assert_eq!(
            out.column(0, "n").unwrap().data.unwrap().slice::<u32>(),
            [7, 7]
        );
        let other = table(vec![("n", "nm", counts(&[7]))]);
        let two = [("a".to_owned(), one()), ("b".to_owned(), other)];
        let text = stack("file", &two).unwrap_err().to_string();
        assert!(
            text.contains("n is in 1 in one file and in nm in b"),
            "{text}"
        );
        assert!(stack("n", &[("a".to_owned(), one())]).is_err());
        assert_eq!(stack("file", &[]).unwrap().header().rows(), 0);
    }

    #[test]
    fn a_report_is_a_row() {
        let mut report = Report::new("report");
        report.number("resolution", 31.5, "nm").interval = Some([30.into(), 33.into()]);
        report.number("none", f64::NAN, "1");
        let row = row_of(&report).unwrap();
        assert_eq!(floats(&row, "resolution"), [31.5]);
        assert_eq!(floats(&row, "resolution_high"), [33.0]);
        assert!(floats(&row, "none")[0].is_nan());
    }
}
