//! Real files of many programs, compared with what other programs say of them (`tests/expected`).
//! Files that are not there, or are other files of the same name, are skipped.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use puncta_engine::documents::{ColumnInfo, Element, Map, units};
use puncta_engine::store::ColumnData;
use puncta_engine::{Isolation, Object};
use puncta_tests::{Bundle, root, sha256, shared_data, unwatched};
use serde_json::{Value, json};
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::process::Command;

/// The lists of expected contents.
fn list(name: &str) -> Value {
    let text = std::fs::read_to_string(root().join("tests/expected").join(name)).unwrap();
    serde_json::from_str(&text).unwrap()
}

/// A file of a list, unpacked into `folder` where it is part of an archive; nothing where it is not
/// there, or is another file of that name.
fn found(data: &Path, file: &Value, folder: &Path) -> Option<PathBuf> {
    let mut path = data.join(file["file"].as_str().unwrap());
    if let Some(member) = file["member"].as_str() {
        let unzip = Command::new("unzip")
            .arg("-p")
            .arg(&path)
            .arg(member)
            .output();
        path = folder.join(member);
        std::fs::write(&path, unzip.ok().filter(|o| o.status.success())?.stdout).unwrap();
    }
    let bytes = std::fs::read(&path).ok()?;
    (sha256(&bytes) == file["sha256"].as_str().unwrap()).then_some(path)
}

/// The reader's options for a file: those of the list, then those of the test.
fn options_of(file: &Value, more: Map) -> Map {
    let mut options = file["options"].as_object().cloned().unwrap_or_default();
    options.extend(more);
    options
}

/// Compares every file of one list. Returns how many were there.
fn compare(name: &str, packages: &[&str], options: &dyn Fn(&str) -> Map) -> usize {
    let Some(data) = shared_data() else { return 0 };
    let expected = list(name);
    let folder = tempfile::tempdir().unwrap();
    let bundle = Bundle::of(packages);
    let engine = bundle.engine(Isolation::ByPlugin);
    let mut problems = Vec::new();
    let mut compared = 0;
    for file in expected["files"].as_array().unwrap() {
        let name = file["file"].as_str().unwrap();
        let Some(path) = found(&data, file, folder.path()) else {
            continue;
        };
        compared += 1;
        match engine.read(&path, None, &options_of(file, options(name)), &unwatched()) {
            Ok(read) => {
                for object in file["objects"].as_array().unwrap() {
                    let wanted = object["object"].as_str().unwrap();
                    match read.object(Some(wanted)) {
                        Ok(ours) => check_object(name, object, ours, &mut problems),
                        Err(failure) => problems.push(format!("{name}: {failure}")),
                    }
                }
            }
            Err(failure) => problems.push(format!("{name}: {failure}")),
        }
    }
    assert!(
        problems.is_empty(),
        "{} differences:\n{}",
        problems.len(),
        problems.join("\n")
    );
    compared
}

fn check_object(file: &str, expected: &Value, ours: &Object, problems: &mut Vec<String>) {
    let rows = expected["rows"].as_u64().unwrap();
    if ours.header().rows() != rows {
        problems.push(format!("{file}: {} rows, not {rows}", ours.header().rows()));
        return;
    }
    if let Some(size) = expected["size"].as_array() {
        let ours: Vec<Value> = ours.header().image.as_ref().map_or(Vec::new(), |image| {
            image.size.iter().map(|size| json!(size)).collect()
        });
        if &ours != size {
            problems.push(format!("{file}: the size is {ours:?}, not {size:?}"));
        }
    }
    for column in expected["columns"].as_array().unwrap() {
        // Some files have no names for their columns.
        let source = column["source"].as_str().unwrap_or_default();
        let infos = &ours.header().parts[0].columns;
        let found = infos.iter().find(|info| match column["name"].as_str() {
            Some(name) => info.name == name,
            None => info.source.as_deref().unwrap_or(&info.name) == source,
        });
        let Some(info) = found else {
            let names: Vec<&str> = infos.iter().map(|info| info.name.as_str()).collect();
            let place = column["name"].as_str().unwrap_or(source);
            problems.push(format!(
                "{file}: no column {place}, but {}",
                names.join(" ")
            ));
            continue;
        };
        let data = ours.column(0, &info.name).unwrap();
        if let Err(why) = check_column(column, info, &data) {
            problems.push(format!("{file}: column {}: {why}", info.name));
        }
    }
}

