//! Arrays and JSON of both layouts, files of others, and damaged files.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use crate::{ReadJson, ReadNpy};
use puncta_sdk::{Failure, FailureCode, Operation};
use puncta_testkit::{Call, Done, damage};
use std::path::{Path, PathBuf};

const OLD: &[u8] = include_bytes!("../data/example.npy");
const NEW: &[u8] = include_bytes!("../data/new.npy");

fn open<O: Operation + Sync>(bytes: &[u8], options: &[(&str, f64)]) -> Result<Done, Failure> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.npy");
    std::fs::write(&path, bytes).unwrap();
    let mut call = Call::of::<O>().file(&path);
    for (name, value) in options {
        call = match *name {
            "all_rows" => call.set(name, true),
            _ => call.set(name, *value),
        };
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
fn of_the_old_layout_the_last_iteration_of_valid_rows_is_taken() {
    let done = open::<ReadNpy>(OLD, &[]).unwrap();
    let out = done.output("localisations").unwrap();
    assert_eq!(out.header.rows(), 2);
    let x = out.f64("x").unwrap();
    assert!(
        (x[0] - 1000.0).abs() < 1e-9 && (x[1] - 1002.0).abs() < 1e-9,
        "{x:?}"
    );
    assert_eq!(out.i32("eco").unwrap(), [1, 21]);
    assert_eq!(out.i32("clumpIndex").unwrap(), [0, 1]);
    assert_eq!(out.f64("t").unwrap(), [0.0, 1.0]);
    let x = out.header.column("x").unwrap();
    assert_eq!(
        (x.unit.as_str(), x.role.as_deref()),
        ("nm", Some("position"))
    );
    assert_eq!(out.header.column("t").unwrap().unit, "s");
    assert!(
        done.messages
            .iter()
            .any(|(_, text)| text.starts_with("1 of 3 rows"))
    );
    let all = open::<ReadNpy>(OLD, &[("all_rows", 1.0), ("z_factor", 0.5)]).unwrap();
    let out = all.output("localisations").unwrap();
    assert_eq!(out.header.rows(), 3);
    assert!((out.f64("z").unwrap()[1] - 0.5).abs() < 1e-9);
}

#[test]
fn of_the_new_layout_final_rows_are_taken() {
    let done = open::<ReadNpy>(NEW, &[]).unwrap();
    let out = done.output("localisations").unwrap();
    assert_eq!(out.header.rows(), 1);
    assert!((out.f64("z").unwrap()[0] - 3.0).abs() < 1e-9);
    assert_eq!(out.u32("eco").unwrap(), [101]);
    assert_eq!(out.f32("cfr").unwrap(), [0.5]);
}

const JSON: &str = r#"[
 {"tid": 1, "vld": true, "tim": 0.5, "itr": [{"itr": 0, "loc": [9, 9, 9]}, {"itr": 1, "loc": [1e-9, 2e-9, 3e-9], "eco": 5}], "deep": {"a": [1]}},
 {"tid": 2, "vld": false, "tim": 0.6, "itr": [{"loc": [1, 1, 1], "eco": 6}]},
 {"tid": 3, "vld": true, "tim": null, "loc": [4e-9, 5e-9, 6e-9]}
]"#;

#[test]
fn json_of_both_layouts_is_read_row_by_row() {
    let done = open::<ReadJson>(JSON.as_bytes(), &[]).unwrap();
    let out = done.output("localisations").unwrap();
    assert_eq!(out.header.rows(), 2);
    let x = out.f64("x").unwrap();
    assert!(
        (x[0] - 1.0).abs() < 1e-9 && (x[1] - 4.0).abs() < 1e-9,
        "{x:?}"
    );
    assert_eq!(out.i64("clumpIndex").unwrap(), [1, 3]);
    assert!(out.f64("t").unwrap()[1].is_nan());
    assert!(out.f64("eco").unwrap()[1].is_nan());
    assert!(
        done.messages
            .iter()
            .any(|(_, text)| text.starts_with("1 of 3 rows"))
    );
}

#[test]
fn other_files_are_left_to_others() {
    for bytes in [&b"x,y\n1,2\n"[..], b"PK\x05\x06", b"\x93NUMPY\x01\x00"] {
        let failure = open::<ReadNpy>(bytes, &[]).unwrap_err();
        let known = [FailureCode::NotMine, FailureCode::BadFile];
        assert!(known.contains(&failure.code), "{failure}");
    }
    for text in [
        "{}",
        "[1, 2]",
        "[{\"a\": 1}]",
        "[",
        "x",
        "[{\"loc\": 3, \"tid\": 1}]",
    ] {
        let failure = open::<ReadJson>(text.as_bytes(), &[]).unwrap_err();
        assert_eq!(failure.code, FailureCode::NotMine, "{text}: {failure}");
    }
    let image = b"\x93NUMPY\x01\x00\x46\x00{'descr': '<f8', 'fortran_order': False, 'shape': (2, 2), }          \n";
    let failure = open::<ReadNpy>(image, &[]).unwrap_err();
    assert_eq!(failure.code, FailureCode::NotMine, "{failure}");
}

