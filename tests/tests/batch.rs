//! Many files through one recipe: a bad file never stops the rest, and what was done stands.
#![cfg(target_os = "linux")]
#![allow(clippy::unwrap_used, clippy::expect_used)]

use puncta_tests::Bundle;
use serde_json::Value;
use std::path::Path;
use std::process::Output;
use std::sync::OnceLock;

fn bundle() -> &'static Bundle {
    static BUNDLE: OnceLock<Bundle> = OnceLock::new();
    BUNDLE.get_or_init(|| {
        Bundle::of(&[
            "puncta_plugin_filter",
            "puncta_plugin_text",
            "puncta_test_fault",
        ])
    })
}

fn puncta(folder: &Path, arguments: &[&str]) -> Output {
    let mut command = bundle().command();
    command.args(arguments).current_dir(folder);
    command.output().expect("puncta runs")
}

const RECIPE: &str = r#"
format = "puncta.recipe/1"
[inputs.locs]
kind = "table"
[steps.good]
op = "puncta.filter.range/1"
in.table = "locs"
set.ranges = { x = [0, 100] }
[outputs]
"{input}-good.csv" = "good"
"#;

const GOOD: usize = 89;
const CORRUPT: usize = 10;

/// 89 good files, 10 that are cut or garbage, and one whose reader crashes.
fn files(folder: &Path) -> Vec<String> {
    let mut names = Vec::new();
    let mut file = |name: String, bytes: &[u8]| {
        std::fs::write(folder.join(&name), bytes).unwrap();
        names.push(name);
    };
    for number in 0..GOOD {
        let text = format!(
            "x [nm],y [nm],frame\n1,{number},1\n500,2,2\n7,8,{}\n",
            number + 3
        );
        file(format!("a{number:02}.csv"), text.as_bytes());
    }
    for number in 0..CORRUPT {
        let text = match number % 3 {
            0 => "x [nm],y [nm],frame\n1,2,3\n4,five,6\n".to_owned(),
            1 => String::new(),
            _ => "x [nm],y [nm],frame\n1,2,3\n4\n".to_owned(),
        };
        file(format!("bad{number}.csv"), text.as_bytes());
    }
    file("worst.fault".into(), b"puncta-fault\nrun abort file\n");
    std::fs::write(folder.join("r.toml"), RECIPE).unwrap();
    names
}

fn record(folder: &Path) -> Value {
    let text = std::fs::read_to_string(folder.join("out/batch.json")).unwrap();
    serde_json::from_str(&text).unwrap()
}

fn states(record: &Value, state: &str) -> Vec<String> {
    let files = record["files"].as_array().unwrap().iter();
    let those = files.filter(|file| file["state"] == state);
    those
        .map(|file| file["label"].as_str().unwrap().to_owned())
        .collect()
}

fn batch(folder: &Path, names: &[String], more: &[&str]) -> Output {
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    puncta(
        folder,
        &[&["batch", "r.toml", "--out", "out"], &names[..], more].concat(),
    )
}

#[test]
fn eleven_bad_files_of_a_hundred_leave_eighty_nine_results() {
    let folder = tempfile::tempdir().unwrap();
    let names = files(folder.path());
    let output = batch(
        folder.path(),
        &names,
        &["--collect", "all.csv={input}-good.csv"],
    );
    let errors = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(3), "{errors}");
    let value = record(folder.path());
    assert_eq!(states(&value, "done").len(), GOOD);
    let failed = states(&value, "failed");
    assert_eq!(failed.len(), CORRUPT + 1, "{errors}");
    assert!(failed.contains(&"worst".to_owned()) && failed.contains(&"bad0".to_owned()));
    for file in value["files"].as_array().unwrap() {
        let (path, errors) = (file["path"].as_str().unwrap(), &file["errors"]);
        assert_eq!(file["state"] != "done", errors.is_array(), "{file}");
        if let Some(error) = errors.as_array().and_then(|all| all[0].as_str()) {
            let name = Path::new(path).file_name().unwrap().to_str().unwrap();
            let named = error.contains(name) || error.contains("test.fault");
            assert!(named, "{error} names no file");
        }
    }
    for number in 0..GOOD {
        let name = format!("out/a{number:02}-good.csv");
        let text = std::fs::read_to_string(folder.path().join(&name)).unwrap();
        assert_eq!(text.lines().count(), 3, "{name}: {text}");
        assert!(folder.path().join(format!("{name}.puncta.json")).exists());
    }
    // Two rows of each file, beside the name of the file.
    let all = std::fs::read_to_string(folder.path().join("out/all.csv")).unwrap();
    assert_eq!(all.lines().count(), 2 * GOOD + 1);
    assert!(all.lines().next().unwrap().contains("file"));
    assert!(all.lines().nth(1).unwrap().contains("a00"), "{all}");
    assert!(all.lines().last().unwrap().contains("a88"));
    let page = std::fs::read_to_string(folder.path().join("out/batch.html")).unwrap();
    assert!(page.contains("100 files: 89 done, 11 failed"));
    assert!(page.contains("./a07-good.csv"));
}

