//! The writer as an operation.

use crate::options::Delimiter;
use crate::reader::Separator;
use crate::schema::TYPES;
use crate::write::{self, Column};
use puncta_sdk::documents::call::Read;
use puncta_sdk::input::ColumnRef;
use puncta_sdk::prelude::*;
use puncta_sdk::serde_json::json;
use puncta_shared_import::{UNKNOWN, names};
use std::path::Path;

/// Writes a table as text.
#[derive(Debug, Params)]
pub struct WriteText {
    /// Whose files the names and units follow.
    #[param(default = Style::Plain)]
    style: Style,
    /// What stands between values.
    #[param(default = Separator::Auto)]
    delimiter: Separator,
}

/// Whose files the names and units follow.
#[derive(Choice, Clone, Copy, Debug, PartialEq, Eq)]
pub enum Style {
    /// A header of `name [unit]`, which any program opens.
    Plain,
    /// The same behind a line with the type of each column, so that all types come back.
    Typed,
    /// ThunderSTORM's names in quotes, frames from 1.
    Thunderstorm,
    /// PYME's names behind `#`, without units.
    Pyme,
}

impl Operation for WriteText {
    const ID: &'static str = "puncta.text.write/1";

    fn info() -> Info {
        Info::writer("Text tables", &[".csv", ".tsv", ".txt"])
            .description(
                "Writes a table as text with a header of names and units. Numbers have the fewest \
                 digits that give the same number again; missing values are nan.",
            )
            .input(Ports::table("table").description("All columns are written."))
            .example(json!({}))
            .example_input("table", "puncta.synthetic.membrane/1", json!({}))
    }

    fn prepare(&self, request: &Request) -> Result<Plan, Failure> {
        let input = request.inputs.first();
        let input = input.ok_or_else(|| Failure::bad_input("there is no table to write"))?;
        let names = input.header.parts.first().map(|part| &part.columns);
        let columns: Vec<String> = names
            .into_iter()
            .flatten()
            .map(|c| c.name.clone())
            .collect();
        if columns.is_empty() {
            return Err(Failure::bad_input(
                "a table without columns cannot be written as text",
            ));
        }
        let mut plan = Plan {
            interruptible: true,
            memory: 32 << 20,
            ..Plan::default()
        };
        plan.read.push(Read {
            input: 0,
            part: 0,
            columns,
        });
        Ok(plan)
    }

    fn run(&self, job: &Job) -> Result<(), Failure> {
        let file = job.file()?;
        let path = Path::new(&file.path);
        let delimiter = self.delimiter.delimiter().unwrap_or(by_suffix(&file.name));
        let delimiter = write::byte(delimiter);
        let input = job.input("table")?;
        let infos = input
            .header()
            .parts
            .first()
            .map_or(&[][..], |part| &part.columns);
        let mut columns = Vec::new();
        for info in infos {
            columns.extend(self.columns(info, input.column(0, &info.name)?, job));
        }
        if self.style == Style::Thunderstorm {
            drop_equal_error(&mut columns);
        }
        let head = self.head(infos, &columns, delimiter);
        let mut out = std::fs::File::create(path).map_err(|e| Failure::io("write", path, &e))?;
        write::write(&mut out, &head, &columns, input.rows(), delimiter, job)
            .map_err(|error| error.failure(path))
    }
}

fn by_suffix(name: &str) -> Delimiter {
    let lower = name.to_lowercase();
    let tab = [".tsv", ".txt", ".xls"]
        .iter()
        .any(|suffix| lower.ends_with(suffix));
    Delimiter::Byte(if tab { b'\t' } else { b',' })
}

impl WriteText {
    /// The columns of the file for one of the table: several for lists.
    fn columns<'a>(&self, info: &ColumnInfo, values: ColumnRef<'a>, job: &Job) -> Vec<Column<'a>> {
        let frames = info.name == "t" && info.unit == "frame";
        let base = i32::from(self.style == Style::Thunderstorm && frames);
        let width = info.type_.width as usize;
        if info.type_.element.is_text() && self.style == Style::Pyme {
            let name = &info.name;
            job.warn(&format!(
                "PYME's text files hold numbers only; column {name} is left out"
            ));
            return Vec::new();
        }
        let column = |part: usize| {
            let name = if width == 1 {
                self.name(&info.name, &info.unit)
            } else {
                self.name(&format!("{}_{part}", info.name), &info.unit)
            };
            Column {
                name,
                values,
                width,
                part,
                base,
            }
        };
        (0..width).map(column).collect()
    }

    /// A name as the style writes it.
    fn name(&self, name: &str, unit: &str) -> String {
        // Whether the reader takes the bare name for a column of unknown unit.
        let clear = names::split_unit(name).1.is_none() && !names::labels(name);
        match self.style {
            Style::Pyme => name.to_owned(),
            Style::Thunderstorm => thunderstorm(name, unit),
            Style::Plain if unit == UNKNOWN && clear => name.to_owned(),
            Style::Plain | Style::Typed => format!("{name} [{unit}]"),
        }
    }

    /// The lines above the values.
    fn head(&self, infos: &[ColumnInfo], columns: &[Column<'_>], delimiter: u8) -> String {
        let mut head = Vec::new();
        match self.style {
            Style::Typed => head.extend_from_slice(types(infos).as_bytes()),
            Style::Pyme => head.push(b'#'),
            Style::Plain | Style::Thunderstorm => {}
        }
        for (i, column) in columns.iter().enumerate() {
            if i > 0 {
                head.push(delimiter);
            }
            if self.style == Style::Thunderstorm {
                let label = column.name.replace('"', "\"\"");
                head.extend_from_slice(format!("\"{label}\"").as_bytes());
            } else {
                write::quote(&mut head, &column.name, delimiter);
            }
        }
        head.push(b'\n');
        String::from_utf8_lossy(&head).into_owned()
    }
}

/// The line with the type of each column.
fn types(infos: &[ColumnInfo]) -> String {
    let names = infos.iter().flat_map(|info| {
        let element = info.type_.element;
        let element = if element.is_text() {
            Element::Utf8
        } else {
            element
        };
        std::iter::repeat_n(element.name(), info.type_.width as usize)
    });
    format!("#{TYPES}{}\n", names.collect::<Vec<_>>().join(","))
}

fn thunderstorm(name: &str, unit: &str) -> String {
    let name = match name {
        "t" => return "frame".to_owned(),
        "sig" => "sigma",
        "sigx" => "sigma1",
        "sigy" => "sigma2",
        "nPhotons" => "intensity",
        "background" => "offset",
        "error_x" => "uncertainty_xy",
        "error_z" => "uncertainty_z",
        other => other,
    };
    if unit == UNKNOWN || unit == "1" {
        name.to_owned()
    } else {
        format!("{name} [{unit}]")
    }
}

/// ThunderSTORM has one lateral uncertainty: a y error that equals that of x is left out.
fn drop_equal_error(columns: &mut Vec<Column<'_>>) {
    let place = |name: &str| columns.iter().position(|c| c.name == name);
    let (x, y) = (place("uncertainty_xy [nm]"), place("error_y [nm]"));
    let values = |i: Option<usize>| Some(columns.get(i?)?.values);
    let (Some(ColumnRef::F64(a)), Some(ColumnRef::F64(b)), Some(y)) = (values(x), values(y), y)
    else {
        return;
    };
    if a.len() == b.len() && a.iter().zip(b).all(|(a, b)| a.to_bits() == b.to_bits()) {
        columns.remove(y);
    }
}

register!(WriteText);
