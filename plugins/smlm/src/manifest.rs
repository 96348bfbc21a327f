//! The manifest: which tables there are, and how their rows are stored.

use puncta_sdk::serde_json::{self, Value};
use puncta_sdk::{ColumnInfo, Failure};
use puncta_shared_import::Mapping;
use puncta_shared_records::names::{self, Raw};
use puncta_shared_records::{Field, Number, damaged, unsupported};

/// Most columns of a table.
const MOST_COLUMNS: usize = 4096;
/// Most values of a row and column.
const MOST_VALUES: u64 = 4096;

/// A table of the archive.
#[derive(Debug)]
pub struct File {
    /// Member of the archive.
    pub name: String,
    /// Its channel.
    pub channel: String,
    /// Rows it announces.
    pub rows: u64,
    /// Added to the values of each column of the format.
    pub offsets: Vec<f64>,
    format: String,
}

/// How rows are stored.
#[derive(Debug)]
pub struct Format {
    /// Bytes of a row.
    pub record: usize,
    /// Columns.
    pub columns: Vec<Stored>,
}

/// A column of a format.
#[derive(Clone, Debug)]
pub struct Stored {
    header: String,
    number: Number,
    at: usize,
    values: usize,
    unit: Option<String>,
}

/// The manifest.
#[derive(Debug)]
pub struct Manifest {
    /// The tables of one format.
    pub files: Vec<File>,
    /// Their format.
    pub format: Format,
    /// All that the manifest says besides.
    pub rest: Value,
    /// For the person.
    pub notes: Vec<String>,
}

/// Numbers stand in the manifest as such or as texts.
fn whole(value: &Value) -> Option<u64> {
    match value {
        Value::String(text) => text.trim().parse().ok(),
        Value::Number(number) => {
            let float = number
                .as_f64()
                .filter(|v| v.fract() == 0.0 && (0.0..9e15).contains(v));
            #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
            number.as_u64().or(float.map(|v| v as u64))
        }
        _ => None,
    }
}

fn text(value: Option<&Value>) -> String {
    value.and_then(Value::as_str).unwrap_or("").to_owned()
}

/// Reads a manifest.
pub fn parse(name: &str, bytes: &[u8]) -> Result<Manifest, Failure> {
    let broken = |what: &str| damaged(format!("the manifest of {name} {what}"));
    let mut tree: Value = serde_json::from_slice(bytes)
        .map_err(|error| broken(&format!("is no JSON (line {})", error.line())))?;
    let all = tree.get("files").and_then(Value::as_array);
    let all = all.ok_or_else(|| broken("lists no files"))?;
    let mut files: Vec<File> = Vec::new();
    let (mut left, mut others) = (Vec::new(), 0);
    for file in all {
        let inner = text(file.get("name"));
        if file.get("type").and_then(Value::as_str) != Some("table") {
            others += 1;
            continue;
        }
        let format = text(file.get("format"));
        if files.first().is_some_and(|first| first.format != format) {
            left.push(inner);
            continue;
        }
        let rows = file.get("rows").and_then(whole);
        files.push(File {
            rows: rows.ok_or_else(|| broken(&format!("does not say the rows of {inner}")))?,
            channel: text(file.get("channel")),
            offsets: Vec::new(),
            name: inner,
            format,
        });
    }
    let Some(first) = files.first() else {
        let message = format!("{name} holds no table");
        return Err(unsupported(message, "export it with its localisations"));
    };
    let described = tree
        .get("formats")
        .and_then(|formats| formats.get(&first.format));
    let described =
        described.ok_or_else(|| broken(&format!("does not describe {}", first.format)))?;
    let format = format(name, described)?;
    let tables = all.iter().filter(|file| {
        files
            .iter()
            .any(|known| Some(known.name.as_str()) == file.get("name").and_then(Value::as_str))
    });
    let offsets: Vec<Vec<f64>> = tables.map(|file| offsets(file, &format)).collect();
    for (file, offsets) in files.iter_mut().zip(offsets) {
        file.offsets = offsets;
    }
    let mut notes = Vec::new();
    if !left.is_empty() {
        let list = left.join(", ");
        notes.push(format!(
            "Left out of {name}, as their columns differ from the first table: {list}."
        ));
    }
    if others > 0 {
        notes.push(format!(
            "{others} files in {name} that are no tables were left out."
        ));
    }
    if let Some(members) = tree.as_object_mut() {
        members.remove("thumbnail");
    }
    Ok(Manifest {
        files,
        format,
        rest: tree,
        notes,
    })
}

