//! Who is trusted, and what happens to the others, through the program as a person uses it.
#![cfg(target_os = "linux")]
#![allow(clippy::unwrap_used, clippy::expect_used)]

use puncta_tests::lab::{Lab, all_in, entry, text};
use puncta_tests::{Bundle, library, root};
use serde_json::Value;
use std::fs;
use std::path::Path;

const SING: [&str; 2] = ["op", "test.canary.sing/1"];
const RECIPE: &str = "format = \"puncta.recipe/1\"\n[steps.song]\nop = \"test.canary.sing/1\"\n\
    [outputs]\n\"song.csv\" = \"song\"\n";

#[test]
fn nothing_of_a_library_runs_before_consent() {
    let lab = Lab::with_canary();
    let shown = lab.canary().display().to_string();
    let list = lab.json(&["plugins", "list"]);
    let waiting = &list["waiting"][0];
    assert_eq!(waiting["library"], *shown);
    assert_eq!(waiting["bytes"], fs::metadata(lab.canary()).unwrap().len());
    assert_eq!(waiting["hash"].as_str().map(str::len), Some(64));
    assert!(waiting["modified"].as_str().unwrap().ends_with('Z'));
    assert!(entry(&list, "plugins", "test.canary").is_none());
    let words = [
        "waiting",
        &shown,
        "puncta plugins trust",
        "hash ",
        "bytes, changed ",
    ];
    all_in(&lab.good(&["plugins", "list"]), &words);
    // Without a description nobody knows what is in it, and the sentence still says where to look.
    all_in(
        &lab.refused(&SING),
        &["test.canary.sing/1", "puncta plugins list"],
    );
    lab.write("r.toml", RECIPE);
    lab.refused(&["run", "r.toml"]);
    for isolation in ["--isolated", "--in-process"] {
        lab.refused(&["op", "test.canary.sing/1", isolation]);
    }
    assert_eq!(lab.songs(), 0, "the library was opened");
    // After it, everything works.
    let trusted = lab.json(&["plugins", "trust", &shown]);
    assert_eq!(trusted["trusted"]["id"], "test.canary");
    assert_eq!(lab.songs(), 1, "describing opens it once");
    let list = lab.json(&["plugins", "list"]);
    let plugin = entry(&list, "plugins", "test.canary").unwrap();
    assert_eq!(plugin["trusted"]["by"], "person");
    assert_eq!(plugin["runs"], "worker");
    assert_eq!(lab.songs(), 1, "the description is remembered");
    lab.good(&["run", "r.toml"]);
    assert!(lab.folder.path().join("song.csv").is_file());
    assert_eq!(lab.songs(), 2);
}

#[test]
fn a_claimed_description_names_the_remedy_and_runs_nothing() {
    let lab = Lab::with_canary();
    let shown = lab.canary().display().to_string();
    lab.good(&["plugins", "pack", &shown]);
    let before = lab.songs();
    assert_eq!(before, 1, "packing describes it, as its author asked");
    let remedy = format!("run puncta plugins trust {shown}");
    all_in(
        &lab.refused(&SING),
        &["test.canary", "waits for your consent", &remedy],
    );
    lab.write("r.toml", RECIPE);
    let sentence = lab.refused(&["run", "r.toml"]);
    all_in(
        &sentence,
        &["line 3", "step song", "test.canary.sing/1", &remedy],
    );
    assert_eq!(lab.songs(), before);
    // By its id, since only one library claims it.
    lab.good(&["plugins", "trust", "test.canary"]);
    lab.good(&SING);
    let sentence = lab.refused(&["plugins", "trust", "test.nothing"]);
    all_in(&sentence, &["test.nothing", "no library"]);
}

