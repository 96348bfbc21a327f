//! Known files, and damaged ones.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use crate::ReadInsight3;
use puncta_sdk::{Failure, FailureCode};
use puncta_testkit::{Call, Done, damage};
use std::path::{Path, PathBuf};

const EXAMPLE: &[u8] = include_bytes!("../data/example.bin");

fn open(bytes: &[u8], pixel_size: Option<f64>) -> Result<Done, Failure> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.bin");
    std::fs::write(&path, bytes).unwrap();
    let mut call = Call::of::<ReadInsight3>().file(&path);
    if let Some(size) = pixel_size {
        call = call.set("pixel_size", size);
    }
    call.run()
}

fn real(name: &str) -> Option<PathBuf> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"))
        .parent()?
        .parent()?
        .parent()?;
    let path = root.join("shared/data").join(name);
    path.exists().then_some(path)
}

#[test]
fn pixels_stay_unknown_until_their_size_is_given() {
    let done = open(EXAMPLE, None).unwrap();
    let out = done.output("localisations").unwrap();
    assert_eq!(out.f64("x").unwrap(), [21.0, 60.5, 101.0]);
    assert_eq!(out.header.column("x").unwrap().unit, "unknown");
    assert_eq!(out.header.column("z").unwrap().unit, "nm");
    assert_eq!(out.i64("t").unwrap(), [0, 1, 2]);
    assert_eq!(out.i32("link").unwrap(), [-1, -1, -1]);
    let done = open(EXAMPLE, Some(160.0)).unwrap();
    let out = done.output("localisations").unwrap();
    assert_eq!(out.f64("x").unwrap()[1], 9680.0);
    assert_eq!(out.header.column("x").unwrap().unit, "nm");
    assert_eq!(out.f64("z").unwrap(), [-750.0, -684.0, 10.0]);
}

#[test]
fn other_and_damaged_files_are_refused() {
    assert_eq!(
        open(b"x,y\n1,2\n", None).unwrap_err().code,
        FailureCode::NotMine
    );
    for cut in damage::cuts(&EXAMPLE[..EXAMPLE.len() - 4]) {
        let failure = open(cut, None).unwrap_err();
        let known = [FailureCode::NotMine, FailureCode::BadFile];
        assert!(known.contains(&failure.code), "{failure}");
    }
    for (_, changed) in damage::flips(EXAMPLE, 16) {
        let _ = open(&changed, None);
    }
    let mut lie = EXAMPLE.to_vec();
    lie[12..16].copy_from_slice(&u32::MAX.to_le_bytes());
    let failure = open(&lie, None).unwrap_err();
    assert!(
        failure.to_string().contains("4294967295 molecules"),
        "{failure}"
    );
}

#[test]
fn real_files_have_their_rows() {
    for (name, rows, x) in [
        ("storm-analysis/test_olist.bin", 2000, 63.344_547),
        ("storm-analysis/test_300x200_dh_olist.bin", 120, 21.0),
    ] {
        let Some(path) = real(name) else { continue };
        let done = Call::of::<ReadInsight3>().file(&path).run().unwrap();
        let out = done.output("localisations").unwrap();
        assert_eq!(out.header.rows(), rows, "{name}");
        assert!((out.f64("x").unwrap()[0] - x).abs() < 1e-5, "{name}");
    }
}
