//! A place to try the program as a person uses it, with a plugin that the program does not know.

use crate::{Bundle, library};
use serde_json::Value;
use std::fs;
use std::path::PathBuf;
use std::process::Output;

/// A bundle with the sample plugin, a canary in the person's plugin folder, and a place to work.
pub struct Lab {
    /// The bundle that the program lies in.
    pub bundle: Bundle,
    /// Where it runs.
    pub folder: tempfile::TempDir,
}

impl Lab {
    /// A lab without a canary.
    pub fn plain() -> Lab {
        let folder = tempfile::tempdir().unwrap();
        Lab {
            bundle: Bundle::of(&["puncta_test_sample", "puncta_plugin_text"]),
            folder,
        }
    }

    /// A lab with a canary that nobody trusts.
    pub fn with_canary() -> Lab {
        let lab = Lab::plain();
        fs::create_dir_all(lab.canary().parent().unwrap()).unwrap();
        fs::copy(library("puncta_test_canary"), lab.canary()).unwrap();
        lab
    }

    /// The canary's library.
    pub fn canary(&self) -> PathBuf {
        self.bundle.config().join("plugins/canary/libcanary.so")
    }

    /// How often the canary was loaded.
    pub fn songs(&self) -> usize {
        let trace = fs::read_to_string(self.folder.path().join("trace"));
        trace.unwrap_or_default().lines().count()
    }

    /// Runs the program.
    pub fn run(&self, arguments: &[&str]) -> Output {
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
    pub fn notes(&self, arguments: &[&str]) -> String {
        let output = self.run(arguments);
        assert!(output.status.success(), "{}", text(&output.stderr));
        text(&output.stderr)
    }

    /// Files of sessions that run or ended badly.
    pub fn marks(&self) -> Vec<PathBuf> {
        let entries = fs::read_dir(self.bundle.config().join("state"));
        let paths = entries
            .into_iter()
            .flatten()
            .flatten()
            .map(|one| one.path());
        let mark = |path: &PathBuf| path.to_string_lossy().contains("running-");
        paths.filter(mark).collect()
    }

    /// What a command that works writes.
    pub fn good(&self, arguments: &[&str]) -> String {
        let output = self.run(arguments);
        let errors = text(&output.stderr);
        assert!(output.status.success(), "{arguments:?}: {errors}");
        text(&output.stdout)
    }

    /// What a command that works writes as JSON.
    pub fn json(&self, arguments: &[&str]) -> Value {
        let mut all = arguments.to_vec();
        all.push("--json");
        serde_json::from_str(&self.good(&all)).unwrap()
    }

    /// The sentence of a failure.
    pub fn refused(&self, arguments: &[&str]) -> String {
        let output = self.run(arguments);
        let errors = text(&output.stderr);
        assert!(!output.status.success(), "{arguments:?} was accepted");
        let lines: Vec<&str> = errors.trim().lines().collect();
        // What a reader has to say of the file comes before.
        assert!(
            !lines.is_empty() && lines.iter().all(|line| line.starts_with("puncta: ")),
            "{errors}"
        );
        lines[lines.len() - 1].to_owned()
    }

    /// Writes a file where the program runs.
    pub fn write(&self, name: &str, text: &str) {
        fs::write(self.folder.path().join(name), text).unwrap();
    }
}

/// Bytes as text.
pub fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// Whether a sentence has all words.
pub fn all_in(sentence: &str, words: &[&str]) {
    for word in words {
        assert!(sentence.contains(word), "no \"{word}\" in {sentence}");
    }
}

/// The entry of a plugin in `plugins list --json`.
pub fn entry<'a>(list: &'a Value, group: &str, id: &str) -> Option<&'a Value> {
    let plugins = list[group].as_array().unwrap();
    plugins.iter().find(|plugin| plugin["id"] == id)
}