#[test]
fn a_change_asks_for_consent_again() {
    let lab = Lab::with_canary();
    let shown = lab.canary().display().to_string();
    lab.good(&["plugins", "trust", &shown]);
    lab.good(&SING);
    let before = lab.songs();
    let mut bytes = fs::read(lab.canary()).unwrap();
    bytes.push(0);
    fs::write(lab.canary(), &bytes).unwrap();
    let list = lab.good(&["plugins", "list"]);
    let day = lab.json(&["plugins", "list"])["waiting"][0]["why"].to_string();
    all_in(&list, &["has changed since it was trusted on 20", &shown]);
    assert!(
        day.contains("has changed since it was trusted on 20"),
        "{day}"
    );
    lab.refused(&SING);
    assert_eq!(lab.songs(), before);
    lab.good(&["plugins", "trust", &shown]);
    lab.good(&SING);
    // The old one is still trusted: consent is to a hash, not to a place.
    bytes.pop();
    fs::write(lab.canary(), &bytes).unwrap();
    lab.good(&SING);
}

#[test]
fn a_list_in_a_folder_of_plugins_is_not_believed() {
    let lab = Lab::plain();
    let other = Bundle::of(&["puncta_test_canary"]);
    let plugins = other.path().join("plugins");
    assert!(plugins.join("bundle.json").is_file());
    let plugins = plugins.to_str().unwrap();
    let sentence = lab.refused(&["--plugins", plugins, "op", "test.canary.sing/1"]);
    all_in(&sentence, &["test.canary", "waits for your consent"]);
    assert_eq!(lab.songs(), 0);
    // Its own program believes it, wherever the library is.
    let copy = lab.folder.path().join("elsewhere");
    fs::create_dir_all(&copy).unwrap();
    fs::copy(library("puncta_test_canary"), copy.join("libcanary.so")).unwrap();
    let mut command = other.command();
    command
        .args(["plugins", "list", "--json"])
        .arg("--plugins")
        .arg(copy);
    let list: Value = serde_json::from_slice(&command.output().unwrap().stdout).unwrap();
    let plugin = entry(&list, "plugins", "test.canary").unwrap();
    assert_eq!(plugin["trusted"]["by"], "bundle");
    assert!(list["waiting"].as_array().unwrap().is_empty());
}

#[test]
fn a_disabled_plugin_hides_what_it_offers() {
    let lab = Lab::plain();
    lab.good(&["op", "test.points/1", "-o", "p.csv"]);
    let chosen = lab.json(&["plugins", "disable", "test.sample"]);
    assert_eq!(chosen["plugin"]["enabled"], false);
    assert!(!lab.good(&["ops"]).contains("test.points"));
    let sentence = lab.refused(&["op", "test.points/1"]);
    all_in(
        &sentence,
        &[
            "test.sample is disabled",
            "puncta plugins enable test.sample",
        ],
    );
    lab.write(
        "r.toml",
        "format = \"puncta.recipe/1\"\n[steps.p]\nop = \"test.points/1\"\n",
    );
    let sentence = lab.refused(&["run", "r.toml"]);
    all_in(&sentence, &["step p", "line 3", "test.sample is disabled"]);
    let list = lab.json(&["plugins", "list"]);
    let plugin = entry(&list, "plugins", "test.sample").unwrap();
    assert_eq!(
        (&plugin["enabled"], &plugin["runs"]),
        (&false.into(), &"disabled".into())
    );
    // A reader that is switched off is named where the file is read.
    lab.good(&["plugins", "disable", "puncta.text"]);
    let sentence = lab.refused(&["info", "p.csv"]);
    all_in(&sentence, &["p.csv", "puncta.text is disabled"]);
    lab.good(&["plugins", "enable", "puncta.text"]);
    lab.good(&["plugins", "enable", "test.sample"]);
    lab.good(&["run", "r.toml"]);
    let sentence = lab.refused(&["plugins", "disable", "test.simple"]);
    all_in(&sentence, &["test.simple", "there is test.sample"]);
}

#[test]
fn the_person_chooses_where_a_plugin_runs() {
    let lab = Lab::with_canary();
    lab.good(&["plugins", "trust", lab.canary().to_str().unwrap()]);
    let runs = |id: &str, more: &[&str]| {
        let list = lab.json(&[&["plugins", "list"], more].concat());
        entry(&list, "plugins", id).unwrap()["runs"]
            .as_str()
            .unwrap()
            .to_owned()
    };
    assert_eq!(runs("test.sample", &[]), "in process");
    assert_eq!(runs("test.canary", &[]), "worker");
    lab.good(&["plugins", "mode", "test.sample", "worker"]);
    lab.good(&["plugins", "mode", "test.canary", "in-process"]);
    assert_eq!(runs("test.sample", &[]), "worker");
    assert_eq!(runs("test.canary", &[]), "in process");
    // An option of a run is stronger.
    assert_eq!(runs("test.canary", &["--isolated"]), "worker");
    assert_eq!(runs("test.sample", &["--in-process"]), "in process");
    lab.good(&["plugins", "mode", "test.sample", "default"]);
    assert_eq!(runs("test.sample", &[]), "in process");
}

