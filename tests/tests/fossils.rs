//! Plugins of earlier ABI numbers, and what later and earlier SDKs might build.
#![cfg(target_os = "linux")]
#![allow(clippy::unwrap_used, clippy::expect_used)]

use puncta_abi::ABI_NUMBER;
use puncta_engine::plugins::catalogue;
use puncta_engine::worker::{Pool, Start};
use puncta_tests::{Bundle, c, faults::has, program, root};
use std::path::{Path, PathBuf};

fn fossils() -> Vec<PathBuf> {
    let entries = std::fs::read_dir(root().join("tests/fossils"))
        .unwrap()
        .flatten();
    let folders = entries
        .map(|entry| entry.path())
        .filter(|path| path.is_dir());
    folders.collect()
}

fn number(fossil: &Path) -> u32 {
    let name = fossil.file_name().unwrap().to_str().unwrap();
    name.strip_prefix("v0_").unwrap().parse().unwrap()
}

fn build(fossil: &Path, source: &Path, to: &Path) -> PathBuf {
    let search = format!("-I{}", fossil.display());
    c::compile_with(fossil, &[source], &[&search], to)
}

#[test]
fn every_number_has_a_fossil_that_does_as_promised() {
    let folder = tempfile::tempdir().unwrap();
    let workers = Pool::new(Start::new(program()));
    let mut numbers = Vec::new();
    for fossil in fossils() {
        let to = folder
            .path()
            .join(format!("libfossil{}.so", number(&fossil)));
        let library = build(&fossil, &fossil.join("plugin.c"), &to);
        let described = catalogue::describe(&library, &workers);
        if number(&fossil) == ABI_NUMBER {
            assert_eq!(described.unwrap().manifest.operations.len(), 1);
        } else {
            let text = described.unwrap_err().to_string();
            has(
                &text,
                &["ABI number", "build it with this host's SDK"],
                "an old fossil",
            );
        }
        numbers.push(number(&fossil));
    }
    numbers.sort_unstable();
    let all: Vec<u32> = (1..=ABI_NUMBER).collect();
    assert_eq!(numbers, all, "a number has no fossil");
}

#[test]
fn a_plugin_of_a_later_sdk_loads_and_works() {
    let folder = tempfile::tempdir().unwrap();
    let fossil = root().join(format!("tests/fossils/v0_{ABI_NUMBER}"));
    let source = root().join("tests/fossils/future.c");
    let library = build(&fossil, &source, &folder.path().join("libfuture.so"));
    let workers = Pool::new(Start::new(program()));
    let packed = catalogue::describe(&library, &workers).unwrap();
    assert!(
        packed.manifest.rest.contains_key("later"),
        "unknown members are kept"
    );
    // It is called as well.
    let bundle = Bundle::of(&["puncta_plugin_text"]);
    let good = |arguments: &[&str]| {
        let mut command = bundle.command();
        let output = command
            .args(arguments)
            .current_dir(folder.path())
            .output()
            .unwrap();
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(output.status.success(), "{arguments:?}: {said}");
    };
    std::fs::write(folder.path().join("in.csv"), "x [nm],y [nm]\n3,1\n-4,2\n").unwrap();
    good(&["plugins", "trust", "libfuture.so"]);
    let call = [
        "op",
        "fossil.v0-1.distance/1",
        "in.csv",
        "--position",
        "1",
        "-o",
        "out.csv",
    ];
    good(&[&["--plugins", "."][..], &call].concat());
    let text = std::fs::read_to_string(folder.path().join("out.csv")).unwrap();
    let last = |line: &str| line.rsplit(',').next().unwrap().parse::<f64>().unwrap();
    let distances: Vec<f64> = text.lines().skip(1).map(last).collect();
    assert_eq!(distances, [2.0, 5.0], "{text}");
}
