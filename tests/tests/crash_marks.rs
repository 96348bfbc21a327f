//! What a session that ended inside a plugin leaves for the next one to say.
#![cfg(target_os = "linux")]
#![allow(clippy::unwrap_used, clippy::expect_used)]

use puncta_tests::lab::{Lab, all_in, entry, text};
use puncta_tests::library;
use std::fs;

#[test]
fn a_crash_in_the_program_itself_is_named_at_the_next_start() {
    use std::os::unix::process::ExitStatusExt;
    let lab = Lab::plain();
    let abort = ["op", "test.misbehave/1", "--fault", "abort"];
    let runs = || {
        let list = lab.json(&["plugins", "list"]);
        let crashes = list["crashes"].as_array().unwrap().len();
        let runs = entry(&list, "plugins", "test.sample").unwrap()["runs"].clone();
        (runs.as_str().unwrap().to_owned(), crashes)
    };
    lab.good(&["op", "test.points/1"]);
    assert!(
        lab.marks().is_empty(),
        "a session that ended properly leaves nothing"
    );
    assert_eq!(lab.run(&abort).status.signal(), Some(6));
    assert_eq!(lab.marks().len(), 1);
    // Nobody reads notes of a quiet command, so that it does not count as told.
    assert_eq!(lab.notes(&["ops", "--quiet"]), "");
    let told = lab.notes(&["ops"]);
    let words = [
        "the last session ended inside plugin test.sample, operation test.misbehave/1, on 20",
        "puncta plugins mode test.sample worker",
        "puncta plugins disable test.sample",
    ];
    all_in(&told, &words);
    assert!(lab.marks().is_empty());
    assert_eq!(lab.notes(&["ops"]), "", "it is said once");
    all_in(&lab.good(&["plugins", "list"]), &["note ", words[0]]);
    assert_eq!(runs(), ("in process".into(), 1));
    // The second time it was enough, here while it was prepared.
    let early = [&abort[..], &["--early"]].concat();
    assert_eq!(lab.run(&early).status.signal(), Some(6));
    let told = lab.notes(&["ops"]);
    all_in(
        &told,
        &[
            "2 sessions ended inside plugin test.sample",
            "in a worker from now on",
        ],
    );
    assert_eq!(runs(), ("worker".into(), 1));
    let output = lab.run(&abort);
    assert_eq!(output.status.code(), Some(1));
    all_in(&text(&output.stderr), &["test.sample", "abort"]);
    // What the person says counts.
    lab.good(&["plugins", "mode", "test.sample", "default"]);
    assert_eq!(runs(), ("in process".into(), 0));
    assert_eq!(lab.notes(&["ops"]), "");
}

#[test]
fn a_session_that_was_killed_inside_a_plugin_is_named() {
    let lab = Lab::plain();
    let mut command = lab.bundle.command();
    let mut child = command
        .args(["op", "test.wait/1", "--time", "60"])
        .current_dir(lab.folder.path())
        .env("PUNCTA_CACHE", lab.folder.path().join("cache"))
        .stderr(std::process::Stdio::null())
        .spawn()
        .unwrap();
    let begin = std::time::Instant::now();
    let waiting = || {
        let bytes = lab
            .marks()
            .first()
            .map(|path| fs::read(path).unwrap_or_default());
        let slot = bytes.as_ref().and_then(|bytes| bytes.get(16..24));
        // The second label is the operation, the first the opening of the library.
        slot.is_some_and(|slot| slot == 2_u64.to_le_bytes())
    };
    while !waiting() {
        assert!(begin.elapsed().as_secs() < 60, "the call is not marked");
        std::thread::sleep(std::time::Duration::from_millis(10));
    }
    // Another session leaves the mark of one that runs alone.
    assert_eq!(lab.notes(&["ops"]), "");
    assert_eq!(lab.marks().len(), 1);
    child.kill().unwrap();
    child.wait().unwrap();
    let told = lab.notes(&["ops"]);
    all_in(&told, &["inside plugin test.sample, operation test.wait/1"]);
    // Another library of the same plugin begins anew.
    let library = lab.bundle.path().join("plugins/puncta_test_sample");
    let library = library.join(library_name());
    let mut bytes = fs::read(&library).unwrap();
    fs::remove_file(&library).unwrap();
    bytes.push(0);
    fs::write(&library, bytes).unwrap();
    lab.good(&["plugins", "trust", library.to_str().unwrap()]);
    let list = lab.json(&["plugins", "list"]);
    assert!(list["crashes"].as_array().unwrap().is_empty());
    assert_eq!(
        entry(&list, "plugins", "test.sample").unwrap()["trusted"]["by"],
        "person"
    );
}

fn library_name() -> std::ffi::OsString {
    library("puncta_test_sample")
        .file_name()
        .unwrap()
        .to_owned()
}

#[test]
fn records_of_crashes_keep_nobody_from_working() {
    let lab = Lab::plain();
    let state = lab.bundle.config().join("state");
    fs::create_dir_all(&state).unwrap();
    fs::write(state.join("crashes.json"), "{").unwrap();
    fs::write(state.join("running-odd"), "rubbish").unwrap();
    let told = lab.notes(&["op", "test.points/1"]);
    all_in(&told, &["crashes.json", "damaged"]);
    assert_eq!(fs::read_to_string(state.join("crashes.json")).unwrap(), "{");
}