#[test]
fn in_process_is_refused_to_what_insists_on_a_worker() {
    let folder = tempfile::tempdir().unwrap();
    let packages = [
        "puncta_plugin_hdf5",
        "puncta_plugin_text",
        "puncta_test_sample",
    ];
    let bundle = Bundle::of(&packages);
    let data = root().join("plugins/hdf5/data/example_locs.hdf5");
    fs::copy(data, folder.path().join("p.hdf5")).unwrap();
    let run = |arguments: &[&str]| {
        let mut command = bundle.command();
        let output = command
            .args(arguments)
            .current_dir(folder.path())
            .output()
            .unwrap();
        (output.status.success(), text(&output.stderr))
    };
    for isolation in [&[][..], &["--isolated"]] {
        let (good, sentence) = run(&[&["info", "p.hdf5"], isolation].concat());
        assert!(good, "{sentence}");
    }
    for arguments in [
        &["info", "p.hdf5", "--in-process"][..],
        &["convert", "p.hdf5", "q.csv", "--in-process"],
        &["op", "test.scale/1", "p.hdf5", "--in-process"],
        &["plugins", "mode", "puncta.hdf5", "in-process"],
    ] {
        let (good, sentence) = run(arguments);
        assert!(!good, "{arguments:?} was accepted");
        all_in(
            &sentence,
            &["puncta.hdf5 runs only in a process of its own"],
        );
        assert!(!folder.path().join("q.csv").exists());
    }
    let (good, sentence) = run(&["op", "test.stubborn/1", "--in-process"]);
    assert!(!good);
    all_in(
        &sentence,
        &[
            "test.stubborn/1 cannot be stopped",
            "leave out --in-process",
        ],
    );
    assert!(run(&["op", "test.stubborn/1"]).0);
}

#[test]
fn damaged_settings_are_named_and_kept() {
    let lab = Lab::plain();
    lab.good(&["plugins", "disable", "test.sample"]);
    let path = lab.bundle.config().join("settings.json");
    let whole = fs::read_to_string(&path).unwrap();
    assert!(whole.contains("puncta.settings/1"));
    let cut = &whole[..whole.len() / 2];
    fs::write(&path, cut).unwrap();
    for arguments in [
        &["plugins", "list"][..],
        &["ops"],
        &["plugins", "enable", "test.sample"],
        &["plugins", "mode", "test.sample", "worker"],
        &["op", "test.points/1"],
    ] {
        let sentence = lab.refused(arguments);
        all_in(&sentence, &["settings", "settings.json", "damaged"]);
        assert_eq!(fs::read_to_string(&path).unwrap(), cut);
    }
    assert!(lab.run(&["--help"]).status.success());
}

#[test]
fn two_programs_change_the_settings_at_once() {
    let lab = Lab::plain();
    std::thread::scope(|scope| {
        for id in ["test.sample", "puncta.text"] {
            for mode in ["worker", "default", "in-process", "worker"] {
                let lab = &lab;
                scope.spawn(move || lab.good(&["plugins", "mode", id, mode]));
            }
        }
        scope.spawn(|| lab.good(&["plugins", "disable", "test.sample"]));
    });
    let text = fs::read_to_string(lab.bundle.config().join("settings.json")).unwrap();
    let settings: Value = serde_json::from_str(&text).unwrap();
    assert_eq!(settings["plugins"]["test.sample"]["enabled"], false);
    assert!(settings["plugins"]["puncta.text"]["mode"].is_string());
    let left: Vec<_> = fs::read_dir(lab.bundle.config())
        .unwrap()
        .flatten()
        .collect();
    let temporary = |path: &Path| {
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        name.starts_with(".puncta-")
    };
    assert!(left.iter().all(|one| !temporary(&one.path())));
}
