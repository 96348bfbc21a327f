//! Files of both layouts, real files, and damaged ones.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use crate::ReadMat;
use flate2::Compression;
use flate2::write::ZlibEncoder;
use puncta_sdk::{Failure, FailureCode};
use puncta_testkit::{Call, Done, damage};
use std::io::Write;
use std::path::{Path, PathBuf};

const SMAP: &[u8] = include_bytes!("../data/example.mat");
const MINFLUX: &[u8] = include_bytes!("../data/minflux.mat");

fn call(bytes: &[u8]) -> (tempfile::TempDir, Call) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mat");
    std::fs::write(&path, bytes).unwrap();
    let call = Call::of::<ReadMat>().file(&path);
    (folder, call)
}

fn open(bytes: &[u8]) -> Result<Done, Failure> {
    let (_folder, call) = call(bytes);
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

/// An element with its padding.
fn element(kind: u32, bytes: &[u8]) -> Vec<u8> {
    let mut all = kind.to_le_bytes().to_vec();
    all.extend_from_slice(&u32::try_from(bytes.len()).unwrap().to_le_bytes());
    all.extend_from_slice(bytes);
    while !all.len().is_multiple_of(8) {
        all.push(0);
    }
    all
}

fn matrix(name: &str, class: u32, sizes: [i32; 2], content: &[u8]) -> Vec<u8> {
    let flags: Vec<u8> = [class, 0]
        .iter()
        .flat_map(|word| word.to_le_bytes())
        .collect();
    let sizes: Vec<u8> = sizes.iter().flat_map(|size| size.to_le_bytes()).collect();
    let parts = [
        element(6, &flags),
        element(5, &sizes),
        element(1, name.as_bytes()),
    ]
    .concat();
    element(14, &[&parts, content].concat())
}

fn file(variables: &[Vec<u8>]) -> Vec<u8> {
    let mut all = vec![b' '; 124];
    all[..10].copy_from_slice(b"MATLAB 5.0");
    all.extend_from_slice(&[0, 1, b'I', b'M']);
    all.extend(variables.concat());
    all
}

fn vector(name: &str, values: &[f64]) -> Vec<u8> {
    let bytes: Vec<u8> = values
        .iter()
        .flat_map(|value| value.to_le_bytes())
        .collect();
    matrix(
        name,
        6,
        [i32::try_from(values.len()).unwrap(), 1],
        &element(9, &bytes),
    )
}

fn packed(variable: &[u8]) -> Vec<u8> {
    let mut packer = ZlibEncoder::new(Vec::new(), Compression::fast());
    packer.write_all(variable).unwrap();
    let bytes = packer.finish().unwrap();
    let mut all = 15_u32.to_le_bytes().to_vec();
    all.extend_from_slice(&u32::try_from(bytes.len()).unwrap().to_le_bytes());
    all.extend(bytes);
    all
}

#[test]
fn smap_has_its_names_and_units() {
    let done = open(SMAP).unwrap();
    let out = done.output("localisations").unwrap();
    assert_eq!(out.header.rows(), 20);
    assert_eq!(out.f64("x").unwrap()[3], 30.0);
    assert_eq!(out.f64("y").unwrap()[3], 3.25);
    assert_eq!(out.f64("t").unwrap()[..3], [0.0, 1.0, 2.0]);
    assert_eq!(out.f64("error_y").unwrap()[0], 9.5);
    assert_eq!(out.f32("nPhotons").unwrap()[0], 1000.0);
    assert_eq!(out.header.column("x").unwrap().unit, "nm");
    assert_eq!(
        out.header.metadata["matlab"]["saveloc"]["file"]["name"],
        "a.tif"
    );
}

#[test]
fn minflux_has_the_last_iteration_of_valid_rows() {
    let done = open(MINFLUX).unwrap();
    let out = done.output("localisations").unwrap();
    assert_eq!(out.header.rows(), 19);
    let x = out.f64("x").unwrap();
    assert!((x[3] - 4.0).abs() < 1e-9, "{x:?}");
    assert!((out.f64("z").unwrap()[0] - 3.0).abs() < 1e-9);
    assert_eq!(out.header.column("t").unwrap().unit, "s");
    assert!(
        done.messages
            .iter()
            .any(|(_, text)| text.starts_with("1 of 20 rows"))
    );
    let (_folder, call) = call(MINFLUX);
    let all = call.set("all_rows", true).run().unwrap();
    assert_eq!(all.output("localisations").unwrap().header.rows(), 20);
}

#[test]
fn long_vectors_are_read_from_where_they_are() {
    let rows = 50_000;
    let x: Vec<f64> = (0..rows).map(f64::from).collect();
    let y: Vec<f64> = x.iter().map(|x| x * 2.0).collect();
    let plain = [
        vector("y", &y),
        vector("x", &x),
        vector("other", &[1.0, 2.0]),
    ];
    let small: Vec<Vec<u8>> = plain.iter().map(|variable| packed(variable)).collect();
    for bytes in [file(&plain), file(&small)] {
        let (_folder, call) = call(&bytes);
        let notes = call.prepare().unwrap().notes.join(" ");
        assert!(
            notes.contains("unit of y, x") && notes.contains("unknown"),
            "{notes}"
        );
        let done = call.set("units", "um").run().unwrap();
        let out = done.output("localisations").unwrap();
        let scaled: Vec<f64> = x.iter().map(|x| x * 1000.0).collect();
        assert_eq!(out.f64("x").unwrap(), scaled);
        assert_eq!(
            out.f64("y").unwrap()[rows as usize - 1],
            f64::from(rows - 1) * 2000.0
        );
        assert!(out.header.column("other").is_none());
    }
}

#[test]
fn other_files_are_left_to_others() {
    let mut newer = file(&[]);
    newer[124..126].copy_from_slice(&[0, 2]);
    for bytes in [&b"x,y\n"[..], b"\x89HDF\r\n\x1a\n", &newer] {
        assert_eq!(open(bytes).unwrap_err().code, FailureCode::NotMine);
    }
    let text = matrix("a", 4, [1, 2], &element(4, &[104, 0, 105, 0]));
    let failure = open(&file(&[text])).unwrap_err();
    assert_eq!(failure.code, FailureCode::Unsupported, "{failure}");
}

#[test]
fn lies_are_refused() {
    let bytes: Vec<u8> = [1.0_f64; 4]
        .iter()
        .flat_map(|value| value.to_le_bytes())
        .collect();
    let long = matrix("x", 6, [i32::MAX, i32::MAX], &element(9, &bytes));
    let negative = matrix("x", 6, [-1, 4], &element(9, &bytes));
    let cells = matrix("c", 1, [i32::MAX, 1], &[]);
    let mut fields = element(5, &1_i32.to_le_bytes());
    fields.extend(element(1, &vec![b'a'; 1 << 16]));
    let many = matrix("s", 2, [1 << 20, 1 << 10], &fields);
    let mut beyond = vector("x", &[1.0; 8]);
    beyond[4..8].copy_from_slice(&u32::MAX.to_le_bytes());
    for variable in [long, negative, cells, many, beyond] {
        assert_eq!(
            open(&file(&[variable])).unwrap_err().code,
            FailureCode::BadFile
        );
    }
    let mut bomb = packed(&vector("x", &[0.0; 1000]));
    let mut inner = vector("x", &[0.0; 1000]);
    inner[4..8].copy_from_slice(&u32::MAX.to_le_bytes());
    bomb.splice(.., packed(&inner));
    assert_eq!(open(&file(&[bomb])).unwrap_err().code, FailureCode::BadFile);
}

#[test]
fn deep_cells_do_not_overflow() {
    let mut cell = vector("x", &[1.0]);
    for _ in 0..5000 {
        cell = matrix("", 1, [1, 1], &cell);
    }
    assert_eq!(open(&file(&[cell])).unwrap_err().code, FailureCode::BadFile);
}

#[test]
fn damaged_files_are_refused_or_read() {
    let two = file(&[vector("x", &[1.0, 2.0, 3.0]), vector("y", &[1.0, 2.0, 3.0])]);
    for whole in [SMAP, MINFLUX, &two] {
        for cut in damage::cuts(whole) {
            let _ = open(cut);
        }
        for (_, changed) in damage::flips(whole, 400) {
            let _ = open(&changed);
        }
    }
    for cut in damage::cuts(SMAP) {
        assert!(open(cut).is_err(), "{} bytes", cut.len());
    }
}

#[test]
fn real_files_have_their_rows() {
    for (name, rows, x, unit) in [
        ("spot-on/anders.mat", 9_102_u64, 1_032.060_63, "nm"),
        ("spot-on/utrack.mat", 35, 70.083_395_87, "unknown"),
        (
            "smap/sampledata_npc.mat",
            57_778,
            11_861.455_014_18,
            "unknown",
        ),
    ] {
        let Some(path) = real(name) else { continue };
        let done = Call::of::<ReadMat>().file(&path).run().unwrap();
        let out = done.output("localisations").unwrap();
        assert_eq!(out.header.rows(), rows, "{name}");
        assert!((out.f64("x").unwrap()[0] - x).abs() < 1e-4, "{name}");
        assert_eq!(out.header.column("x").unwrap().unit, unit, "{name}");
    }
    if let Some(path) = real("locan/smap_dstorm_data.mat") {
        let failure = Call::of::<ReadMat>().file(&path).run().unwrap_err();
        assert_eq!(failure.code, FailureCode::NotMine, "HDF5");
    }
}
