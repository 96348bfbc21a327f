//! The record of a batch, `batch.json`: each file with its state, outputs and errors. It is written
//! whole after each change, so that a batch that was ended can be resumed.

use crate::files::write_whole;
use crate::provenance::FileRecord;
use puncta_documents::{Failure, Map};
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Format of [`BatchRecord`].
pub const BATCH: &str = "puncta.batch/1";
/// Name of the record in the output folder.
pub const RECORD: &str = "batch.json";
/// Largest record that is read.
const MOST_BYTES: u64 = 256 << 20;

/// How far a file of a batch is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum State {
    /// Not begun.
    #[default]
    Waiting,
    /// Begun; in the record of a batch that was ended, not finished.
    Running,
    /// Every output is written.
    Done,
    /// Some outputs are written.
    Partly,
    /// No output is written.
    Failed,
    /// The person stopped it.
    Stopped,
}

impl State {
    /// In words.
    #[must_use]
    pub fn word(self) -> &'static str {
        match self {
            State::Waiting => "waiting",
            State::Running => "running",
            State::Done => "done",
            State::Partly => "partly done",
            State::Failed => "failed",
            State::Stopped => "stopped",
        }
    }
}

/// A file of a batch.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Entry {
    /// Where it is.
    pub path: String,
    /// What stands for `{input}` in the names of its outputs; no two files have the same.
    pub label: String,
    /// How far it is.
    pub state: State,
    /// The file as it was read.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub input: Option<FileRecord>,
    /// Files that were written, below the output folder, by the recipe's names.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub outputs: Vec<OutputEntry>,
    /// Sentences: what went wrong.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub errors: Vec<String>,
    /// How long it took.
    #[serde(default)]
    pub seconds: f64,
    /// Members that this version does not know.
    #[serde(flatten)]
    pub rest: Map,
}

/// A file that was written.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct OutputEntry {
    /// The recipe's name for it.
    pub name: String,
    /// Path below the output folder.
    pub path: String,
    /// Bytes, to see whether it is still there whole.
    pub bytes: u64,
}

/// The record of a batch. Format `puncta.batch/1`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct BatchRecord {
    /// Version of the host.
    pub host: String,
    /// BLAKE3 of the recipe as it was run: text, parameters that were set, other inputs.
    pub recipe: String,
    /// The input that each file is bound to.
    pub each: String,
    /// The files, in the order in which they were given.
    pub files: Vec<Entry>,
    /// Collected tables, below the output folder.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub collected: Vec<String>,
    /// Members that this version does not know.
    #[serde(flatten)]
    pub rest: Map,
}

impl BatchRecord {
    /// Reads the record of an output folder; none if there is none.
    ///
    /// # Errors
    /// When it cannot be read or is damaged.
    pub fn read(out: &Path) -> Result<Option<BatchRecord>, Failure> {
        let path = out.join(RECORD);
        let bytes = match path.metadata() {
            Ok(metadata) => metadata.len(),
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(None),
            Err(error) => return Err(Failure::io("read", &path, &error)),
        };
        let damaged = |why: String| {
            let message = format!("{} is {why}", path.display());
            Failure::bad_file(message).remedy("choose another folder with --out")
        };
        if bytes > MOST_BYTES {
            return Err(damaged("too large for the record of a batch".into()));
        }
        let text =
            std::fs::read_to_string(&path).map_err(|error| Failure::io("read", &path, &error))?;
        let mut record: BatchRecord =
            puncta_documents::parse(&text, BATCH).map_err(|why| damaged(why.to_string()))?;
        // It is written anew with every document.
        record.rest.remove("format");
        Ok(Some(record))
    }

    /// Writes it.
    ///
    /// # Errors
    /// When the folder cannot be written.
    pub fn write(&self, out: &Path) -> Result<(), Failure> {
        let text = puncta_documents::write(self, BATCH);
        let value: Result<serde_json::Value, _> = serde_json::from_str(&text);
        let text = value.map_or(text, |value| format!("{value:#}\n"));
        write_whole(&out.join(RECORD), text.as_bytes())
    }

    /// How many files are in a state.
    #[must_use]
    pub fn count(&self, state: State) -> usize {
        self.files.iter().filter(|one| one.state == state).count()
    }

    /// Whether the outputs of an entry that was done are still there.
    #[must_use]
    pub fn stands(&self, entry: &Entry, out: &Path) -> bool {
        let there = |one: &OutputEntry| {
            let metadata = out.join(&one.path).metadata();
            metadata.is_ok_and(|metadata| metadata.len() == one.bytes)
        };
        entry.state == State::Done && entry.outputs.iter().all(there)
    }
}

/// A label for each file: its name without suffix, with a number where several have the same.
#[must_use]
pub fn labels(paths: &[std::path::PathBuf]) -> Vec<String> {
    let mut taken = std::collections::HashSet::new();
    let label = |path: &std::path::PathBuf| {
        let stem = path.file_stem().unwrap_or_default().to_string_lossy();
        let mut label = stem.clone().into_owned();
        let mut number = 1;
        // Not every system tells small letters from large ones.
        while !taken.insert(label.to_lowercase()) {
            number += 1;
            label = format!("{stem}-{number}");
        }
        label
    };
    paths.iter().map(label).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn labels_are_different() {
        let paths = ["a/x.csv", "b/X.csv", "x-2.csv", "c/x.tsv"].map(Into::into);
        assert_eq!(labels(&paths), ["x", "X-2", "x-2-2", "x-3"]);
    }

    #[test]
    fn records_come_back_and_damaged_ones_are_named() {
        let folder = tempfile::tempdir().unwrap();
        assert_eq!(BatchRecord::read(folder.path()), Ok(None));
        let file = Entry {
            path: "/data/a.csv".into(),
            label: "a".into(),
            state: State::Done,
            outputs: vec![OutputEntry {
                name: "{input}.tif".into(),
                path: "a.tif".into(),
                bytes: 3,
            }],
            seconds: 1.5,
            ..Entry::default()
        };
        let record = BatchRecord {
            each: "locs".into(),
            files: vec![file],
            ..BatchRecord::default()
        };
        record.write(folder.path()).unwrap();
        let back = BatchRecord::read(folder.path()).unwrap().unwrap();
        assert_eq!(back, record);
        assert!(!back.stands(&back.files[0], folder.path()));
        std::fs::write(folder.path().join("a.tif"), "abc").unwrap();
        assert!(back.stands(&back.files[0], folder.path()));
        std::fs::write(folder.path().join(RECORD), "{}").unwrap();
        let failure = BatchRecord::read(folder.path()).unwrap_err();
        assert!(failure.to_string().contains("puncta.batch/1"), "{failure}");
    }
}
