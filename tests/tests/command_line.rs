//! The command line as a person meets it: what works, and one sentence for each thing that cannot.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use puncta_tests::{Bundle, build_folder};
use serde_json::Value;
use std::path::Path;
use std::process::{Command, Output};
use std::sync::OnceLock;

fn bundle() -> &'static Bundle {
    static BUNDLE: OnceLock<Bundle> = OnceLock::new();
    BUNDLE.get_or_init(|| {
        Bundle::of(&[
            "puncta_plugin_arrow_io",
            "puncta_plugin_filter",
            "puncta_plugin_hdf5",
            "puncta_plugin_image_io",
            "puncta_plugin_render",
            "puncta_plugin_synthetic",
            "puncta_plugin_text",
            "puncta_test_sample",
        ])
    })
}

fn bare(folder: &Path, arguments: &[&str]) -> Output {
    static EMPTY: OnceLock<Bundle> = OnceLock::new();
    run(EMPTY.get_or_init(|| Bundle::of(&[])), folder, arguments)
}

fn puncta(folder: &Path, arguments: &[&str]) -> Output {
    run(bundle(), folder, arguments)
}

fn run(bundle: &Bundle, folder: &Path, arguments: &[&str]) -> Output {
    let mut command = bundle.command();
    command.args(arguments).current_dir(folder);
    command.output().expect("puncta runs")
}

fn good(folder: &Path, arguments: &[&str]) -> String {
    let output = puncta(folder, arguments);
    let errors = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.success(), "{arguments:?}: {errors}");
    String::from_utf8(output.stdout).unwrap()
}

/// The one sentence of a failure; nothing may be left behind in the folder.
fn refused(folder: &Path, arguments: &[&str]) -> String {
    let before = names(folder);
    let output = puncta(folder, arguments);
    assert!(!output.status.success(), "{arguments:?} was accepted");
    assert!(
        output.status.code().is_some_and(|code| code < 100),
        "{arguments:?} crashed"
    );
    let text = String::from_utf8_lossy(&output.stderr).trim().to_owned();
    assert_eq!(names(folder), before, "{arguments:?} left something behind");
    assert!(!text.contains("panicked"), "{text}");
    text
}

fn names(folder: &Path) -> Vec<String> {
    let mut names: Vec<String> = std::fs::read_dir(folder)
        .unwrap()
        .flatten()
        .map(|entry| entry.file_name().to_string_lossy().into_owned())
        .collect();
    names.sort();
    names
}

const CSV: &str = "\"id\",\"frame\",\"x [nm]\",\"y [nm]\",\"uncertainty [nm]\"\n\
    1,1,100.5,200.5,10\n2,2,110,210,12\n3,2,120,220,30\n4,9,130.25,205,8\n";

#[test]
fn info_has_the_promised_shape() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("a.csv"), CSV).unwrap();
    let text = good(folder.path(), &["info", "a.csv", "--json"]);
    let value: Value = serde_json::from_str(&text).unwrap();
    let object = &value["objects"][0];
    assert_eq!(
        (object["kind"].as_str(), object["rows"].as_u64()),
        (Some("table"), Some(4))
    );
    assert!(object["metadata"].is_object());
    let column = |name: &str| {
        let columns = object["columns"].as_array().unwrap();
        columns
            .iter()
            .find(|column| column["name"] == name)
            .unwrap()
            .clone()
    };
    let x = column("x");
    assert_eq!(
        (x["type"].as_str(), x["unit"].as_str()),
        (Some("f64"), Some("nm"))
    );
    assert_eq!(x["min"].as_f64(), Some(100.5));
    assert_eq!(x["max"].as_f64(), Some(130.25));
    assert_eq!(x["sum"].as_f64(), Some(460.75));
    assert_eq!(
        column("t")["min"].as_f64(),
        Some(0.0),
        "ThunderSTORM counts frames from 1"
    );
}

#[test]
fn a_file_becomes_a_picture_by_a_recipe() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("a.csv"), CSV).unwrap();
    let recipe = "format = \"puncta.recipe/1\"\n[inputs.locs]\nkind = \"table\"\n\
        [steps.good]\nop = \"puncta.filter.range/1\"\nin.table = \"locs\"\n\
        set.ranges = { error_x = [0, 15], t = [0, inf] }\n\
        [steps.image]\nop = \"puncta.render.gaussian/1\"\nin.table = \"good\"\nset = { pixel_size = 5 }\n\
        [outputs]\n\"a.tif\" = \"image\"\n\"a.png\" = \"image\"\n\"a-good.csv\" = \"good\"\n";
    std::fs::write(folder.path().join("r.toml"), recipe).unwrap();
    good(
        folder.path(),
        &["run", "r.toml", "--input", "locs=a.csv", "--out", "out"],
    );
    let out = folder.path().join("out");
    let files = names(&out);
    for name in ["a.tif", "a.png", "a-good.csv", "a.tif.puncta.json"] {
        assert!(
            files.iter().any(|file| file == name),
            "{name} is not among {files:?}"
        );
    }
    let text = good(folder.path(), &["info", "out/a-good.csv", "--json"]);
    let value: Value = serde_json::from_str(&text).unwrap();
    assert_eq!(value["objects"][0]["rows"], 3);
    let record = std::fs::read_to_string(out.join("a.tif.puncta.json")).unwrap();
    assert!(
        record.contains("puncta.render.gaussian/1") && record.contains("puncta.filter.range/1")
    );
    // A second run does not replace what is there, unless it is told to.
    let again = ["run", "r.toml", "--input", "locs=a.csv", "--out", "out"];
    assert!(refused(folder.path(), &again).contains("--overwrite"));
    good(
        folder.path(),
        &[
            "run",
            "r.toml",
            "--input",
            "locs=a.csv",
            "--out",
            "out",
            "--overwrite",
        ],
    );
}

