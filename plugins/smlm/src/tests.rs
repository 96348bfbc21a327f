//! Containers of one and of several tables, and damaged ones.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use crate::ReadSmlm;
use puncta_sdk::{Failure, FailureCode};
use puncta_testkit::{Call, Done, damage};
use std::io::{Cursor, Write};
use std::path::Path;
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, ZipWriter};

const ONE: &[u8] = include_bytes!("../data/example.smlm");
const TWO: &[u8] = include_bytes!("../data/two.smlm");

fn open(bytes: &[u8]) -> Result<Done, Failure> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.smlm");
    std::fs::write(&path, bytes).unwrap();
    Call::of::<ReadSmlm>().file(&path).run()
}

#[test]
fn offsets_and_units_apply() {
    let done = open(ONE).unwrap();
    let out = done.output("localisations").unwrap();
    assert_eq!(out.f64("x").unwrap(), [2500.0, 3500.0]);
    assert_eq!(out.f64("y").unwrap(), [20.0, 30.0]);
    assert_eq!(out.u32("t").unwrap(), [0, 1]);
    assert_eq!(out.bytes("quality").unwrap(), [7, 8]);
    assert_eq!(out.header.column("x").unwrap().unit, "nm");
    assert_eq!(out.header.metadata["smlm"]["name"], "example");
}

#[test]
fn tables_of_the_same_columns_become_one() {
    let done = open(TWO).unwrap();
    let out = done.output("localisations").unwrap();
    assert_eq!(out.f64("x").unwrap(), [1500.0, 2500.0, 10_500.0]);
    assert_eq!(out.f64("y").unwrap(), [20.0, 30.0, 1.0]);
    assert_eq!(out.u16("probe").unwrap(), [0, 0, 1]);
    assert_eq!(out.header.metadata["channels"][1], "green");
}

/// A container with this manifest and a table of two rows.
fn pack(manifest: &str) -> Vec<u8> {
    let mut zip = ZipWriter::new(Cursor::new(Vec::new()));
    let options = SimpleFileOptions::default().compression_method(CompressionMethod::Stored);
    for (name, bytes) in [("manifest.json", manifest.as_bytes()), ("a.bin", &[0; 26])] {
        zip.start_file(name, options).unwrap();
        zip.write_all(bytes).unwrap();
    }
    zip.finish().unwrap().into_inner()
}

const MANIFEST: &str = r#"{"formats": {"t": {"mode": "binary", "columns": 4,
    "headers": ["frame", "x", "y", "quality"], "dtype": ["uint32", "float32", "float32", "uint8"],
    "shape": [1, 1, 1, 1]}},
    "files": [{"name": "a.bin", "type": "table", "format": "t", "rows": "2"}]}"#;

#[test]
fn lies_are_refused() {
    assert_eq!(
        open(&pack(MANIFEST))
            .unwrap()
            .output("localisations")
            .unwrap()
            .header
            .rows(),
        2
    );
    for (from, to) in [
        ("\"rows\": \"2\"", "\"rows\": \"9\""),
        ("\"rows\": \"2\"", "\"rows\": 99999999999999999999"),
        ("\"rows\": \"2\"", "\"rows\": -1"),
        ("\"columns\": 4", "\"columns\": 5"),
        ("\"uint32\"", "\"uint99\""),
        ("\"binary\"", "\"text\""),
        ("[1, 1, 1, 1]", "[1, 0, 1, 1]"),
        ("[1, 1, 1, 1]", "[1, [99999999999, 99999999999], 1, 1]"),
        ("\"a.bin\"", "\"b.bin\""),
        ("\"format\": \"t\"", "\"format\": \"u\""),
        ("\"table\"", "\"image\""),
        (
            "{\"formats\"",
            &format!("{}{{\"formats\"", "[".repeat(100_000)),
        ),
    ] {
        let failure = open(&pack(&MANIFEST.replace(from, to))).unwrap_err();
        let known = [FailureCode::BadFile, FailureCode::Unsupported];
        assert!(known.contains(&failure.code), "{to}: {failure}");
    }
}

#[test]
fn other_and_damaged_files_are_refused() {
    for bytes in [&b"x,y\n1,2\n"[..], b"\x89HDF\r\n\x1a\n"] {
        assert_eq!(open(bytes).unwrap_err().code, FailureCode::NotMine);
    }
    for whole in [ONE, TWO] {
        for cut in damage::cuts(whole) {
            assert!(open(cut).is_err(), "{} bytes", cut.len());
        }
        for (_, changed) in damage::flips(whole, whole.len()) {
            let _ = open(&changed);
        }
    }
}

#[test]
fn a_real_file_has_its_rows() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"))
        .ancestors()
        .nth(3)
        .unwrap();
    let path = root.join("shared/data/locan/SMLM_dstorm_data.smlm");
    if !path.exists() {
        return;
    }
    let done = Call::of::<ReadSmlm>().file(&path).run().unwrap();
    let out = done.output("localisations").unwrap();
    assert_eq!(out.header.rows(), 10);
    let x = out.f64("x").unwrap();
    let max = x.iter().copied().fold(0.0, f64::max);
    assert!((max - 14_215.5).abs() < 1e-2, "{max}");
    assert_eq!(out.header.column("x").unwrap().unit, "nm");
}
