//! Faults in readers, writers, and libraries that are being opened.
#![cfg(target_os = "linux")]
#![allow(clippy::unwrap_used, clippy::expect_used)]

use puncta_engine::documents::{Failure, Map};
use puncta_engine::plugins::catalogue;
use puncta_engine::worker::{Pool, Start};
use puncta_tests::faults::{Bench, DEADLY, LEAVING, all, has, pairs, turn};
use puncta_tests::{fingerprint, left, library, program, unwatched};
use serde_json::json;
use std::path::{Path, PathBuf};
use std::sync::Arc;

#[test]
fn a_reader_that_crashes_costs_its_own_file() {
    let _turn = turn();
    let bench = Bench::new();
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("a.fault");
    let read = |orders: &str| {
        std::fs::write(&file, format!("puncta-fault\n{orders}\n")).unwrap();
        bench.engine.read(&file, None, &Map::new(), &unwatched())
    };
    let truth = fingerprint(&read("").unwrap().objects);
    let phases = ["prepare", "run", "commit"];
    all(pairs(&DEADLY, &phases), |((fault, words), phase)| {
        let what = format!("{fault} in {phase} of a reader");
        let read_now = read(&format!("{phase} {fault} file"));
        let text = read_now.unwrap_err().to_string();
        has(&text, &["test.fault", "fault.read/1"], &what);
        has(&text, words, &what);
        assert_eq!(fingerprint(&read("").unwrap().objects), truth, "{what}");
    });
    bench.end();
}

#[test]
fn a_writer_that_crashes_leaves_no_file() {
    let _turn = turn();
    let bench = Bench::new();
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("a.faulty");
    let orders = tempfile::tempdir().unwrap();
    let orders = orders.path().join("orders");
    let parameters = json!({"orders": orders});
    let write = |fault: &str, phase: &str| {
        std::fs::write(&orders, format!("{phase} {fault} writer\n")).unwrap();
        let parameters = parameters.as_object().unwrap();
        let engine = &bench.engine;
        engine.write(&file, None, parameters, &bench.table, true, &unwatched())
    };
    let files = || -> Vec<_> {
        let entries = std::fs::read_dir(folder.path()).unwrap().flatten();
        entries.map(|entry| entry.file_name()).collect()
    };
    all(
        pairs(&DEADLY, &["run", "finished"]),
        |((fault, words), phase)| {
            let what = format!("{fault} in {phase} of a writer");
            let text = write(fault, phase).unwrap_err().to_string();
            has(&text, &["test.fault", "fault.write/1"], &what);
            has(&text, words, &what);
            assert!(files().is_empty(), "{what} left {:?}", files());
        },
    );
    write("panic", "never").unwrap();
    let whole = std::fs::read_to_string(&file).unwrap();
    assert_eq!(whole.lines().count(), 5000);
    // What was there stays whole.
    assert!(write("segfault", "run").is_err());
    assert_eq!(std::fs::read_to_string(&file).unwrap(), whole);
    assert_eq!(files(), ["a.faulty"]);
    bench.end();
}

/// A copy of the fault plugin, alone in a folder, with orders beside it.
fn lone_library(folder: &Path, orders: &str) -> PathBuf {
    let library = library("puncta_test_fault");
    let copy = folder.join(library.file_name().unwrap());
    if !copy.exists() {
        std::fs::copy(library, &copy).unwrap();
    }
    std::fs::write(format!("{}.orders", copy.display()), orders).unwrap();
    copy
}

/// What a library says when it is asked what it is, while orders lie beside it.
struct Describer {
    folder: tempfile::TempDir,
    workers: Arc<Pool>,
}

impl Describer {
    fn new() -> Describer {
        Describer {
            folder: tempfile::tempdir().unwrap(),
            workers: Arc::new(Pool::new(Start::new(program()))),
        }
    }

    fn ask(&self, orders: &str) -> Result<catalogue::Packed, Failure> {
        let library = lone_library(self.folder.path(), orders);
        catalogue::describe(&library, &self.workers)
    }

    fn end(self) {
        drop(self);
        left::nothing();
    }
}

const OPENING: [&str; 3] = ["load", "describe", "create"];

#[test]
fn a_library_that_crashes_when_it_is_opened_is_refused() {
    let _turn = turn();
    let describer = Describer::new();
    let good = describer.ask("").unwrap().manifest;
    let deadly = pairs(&DEADLY[..10], &OPENING).into_iter();
    let deadly = deadly.map(|((fault, words), phase)| (fault, phase, words));
    let lies: [(&str, &str, &[&str]); 12] = [
        ("panic", "load", &["abort"]),
        ("panic", "describe", &["cannot describe itself"]),
        ("panic", "create", &["abort"]),
        ("bad_document", "describe", &["describes itself"]),
        ("null_document", "describe", &["describes itself"]),
        ("not_utf8", "describe", &["describes itself"]),
        ("wild_size", "load", &["size"]),
        ("wild_number", "load", &["tables"]),
        ("null_table", "load", &["no function"]),
        ("wild_status", "create", &["refuses to start"]),
        ("null_table", "describe", &["call/1"]),
        ("wild_size", "describe", &["call/1"]),
    ];
    all(deadly.chain(lies), |(fault, phase, words)| {
        let what = format!("{fault} in {phase}");
        let failure = match describer.ask(&format!("{phase} {fault} library")) {
            Err(failure) => failure,
            Ok(_) => panic!("{what} was not noticed"),
        };
        let text = failure.to_string();
        has(&text, &["puncta_test_fault"], &what);
        has(&text, words, &what);
        assert_eq!(describer.ask("").unwrap().manifest, good, "{what}");
    });
    describer.end();
}

#[test]
fn what_a_library_leaves_behind_when_it_is_opened_is_gone() {
    let _turn = turn();
    let describer = Describer::new();
    let good = describer.ask("").unwrap().manifest;
    all(pairs(&LEAVING, &OPENING), |(fault, phase)| {
        let described = describer.ask(&format!("{phase} {fault} library"));
        let why = |failure| panic!("{fault} in {phase}: {failure}");
        assert_eq!(described.unwrap_or_else(why).manifest, good);
        let gone = || left::processes_left().is_empty();
        assert!(
            left::soon(std::time::Duration::from_secs(2), gone),
            "{fault} in {phase}"
        );
    });
    describer.end();
}

/// Takes the minute after which a silent worker is ended.
#[test]
fn a_library_that_hangs_when_it_is_opened_is_ended() {
    if std::env::var_os("PUNCTA_TEST_ALL").is_none() {
        return;
    }
    let _turn = turn();
    std::thread::scope(|scope| {
        for phase in OPENING {
            scope.spawn(move || {
                let describer = Describer::new();
                let asked = describer.ask(&format!("{phase} hang library"));
                let text = asked.unwrap_err().to_string();
                has(&text, &["puncta_test_fault", "did not answer"], phase);
                assert!(describer.ask("").is_ok());
            });
        }
    });
    left::nothing();
}
