//! `puncta.chaining.merge/1`

use crate::merged::{Groups, groups, mean, root_sum_square, sum, weighted};
use puncta_sdk::documents::Read;
use puncta_sdk::input::ColumnRef;
use puncta_sdk::operation::default_plan;
use puncta_sdk::prelude::*;
use puncta_sdk::serde_json::json;
use puncta_sdk::{ColumnMut, Input, OutputObject};

/// Makes the localisations of each chain one.
#[derive(Params)]
pub struct Merge {
    /// Column with the number of the group; rows below 1 are left out.
    #[param(default = "clumpIndex")]
    group: Column,
    /// Columns that are summed, if they are there.
    #[param(default = ["nPhotons", "A", "Ag", "Ar"])]
    sum: Columns,
    /// No error of a position becomes smaller than this, for errors that repeats do not average.
    #[param(default = 0, min = 0, max = 1e6, unit = "nm")]
    error_floor: f64,
}

/// How a column is made from the values of a group.
#[derive(Clone, Debug, PartialEq, Eq)]
enum How {
    Group,
    First,
    Last,
    Count,
    Sum,
    Mean,
    Earliest,
    Weighted(String),
    ErrorOf(String),
    ErrorOfSum,
}

const LAST: &str = "t_last";
const COUNT: &str = "clumpSize";

impl Merge {
    /// The columns of the output, and how each is made.
    fn columns(&self, header: &Header) -> Vec<(ColumnInfo, How)> {
        let known = header.parts.first().map_or(&[][..], |part| &part.columns);
        let mut columns = Vec::new();
        for info in known {
            if info.type_.element.is_text() || [LAST, COUNT].contains(&info.name.as_str()) {
                continue;
            }
            let mut info = info.clone();
            info.source = None;
            let how = self.how(&info, header);
            if how == How::First {
                info.description = Some("First frame".into());
            }
            if matches!(
                how,
                How::Weighted(_) | How::ErrorOf(_) | How::Sum | How::ErrorOfSum
            ) {
                let wide = matches!(info.type_.element, Element::F64 | Element::F32);
                let element = if wide {
                    info.type_.element
                } else {
                    Element::F64
                };
                info.type_ = puncta_sdk::ColumnType::scalar(element);
            }
            columns.push((info, how));
        }
        if let Some(t) = header.column("t") {
            let mut last = t.clone();
            last.name = LAST.into();
            last.role = None;
            columns.push((last.description("Last frame"), How::Last));
        }
        let count = ColumnInfo::new(COUNT, Element::U32, "1");
        columns.push((
            count.description("Localisations that were merged"),
            How::Count,
        ));
        columns
    }

    fn how(&self, info: &ColumnInfo, header: &Header) -> How {
        let name = info.name.as_str();
        let float = matches!(info.type_.element, Element::F64 | Element::F32);
        let scalar = |name: &str| {
            header
                .column(name)
                .filter(|c| c.type_.width == 1 && !c.type_.element.is_text())
        };
        if name == self.group.0 {
            return How::Group;
        }
        if info.type_.width != 1 {
            return if float { How::Mean } else { How::Earliest };
        }
        if let Some(of) = name
            .strip_prefix("error_")
            .filter(|of| scalar(of).is_some())
        {
            let summed = self.sum.0.iter().any(|sum| sum == of);
            return if summed {
                How::ErrorOfSum
            } else {
                How::ErrorOf(of.into())
            };
        }
        if self.sum.0.iter().any(|sum| sum == name) {
            return How::Sum;
        }
        let error = format!("error_{name}");
        match name {
            "t" => How::First,
            _ if scalar(&error).is_some() => How::Weighted(error),
            _ if float => How::Mean,
            _ => How::Earliest,
        }
    }
}

impl Operation for Merge {
    const ID: &'static str = "puncta.chaining.merge/1";

    fn info() -> Info {
        Info::operation("Merge repeats")
            .description(
                "Makes one localisation of each group, in the order of the groups' numbers. A \
                 column k with a column error_k becomes the mean weighted with 1 / error_k^2, and \
                 error_k becomes 1 / sqrt(sum 1 / error_k^2), or the floor if that is larger. \
                 Photon numbers are summed. t is the first frame, t_last the last, clumpSize the \
                 number of localisations. Other numbers become their mean, and whole numbers, such \
                 as a channel, that of the earliest localisation. Texts are left out. Rows of no \
                 group (below 1) give nothing.",
            )
            .input(
                Ports::table("table")
                    .any_column("$group")
                    .description("Localisations with the number of their chain"),
            )
            .output(Ports::table("table").description("One row for each chain"))
            .output(Ports::report("report").description("Localisations and chains"))
            .example(json!({ "group": "site" }))
            .example_input("table", "puncta.synthetic.membrane/1", json!({}))
    }

