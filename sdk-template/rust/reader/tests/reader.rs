//! The reader without the host.

use my_plugin::ReadPoints;
use puncta_sdk::{Failure, FailureCode};
use puncta_testkit::{Call, Done};

fn read(name: &str, text: &str) -> Result<Done, Failure> {
    let path = std::env::temp_dir().join(format!("my-plugin-{}-{name}", std::process::id()));
    std::fs::write(&path, text).unwrap();
    let done = Call::of::<ReadPoints>().file(&path).run();
    std::fs::remove_file(&path).unwrap();
    done
}

#[test]
fn points_are_read() {
    let done = read("a.points", "POINTS\n1 2\n3.5 -4\n").unwrap();
    let points = done.output("localisations").unwrap();
    assert_eq!(points.f64("x").unwrap(), [1.0, 3.5]);
    assert_eq!(points.f64("y").unwrap(), [2.0, -4.0]);
}

#[test]
fn other_and_damaged_files_are_refused() {
    let failure = read("b.points", "x,y\n1,2\n").unwrap_err();
    assert_eq!(failure.code, FailureCode::NotMine);
    let failure = read("c.points", "POINTS\n1 2\n3\n").unwrap_err();
    assert_eq!((failure.code, failure.row), (FailureCode::BadFile, Some(3)));
}
