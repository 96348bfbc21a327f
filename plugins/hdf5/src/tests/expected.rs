//! The statistics that h5py and PyYAML give for real files, in `tests/expected`.

use std::path::{Path, PathBuf};
use std::process::Command;

use puncta_sdk::{ColumnInfo, Element};
use serde_json::Value;

use super::{call, numbers, output, shared};

fn check(name: &str) {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../../tests/expected")
        .join(name);
    let document: Value = serde_json::from_str(&std::fs::read_to_string(root).unwrap()).unwrap();
    for file in document["files"].as_array().unwrap() {
        let file_name = file["file"].as_str().unwrap();
        let Some(path) = shared(file_name) else {
            return;
        };
        let folder = tempfile::tempdir().unwrap();
        let path = match file["member"].as_str() {
            Some(member) => match unpacked(&path, member, folder.path()) {
                Some(path) => path,
                None => continue,
            },
            None => path,
        };
        let done = call(&path).run().unwrap();
        for object in file["objects"].as_array().unwrap() {
            let table = output(&done, object["object"].as_str().unwrap());
            assert_eq!(table.header.rows(), object["rows"].as_u64().unwrap());
            for column in object["columns"].as_array().unwrap() {
                let name = column["name"]
                    .as_str()
                    .or(column["source"].as_str())
                    .unwrap();
                let info = table.header.column(name).expect(name);
                let what = format!("{file_name}, {name}");
                if column["type"] == "text" {
                    let mut texts = table.texts(name).unwrap();
                    texts.sort();
                    texts.dedup();
                    assert_eq!(
                        texts.len() as u64,
                        column["distinct"].as_u64().unwrap(),
                        "{what}"
                    );
                } else {
                    compare(column, info, &numbers(&table, name), &what);
                }
            }
        }
    }
}

/// A file of a zip archive, where the system can unpack it.
fn unpacked(archive: &Path, member: &str, folder: &Path) -> Option<PathBuf> {
    let output = Command::new("unzip")
        .arg("-p")
        .arg(archive)
        .arg(member)
        .output()
        .ok()?;
    let path = folder.join(member);
    std::fs::write(&path, output.stdout).ok()?;
    output.status.success().then_some(path)
}

fn compare(column: &Value, info: &ColumnInfo, values: &[f64], what: &str) {
    if let Some(source) = column["source"].as_str() {
        assert_eq!(info.source.as_deref(), Some(source), "{what}");
    }
    if let Some(unit) = column["unit"].as_str() {
        assert_eq!(info.unit, unit, "{what}");
    }
    let converted = column["factor"].as_f64() != Some(1.0)
        || info.role.as_deref() == Some("position")
        || info.role.as_deref() == Some("error");
    let stored = column["type"].as_str().and_then(Element::from_name);
    let wanted = if converted {
        Some(Element::F64)
    } else {
        stored
    };
    // The list has no type where a format's own types say little.
    if column["type"] != "number" {
        assert_eq!(Some(info.type_.element), wanted, "{what}");
    }
    let there: Vec<f64> = values
        .iter()
        .copied()
        .filter(|value| !value.is_nan())
        .collect();
    let number = |key: &str| column[key].as_f64().unwrap();
    assert_eq!((values.len() - there.len()) as f64, number("nan"), "{what}");
    if there.is_empty() {
        return;
    }
    assert_eq!(
        there.iter().copied().fold(f64::INFINITY, f64::min),
        number("min"),
        "{what}"
    );
    assert_eq!(
        there.iter().copied().fold(f64::NEG_INFINITY, f64::max),
        number("max"),
        "{what}"
    );
    let allowed = there.len() as f64 * f64::EPSILON / 2.0 * number("sum_abs");
    let sum: f64 = there.iter().sum();
    assert!((sum - number("sum")).abs() <= allowed, "{what}: {sum}");
}

#[test]
fn picasso_as_h5py_reads_it() {
    check("picasso.json");
}

#[test]
fn pyme_as_h5py_reads_it() {
    check("h5r.json");
}

#[test]
fn other_programs_as_h5py_reads_them() {
    check("hdf5-formats.json");
}