fn check_column(expected: &Value, info: &ColumnInfo, data: &ColumnData) -> Result<(), String> {
    if let Some(distinct) = expected.get("distinct").and_then(Value::as_u64) {
        let ours = distinct_values(data) as u64;
        return if ours == distinct {
            Ok(())
        } else {
            Err(format!("{ours} different values, not {distinct}"))
        };
    }
    let mut factor = 1.0;
    if let Some(unit) = expected["unit"].as_str() {
        factor = units::conversion(unit, &info.unit)
            .map_err(|_| format!("has the unit {}, not {unit}", info.unit))?;
        if expected["name"].is_string() && info.unit != unit {
            return Err(format!("has the unit {}, not {unit}", info.unit));
        }
    }
    let values = numbers(data).ok_or("holds texts, not numbers")?;
    let missing = values.iter().filter(|value| value.is_nan()).count() as u64;
    if Some(missing) != expected["nan"].as_u64() {
        return Err(format!(
            "{missing} values are missing, not {}",
            expected["nan"]
        ));
    }
    let there = || values.iter().copied().filter(|value| !value.is_nan());
    let sum_abs = expected["sum_abs"].as_f64().unwrap_or(0.0) * factor;
    // Sums in another order, and conversions that round each value, in both programs.
    let converted = expected["factor"].as_f64() != Some(1.0);
    let rounding = match info.type_.element {
        Element::F32 => 1.2e-7,
        _ if converted => 4.6e-16,
        _ => 2.3e-16,
    };
    let slack = sum_abs * (values.len() as f64 * 2.3e-16 + rounding);
    let pairs = [
        ("min", there().fold(f64::INFINITY, f64::min), f64::EPSILON),
        (
            "max",
            there().fold(f64::NEG_INFINITY, f64::max),
            f64::EPSILON,
        ),
        ("sum", there().sum(), 0.0),
    ];
    for (name, ours, relative) in pairs {
        let Some(theirs) = expected[name].as_f64().map(|value| value * factor) else {
            continue;
        };
        let allowed = if name == "sum" {
            slack
        } else {
            theirs.abs() * (relative + rounding)
        };
        if (ours - theirs).abs() > allowed {
            return Err(format!("{name} is {ours}, not {theirs}"));
        }
    }
    Ok(())
}

fn numbers(data: &ColumnData) -> Option<Vec<f64>> {
    let region = data.data.as_ref()?;
    macro_rules! all {
        ($type:ty) => {
            Some(
                region
                    .slice::<$type>()
                    .iter()
                    .map(|value| *value as f64)
                    .collect(),
            )
        };
    }
    match data.type_.element {
        Element::U8 | Element::Bool => all!(u8),
        Element::I8 => all!(i8),
        Element::U16 => all!(u16),
        Element::I16 => all!(i16),
        Element::U32 => all!(u32),
        Element::I32 => all!(i32),
        Element::U64 => all!(u64),
        Element::I64 => all!(i64),
        Element::F32 => all!(f32),
        Element::F64 => all!(f64),
        Element::Utf8 | Element::Dictionary => None,
    }
}

/// Texts that differ, or numbers where a column of words turned out to be numbers with gaps.
fn distinct_values(data: &ColumnData) -> usize {
    if let Some(values) = numbers(data) {
        let all: BTreeSet<u64> = values.iter().map(|value| value.to_bits()).collect();
        return all.len();
    }
    let (Some(offsets), Some(text)) = (&data.offsets, &data.text) else {
        return 0;
    };
    let text = text.slice::<u8>();
    let texts = offsets.slice::<u64>().windows(2);
    let all: BTreeSet<&[u8]> = texts
        .map(|pair| &text[pair[0] as usize..pair[1] as usize])
        .collect();
    all.len()
}

fn no_options(_file: &str) -> Map {
    Map::new()
}

fn all_compared(list: &str, compared: usize, least: usize) {
    if shared_data().is_some() {
        assert!(
            compared >= least,
            "only {compared} files of {list} were compared"
        );
    }
}

#[test]
fn thunderstorm() {
    let compared = compare("thunderstorm.json", &["puncta_plugin_text"], &no_options);
    all_compared("thunderstorm.json", compared, 6);
}

#[test]
fn named_columns() {
    // The list has the frames as they stand in the file.
    let raw = |_: &str| {
        json!({"frame_base": "zero"})
            .as_object()
            .cloned()
            .unwrap_or_default()
    };
    let compared = compare("named-text.json", &["puncta_plugin_text"], &raw);
    all_compared("named-text.json", compared, 10);
}

#[test]
fn pyme_text() {
    let compared = compare("pyme-text.json", &["puncta_plugin_text"], &no_options);
    all_compared("pyme-text.json", compared, 1);
}

#[test]
fn picasso() {
    let compared = compare("picasso.json", &["puncta_plugin_hdf5"], &no_options);
    all_compared("picasso.json", compared, 5);
}

#[test]
fn pyme_fit_results() {
    let compared = compare("h5r.json", &["puncta_plugin_hdf5"], &no_options);
    all_compared("h5r.json", compared, 1);
}

#[test]
fn matlab() {
    let compared = compare("matlab.json", &["puncta_plugin_matlab"], &no_options);
    all_compared("matlab.json", compared, 3);
}

#[test]
fn minflux() {
    let compared = compare("minflux.json", &["puncta_plugin_minflux"], &no_options);
    all_compared("minflux.json", compared, 4);
}

