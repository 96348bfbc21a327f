//! Arrays of both orders, real files, and damaged ones.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use crate::ReadAsdf;
use puncta_sdk::{Failure, FailureCode};
use puncta_testkit::{Call, Done, damage};
use std::path::{Path, PathBuf};

const PLAIN: &[u8] = include_bytes!("../data/example.asdf");
const ROWS: &[u8] = include_bytes!("../data/rows.asdf");
const COLUMNS: &[u8] = include_bytes!("../data/columns.asdf");

fn open(bytes: &[u8]) -> Result<Done, Failure> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.asdf");
    std::fs::write(&path, bytes).unwrap();
    Call::of::<ReadAsdf>().file(&path).run()
}

fn real(name: &str) -> Option<PathBuf> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).ancestors().nth(3)?;
    let path = root.join("shared/data").join(name);
    path.exists().then_some(path)
}

#[test]
fn arrays_of_both_orders_are_read() {
    for (bytes, factor) in [(PLAIN, 1000.0), (ROWS, 1000.0), (COLUMNS, 1.0)] {
        let done = open(bytes).unwrap();
        let out = done.output("localisations").unwrap();
        assert_eq!(
            out.f64("x").unwrap(),
            [1.5 * factor, 2.5 * factor, 3.5 * factor]
        );
        assert_eq!(out.f64("y").unwrap(), [20.0, 30.0, 40.0]);
        let unit = |name: &str| out.header.column(name).unwrap().unit.clone();
        assert_eq!(unit("x") == "nm", factor > 1.0);
        assert_eq!(
            (unit("y").as_str(), unit("t").as_str()),
            ("unknown", "frame")
        );
    }
    let done = open(PLAIN).unwrap();
    let out = done.output("localisations").unwrap();
    assert_eq!(out.f32("t").unwrap(), [0.0, 1.0, 1.0]);
    assert_eq!(out.header.metadata["asdf"]["meta"]["identifier"], "1");
}

fn changed(whole: &[u8], from: &[u8], to: &[u8]) -> Vec<u8> {
    assert_eq!(from.len(), to.len());
    let place = whole.windows(from.len()).position(|w| w == from).unwrap();
    let mut bytes = whole.to_vec();
    bytes[place..place + to.len()].copy_from_slice(to);
    bytes
}

#[test]
fn lies_are_refused() {
    for (whole, from, to) in [
        (PLAIN, &b"shape: [3, 4]"[..], &b"shape: [9, 4]"[..]),
        (PLAIN, b"shape: [3, 4]", b"shape: [3, 3]"),
        (PLAIN, b"strides: [4, 12]", b"strides: [4, 16]"),
        (PLAIN, b"float32", b"float99"),
        (PLAIN, b"source: 0", b"source: 7"),
        (ROWS, b"BLK\x000\0\0\0\0zlib", b"BLK\x000\0\0\0\0bzp2"),
    ] {
        let failure = open(&changed(whole, from, to)).unwrap_err();
        let known = [FailureCode::BadFile, FailureCode::Unsupported];
        assert!(known.contains(&failure.code), "{failure}");
    }
    let mut bomb = ROWS.to_vec();
    let block = bomb.windows(4).position(|w| w == b"\xd3BLK").unwrap();
    bomb[block + 30..block + 38].copy_from_slice(&(1_u64 << 50).to_be_bytes());
    let failure = open(&bomb).unwrap_err();
    assert!(
        failure.to_string().contains("lies about its size"),
        "{failure}"
    );
}

#[test]
fn other_and_damaged_files_are_refused() {
    for bytes in [&b"x,y\n1,2\n"[..], b"#ASDF 1.0.0\n--- {a: 1}\n"] {
        assert_eq!(open(bytes).unwrap_err().code, FailureCode::NotMine);
    }
    for whole in [PLAIN, ROWS, COLUMNS] {
        let end = whole.windows(12).rposition(|w| w == b"#ASDF BLOCK ");
        let data = &whole[..end.unwrap_or(whole.len())];
        for cut in damage::cuts(data) {
            assert!(open(cut).is_err(), "{} bytes", cut.len());
        }
        for (_, changed) in damage::flips(whole, whole.len()) {
            let _ = open(&changed);
        }
    }
}

#[test]
fn real_files_have_their_rows() {
    for (name, rows) in [
        ("locan/npc_gp210.asdf", 202),
        ("locan/clathrin_3d.asdf", 23_517),
        ("locan/rapidSTORM_beads_green.asdf", 100),
        ("locan/rapidSTORM_beads_red.asdf", 100),
    ] {
        let Some(path) = real(name) else { continue };
        let done = Call::of::<ReadAsdf>().file(&path).run().unwrap();
        let out = done.output("localisations").unwrap();
        assert_eq!(out.header.rows(), rows, "{name}");
        assert_eq!(out.header.column("x").unwrap().unit, "unknown");
        if name.ends_with("gp210.asdf") {
            let x = out.f64("x").unwrap();
            let mean = x.iter().sum::<f64>() / rows as f64;
            assert!((mean - 5_623.488_892_810).abs() < 1e-6, "{mean}");
        }
    }
}
