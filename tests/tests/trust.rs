//! Who is trusted, and what happens to the others, through the program as a person uses it.
#![cfg(target_os = "linux")]
#![allow(clippy::unwrap_used, clippy::expect_used)]

use puncta_tests::{Bundle, library, root};
use serde_json::Value;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Output;

/// A bundle with the sample plugin, a canary in the person's plugin folder, and a place to work.
struct Lab {
    bundle: Bundle,
    folder: tempfile::TempDir,
}

impl Lab {
    fn new() -> Lab {
        let folder = tempfile::tempdir().unwrap();
        Lab {
            bundle: Bundle::of(&["puncta_test_sample", "puncta_plugin_text"]),
            folder,
        }
    }

    fn with_canary() -> Lab {
        let lab = Lab::new();
        fs::create_dir_all(lab.canary().parent().unwrap()).unwrap();
        fs::copy(library("puncta_test_canary"), lab.canary()).unwrap();
        lab
    }

    fn canary(&self) -> PathBuf {
        self.bundle.config().join("plugins/canary/libcanary.so")
    }

    /// How often the canary was loaded.
    fn songs(&self) -> usize {
        let trace = fs::read_to_string(self.folder.path().join("trace"));
        trace.unwrap_or_default().lines().count()
    }

    fn run(&self, arguments: &[&str]) -> Output {
        let mut command = self.bundle.command();
        command
            .args(arguments)
            .current_dir(self.folder.path())
            .env("PUNCTA_TEST_CANARY", self.folder.path().join("trace"))
            // What other tests have described is not known here.
            .env("PUNCTA_CACHE", self.folder.path().join("cache"));
        command.output().expect("puncta runs")
    }

    /// The notes of a command that works.
    fn notes(&self, arguments: &[&str]) -> String {
        let output = self.run(arguments);
        assert!(output.status.success(), "{}", text(&output.stderr));
        text(&output.stderr)
    }

    /// Files of sessions that run or ended badly.
    fn marks(&self) -> Vec<PathBuf> {
        let entries = fs::read_dir(self.bundle.config().join("state"));
        let paths = entries
            .into_iter()
            .flatten()
            .flatten()
            .map(|one| one.path());
        let mark = |path: &PathBuf| path.to_string_lossy().contains("running-");
        paths.filter(mark).collect()
    }

    fn good(&self, arguments: &[&str]) -> String {
        let output = self.run(arguments);
        let errors = text(&output.stderr);
        assert!(output.status.success(), "{arguments:?}: {errors}");
        text(&output.stdout)
    }

    fn json(&self, arguments: &[&str]) -> Value {
        let mut all = arguments.to_vec();
        all.push("--json");
        serde_json::from_str(&self.good(&all)).unwrap()
    }

    /// The sentence of a failure.
    fn refused(&self, arguments: &[&str]) -> String {
        let output = self.run(arguments);
        let errors = text(&output.stderr);
        assert!(!output.status.success(), "{arguments:?} was accepted");
        let lines: Vec<&str> = errors.trim().lines().collect();
        assert!(
            lines.len() == 1 && lines[0].starts_with("puncta: "),
            "{errors}"
        );
        lines[0].to_owned()
    }

    fn write(&self, name: &str, text: &str) {
        fs::write(self.folder.path().join(name), text).unwrap();
    }
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

fn all_in(sentence: &str, words: &[&str]) {
    for word in words {
        assert!(sentence.contains(word), "no \"{word}\" in {sentence}");
    }
}

const SING: [&str; 2] = ["op", "test.canary.sing/1"];
const RECIPE: &str = "format = \"puncta.recipe/1\"\n[steps.song]\nop = \"test.canary.sing/1\"\n\
    [outputs]\n\"song.csv\" = \"song\"\n";

/// The entry of a plugin in `plugins list --json`.
fn entry<'a>(list: &'a Value, group: &str, id: &str) -> Option<&'a Value> {
    let plugins = list[group].as_array().unwrap();
    plugins.iter().find(|plugin| plugin["id"] == id)
}

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
    let lab = Lab::new();
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
    let lab = Lab::new();
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
    let lab = Lab::new();
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
    let lab = Lab::new();
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

