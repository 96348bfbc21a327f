//! The writer without the host.

use my_plugin::WritePoints;
use puncta_sdk::FailureCode;
use puncta_testkit::{Call, Table};
use std::path::Path;

fn call() -> Call {
    let table = Table::new("table")
        .f64("x", "nm", &[1.0, 2.5])
        .f64("y", "nm", &[-1.0, 0.125]);
    Call::of::<WritePoints>()
        .set("digits", 2)
        .input("table", table)
}

#[test]
fn points_are_written() {
    let path = std::env::temp_dir().join(format!("my-plugin-{}.points", std::process::id()));
    call().file(&path).run().unwrap();
    let text = std::fs::read_to_string(&path).unwrap();
    std::fs::remove_file(&path).unwrap();
    assert_eq!(text, "POINTS\n1.00 -1.00\n2.50 0.12\n");
}

#[test]
fn a_folder_that_is_not_there_is_told() {
    let failure = call()
        .file(Path::new("/no such folder/a.points"))
        .run()
        .unwrap_err();
    assert_eq!(failure.code, FailureCode::Io);
}