#[test]
fn python_objects_and_lies_are_refused() {
    let head = |text: &str| {
        let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
        bytes.extend_from_slice(&u16::try_from(text.len()).unwrap().to_le_bytes());
        bytes.extend_from_slice(text.as_bytes());
        bytes.extend_from_slice(&[0; 64]);
        bytes
    };
    let objects = head("{'descr': '|O', 'fortran_order': False, 'shape': (3,)}");
    let failure = open::<ReadNpy>(&objects, &[]).unwrap_err();
    assert!(failure.to_string().contains("Python objects"), "{failure}");
    let nested =
        head("{'descr': [('a', '|O'), ('b', '<f8')], 'shape': (3,), 'fortran_order': False}");
    assert_eq!(
        open::<ReadNpy>(&nested, &[]).unwrap_err().code,
        FailureCode::Unsupported
    );
    for shape in ["(9,)", "(99999999999999999,)"] {
        let text = format!("{{'descr': [('x', '<f8')], 'fortran_order': False, 'shape': {shape}}}");
        let failure = open::<ReadNpy>(&head(&text), &[]).unwrap_err();
        assert_eq!(failure.code, FailureCode::BadFile, "{failure}");
    }
    let failure = open::<ReadNpy>(&head("{'descr': [('x', '<f8')], 'shape': (-1,)}"), &[]);
    assert_eq!(failure.unwrap_err().code, FailureCode::BadFile);
}

#[test]
fn nested_json_does_not_overflow() {
    for (open_, close, refused) in [
        ("[", "]", false),
        ("{\"itr\":", "}", true),
        ("[{\"itr\":", "}]", true),
    ] {
        let (before, after) = (open_.repeat(100_000), close.repeat(100_000));
        let deep = format!("[{{\"loc\":[1,2],\"tid\":1,\"itr\":{before}1{after}}}]");
        let read = open::<ReadJson>(deep.as_bytes(), &[]);
        assert_eq!(read.is_err(), refused, "{open_}");
    }
}

#[test]
fn damaged_files_are_refused_or_read() {
    for whole in [OLD, NEW] {
        for cut in damage::cuts(whole) {
            assert!(open::<ReadNpy>(cut, &[]).is_err(), "{} bytes", cut.len());
        }
        for (_, changed) in damage::flips(whole, 400) {
            let _ = open::<ReadNpy>(&changed, &[]);
        }
    }
    for cut in damage::cuts(JSON.as_bytes()) {
        assert!(open::<ReadJson>(cut, &[]).is_err(), "{} bytes", cut.len());
    }
    for (_, changed) in damage::flips(JSON.as_bytes(), JSON.len()) {
        let _ = open::<ReadJson>(&changed, &[]);
    }
}

#[test]
fn real_files_have_their_rows() {
    for (name, rows, track) in [
        ("pyminflux/2D_ValidOnly.npy.zip", 12_580, true),
        ("pyminflux/3D_ValidOnly.npy.zip", 5_812, true),
        ("pyminflux/two_fluorophores_assignment.npy", 17_955, false),
    ] {
        let Some(path) = real(name) else { continue };
        let done = Call::of::<ReadNpy>().file(&path).run().unwrap();
        let out = done.output("localisations").unwrap();
        assert_eq!(out.header.rows(), rows, "{name}");
        assert_eq!(out.header.column("clumpIndex").is_some(), track);
    }
    if let Some(path) = real("rfrc4minflux/nup96.json") {
        let done = Call::of::<ReadJson>().file(&path).run().unwrap();
        let out = done.output("localisations").unwrap();
        assert_eq!(out.header.rows(), 2261);
        let x = out.f64("x").unwrap();
        assert!((x[0] - 359.514_635_525_059).abs() < 1e-9, "{}", x[0]);
    }
}

#[test]
fn archives_hold_one_array_or_say_so() {
    // Local headers and a directory that says a size which deflate cannot reach.
    let Some(path) = real("pyminflux/2D_ValidOnly.npy.zip") else {
        return;
    };
    let whole = std::fs::read(path).unwrap();
    let at = whole.len() - 600;
    let place = at
        + whole[at..]
            .windows(4)
            .position(|w| w == b"PK\x01\x02")
            .unwrap();
    let mut bomb = whole.clone();
    bomb[place + 24..place + 28].copy_from_slice(&u32::MAX.wrapping_sub(1).to_le_bytes());
    let failure = open::<ReadNpy>(&bomb, &[]).unwrap_err();
    assert_eq!(failure.code, FailureCode::BadFile, "{failure}");
    for cut in damage::cuts(&whole).step_by(8) {
        assert!(open::<ReadNpy>(cut, &[]).is_err());
    }
}
