//! What the writers write: read again here, and by h5py where there is Python.

use std::path::{Path, PathBuf};
use std::process::Command;

use puncta_testkit::{Call, Object, Table};
use serde_json::json;

use super::{call, output};
use crate::{WritePicasso, WritePyme};

fn table() -> Object {
    let table = Table::new("localisations")
        .f64("x", "nm", &[100.5, 200.25, -3.0])
        .f64("y", "nm", &[10.0, 20.0, 30.125])
        .f64("z", "nm", &[-50.0, 0.5, f64::NAN])
        .f64("error_x", "nm", &[5.0, 6.0, 7.0])
        .f64("error_y", "nm", &[5.5, 6.5, 7.5])
        .i32("t", "frame", &[0, 2, 1])
        .f32("nPhotons", "photon", &[500.0, 600.5, 700.0])
        .i32("clumpIndex", "1", &[1, -1, 7]);
    let mut object: Object = table.into();
    object.header.metadata = json!({
        "camera": { "pixel_size_nm": 130.0, "width_px": 64, "height_px": 32, "frames": 100 },
        "picasso": [{ "Width": 64, "Height": 32, "Frames": 100, "Pixelsize": 130.0, "a": [1, "b"] }],
        "note": "a text",
    })
    .as_object()
    .cloned()
    .unwrap();
    object
}

fn pyme(folder: &Path) -> PathBuf {
    let path = folder.join("t.hdf");
    Call::of::<WritePyme>()
        .input("table", table())
        .file(&path)
        .run()
        .unwrap();
    path
}

fn picasso(folder: &Path) -> PathBuf {
    let path = folder.join("t.hdf5");
    Call::of::<WritePicasso>()
        .input("table", table())
        .file(&path)
        .run()
        .unwrap();
    path
}

#[test]
fn a_pyme_table_comes_back_as_it_was() {
    let folder = tempfile::tempdir().unwrap();
    let again = output(&call(&pyme(folder.path())).run().unwrap(), "localisations");
    let first = table();
    assert_eq!(again.header.metadata, first.header.metadata);
    // Roles that the writer's table lacks come from the names.
    let columns = |o: &Object| {
        let infos = o.header.parts[0].columns.iter();
        infos
            .map(|c| (c.name.clone(), c.type_.element.name(), c.unit.clone()))
            .collect::<Vec<_>>()
    };
    assert_eq!(columns(&again), columns(&first));
    for name in ["x", "y", "z", "error_x", "error_y"] {
        let bits = |o: &Object| -> Vec<u64> {
            o.f64(name).unwrap().into_iter().map(f64::to_bits).collect()
        };
        assert_eq!(bits(&again), bits(&first), "{name}");
    }
    assert_eq!(again.i32("t").unwrap(), [0, 2, 1]);
    assert_eq!(again.f32("nPhotons").unwrap(), [500.0, 600.5, 700.0]);
}

#[test]
fn picasso_keeps_32_bits_and_every_step() {
    let folder = tempfile::tempdir().unwrap();
    let again = output(
        &call(&picasso(folder.path())).run().unwrap(),
        "localisations",
    );
    let (found, wanted) = (again.f64("x").unwrap(), table().f64("x").unwrap());
    for (found, wanted) in found.iter().zip(&wanted) {
        assert!((found - wanted).abs() < 1e-4, "{found} is not {wanted}");
    }
    assert_eq!(again.u32("t").unwrap(), [0, 2, 1]);
    assert_eq!(again.i32("clumpindex").unwrap(), [1, -1, 7]);
    let steps = again.header.metadata["picasso"].as_array().unwrap();
    assert_eq!(steps.len(), 2);
    assert_eq!(steps[0]["a"], json!([1, "b"]));
    assert_eq!(steps[1]["Pixelsize"], 130.0);
    let mut bare = table();
    bare.header.metadata.clear();
    let refused = Call::of::<WritePicasso>()
        .input("table", bare)
        .file(&folder.path().join("b.hdf5"));
    let failure = refused.run().err().unwrap();
    assert!(
        failure.to_string().contains("--out-pixel_size"),
        "{failure}"
    );
}

#[test]
fn tables_without_rows_are_written() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("e.hdf");
    let empty = Table::new("t").f64("x", "nm", &[]).f64("y", "nm", &[]);
    Call::of::<WritePyme>()
        .input("table", empty)
        .file(&path)
        .run()
        .unwrap();
    let again = output(&call(&path).run().unwrap(), "localisations");
    assert_eq!(again.header.rows(), 0);
}

/// A Python with a module, where there is one.
fn python(module: &str) -> Option<String> {
    let own = std::env::var("PUNCTA_TEST_PYTHON").ok();
    let names = own.into_iter().chain(["python3".to_owned()]);
    let import = format!("import {module}");
    let works = |name: &String| {
        let status = Command::new(name).args(["-c", &import]).output();
        status.is_ok_and(|output| output.status.success())
    };
    names.into_iter().find(works)
}

#[test]
#[allow(clippy::print_stderr, reason = "says that it is skipped")]
fn h5py_reads_both() {
    let Some(python) = python("h5py") else {
        eprintln!("skipped: no python3 with h5py (PUNCTA_TEST_PYTHON may name one)");
        return;
    };
    let folder = tempfile::tempdir().unwrap();
    let script = "\
import h5py, sys
locs = h5py.File(sys.argv[1])['locs'][:]
assert locs.dtype.names[:3] == ('frame', 'x', 'y'), locs.dtype
assert locs['frame'].dtype == 'u4' and locs['frame'].tolist() == [0, 2, 1]
assert abs(locs['x'][0] * 130 - 100.5) < 1e-4 and abs(locs['lpx'][1] * 130 - 6) < 1e-5
table = h5py.File(sys.argv[2])
rows = table['Localizations'][:]
assert rows['x'].tolist() == [100.5, 200.25, -3.0] and rows['clumpIndex'].tolist() == [1, -1, 7]
assert table.attrs['CLASS'] == b'GROUP' and table['MetaData/camera'].attrs['pixel_size_nm'] == 130
";
    let output = Command::new(python)
        .args(["-c", script])
        .arg(picasso(folder.path()))
        .arg(pyme(folder.path()))
        .output()
        .unwrap();
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
}