#[test]
fn smlm() {
    let compared = compare("smlm.json", &["puncta_plugin_smlm"], &no_options);
    all_compared("smlm.json", compared, 1);
}

#[test]
fn asdf() {
    let compared = compare("asdf.json", &["puncta_plugin_asdf"], &no_options);
    all_compared("asdf.json", compared, 4);
}

#[test]
fn insight3() {
    let compared = compare("insight3.json", &["puncta_plugin_insight3"], &no_options);
    all_compared("insight3.json", compared, 2);
}

#[test]
fn trackmate() {
    let compared = compare("trackmate.json", &["puncta_plugin_trackmate"], &no_options);
    all_compared("trackmate.json", compared, 2);
}

const READERS: [&str; 11] = [
    "puncta_plugin_arrow_io",
    "puncta_plugin_asdf",
    "puncta_plugin_hdf5",
    "puncta_plugin_image_io",
    "puncta_plugin_insight3",
    "puncta_plugin_matlab",
    "puncta_plugin_mesh_io",
    "puncta_plugin_minflux",
    "puncta_plugin_smlm",
    "puncta_plugin_text",
    "puncta_plugin_trackmate",
];

#[test]
fn text_of_other_programs() {
    let compared = compare("dialects.json", &["puncta_plugin_text"], &no_options);
    all_compared("dialects.json", compared, 20);
}

#[test]
fn hdf5_of_other_programs() {
    let compared = compare("hdf5-formats.json", &["puncta_plugin_hdf5"], &no_options);
    all_compared("hdf5-formats.json", compared, 7);
}

#[test]
fn images() {
    let compared = compare("images.json", &["puncta_plugin_image_io"], &no_options);
    all_compared("images.json", compared, 8);
}

const LISTS: [&str; 14] = [
    "asdf.json",
    "insight3.json",
    "matlab.json",
    "minflux.json",
    "smlm.json",
    "trackmate.json",
    "thunderstorm.json",
    "named-text.json",
    "pyme-text.json",
    "dialects.json",
    "picasso.json",
    "h5r.json",
    "hdf5-formats.json",
    "images.json",
];
const TABLE: &str = "docs/formats/README.md";

/// The table of formats: what every reader says that it reads, and the real files that it read.
/// `PUNCTA_UPDATE_DOCS=1` writes it.
#[test]
fn the_table_of_formats_is_what_was_read() {
    let Some(data) = shared_data() else { return };
    let folder = tempfile::tempdir().unwrap();
    let bundle = Bundle::of(&READERS);
    let engine = bundle.engine(Isolation::ByPlugin);
    let mut read: BTreeMap<(String, String), BTreeSet<String>> = BTreeMap::new();
    for name in LISTS {
        for file in list(name)["files"].as_array().unwrap() {
            let Some(path) = found(&data, file, folder.path()) else {
                return;
            };
            let options = options_of(file, Map::new());
            let shown = match file["member"].as_str() {
                Some(member) => format!("{} ({member})", file["file"].as_str().unwrap()),
                None => file["file"].as_str().unwrap().to_owned(),
            };
            let file = engine.read(&path, None, &options, &unwatched()).unwrap();
            read.entry((file.reader, file.format))
                .or_default()
                .insert(shown);
        }
    }
    let mut text = std::fs::read_to_string(root().join(TABLE)).unwrap_or_default();
    let (head, _) = text.split_once("<!-- table -->").unwrap_or((&text, ""));
    let mut table = format!(
        "{head}<!-- table -->\n| format | reader | suffixes | shown by |\n| --- | --- | --- | --- |\n"
    );
    for (_, operation) in engine.catalogue().operations() {
        let Some(rule) = operation.file.as_ref() else {
            continue;
        };
        if operation.kind != puncta_engine::documents::OperationKind::Reader {
            continue;
        }
        for format in &rule.formats {
            let files = read.remove(&(operation.id.clone(), format.clone()));
            let files = files.map_or("no real file; a fixture of the tests".to_owned(), |files| {
                let shown: Vec<String> = files.iter().take(3).map(|f| format!("`{f}`")).collect();
                let more = files.len().saturating_sub(3);
                let more = if more > 0 {
                    format!(" and {more} more")
                } else {
                    String::new()
                };
                format!("{}{more}", shown.join(", "))
            });
            let suffixes = rule.suffixes.join(" ");
            table.push_str(&format!(
                "| {format} | `{}` | {suffixes} | {files} |\n",
                operation.id
            ));
        }
    }
    assert!(
        read.is_empty(),
        "formats that no reader announces: {read:?}"
    );
    if std::env::var_os("PUNCTA_UPDATE_DOCS").is_some() {
        std::fs::write(root().join(TABLE), &table).unwrap();
        text.clone_from(&table);
    }
    assert_eq!(
        text, table,
        "set PUNCTA_UPDATE_DOCS=1 and run this test to write {TABLE}"
    );
}