#[test]
fn a_batch_goes_on_where_it_was_ended() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let names = files(at);
    let (first, all) = (&names[..20], &names[..40]);
    assert!(batch(at, first, &[]).status.success());
    let output = batch(at, all, &[]);
    let text = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(
        text.contains("holds a batch already; add --resume"),
        "{text}"
    );

    // One output is gone, one input has changed, one was under way when the batch was ended.
    std::fs::remove_file(at.join("out/a03-good.csv")).unwrap();
    std::fs::write(
        at.join("a05.csv"),
        "x [nm],y [nm],frame\n1,0,1\n2,2,2\n3,8,3\n",
    )
    .unwrap();
    let mut value = record(at);
    value["files"][7]["state"] = "running".into();
    std::fs::write(at.join("out/batch.json"), value.to_string()).unwrap();
    let kept = at
        .join("out/a04-good.csv")
        .metadata()
        .unwrap()
        .modified()
        .unwrap();
    let output = batch(at, all, &["--resume"]);
    let text = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.success(), "{text}");
    assert_eq!(text.matches("done before").count(), 17, "{text}");
    assert_eq!(states(&record(at), "done").len(), 40);
    let now = at
        .join("out/a04-good.csv")
        .metadata()
        .unwrap()
        .modified()
        .unwrap();
    assert_eq!(now, kept);
    let changed = std::fs::read_to_string(at.join("out/a05-good.csv")).unwrap();
    assert_eq!(changed.lines().count(), 4);

    std::fs::write(at.join("r.toml"), RECIPE.replace("100]", "90]")).unwrap();
    let output = batch(at, all, &["--resume"]);
    let text = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(text.contains("was of another recipe"), "{text}");
    assert!(
        batch(at, all, &["--resume", "--overwrite"])
            .status
            .success()
    );
}

#[test]
fn wrong_arguments_are_refused_before_anything_runs() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let names = files(at);
    let refused = |more: &[&str], expected: &str| {
        let output = batch(at, &names[..2], more);
        let text = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(2), "{text}");
        assert!(text.contains(expected), "{text}");
        assert!(!at.join("out").exists());
    };
    refused(
        &["--each", "beads"],
        "no free input beads; its inputs are locs",
    );
    refused(
        &["--input", "locs=a00.csv"],
        "every input of the recipe has its file",
    );
    refused(
        &["--collect", "all.csv=x.csv"],
        "writes no file x.csv; it writes {input}-good.csv",
    );
    refused(&["--collect", "all.csv"], "write FILE=OUTPUT");
    std::fs::create_dir(at.join("folder")).unwrap();
    refused(&["folder"], "folder is a folder; name its files");
}

#[test]
fn a_batch_that_is_killed_is_resumed_to_the_same_files() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let names = files(at)[..60].to_vec();
    let mut command = bundle().command();
    command
        .args(["batch", "r.toml", "--out", "out", "-q"])
        .args(&names);
    let mut child = command.current_dir(at).spawn().unwrap();
    while record_or_none(at).is_none_or(|value| states(&value, "done").len() < 10) {
        std::thread::sleep(std::time::Duration::from_millis(2));
    }
    child.kill().unwrap();
    child.wait().unwrap();
    assert!(
        states(&record(at), "done").len() < 60,
        "the batch was over too soon"
    );
    assert!(batch(at, &names, &["--resume"]).status.success());
    assert_eq!(states(&record(at), "done").len(), 60);
    let entries = std::fs::read_dir(at.join("out")).unwrap().flatten();
    let names: Vec<String> = entries
        .map(|entry| entry.file_name().to_string_lossy().into_owned())
        .filter(|name| !name.starts_with(".puncta-"))
        .collect();
    assert_eq!(names.len(), 2 * 60 + 2, "{names:?}");
}

fn record_or_none(folder: &Path) -> Option<Value> {
    let text = std::fs::read_to_string(folder.join("out/batch.json")).ok()?;
    serde_json::from_str(&text).ok()
}
