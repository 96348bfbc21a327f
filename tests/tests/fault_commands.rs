//! Faults and Ctrl-C as a person meets them at the command line.
#![cfg(target_os = "linux")]
#![allow(clippy::unwrap_used, clippy::expect_used)]

use puncta_tests::{Bundle, left};
use serde_json::Value;
use std::path::Path;
use std::process::{Child, Command, Output, Stdio};
use std::sync::OnceLock;
use std::time::{Duration, Instant};

fn bundle() -> &'static Bundle {
    static BUNDLE: OnceLock<Bundle> = OnceLock::new();
    let packages = [
        "puncta_plugin_text",
        "puncta_test_fault",
        "puncta_test_sample",
    ];
    BUNDLE.get_or_init(|| Bundle::of(&packages))
}

fn command(folder: &Path, arguments: &[&str]) -> Command {
    let mut command = bundle().command();
    command
        .args(arguments)
        .current_dir(folder)
        .stdin(Stdio::null());
    command
}

fn puncta(folder: &Path, arguments: &[&str]) -> Output {
    command(folder, arguments).output().expect("puncta runs")
}

fn names(folder: &Path) -> Vec<String> {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let names = entries.map(|entry| entry.file_name().to_string_lossy().into_owned());
    let mut names: Vec<String> = names.collect();
    names.sort();
    names
}

const CSV: &str = "x [nm],y [nm]\n1,2\n3,4\n";

#[test]
fn a_crash_is_one_sentence_and_an_exit_code() {
    let folder = tempfile::tempdir().unwrap();
    let place = folder.path();
    std::fs::write(place.join("a.csv"), CSV).unwrap();
    let cases = [
        ("panic", "this plugin is wrong"),
        ("segfault", "segmentation fault"),
        ("exit-three", "exit status 3"),
        ("overflow", "stack"),
    ];
    for (fault, word) in cases {
        for phase in ["prepare", "run"] {
            let operation = format!("fault.{fault}/1");
            let arguments = ["op", &operation, "a.csv", "--phase", phase, "-o", "b.csv"];
            let output = puncta(place, &[&arguments[..], &["--json"]].concat());
            let text = String::from_utf8_lossy(&output.stderr).trim().to_owned();
            assert_eq!(output.status.code(), Some(1), "{text}");
            assert!(
                text.starts_with("puncta: ") && text.lines().count() == 1,
                "{text}"
            );
            for word in ["test.fault", &operation, word] {
                assert!(
                    text.contains(word),
                    "{fault} in {phase}: no \"{word}\" in {text}"
                );
            }
            let told: Value = serde_json::from_slice(&output.stdout).unwrap();
            assert_eq!(told["error"]["code"], "crashed", "{told}");
            assert_eq!(names(place), ["a.csv"], "{fault} in {phase}");
        }
    }
}

const RECIPE: &str = r#"format = "puncta.recipe/1"
[steps.points]
op = "test.points/1"
[steps.bad]
op = "fault.FAULT/1"
in.table = "points"
set.phase = "run"
[steps.after]
op = "test.scale/1"
in.table = "bad"
[outputs]
"points.csv" = "points"
"after.csv" = "after"
"#;

fn state(told: &Value, step: &str) -> String {
    let steps = told["steps"].as_array().unwrap();
    let found = steps.iter().find(|one| one["name"] == step).unwrap();
    found["state"].as_str().unwrap().into()
}

#[test]
fn a_crash_in_a_recipe_leaves_the_rest_standing() {
    let folder = tempfile::tempdir().unwrap();
    let place = folder.path();
    std::fs::write(place.join("r.toml"), RECIPE.replace("FAULT", "abort")).unwrap();
    let output = puncta(place, &["run", "r.toml", "--out", "out", "--json"]);
    let text = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(3), "{text}");
    for word in ["step bad", "test.fault", "fault.abort/1", "abort"] {
        assert!(text.contains(word), "no \"{word}\" in {text}");
    }
    let told: Value = serde_json::from_slice(&output.stdout).unwrap();
    let states = ["points", "bad", "after"].map(|step| state(&told, step));
    assert_eq!(states, ["done", "failed", "skipped"]);
    let files = names(&place.join("out"));
    assert!(files.contains(&"points.csv".into()), "{files:?}");
    assert!(
        !files.iter().any(|file| file.starts_with("after")),
        "{files:?}"
    );
}