#[test]
fn recipes_that_cannot_run_say_why() {
    let folder = tempfile::tempdir().unwrap();
    let place = folder.path();
    std::fs::write(place.join("a.csv"), CSV).unwrap();
    std::fs::write(place.join("plain.csv"), "x,y\n1,2\n3,4\n").unwrap();
    let head = "format = \"puncta.recipe/1\"\n[inputs.locs]\nkind = \"table\"\n";
    let range = "op = \"puncta.filter.range/1\"\n";
    let cases: [(&str, String, &str, &[&str]); 7] = [
        (
            "cycle",
            format!(
                "{head}[steps.a]\n{range}in.table = \"b\"\n[steps.b]\n{range}in.table = \"a\"\n"
            ),
            "a.csv",
            &["line 6", "a needs b needs a"],
        ),
        (
            "unknown",
            format!("{head}[steps.a]\nop = \"puncta.filter.rage/1\"\nin.table = \"locs\"\n"),
            "a.csv",
            &["puncta.filter.rage/1", "puncta.filter.range/1"],
        ),
        (
            "kind",
            format!(
                "{head}[steps.i]\nop = \"puncta.render.histogram/1\"\nin.table = \"locs\"\n\
                 [steps.a]\n{range}in.table = \"i\"\n"
            ),
            "a.csv",
            &["image", "table"],
        ),
        (
            "unit",
            format!("{head}[steps.i]\nop = \"puncta.render.histogram/1\"\nin.table = \"locs\"\n"),
            "plain.csv",
            &["unknown", "nm"],
        ),
        (
            "twice",
            format!(
                "{head}[steps.a]\n{range}in.table = \"locs\"\n[steps.a]\n{range}in.table = \"locs\"\n"
            ),
            "a.csv",
            &["a", "line"],
        ),
        (
            "toml",
            "format = \"puncta.recipe/1\"\n[steps.a\n".into(),
            "a.csv",
            &["line 2"],
        ),
        (
            "escape",
            format!("{head}[outputs]\n\"../b.csv\" = \"locs\"\n"),
            "a.csv",
            &["../b.csv"],
        ),
    ];
    for (name, recipe, file, words) in cases {
        std::fs::write(place.join("r.toml"), recipe).unwrap();
        let input = format!("locs={file}");
        let output = puncta(place, &["run", "r.toml", "--input", &input, "--out", "out"]);
        assert!(!output.status.success(), "{name} was accepted");
        let text = [output.stdout, output.stderr].map(|t| String::from_utf8_lossy(&t).into_owned());
        let text = text.concat();
        for word in words {
            assert!(text.contains(word), "{name}: no \"{word}\" in {text}");
        }
        assert!(!place.join("b.csv").exists());
    }
}

#[test]
fn files_that_cannot_be_read_say_why() {
    let folder = tempfile::tempdir().unwrap();
    let place = folder.path();
    let binary: Vec<u8> = (0..4000_u32).map(|i| (i * 7919 % 251) as u8).collect();
    let files: [(&str, &[u8], &[&str]); 9] = [
        ("empty.csv", b"", &["empty.csv", "empty"]),
        ("binary.csv", &binary, &["binary.csv"]),
        (
            "ragged.csv",
            b"x [nm],y [nm]\n1,2\n3\n4,5\n",
            &["ragged.csv", "3"],
        ),
        (
            "word.csv",
            b"x [nm],y [nm]\n1,2\n3,oops\n",
            &["word.csv", "oops", "y [nm]", "row 3"],
        ),
        ("twice.csv", b"x [nm],x [nm]\n1,2\n", &["twice.csv", "x"]),
        ("cut.hdf5", b"\x89HDF\r\n\x1a\n\0\0\0\0", &["cut.hdf5"]),
        ("table.xyzzy", &binary, &["table.xyzzy"]),
        ("noise.h5r", &binary, &["noise.h5r"]),
        ("zeros.csv", &[0; 1000], &["zeros.csv"]),
    ];
    for (name, bytes, words) in files {
        std::fs::write(place.join(name), bytes).unwrap();
        let output = puncta(place, &["info", name]);
        let text = String::from_utf8_lossy(&output.stderr).trim().to_owned();
        assert_eq!(output.status.code(), Some(1), "{name}: {text}");
        assert!(
            text.starts_with("puncta: ") && text.lines().count() == 1,
            "{name}: {text}"
        );
        for word in words {
            assert!(text.contains(word), "{name}: no \"{word}\" in {text}");
        }
    }
    let text = refused(place, &["info", "nowhere.csv"]);
    assert!(
        text.contains("nowhere.csv") && text.contains("no such file"),
        "{text}"
    );
    let text = refused(place, &["info", "."]);
    assert!(text.contains("folder"), "{text}");
}

