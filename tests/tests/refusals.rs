//! Libraries that are refused: one sentence with the file, the cause and what to do, and nothing of
//! the library ran.
#![cfg(target_os = "linux")]
#![allow(clippy::unwrap_used, clippy::expect_used)]

use puncta_tests::{Bundle, c, faults::has, program, root};
use serde_json::Value;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

/// Says in a file that it was loaded.
const CANARY: &str = r#"
#include <stdio.h>
#include <stdlib.h>
__attribute__((constructor)) static void loaded(void) {
    const char *path = getenv("PUNCTA_TEST_CANARY");
    FILE *file = path ? fopen(path, "a") : NULL;
    if (file) fclose(file);
}
"#;

struct Cage {
    folder: tempfile::TempDir,
}

impl Cage {
    fn new() -> Cage {
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join("canary.c"), CANARY).unwrap();
        Cage { folder }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// A plugin with a canary in it.
    fn bird(&self, name: &str, options: &[&str]) -> PathBuf {
        let sources = [root().join("tests/broken/broken.c"), self.path("canary.c")];
        let sources = sources.each_ref().map(PathBuf::as_path);
        c::compile(&sources, options, &self.path(name))
    }

    fn sang(&self) -> bool {
        self.path("song").exists()
    }

    /// The sentence of a refusal.
    fn refused(&self, library: &Path) -> String {
        let output = Command::new(program())
            .args(["plugins", "pack"])
            .arg(library)
            .env("PUNCTA_CONFIG", self.path("config"))
            .env("PUNCTA_CACHE", self.path("cache"))
            .env("PUNCTA_TEST_CANARY", self.path("song"))
            .output()
            .unwrap();
        assert!(
            !output.status.success(),
            "{} was not refused",
            library.display()
        );
        let text = String::from_utf8_lossy(&output.stderr).trim().to_owned();
        assert_eq!(text.lines().count(), 1, "{text}");
        text
    }
}

#[test]
fn a_bird_sings_when_its_library_is_opened() {
    let cage = Cage::new();
    let library = cage.bird("libbird.so", &[]);
    let mut pack = Command::new(program());
    pack.args(["plugins", "pack"]).arg(&library);
    pack.env("PUNCTA_CONFIG", cage.path("config"));
    pack.env("PUNCTA_TEST_CANARY", cage.path("song"));
    assert!(pack.status().unwrap().success());
    assert!(cage.sang(), "the canary proves nothing");
}

#[test]
fn what_cannot_be_a_plugin_is_refused_unopened() {
    let cage = Cage::new();
    let whole = fs::read(cage.bird("libwhole.so", &[])).unwrap();
    let write = |name: &str, bytes: &[u8]| {
        fs::write(cage.path(name), bytes).unwrap();
        cage.path(name)
    };
    let mut foreign = whole.clone();
    // The processor of an ELF file: AArch64, or x86-64 where that is this machine.
    foreign[18] = if cfg!(target_arch = "x86_64") {
        183
    } else {
        62
    };
    let mut executable = whole.clone();
    executable[16] = 2;
    let noise: Vec<u8> = (0..5000_u32)
        .map(|i| (i.wrapping_mul(2_654_435_761) >> 24) as u8)
        .collect();
    let other = cage.path("other.c");
    fs::write(&other, format!("{CANARY}\nint other;\nint other = 1;\n")).unwrap();
    let cases: [(PathBuf, &[&str]); 8] = [
        (
            cage.bird("libnumber.so", &["-DOTHER_NUMBER"]),
            &[
                "ABI number 4711",
                "this host has 1",
                "build it with this host's SDK",
            ],
        ),
        (
            write("libforeign.so", &foreign),
            &["was built for", "build it for this system"],
        ),
        (
            write("libprogram.so", &executable),
            &["not a dynamic library", "build it for this system"],
        ),
        (
            c::compile(&[&other], &[], &cage.path("libother.so")),
            &["no Puncta plugin", "choose a plugin"],
        ),
        (
            write("libcut.so", &whole[..whole.len() * 2 / 3]),
            &["part of", "copy or build it again"],
        ),
        (
            write("libempty.so", b""),
            &["is empty", "copy or build it again"],
        ),
        (
            write("libnoise.so", &noise),
            &["no library", "copy or build it again"],
        ),
        (cage.path("libnowhere.so"), &["no such file"]),
    ];
    for (library, words) in cases {
        let text = cage.refused(&library);
        let name = library.file_name().unwrap().to_str().unwrap();
        has(&text, &[name], name);
        has(&text, words, name);
        assert!(!cage.sang(), "{name}: a constructor ran");
    }
}

#[test]
fn what_the_system_or_this_host_lacks_is_named() {
    let cage = Cage::new();
    let needy = c::without_its_library(cage.folder.path());
    let text = cage.refused(&needy);
    has(
        &text,
        &[
            "needs_another",
            "vendor-sdk",
            "install the library it needs",
        ],
        "dependency",
    );
    let library = cage.bird("libscene.so", &["-DFAULT=F_needs"]);
    let text = cage.refused(&library);
    has(
        &text,
        &["libscene.so", "needs scene/9", "update Puncta"],
        "extension",
    );
}

fn list(bundle: &Bundle, plugins: &Path) -> Value {
    let mut command = bundle.command();
    command
        .arg("--plugins")
        .arg(plugins)
        .args(["plugins", "list", "--json"]);
    serde_json::from_slice(&command.output().unwrap().stdout).unwrap()
}

#[test]
fn an_id_is_claimed_once_and_a_changed_library_waits() {
    let cage = Cage::new();
    let bundle = Bundle::of(&[]);
    let plugins = cage.path("plugins");
    let trust = |path: &Path| {
        let mut command = bundle.command();
        command.args(["plugins", "trust"]).arg(path);
        assert!(command.status().unwrap().success());
    };
    for (folder, options) in [("one", &[][..]), ("two", &["-DFAULT=F_version"])] {
        fs::create_dir_all(plugins.join(folder)).unwrap();
        let library = cage.bird(&format!("plugins/{folder}/libbird.so"), options);
        trust(&library);
    }
    let found = list(&bundle, &plugins);
    let why = found["refused"][0]["why"].as_str().unwrap();
    has(
        why,
        &["test.broken is already installed in", "one/libbird.so"],
        "twice",
    );
    assert!(
        found["refused"][0]["path"]
            .as_str()
            .unwrap()
            .ends_with("two/libbird.so")
    );
    // Another library in the place of a trusted one.
    fs::copy(
        cage.bird("libother.so", &["-DFAULT=F_help"]),
        plugins.join("one/libbird.so"),
    )
    .unwrap();
    let found = list(&bundle, &plugins);
    let waiting = found["waiting"][0]["why"].as_str().unwrap();
    has(waiting, &["has changed since it was trusted"], "changed");
}
