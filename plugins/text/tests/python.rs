//! What is written opens in pandas with the same values, where there is Python.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use puncta_plugin_text::writer::WriteText;
use puncta_testkit::{Call, Table};
use std::process::Command;

/// A Python with a module, where there is one.
fn python(module: &str) -> Option<String> {
    let own = std::env::var("PUNCTA_TEST_PYTHON").ok();
    let import = format!("import {module}");
    let works = |name: &String| {
        let status = Command::new(name).args(["-c", &import]).output();
        status.is_ok_and(|output| output.status.success())
    };
    own.into_iter().chain(["python3".to_owned()]).find(works)
}

#[test]
#[allow(clippy::print_stderr, reason = "says that it is skipped")]
fn pandas_reads_every_style() {
    let Some(python) = python("pandas") else {
        eprintln!("skipped: no python3 with pandas (PUNCTA_TEST_PYTHON may name one)");
        return;
    };
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, style: &str| {
        let table = Table::new("localisations")
            .f64("x", "nm", &[100.1, -2.5e-7, f64::NAN])
            .f64("y", "nm", &[0.1 + 0.2, 1e300, 3.0])
            .i32("t", "frame", &[0, 1, 2]);
        let path = folder.path().join(name);
        let call = Call::of::<WriteText>().set("style", style);
        call.input("table", table).file(&path).run().unwrap();
        path
    };
    let script = "\
import sys, pandas
plain = pandas.read_csv(sys.argv[1], float_precision='round_trip')
assert list(plain) == ['x [nm]', 'y [nm]', 't [frame]'], list(plain)
assert plain['x [nm]'].isna().tolist() == [False, False, True]
assert plain['x [nm]'].tolist()[:2] == [100.1, -2.5e-7]
assert plain['y [nm]'].tolist() == [0.1 + 0.2, 1e300, 3.0]
storm = pandas.read_csv(sys.argv[2], float_precision='round_trip')
assert storm['frame'].tolist() == [1, 2, 3] and storm['y [nm]'].tolist()[0] == 0.1 + 0.2
";
    let output = Command::new(python)
        .args(["-c", script])
        .arg(write("plain.csv", "plain"))
        .arg(write("storm.csv", "thunderstorm"))
        .output()
        .unwrap();
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
}