#[test]
fn odd_tables_are_read_as_they_are() {
    let folder = tempfile::tempdir().unwrap();
    let place = folder.path();
    for (name, text, rows) in [
        ("none.csv", "x [nm],y [nm]\n", 0),
        ("one.csv", "x [nm],y [nm]\n1,2\n", 1),
        ("nan.csv", "x [nm],y [nm]\nnan,2\ninf,-inf\n3,\n", 3),
        ("no-position.csv", "a,b\n1,2\n", 1),
        ("names.csv", "x [nm],name\n1,alpha\n2,beta\n", 2),
        // What is in a file counts, not what it is called.
        ("text.hdf5", "x,y\n1,2\n", 1),
    ] {
        std::fs::write(place.join(name), text).unwrap();
        let text = good(place, &["info", name, "--json"]);
        let value: Value = serde_json::from_str(&text).unwrap();
        assert_eq!(value["objects"][0]["rows"], rows, "{name}");
    }
    // And what works on tables works on empty ones, or says why it cannot.
    let output = puncta(
        place,
        &[
            "op",
            "puncta.render.gaussian/1",
            "none.csv",
            "-o",
            "none.tif",
        ],
    );
    let text = String::from_utf8_lossy(&output.stderr);
    assert!(!text.contains("panicked"), "{text}");
}

#[test]
fn a_full_disk_leaves_nothing_behind() {
    let folder = tempfile::tempdir().unwrap();
    let place = folder.path();
    let disk = place.join("disk");
    std::fs::create_dir(&disk).unwrap();
    let script = format!(
        "mount -t tmpfs -o size=64k none {disk} || exit 77\n\
         {program} op test.points/1 --rows 100000 -o {disk}/big.csv\n\
         code=$?; ls -A {disk}; exit $code\n",
        disk = disk.display(),
        program = bundle().program().display(),
    );
    let output = Command::new("unshare")
        .args(["--user", "--map-root-user", "--mount", "sh", "-c", &script])
        .env("PUNCTA_CACHE", build_folder().join("puncta-test-cache"))
        .env("PUNCTA_CONFIG", bundle().config())
        .output();
    let Ok(output) = output else { return };
    let (text, left) = (
        String::from_utf8_lossy(&output.stderr),
        String::from_utf8_lossy(&output.stdout),
    );
    // Where the system lets nobody mount, there is nothing to show.
    if output.status.code() == Some(77) || text.contains("unshare") {
        return;
    }
    assert_eq!(output.status.code(), Some(1), "{text}");
    assert!(
        text.contains("disk is full") && text.contains("big.csv"),
        "{text}"
    );
    assert_eq!(left.trim(), "", "something was left behind");
}

#[test]
fn without_plugins_there_is_nothing_to_run() {
    let folder = tempfile::tempdir().unwrap();
    let place = folder.path();
    std::fs::write(place.join("a.csv"), CSV).unwrap();
    let output = bare(place, &["ops"]);
    assert!(output.status.success() && output.stdout.is_empty());
    let output = bare(place, &["info", "a.csv"]);
    let text = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(
        !output.status.success() && text.contains("no reader installed"),
        "{text}"
    );
}

#[test]
fn help_comes_from_the_schema() {
    let folder = tempfile::tempdir().unwrap();
    let help = good(folder.path(), &["op", "puncta.render.gaussian/1", "--help"]);
    for word in ["pixel", "nm", "default"] {
        assert!(
            help.to_lowercase().contains(word),
            "no \"{word}\" in {help}"
        );
    }
    let list = good(folder.path(), &["ops"]);
    assert!(list.contains("puncta.filter.range/1") && list.contains("puncta.text.read/1"));
    let plugins = good(folder.path(), &["plugins", "list", "--json"]);
    assert!(plugins.contains("puncta.hdf5"));
    let text = refused(folder.path(), &["frobnicate"]);
    assert!(text.contains("frobnicate"), "{text}");
    let csv = folder.path().join("a.csv");
    std::fs::write(csv, CSV).unwrap();
    let wrong = [
        "op",
        "puncta.render.gaussian/1",
        "a.csv",
        "--pixel_size",
        "3 s",
        "-o",
        "a.tif",
    ];
    let text = refused(folder.path(), &wrong);
    assert!(text.contains("pixel_size") && text.contains("nm"), "{text}");
}