    fn prepare(&self, request: &Request) -> Result<Plan, Failure> {
        let mut plan = default_plan::<Self>(request);
        let Some(input) = request.inputs.first() else {
            return Ok(plan);
        };
        let header = &input.header;
        let group = header.column(&self.group).ok_or_else(|| {
            Failure::bad_input(format!(
                "there is no column {} in {}",
                self.group.0, header.name
            ))
            .parameter("group")
            .remedy("find the repeats first, or name the column with the groups")
        })?;
        if group.type_.element.is_text() || group.type_.width != 1 {
            let message = format!("column {} does not hold single numbers", self.group.0);
            return Err(Failure::bad_input(message).parameter("group"));
        }
        let columns = header.parts.first().map_or(&[][..], |part| &part.columns);
        let (texts, numbers): (Vec<_>, Vec<_>) = columns
            .iter()
            .partition(|column| column.type_.element.is_text());
        plan.read = vec![Read {
            input: 0,
            part: 0,
            columns: numbers.iter().map(|column| column.name.clone()).collect(),
        }];
        if !texts.is_empty() {
            let names: Vec<&str> = texts.iter().map(|column| column.name.as_str()).collect();
            plan.notes.push(format!(
                "{} is left out: texts are not merged",
                names.join(", ")
            ));
        }
        plan.memory = header.rows() * 40 + (64 << 20);
        Ok(plan)
    }

    fn run(&self, job: &Job) -> Result<(), Failure> {
        let table = job.input("table")?;
        job.progress(0.0, "grouping")?;
        let groups = groups(&table.f64(&self.group)?, job)?;
        let columns = self.columns(table.header());
        let infos: Vec<ColumnInfo> = columns.iter().map(|(info, _)| info.clone()).collect();
        let name = table.header().name.clone();
        let mut header = Header::table(name, groups.len() as u64, infos);
        header.metadata = table.header().metadata.clone();
        let mut out = job.begin("table", header)?;
        out.commit(0, groups.len() as u64)?;
        let source = Source {
            table: &table,
            groups: &groups,
            job,
            floor: self.error_floor,
        };
        for (at, (info, how)) in columns.iter().enumerate() {
            job.progress(at as f64 / columns.len() as f64, "merging")?;
            source.write(&mut out, info, how)?;
        }
        out.finish()?;
        let mut report = Report::new("report");
        let merged = groups.rows.len();
        report.number("localisations", merged as f64, "1");
        report.number("merged", groups.len() as f64, "1");
        report
            .number("left out", (table.rows() - merged) as f64, "1")
            .description = Some("Rows of no group".into());
        job.report(&report)
    }
}

struct Source<'a> {
    table: &'a Input<'a>,
    groups: &'a Groups,
    job: &'a Job,
    floor: f64,
}