fn offsets(file: &Value, format: &Format) -> Vec<f64> {
    let known = file.get("offset");
    let one = |column: &Stored| known?.get(&column.header)?.as_f64();
    format
        .columns
        .iter()
        .map(|column| one(column).unwrap_or(0.0))
        .collect()
}

fn format(name: &str, described: &Value) -> Result<Format, Failure> {
    let broken = |what: &str| damaged(format!("the manifest of {name} {what}"));
    if described.get("mode").and_then(Value::as_str) != Some("binary") {
        let message = format!("{name} holds a table that is not binary");
        return Err(unsupported(message, "export it as binary or as csv"));
    }
    let list = |key: &str| {
        let list = described.get(key).and_then(Value::as_array);
        list.ok_or_else(|| broken(&format!("has a format without {key}")))
    };
    let (headers, types) = (list("headers")?, list("dtype")?);
    let count = described
        .get("columns")
        .and_then(whole)
        .unwrap_or(headers.len() as u64);
    if count != headers.len() as u64 || types.len() != headers.len() || headers.len() > MOST_COLUMNS
    {
        return Err(broken(
            "announces another number of columns than it describes",
        ));
    }
    let (shapes, units) = (list("shape").ok(), list("units").ok());
    let (mut columns, mut at) = (Vec::new(), 0_usize);
    for (i, (header, type_)) in headers.iter().zip(types).enumerate() {
        let type_ = type_.as_str().unwrap_or("");
        let number = Number::from_name(type_)
            .ok_or_else(|| broken(&format!("names the unknown type \"{type_}\"")))?;
        let values = shapes
            .and_then(|shapes| shapes.get(i))
            .map_or(Some(1), values);
        let values = values.filter(|values| (1..=MOST_VALUES).contains(values));
        let values = values.ok_or_else(|| broken("has a column of an impossible shape"))?;
        let values = usize::try_from(values).unwrap_or(1);
        let unit = units.and_then(|units| units.get(i)).and_then(Value::as_str);
        columns.push(Stored {
            header: header.as_str().unwrap_or("").to_owned(),
            number,
            at,
            values,
            unit: unit.map(str::to_owned),
        });
        at += values * number.bytes();
    }
    if columns.is_empty() {
        return Err(broken("has a format without columns"));
    }
    Ok(Format {
        record: at,
        columns,
    })
}

/// Values of a row: a number, or the product of a list.
fn values(shape: &Value) -> Option<u64> {
    match shape {
        Value::Array(sizes) => sizes
            .iter()
            .try_fold(1_u64, |all, size| all.checked_mul(whole(size)?)),
        one => whole(one),
    }
}

impl Manifest {
    /// The unit that locan's part of the manifest states.
    fn property(&self, header: &str) -> Option<&str> {
        let units = self.rest.get("locdata_meta")?.get("unit")?.as_array()?;
        let said = |unit: &&Value| unit.get("property").and_then(Value::as_str) == Some(header);
        units.iter().find(said)?.get("unit")?.as_str()
    }

    /// The columns, with the offsets of a file of the archive `name`, and notes.
    ///
    /// # Errors
    /// A mapping that speaks of columns that are not there.
    pub fn fields(
        &self,
        name: &str,
        file: &File,
        mapping: &Mapping,
    ) -> Result<(Vec<Field>, Vec<String>), Failure> {
        let (mut raw, mut fields) = (Vec::new(), Vec::new());
        let shifted: Vec<bool> = (0..self.format.columns.len())
            .map(|i| {
                self.files
                    .iter()
                    .any(|one| one.offsets.get(i).is_some_and(|o| *o != 0.0))
            })
            .collect();
        for (i, column) in self.format.columns.iter().enumerate() {
            let stated = column
                .unit
                .as_deref()
                .filter(|unit| !unit.trim().is_empty());
            let stated = stated.or(self.property(&column.header));
            let float = matches!(column.number, Number::F32 | Number::F64);
            let (lists, places) = match (column.values, float) {
                (1, _) => (1, 1),
                (values, true) => (values, 1),
                (values, false) => (1, values.min(64)),
            };
            for place in 0..places {
                let label = match places {
                    1 => column.header.clone(),
                    _ => format!("{}_{place}", column.header),
                };
                let element = column.number.element();
                let mut info = ColumnInfo::new(&label, element, "");
                info.type_.width = u32::try_from(lists).unwrap_or(1);
                let at = column.at + place * column.number.bytes();
                let mut field = Field::new(info, column.number.little(), at);
                if shifted[i] {
                    field = field.scaled(1.0);
                    field.shift = file.offsets.get(i).copied().unwrap_or(0.0);
                }
                raw.push(Raw::named(&label, element, stated));
                fields.push(field);
            }
        }
        names::fields(name, mapping, &raw, &fields)
    }
}
