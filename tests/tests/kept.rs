//! Results are kept between sessions: a recipe that is run again computes only what is new.
#![cfg(target_os = "linux")]
#![allow(clippy::unwrap_used, clippy::expect_used)]

use puncta_tests::Bundle;
use std::path::Path;

const RECIPE: &str = r#"
format = "puncta.recipe/1"
[steps.cloud]
op = "puncta.synthetic.membrane/1"
set = { seed = 3, copies = 20, acceptance = 0.05 }
[steps.some]
op = "puncta.filter.random/1"
in.table = "cloud"
set = { count = 100 }
[outputs]
"some.csv" = "some"
"#;

struct Place<'a> {
    bundle: &'a Bundle,
    folder: &'a Path,
}

impl Place<'_> {
    /// Runs a recipe in a fresh process; the lines of its steps, and the file it wrote.
    fn run(&self, recipe: &str, more: &[&str]) -> (String, Vec<u8>) {
        std::fs::write(self.folder.join("r.toml"), recipe).unwrap();
        let mut command = self.bundle.command();
        command
            .env("PUNCTA_CACHE", self.folder.join("cache"))
            .env("PUNCTA_RESULTS", "1")
            .args(["run", "r.toml", "--out", "out", "--overwrite"])
            .args(more)
            .current_dir(self.folder);
        let output = command.output().unwrap();
        let errors = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(output.status.success(), "{errors}");
        let text = String::from_utf8(output.stdout).unwrap();
        (
            text,
            std::fs::read(self.folder.join("out/some.csv")).unwrap(),
        )
    }
}

fn state<'a>(text: &'a str, step: &str) -> &'a str {
    let line = text
        .lines()
        .find(|line| line.split_whitespace().next() == Some(step));
    line.unwrap().split_whitespace().nth(1).unwrap()
}

#[test]
fn a_second_run_computes_only_what_is_new() {
    let bundle = Bundle::of(&[
        "puncta_plugin_filter",
        "puncta_plugin_synthetic",
        "puncta_plugin_text",
    ]);
    let folder = tempfile::tempdir().unwrap();
    let place = Place {
        bundle: &bundle,
        folder: folder.path(),
    };
    let (text, first) = place.run(RECIPE, &[]);
    assert_eq!(state(&text, "cloud"), "done", "{text}");
    // The same bits from the disk as from the plugin, in both modes.
    for mode in [&[][..], &["--isolated"], &["--threads", "1"]] {
        let (text, again) = place.run(RECIPE, mode);
        assert_eq!(state(&text, "cloud"), "kept", "{text}");
        assert!(again == first);
    }
    let (text, other) = place.run(&RECIPE.replace("count = 100", "count = 99"), &[]);
    assert_eq!(
        (state(&text, "cloud"), state(&text, "some")),
        ("kept", "done"),
        "{text}"
    );
    assert!(other != first);
    let (text, other) = place.run(&RECIPE.replace("seed = 3", "seed = 4"), &[]);
    assert_eq!(state(&text, "cloud"), "done", "{text}");
    assert!(other != first);

    // A replay computes in any case.
    let provenance = folder.path().join("out/some.csv");
    let mut command = bundle.command();
    command
        .env("PUNCTA_CACHE", folder.path().join("cache"))
        .env("PUNCTA_RESULTS", "1")
        .arg("replay")
        .arg(&provenance);
    let output = command.output().unwrap();
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(text.contains("the same bytes"), "{text}");

    // Damaged files are computed again.
    let results = folder.path().join("cache/results");
    let mut spoiled = 0;
    for inner in std::fs::read_dir(&results).unwrap().flatten() {
        for file in std::fs::read_dir(inner.path()).unwrap().flatten() {
            let mut bytes = std::fs::read(file.path()).unwrap();
            let middle = bytes.len() / 2;
            bytes[middle] ^= 1;
            std::fs::write(file.path(), bytes).unwrap();
            spoiled += 1;
        }
    }
    assert!(spoiled >= 2);
    let (text, again) = place.run(RECIPE, &[]);
    assert_eq!(state(&text, "cloud"), "done", "{text}");
    assert!(again == first);
}