impl Source<'_> {
    fn write(
        &self,
        out: &mut OutputObject<'_>,
        info: &ColumnInfo,
        how: &How,
    ) -> Result<(), Failure> {
        let name = info.name.as_str();
        match how {
            How::Earliest => self.earliest(out, name),
            How::Mean if info.type_.width > 1 => {
                let width = info.type_.width as usize;
                let values = self.table.f64(name)?;
                self.lists(out, name, width, &|rows, k| {
                    let each = rows.iter().map(|row| values[*row as usize * width + k]);
                    each.sum::<f64>() / rows.len() as f64
                })
            }
            How::Count => self.numbers(out, name, &|rows| rows.len() as f64),
            How::Group => {
                let values = self.table.f64(name)?;
                self.numbers(out, name, &|rows| first(rows, &values))
            }
            How::First | How::Last => {
                let t = self.table.f64("t")?;
                let fold = if *how == How::First {
                    f64::min
                } else {
                    f64::max
                };
                self.numbers(out, name, &|rows| {
                    rows.iter().map(|row| t[*row as usize]).fold(f64::NAN, fold)
                })
            }
            How::Sum => {
                let values = self.table.f64(name)?;
                self.numbers(out, name, &|rows| sum(&values, rows))
            }
            How::Mean => {
                let values = self.table.f64(name)?;
                self.numbers(out, name, &|rows| mean(&values, rows))
            }
            How::ErrorOfSum => {
                let values = self.table.f64(name)?;
                self.numbers(out, name, &|rows| root_sum_square(&values, rows))
            }
            How::Weighted(error) => {
                let (values, errors) = (self.table.f64(name)?, self.table.f64(error)?);
                self.numbers(out, name, &|rows| weighted(&values, &errors, rows).0)
            }
            How::ErrorOf(of) => {
                let (values, errors) = (self.table.f64(of)?, self.table.f64(name)?);
                let floor = if info.unit == "nm" { self.floor } else { 0.0 };
                self.numbers(out, name, &|rows| {
                    let error = weighted(&values, &errors, rows).1;
                    if error < floor { floor } else { error }
                })
            }
        }
    }

    fn numbers(
        &self,
        out: &mut OutputObject<'_>,
        name: &str,
        value: &(dyn Fn(&[u32]) -> f64 + Sync),
    ) -> Result<(), Failure> {
        macro_rules! write {
            ($to:expr, $type:ty) => {
                self.groups
                    .each($to, self.job, &|rows| value(rows) as $type)?
            };
        }
        match out.column_mut(0, name)? {
            ColumnMut::F64(to) => write!(to, f64),
            ColumnMut::F32(to) => write!(to, f32),
            ColumnMut::I8(to) => write!(to, i8),
            ColumnMut::I16(to) => write!(to, i16),
            ColumnMut::I32(to) => write!(to, i32),
            ColumnMut::I64(to) => write!(to, i64),
            ColumnMut::U8(to) | ColumnMut::Bool(to) => write!(to, u8),
            ColumnMut::U16(to) => write!(to, u16),
            ColumnMut::U32(to) => write!(to, u32),
            ColumnMut::U64(to) => write!(to, u64),
            _ => return Err(Failure::internal(format!("column {name} holds texts"))),
        }
        Ok(())
    }

    fn lists(
        &self,
        out: &mut OutputObject<'_>,
        name: &str,
        width: usize,
        value: &(dyn Fn(&[u32], usize) -> f64 + Sync),
    ) -> Result<(), Failure> {
        match out.column_mut(0, name)? {
            ColumnMut::F64(to) => {
                for (group, list) in to.chunks_exact_mut(width).enumerate() {
                    for (k, slot) in list.iter_mut().enumerate() {
                        *slot = value(self.groups.of(group), k);
                    }
                }
            }
            ColumnMut::F32(to) => {
                for (group, list) in to.chunks_exact_mut(width).enumerate() {
                    for (k, slot) in list.iter_mut().enumerate() {
                        *slot = value(self.groups.of(group), k) as f32;
                    }
                }
            }
            _ => {
                return Err(Failure::internal(format!(
                    "column {name} is no list of numbers"
                )));
            }
        }
        Ok(())
    }

    /// The earliest localisation's value; of those in one frame, that of the first row.
    fn earliest(&self, out: &mut OutputObject<'_>, name: &str) -> Result<(), Failure> {
        let t = match self.table.header().column("t") {
            Some(_) => Some(self.table.f64("t")?),
            None => None,
        };
        let row = |rows: &[u32]| -> u32 {
            let time = |row: u32| t.as_ref().map_or(0.0, |t| t[row as usize]);
            let earlier = |best: u32, row: u32| if time(row) < time(best) { row } else { best };
            rows.iter().copied().reduce(earlier).unwrap_or(0)
        };
        let width = self
            .table
            .header()
            .column(name)
            .map_or(1, |c| c.type_.width as usize);
        macro_rules! copy {
            ($($kind:ident),*) => {
                match (self.table.column(0, name)?, out.column_mut(0, name)?) {
                    $((ColumnRef::$kind(from), ColumnMut::$kind(to)) => {
                        for (group, list) in to.chunks_exact_mut(width).enumerate() {
                            let row = row(self.groups.of(group)) as usize;
                            list.copy_from_slice(&from[row * width..(row + 1) * width]);
                        }
                    })*
                    _ => return Err(Failure::internal(format!("column {name} cannot be copied"))),
                }
            };
        }
        copy!(U8, I8, U16, I16, U32, I32, U64, I64, F32, F64, Bool);
        Ok(())
    }
}

fn first(rows: &[u32], values: &[f64]) -> f64 {
    rows.first().map_or(f64::NAN, |row| values[*row as usize])
}

puncta_sdk::register!(Merge);

#[cfg(test)]
mod tests;
