//! The validator: a plugin that is right passes every check, and one with a single fault fails the
//! check for it and no other.
#![cfg(target_os = "linux")]
#![allow(clippy::unwrap_used, clippy::expect_used)]

use puncta_tests::{Bundle, c, faults::all, library, product, root};
use serde_json::Value;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;

fn bundle() -> &'static Bundle {
    static BUNDLE: OnceLock<Bundle> = OnceLock::new();
    BUNDLE.get_or_init(|| {
        Bundle::of(&[
            "puncta_plugin_filter",
            "puncta_plugin_synthetic",
            "puncta_plugin_text",
        ])
    })
}

/// What the program says of a library, and whether it is content.
fn checked(library: &Path, more: &[&str]) -> (Value, bool) {
    let mut command = bundle().command();
    let output = command
        .args(["plugins", "check", "--json"])
        .arg(library)
        .args(more)
        .output()
        .unwrap();
    let text = String::from_utf8_lossy(&output.stdout);
    let value = serde_json::from_str(&text).unwrap_or_else(|error| {
        let said = String::from_utf8_lossy(&output.stderr);
        panic!("{}: {error}: {text}{said}", library.display())
    });
    (value, output.status.success())
}

/// Sentences by check, of those that ended so.
fn ended(report: &Value, statuses: &[&str]) -> BTreeMap<String, String> {
    let checks = report["checks"].as_array().unwrap().iter();
    let those = checks.filter(|one| statuses.contains(&one["status"].as_str().unwrap()));
    let pair = |one: &Value| {
        let text = |name: &str| one[name].as_str().unwrap().to_owned();
        (text("check"), text("sentence"))
    };
    those.map(pair).collect()
}

/// Ids of all checks.
fn ids() -> Vec<String> {
    let mut command = bundle().command();
    let output = command.args(["plugins", "check", "--list", "--json"]);
    let list: Value = serde_json::from_slice(&output.output().unwrap().stdout).unwrap();
    let checks = list["checks"].as_array().unwrap().iter();
    checks
        .map(|one| one["check"].as_str().unwrap().to_owned())
        .collect()
}

fn passes(library: &Path) {
    let (report, good) = checked(library, &["--strictness", "10"]);
    let bad = ended(&report, &["failed", "crashed", "warning"]);
    assert!(good && bad.is_empty(), "{}: {bad:#?}", library.display());
    let passed = ended(&report, &["passed"]).len();
    assert!(
        passed >= 40,
        "only {passed} checks of {}",
        library.display()
    );
}

#[test]
fn plugins_that_are_right_pass_everything() {
    let folder = tempfile::tempdir().unwrap();
    passes(&c::broken(folder.path(), "none"));
    for package in ["puncta_plugin_filter", "puncta_plugin_text"] {
        passes(&library(package));
    }
}

/// Every plugin of the bundle, which takes some minutes.
#[test]
fn every_plugin_of_the_bundle_passes_everything() {
    if std::env::var_os("PUNCTA_TEST_ALL").is_none() {
        return;
    }
    let folders = std::fs::read_dir(root().join("plugins")).unwrap().flatten();
    let names = folders
        .filter(|folder| folder.path().join("Cargo.toml").is_file())
        .map(|folder| folder.file_name().to_string_lossy().replace('-', "_"));
    all(names, |name| {
        passes(&library(&format!("puncta_plugin_{name}")))
    });
}

/// A library with one fault.
fn faulty(folder: &Path, check: &str) -> PathBuf {
    use std::env::consts::{DLL_PREFIX, DLL_SUFFIX};
    let place = |name: &str| folder.join(format!("{DLL_PREFIX}{name}{DLL_SUFFIX}"));
    match check {
        "door" => product(&format!("examples/{DLL_PREFIX}doctored{DLL_SUFFIX}")),
        "whole" => {
            let bytes = std::fs::read(c::broken(folder, "none")).unwrap();
            std::fs::write(place("half"), &bytes[..bytes.len() / 2]).unwrap();
            place("half")
        }
        "symbol" => c::compile(
            &[&root().join("tests/broken/broken.c")],
            &["-DOTHER_NUMBER"],
            &place("other_number"),
        ),
        "opens" => c::without_its_library(folder),
        "symbol-kind" => c::compile(
            &[&root().join("tests/broken/broken.c")],
            &["-DAS_FUNCTION", "-Wa,--no-warn"],
            &place("as_function"),
        ),
        check => c::broken(folder, check),
    }
}

/// Among the checks that a fault's own needs; with `PUNCTA_TEST_ALL` among all, which takes minutes
/// and a quiet machine, since some measure times.
#[test]
fn each_fault_fails_its_own_check_and_no_other() {
    let whole = std::env::var_os("PUNCTA_TEST_ALL").is_some();
    let folder = tempfile::tempdir().unwrap();
    let ids = ids();
    assert!(ids.len() >= 40, "{}", ids.len());
    let (left, right) = ids.split_at(ids.len() / 2);
    let one = |check: &String| {
        let library = faulty(folder.path(), check);
        let some = ["--strictness", "8", "--only", check];
        let (report, good) = checked(&library, if whole { &some[..2] } else { &some });
        let bad = ended(&report, &["failed", "crashed"]);
        let names: Vec<&String> = bad.keys().collect();
        assert_eq!(names, [check], "{bad:#?}");
        let sentence = &bad[check];
        assert!(!good && !sentence.is_empty() && !sentence.contains('\n'));
        // Where something was not asked, it says why.
        let skipped = ended(&report, &["skipped"]);
        assert!(skipped.values().all(|why| !why.is_empty()), "{skipped:?}");
    };
    std::thread::scope(|scope| {
        scope.spawn(|| all(left, one));
        all(right, one);
    });
}

#[test]
fn sentences_say_what_was_being_done() {
    let folder = tempfile::tempdir().unwrap();
    for (fault, words) in [
        (
            "inputs-unchanged",
            &["test.broken.double/1", "writes into column x"][..],
        ),
        (
            "writes-within",
            &["outside column doubled of its output table"],
        ),
        ("wrong-types", &["columns of f32", "segmentation fault"]),
        ("memory-returned", &["MB of memory"]),
        ("cancel-said", &["cancelled at its poll", "FAILED"]),
    ] {
        let (report, _) = checked(&c::broken(folder.path(), fault), &["--only", fault]);
        let bad = ended(&report, &["failed", "crashed"]);
        for word in words {
            assert!(bad[fault].contains(word), "{fault}: {}", bad[fault]);
        }
    }
}

#[test]
fn one_check_runs_with_what_it_needs() {
    let folder = tempfile::tempdir().unwrap();
    let library = c::broken(folder.path(), "none");
    let (report, good) = checked(&library, &["--only", "units"]);
    let passed: Vec<String> = ended(&report, &["passed"]).into_keys().collect();
    assert!(
        good && passed.contains(&"units".to_owned()) && passed.len() < 12,
        "{passed:?}"
    );
    let few = checked(&library, &["--strictness", "1"]).0;
    let all = checked(&library, &["--strictness", "7"]).0;
    let count = |report: &Value| report["checks"].as_array().unwrap().len();
    assert!(count(&few) < count(&all));
    let mut command: Command = bundle().command();
    let output = command
        .args(["plugins", "check", "--only", "beauty"])
        .arg(&library);
    let output = output.output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(
        !output.status.success() && said.contains("no check beauty"),
        "{said}"
    );
}
