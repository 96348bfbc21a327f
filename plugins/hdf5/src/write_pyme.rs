//! The writer of PYME's saved tables, `.hdf`.

use std::path::Path;

use hdf5::{File, Group};
use puncta_sdk::documents::call::Read;
use puncta_sdk::prelude::*;
use serde_json::{Map, Value, json};

use crate::write_records::{Field, Stored, create, failed, text, write};

/// Name of the table that PYME's menu writes.
const TABLE: &str = "Localizations";
/// Attribute with units, roles and metadata, for an exact way back.
pub(crate) const HEADER: &str = "puncta_header";
/// HDF5 keeps attributes of up to 64 KiB in the object itself.
const MOST_HEADER: usize = 60_000;

/// Writes a table as PYME's `.hdf`.
#[derive(Debug, Params)]
pub struct WritePyme {}

impl Operation for WritePyme {
    const ID: &'static str = "puncta.hdf5.pyme.write/1";

    fn info() -> Info {
        Info::writer("PYME table", &[".hdf"])
            .description(
                "Writes a table as PYME saves it: /Localizations, which PyTables and h5py read as \
                 records, and the metadata as attributes of groups below /MetaData. Units, roles \
                 and metadata are kept, so that reading gives the same table again.",
            )
            .input(Ports::table("table").description("All columns are written."))
            .cite("10.1038/s41592-021-01165-9")
            .example(json!({}))
            .example_input("table", "puncta.synthetic.membrane/1", json!({}))
    }

    fn prepare(&self, request: &Request) -> Result<Plan, Failure> {
        plan(request)
    }

    fn run(&self, job: &Job) -> Result<(), Failure> {
        let path = Path::new(&job.file()?.path);
        let input = job.input("table")?;
        let header = input.header();
        let infos = header.parts.first().map_or(&[][..], |part| &part.columns);
        let mut fields = Vec::new();
        let mut left_out = Vec::new();
        for info in infos {
            let values = input.column(0, &info.name)?;
            if Field::fits(values) && info.type_.width == 1 {
                fields.push(Field::new(&info.name, values, Stored::Same, 1.0));
            } else {
                left_out.push(info.name.as_str());
            }
        }
        warn_left_out(job, &left_out);
        let file = create(path)?;
        pytables_group(&file, "")?;
        text(&file, "PYTABLES_FORMAT_VERSION", "2.1")?;
        let dataset = write(&file, TABLE, &fields, input.rows(), job)?;
        text(&dataset, "CLASS", "TABLE")?;
        text(&dataset, "VERSION", "2.7")?;
        text(&dataset, "TITLE", "")?;
        for (k, field) in fields.iter().enumerate() {
            text(&dataset, &format!("FIELD_{k}_NAME"), &field.name)?;
        }
        let document = serde_json::to_string(header).unwrap_or_default();
        if document.len() <= MOST_HEADER && document.is_ascii() {
            text(&dataset, HEADER, &document)?;
        }
        let tree = header.metadata.get("pyme").and_then(Value::as_object);
        let tree = tree.unwrap_or(&header.metadata);
        metadata(&file, tree)?;
        file.close().map_err(|e| failed("the file", &e))
    }
}

/// The plan of a writer of all columns of a table.
pub(crate) fn plan(request: &Request) -> Result<Plan, Failure> {
    let input = request.inputs.first();
    let input = input.ok_or_else(|| Failure::bad_input("there is no table to write"))?;
    let part = input.header.parts.first();
    let columns: Vec<String> = part
        .into_iter()
        .flat_map(|part| &part.columns)
        .map(|column| column.name.clone())
        .collect();
    if columns.is_empty() {
        return Err(Failure::bad_input(
            "a table without columns cannot be written",
        ));
    }
    let mut plan = Plan {
        memory: 64 << 20,
        ..Plan::default()
    };
    plan.read.push(Read {
        input: 0,
        part: 0,
        columns,
    });
    Ok(plan)
}

/// Says which columns have no place in the file.
pub(crate) fn warn_left_out(job: &Job, names: &[&str]) {
    if !names.is_empty() {
        job.warn(&format!(
            "The file's records hold plain numbers and texts; left out: {}.",
            names.join(", ")
        ));
    }
}

fn pytables_group(group: &Group, title: &str) -> Result<(), Failure> {
    text(group, "CLASS", "GROUP")?;
    text(group, "VERSION", "1.0")?;
    text(group, "TITLE", title)
}

/// The metadata as PYME keeps them: an entry `A.B.c` is the attribute `c` of `/MetaData/A/B`.
fn metadata(file: &File, tree: &Map<String, Value>) -> Result<(), Failure> {
    let root = file
        .create_group("MetaData")
        .map_err(|e| failed("MetaData", &e))?;
    branch(&root, tree, 0)
}

fn branch(group: &Group, tree: &Map<String, Value>, depth: usize) -> Result<(), Failure> {
    pytables_group(group, "")?;
    for (name, value) in tree {
        let usable = |c: char| c.is_ascii_alphanumeric() || c == '_';
        if name.is_empty()
            || !name.chars().all(usable)
            || ["CLASS", "TITLE", "VERSION"].contains(&name.as_str())
        {
            continue;
        }
        match value {
            Value::Object(below) if depth < 8 => {
                let below_group = group.create_group(name).map_err(|e| failed(name, &e))?;
                branch(&below_group, below, depth + 1)?;
            }
            value => attribute(group, name, value)?,
        }
    }
    Ok(())
}

fn attribute(group: &Group, name: &str, value: &Value) -> Result<(), Failure> {
    let made = |result: hdf5::Result<()>| result.map_err(|e| failed(name, &e));
    match value {
        Value::Bool(value) => made(
            group
                .new_attr::<u8>()
                .create(name)
                .and_then(|a| a.write_scalar(&u8::from(*value))),
        ),
        Value::Number(number) => match (number.as_i64(), number.as_f64()) {
            (Some(value), _) => made(
                group
                    .new_attr::<i64>()
                    .create(name)
                    .and_then(|a| a.write_scalar(&value)),
            ),
            (_, Some(value)) => made(
                group
                    .new_attr::<f64>()
                    .create(name)
                    .and_then(|a| a.write_scalar(&value)),
            ),
            _ => Ok(()),
        },
        Value::String(value) if value.is_ascii() && value.len() < MOST_HEADER => {
            text(group, name, value)
        }
        // Lists are pickles in PYME's own files; numbers keep their list, all else its JSON.
        Value::Array(values) => {
            let numbers: Option<Vec<f64>> = values.iter().map(Value::as_f64).collect();
            match numbers.filter(|n| !n.is_empty() && n.len() < 4096) {
                Some(numbers) => made(
                    group
                        .new_attr::<f64>()
                        .shape(numbers.len())
                        .create(name)
                        .and_then(|a| a.write(&numbers)),
                ),
                None => json_text(group, name, value),
            }
        }
        Value::Null => Ok(()),
        value => json_text(group, name, value),
    }
}

fn json_text(group: &Group, name: &str, value: &Value) -> Result<(), Failure> {
    let document = value.to_string();
    match document.is_ascii() && document.len() < MOST_HEADER {
        true => text(group, name, &document),
        false => Ok(()),
    }
}

register!(WritePyme);