/// A run whose step `bad` loops for ever, and the numbers of its workers.
fn hanging(place: &Path) -> (Child, Vec<u32>) {
    std::fs::write(place.join("r.toml"), RECIPE.replace("FAULT", "hang")).unwrap();
    let arguments = ["run", "r.toml", "--isolated", "--out", "out", "--json"];
    let child = command(place, &arguments)
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let looping = || {
        left::workers_of(child.id())
            .into_iter()
            .any(|one| left::ticks(one) > 30)
    };
    assert!(left::soon(Duration::from_secs(60), looping), "nothing runs");
    let workers = left::workers_of(child.id());
    (child, workers)
}

#[test]
fn ctrl_c_returns_at_once_with_a_report() {
    let folder = tempfile::tempdir().unwrap();
    let place = folder.path();
    let (child, workers) = hanging(place);
    let begin = Instant::now();
    left::interrupt(child.id());
    let output = child.wait_with_output().unwrap();
    // 250 ms are promised, with a fourfold margin.
    assert!(
        begin.elapsed() < Duration::from_secs(1),
        "{:?}",
        begin.elapsed()
    );
    let text = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(130), "{text}");
    assert!(!text.contains("panicked"), "{text}");
    let told: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(told["cancelled"], true);
    let states = ["points", "bad", "after"].map(|step| state(&told, step));
    assert_eq!(states, ["done", "stopped", "stopped"]);
    // Nothing is half-written, in the folder or beside it.
    assert!(
        names(&place.join("out")).is_empty(),
        "{:?}",
        names(&place.join("out"))
    );
    let known = ["out", "r.toml"];
    assert!(
        names(place)
            .iter()
            .all(|name| known.contains(&name.as_str()))
    );
    let gone = || !workers.iter().any(|one| left::runs(*one));
    assert!(left::soon(Duration::from_secs(2), gone), "a worker is left");
}

#[test]
fn ctrl_c_stops_a_single_operation() {
    let folder = tempfile::tempdir().unwrap();
    let place = folder.path();
    std::fs::write(place.join("a.csv"), CSV).unwrap();
    let arguments = [
        "op",
        "fault.hang/1",
        "a.csv",
        "--phase",
        "run",
        "-o",
        "b.csv",
    ];
    let child = command(place, &arguments)
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let looping = || {
        left::workers_of(child.id())
            .into_iter()
            .any(|one| left::ticks(one) > 30)
    };
    assert!(left::soon(Duration::from_secs(60), looping), "nothing runs");
    let begin = Instant::now();
    left::interrupt(child.id());
    let output = child.wait_with_output().unwrap();
    assert!(
        begin.elapsed() < Duration::from_secs(1),
        "{:?}",
        begin.elapsed()
    );
    let text = String::from_utf8_lossy(&output.stderr).trim().to_owned();
    assert_eq!(output.status.code(), Some(130), "{text}");
    assert!(
        text.contains("stopped") && text.lines().count() == 1,
        "{text}"
    );
    assert_eq!(names(place), ["a.csv"]);
}

#[test]
fn workers_end_with_a_host_that_was_killed() {
    let folder = tempfile::tempdir().unwrap();
    let (mut child, workers) = hanging(folder.path());
    left::kill(child.id());
    child.wait().unwrap();
    let gone = || !workers.iter().any(|one| left::runs(*one));
    assert!(
        left::soon(Duration::from_secs(2), gone),
        "a worker outlives its host"
    );
}