#[test]
fn a_crash_in_the_program_itself_is_named_at_the_next_start() {
    use std::os::unix::process::ExitStatusExt;
    let lab = Lab::new();
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
    let lab = Lab::new();
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
    let lab = Lab::new();
    let state = lab.bundle.config().join("state");
    fs::create_dir_all(&state).unwrap();
    fs::write(state.join("crashes.json"), "{").unwrap();
    fs::write(state.join("running-odd"), "rubbish").unwrap();
    let told = lab.notes(&["op", "test.points/1"]);
    all_in(&told, &["crashes.json", "damaged"]);
    assert_eq!(fs::read_to_string(state.join("crashes.json")).unwrap(), "{");
}

#[test]
fn a_recipe_writes_below_its_output_folder_only() {
    use std::os::unix::fs::symlink;
    let lab = Lab::new();
    let place = lab.folder.path();
    let (out, outside) = (place.join("out"), place.join("outside"));
    fs::create_dir_all(&out).unwrap();
    fs::create_dir_all(&outside).unwrap();
    symlink(&outside, out.join("link")).unwrap();
    fs::write(place.join("secret.csv"), "secret").unwrap();
    symlink(place.join("secret.csv"), out.join("file.csv")).unwrap();
    let recipe = |file: &str| {
        let text = format!(
            "format = \"puncta.recipe/1\"\n[steps.p]\nop = \"test.points/1\"\n\
             [outputs]\n\"{file}\" = \"p\"\n"
        );
        lab.write("r.toml", &text);
        ["run", "r.toml", "--out", "out", "--overwrite"]
    };
    for (file, word) in [
        ("link/a.csv", "is a link out of the output folder"),
        ("link/deep/a.csv", "is a link out of the output folder"),
        ("../a.csv", "leaves the output folder"),
        ("x/../../a.csv", "leaves the output folder"),
        ("/tmp/puncta-a.csv", "absolute"),
    ] {
        all_in(&lab.refused(&recipe(file)), &[word]);
    }
    assert_eq!(fs::read_dir(&outside).unwrap().count(), 0);
    assert!(!place.join("a.csv").exists() && !Path::new("/tmp/puncta-a.csv").exists());
    // A link in the place of a file is replaced, and what it leads to stays.
    lab.good(&recipe("file.csv"));
    assert_eq!(
        fs::read_to_string(place.join("secret.csv")).unwrap(),
        "secret"
    );
    assert!(!out.join("file.csv").is_symlink());
}

#[test]
fn documents_that_are_too_large_or_deep_are_named() {
    let lab = Lab::new();
    let large = fs::File::create(lab.folder.path().join("r.toml")).unwrap();
    large.set_len(3 << 30).unwrap();
    let sentence = lab.refused(&["run", "r.toml"]);
    all_in(
        &sentence,
        &["r.toml is no recipe, since it is larger than 16 MB"],
    );
    let nested = format!(
        "format = \"puncta.recipe/1\"\n[steps.p]\nop = \"test.points/1\"\nset.rows = {}{}\n",
        "[".repeat(100_000),
        "]".repeat(100_000)
    );
    lab.write("r.toml", &nested);
    all_in(&lab.refused(&["run", "r.toml"]), &["r.toml, line 4"]);
    // A description in a plugin folder.
    let plugin = lab.bundle.config().join("plugins/odd");
    fs::create_dir_all(&plugin).unwrap();
    let path = plugin.join("plugin.json");
    let large = fs::File::create(&path).unwrap();
    large.set_len(3 << 30).unwrap();
    all_in(
        &lab.good(&["plugins", "list"]),
        &["refused", "plugin.json is larger than 16 MB"],
    );
    fs::write(&path, "[".repeat(1 << 20)).unwrap();
    all_in(
        &lab.good(&["plugins", "list"]),
        &["refused", "plugin.json is no valid JSON"],
    );
    let manifest = "{\"format\": \"puncta.installed/1\", \"library\": \"../x.so\", \"hash\": \"\", \
        \"door\": true, \"manifest\": {\"id\": \"x\", \"title\": \"x\", \"version\": \"1\"}}";
    fs::write(&path, manifest).unwrap();
    all_in(
        &lab.good(&["plugins", "list"]),
        &["refused", "names a library in another folder"],
    );
}
