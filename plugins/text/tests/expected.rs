//! Real files against what other programs read in them (`tests/expected`).

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use puncta_plugin_text::reader::ReadText;
use puncta_testkit::{Call, Object};
use serde_json::Value;
use std::path::{Path, PathBuf};

fn workspace() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

/// The numbers of a column, whatever its type.
fn numbers(table: &Object, name: &str) -> Vec<f64> {
    if let Ok(values) = table.f64(name) {
        return values;
    }
    if let Ok(values) = table.i32(name) {
        return values.into_iter().map(f64::from).collect();
    }
    table
        .i64(name)
        .unwrap()
        .into_iter()
        .map(|v| v as f64)
        .collect()
}

fn check_numbers(place: &str, expected: &Value, mut values: Vec<f64>) {
    let number = |name: &str| expected[name].as_f64().unwrap();
    let all = values.len();
    values.retain(|v| !v.is_nan());
    assert_eq!(
        (all - values.len()) as f64,
        number("nan"),
        "{place}: missing"
    );
    let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
    let (mut sum, mut size) = (0.0, 0.0);
    for v in &values {
        low = low.min(*v);
        high = high.max(*v);
        sum += v;
        size += v.abs();
    }
    let (min, max) = (number("min"), number("max"));
    if number("factor") == 1.0 {
        assert_eq!((low, high), (min, max), "{place}: range");
    } else {
        // The other program multiplies a rounded number.
        let near = |a: f64, b: f64| (a - b).abs() <= 2.0 * f64::EPSILON * b.abs();
        assert!(
            near(low, min) && near(high, max),
            "{place}: {low}..{high}, not {min}..{max}"
        );
    }
    let most = 3.0 * all as f64 * f64::EPSILON * number("sum_abs") + f64::MIN_POSITIVE;
    assert!((sum - number("sum")).abs() <= most, "{place}: sum {sum}");
    assert!(
        (size - number("sum_abs")).abs() <= most,
        "{place}: sum of magnitudes {size}"
    );
}

fn check_column(file: &str, table: &Object, expected: &Value) {
    // Some programs have no names for their columns.
    let source = expected["source"].as_str();
    let place = format!("{file}, {}", source.or(expected["name"].as_str()).unwrap());
    let columns = &table.header.parts[0].columns;
    let found = match expected["name"].as_str() {
        Some(name) => columns.iter().find(|c| c.name == name),
        None => columns
            .iter()
            .find(|c| c.source.as_deref().map(str::trim) == source.map(str::trim)),
    };
    let column = found.unwrap_or_else(|| panic!("{place}: not among {columns:?}"));
    if let Some(source) = source {
        assert_eq!(
            column.source.as_deref().map(str::trim),
            Some(source.trim()),
            "{place}: source"
        );
    }
    if let Some(unit) = expected["unit"].as_str() {
        assert_eq!(column.unit, unit, "{place}: unit");
    }
    if expected["type"] == "text" {
        // Numbers among which the word None stands for a missing one are numbers here.
        let texts = table.texts(&column.name).unwrap_or_else(|_| {
            numbers(table, &column.name)
                .iter()
                .map(f64::to_string)
                .collect()
        });
        let distinct: std::collections::BTreeSet<_> = texts.into_iter().collect();
        assert_eq!(
            distinct.len() as u64,
            expected["distinct"].as_u64().unwrap(),
            "{place}"
        );
    } else {
        check_numbers(&place, expected, numbers(table, &column.name));
    }
}

fn check(list: &str, frames_as_they_stand: bool) {
    let expected = std::fs::read_to_string(workspace().join("tests/expected").join(list)).unwrap();
    let expected: Value = serde_json::from_str(&expected).unwrap();
    for file in expected["files"].as_array().unwrap() {
        let name = file["file"].as_str().unwrap();
        let path = workspace().join("../shared/data").join(name);
        // The data are no part of the repository.
        if !path.exists() {
            continue;
        }
        let mut call = Call::of::<ReadText>().file(&path);
        for (option, value) in file["options"].as_object().into_iter().flatten() {
            call = call.set(option, value.clone());
        }
        if frames_as_they_stand {
            call = call.set("frame_base", "zero");
        }
        let done = call.run().unwrap_or_else(|e| panic!("{name}: {e}"));
        let table = done.output("localisations").unwrap();
        let object = &file["objects"][0];
        assert_eq!(
            table.header.rows(),
            object["rows"].as_u64().unwrap(),
            "{name}: rows"
        );
        let columns = object["columns"].as_array().unwrap();
        columns
            .iter()
            .for_each(|column| check_column(name, table, column));
    }
}

#[test]
fn thunderstorm_files_hold_what_pandas_reads() {
    check("thunderstorm.json", false);
}

#[test]
fn named_columns_hold_what_pandas_reads() {
    check("named-text.json", true);
}

#[test]
fn pyme_text_holds_what_pandas_reads() {
    check("pyme-text.json", false);
}

#[test]
fn tables_of_other_programs_hold_what_pandas_reads() {
    check("dialects.json", false);
}
