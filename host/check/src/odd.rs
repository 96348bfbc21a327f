//! Odd tables: cut, grown, with strange values, with other types, without columns.

use crate::item::{Cells, Item};
use puncta_engine::documents::{ColumnInfo, ColumnType, Element};

/// Whether rows of a table can be taken one by one.
fn plain(item: &Item) -> bool {
    item.parts.len() == 1
        && item.header.parts[0]
            .columns
            .iter()
            .all(|column| column.type_.element != Element::Utf8)
}

/// The table's first rows; `None` if it has no more than those.
pub fn first(item: &Item, rows: u64) -> Option<Item> {
    if !plain(item) || item.rows() <= rows {
        return None;
    }
    let mut cut = item.clone();
    cut.header.parts[0].rows = rows;
    for (info, cells) in cut.header.parts[0].columns.iter().zip(&mut cut.parts[0]) {
        let bytes = rows as usize * info.type_.row_bytes();
        cells.data.truncate(bytes);
    }
    Some(cut)
}

/// A table without rows.
pub fn empty(item: &Item) -> Item {
    let mut cut = item.clone();
    for (group, columns) in cut.header.parts.iter_mut().zip(&mut cut.parts) {
        group.rows = 0;
        for (info, cells) in group.columns.iter().zip(columns) {
            cells.data.clear();
            if info.type_.element == Element::Utf8 {
                cells.offsets.clear();
                cells.text.clear();
            }
        }
    }
    cut
}

/// The table's first row, also of a table with texts.
pub fn one(item: &Item) -> Option<Item> {
    first(item, 1)
}

/// The table so many times, each copy moved along x so that no two points coincide.
pub fn times(item: &Item, count: u64) -> Option<Item> {
    if !plain(item) || item.rows() == 0 {
        return None;
    }
    let mut more = item.clone();
    more.header.parts[0].rows *= count;
    for (info, cells) in more.header.parts[0].columns.iter().zip(&mut more.parts[0]) {
        let once = std::mem::take(&mut cells.data);
        cells.data.reserve_exact(once.len() * count as usize);
        if info.name == "x" && info.type_ == ColumnType::scalar(Element::F64) {
            let values = floats(&once);
            let (low, high) = values
                .iter()
                .fold((f64::MAX, f64::MIN), |(low, high), value| {
                    (low.min(*value), high.max(*value))
                });
            let step = (high - low).abs() * 1.001 + 1.0;
            for copy in 0..count {
                let shift = step * copy as f64;
                cells.data.extend(
                    values
                        .iter()
                        .flat_map(|value| (value + shift).to_le_bytes()),
                );
            }
        } else {
            for _ in 0..count {
                cells.data.extend_from_slice(&once);
            }
        }
    }
    Some(more)
}

fn floats(bytes: &[u8]) -> Vec<f64> {
    let (chunks, _) = bytes.as_chunks::<8>();
    chunks
        .iter()
        .map(|chunk| f64::from_le_bytes(*chunk))
        .collect()
}

/// The table with values of its floating-point columns replaced; `value` gets column, row and value.
pub fn replaced(item: &Item, value: impl Fn(usize, usize, f64) -> f64) -> Option<Item> {
    let mut other = item.clone();
    let mut changed = false;
    for (group, columns) in other.header.parts.iter().zip(&mut other.parts) {
        for (at, (info, cells)) in group.columns.iter().zip(columns).enumerate() {
            match info.type_.element {
                Element::F64 => {
                    let values = floats(&cells.data).into_iter().enumerate();
                    let values = values.map(|(row, old)| value(at, row, old));
                    cells.data = values.flat_map(f64::to_le_bytes).collect();
                }
                Element::F32 => {
                    let (chunks, _) = cells.data.as_chunks::<4>();
                    let values = chunks.iter().map(|chunk| f32::from_le_bytes(*chunk));
                    let values = values
                        .enumerate()
                        .map(|(row, old)| value(at, row, old.into()) as f32);
                    cells.data = values.flat_map(f32::to_le_bytes).collect();
                }
                _ => continue,
            }
            changed = true;
        }
    }
    changed.then_some(other)
}

/// The table with one column left out.
pub fn without(item: &Item, name: &str) -> Option<Item> {
    let at = item.header.parts.first()?;
    let at = at.columns.iter().position(|column| column.name == name)?;
    let mut other = item.clone();
    other.header.parts[0].columns.remove(at);
    other.parts[0].remove(at);
    Some(other)
}

/// Number types that columns are given in.
pub const TYPES: [Element; 6] = [
    Element::F32,
    Element::I32,
    Element::U16,
    Element::U8,
    Element::I64,
    Element::Bool,
];

/// The table with some columns of numbers in another type.
pub fn retyped(item: &Item, names: &[String], element: Element) -> Option<Item> {
    let mut other = item.clone();
    let mut changed = false;
    let groups = other.header.parts.first_mut().zip(other.parts.first_mut());
    let (group, columns) = groups?;
    for (info, cells) in group.columns.iter_mut().zip(columns) {
        if info.type_ == ColumnType::scalar(Element::F64) && names.contains(&info.name) {
            let values = floats(&cells.data);
            cells.data = values
                .iter()
                .flat_map(|value| bytes(*value, element))
                .collect();
            info.type_ = ColumnType::scalar(element);
            changed = true;
        }
    }
    changed.then_some(other)
}

fn bytes(value: f64, element: Element) -> Vec<u8> {
    match element {
        Element::F32 => (value as f32).to_le_bytes().to_vec(),
        Element::I32 => (value as i32).to_le_bytes().to_vec(),
        Element::U16 => (value as u16).to_le_bytes().to_vec(),
        Element::U8 => vec![value as u8],
        Element::Bool => vec![u8::from(value > 0.5)],
        Element::I64 => (value as i64).to_le_bytes().to_vec(),
        _ => value.to_le_bytes().to_vec(),
    }
}

/// The table with one needed column as texts.
pub fn as_texts(item: &Item, name: &str) -> Option<Item> {
    let at = item.header.parts.first()?;
    let at = at.columns.iter().position(|column| column.name == name)?;
    let mut other = item.clone();
    let rows = item.rows();
    let unit = other.header.parts[0].columns[at].unit.clone();
    other.header.parts[0].columns[at] = ColumnInfo::new(name, Element::Utf8, unit);
    other.parts[0][at] = Cells {
        offsets: (0..=rows).flat_map(|row| (2 * row).to_le_bytes()).collect(),
        text: b"ab".repeat(rows as usize),
        ..Cells::default()
    };
    Some(other)
}

#[cfg(test)]
mod tests {
    use super::*;
    use puncta_engine::documents::Header;

    fn item() -> Item {
        let info = ["x", "y"].map(|name| ColumnInfo::new(name, Element::F64, "nm"));
        let cells = |begin: f64| Cells {
            data: (0..4)
                .flat_map(|i| (begin + f64::from(i)).to_le_bytes())
                .collect(),
            ..Cells::default()
        };
        Item {
            header: Header::table("t", 4, info.to_vec()),
            parts: vec![vec![cells(0.0), cells(10.0)]],
        }
    }

    #[test]
    fn tables_are_cut_and_grown() {
        let cut = first(&item(), 2).unwrap();
        assert_eq!(
            (cut.rows(), floats(&cut.parts[0][1].data)),
            (2, vec![10.0, 11.0])
        );
        assert!(first(&item(), 4).is_none());
        assert!(empty(&item()).parts[0][0].data.is_empty());
        let more = times(&item(), 3).unwrap();
        assert_eq!(more.rows(), 12);
        let x = floats(&more.parts[0][0].data);
        assert!(x.windows(2).all(|pair| pair[0] < pair[1]), "{x:?}");
        assert_eq!(floats(&more.parts[0][1].data)[8], 10.0);
    }

    #[test]
    fn values_and_types_are_replaced() {
        let other = replaced(&item(), |_, _, value| -value).unwrap();
        assert_eq!(floats(&other.parts[0][1].data)[0], -10.0);
        let small = retyped(&item(), &["y".into()], Element::U8).unwrap();
        assert_eq!(small.parts[0][1].data, [10, 11, 12, 13]);
        assert_eq!(small.parts[0][0].data.len(), 32);
        assert!(without(&item(), "z").is_none());
        assert_eq!(without(&item(), "x").unwrap().parts[0].len(), 1);
        let texts = as_texts(&item(), "x").unwrap();
        assert_eq!(texts.parts[0][0].text.len(), 8);
    }
}
