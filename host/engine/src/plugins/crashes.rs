//! Sessions that ended inside a plugin, in `crashes.json` of the state folder, until the person
//! decides about the plugin or its library changes.

use super::sentinel::{self, Left};
use crate::kept::Kept;
use puncta_documents::{Failure, Map};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

/// Format of the document.
pub const CRASHES: &str = "puncta.crashes/1";
/// Sessions after which a plugin runs in a worker, unless the person chose otherwise.
pub const PATIENCE: u64 = 2;
/// Libraries that are remembered.
const MOST: usize = 200;

/// What went wrong, by BLAKE3 of the library.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Crashes {
    /// By hash.
    #[serde(default)]
    pub plugins: BTreeMap<String, Crash>,
    /// Members that this version does not know.
    #[serde(flatten)]
    pub rest: Map,
}

/// Sessions that ended inside a plugin.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Crash {
    /// Id of the plugin.
    pub plugin: String,
    /// The operation of the last one; empty while the library was opened.
    #[serde(default)]
    pub operation: String,
    /// When the last call began, in UTC.
    pub date: String,
    /// How many sessions.
    pub count: u64,
    /// Whether the person was told of the last one.
    #[serde(default)]
    pub told: bool,
    /// Members that this version does not know.
    #[serde(flatten)]
    pub rest: Map,
}

impl Crash {
    /// What happened and what to do, in a sentence.
    #[must_use]
    pub fn sentence(&self) -> String {
        let Crash { plugin, count, .. } = self;
        let day = crate::date::day(&self.date);
        let what = if self.operation.is_empty() {
            "while its library was opened".to_owned()
        } else {
            format!("operation {}", self.operation)
        };
        if *count < PATIENCE {
            return format!(
                "the last session ended inside plugin {plugin}, {what}, on {day}; run it in worker \
                 mode (puncta plugins mode {plugin} worker) or disable it (puncta plugins disable \
                 {plugin})"
            );
        }
        format!(
            "{count} sessions ended inside plugin {plugin}, the last one in {what} on {day}, so that \
             it runs in a worker from now on; puncta plugins mode {plugin} in-process brings it \
             back, puncta plugins disable {plugin} switches it off"
        )
    }
}

/// The document of a state folder.
#[must_use]
pub fn file(state: &Path) -> Kept<Crashes> {
    Kept::new(state.join("crashes.json"), CRASHES, "records of crashes")
}

/// Files of sessions in a state folder: running, or left over.
fn marks(state: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(state).into_iter().flatten().flatten();
    let ours = |path: &PathBuf| {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        name.starts_with(sentinel::PREFIX)
    };
    let mut found: Vec<PathBuf> = entries.map(|entry| entry.path()).filter(ours).collect();
    found.sort();
    found
}

/// Notes what left-over files tell, removes them, and gives all that is known.
///
/// # Errors
/// When the document is damaged or cannot be written.
pub fn look(state: &Path) -> Result<Crashes, Failure> {
    let file = file(state);
    if marks(state).is_empty() {
        return file.read();
    }
    // One after the other, so that nothing is counted twice, and files that are just being made
    // are already locked.
    let turn = file.turn()?;
    let mut found: Vec<(PathBuf, Vec<Left>)> = Vec::new();
    for path in marks(state) {
        if let Some(left) = sentinel::left_over(&path) {
            found.push((path, left));
        }
    }
    let result = if found.iter().all(|(_, left)| left.is_empty()) {
        file.read()
    } else {
        file.change_in(&turn, |crashes| {
            found.iter().for_each(|(_, left)| crashes.note(left));
            Ok(crashes.clone())
        })
    };
    if result.is_ok() {
        // One that stays is counted again, which is better than not at all.
        found
            .iter()
            .for_each(|(path, _)| drop(fs::remove_file(path)));
    }
    result
}

impl Crashes {
    /// Notes a session that ended while these calls were running. Each library counts once.
    fn note(&mut self, left: &[Left]) {
        let mut of_session: BTreeMap<&str, &Left> = BTreeMap::new();
        for one in left {
            let known = of_session.entry(&one.hash).or_insert(one);
            if one.since > known.since {
                *known = one;
            }
        }
        for (hash, last) in of_session {
            let crash = self.plugins.entry(hash.to_owned()).or_default();
            crash.plugin.clone_from(&last.plugin);
            crash.operation.clone_from(&last.operation);
            crash.date = crate::date::utc(last.since);
            crash.count += 1;
            crash.told = false;
        }
        while self.plugins.len() > MOST {
            let oldest = self.plugins.iter().min_by_key(|(_, crash)| &crash.date);
            let Some(hash) = oldest.map(|(hash, _)| hash.clone()) else {
                return;
            };
            self.plugins.remove(&hash);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::{Duration, UNIX_EPOCH};

    fn left(hash: &str, operation: &str, seconds: u64) -> Left {
        Left {
            plugin: "lab.blobs".into(),
            hash: hash.into(),
            operation: operation.into(),
            since: UNIX_EPOCH + Duration::from_secs(seconds),
        }
    }

    #[test]
    fn each_session_counts_once_and_the_last_call_is_named() {
        let mut crashes = Crashes::default();
        crashes.note(&[
            left("a", "lab.one/1", 5),
            left("a", "lab.two/1", 9),
            left("b", "", 1),
        ]);
        assert_eq!(crashes.plugins["a"].count, 1);
        let sentence = crashes.plugins["a"].sentence();
        for words in ["lab.two/1", "1970-01-01", "plugins mode lab.blobs worker"] {
            assert!(sentence.contains(words), "{sentence}");
        }
        assert!(
            crashes.plugins["b"]
                .sentence()
                .contains("while its library was opened")
        );
        crashes.plugins.get_mut("a").unwrap().told = true;
        crashes.note(&[left("a", "lab.one/1", 20)]);
        assert_eq!(
            (crashes.plugins["a"].count, crashes.plugins["a"].told),
            (2, false)
        );
        let sentence = crashes.plugins["a"].sentence();
        assert!(
            sentence.contains("2 sessions ended inside plugin lab.blobs"),
            "{sentence}"
        );
        for i in 0..300 {
            crashes.note(&[left(&format!("h{i}"), "", 100 + i)]);
        }
        assert_eq!(crashes.plugins.len(), MOST);
        assert!(crashes.plugins.contains_key("h299") && !crashes.plugins.contains_key("a"));
    }

    #[test]
    fn files_of_living_sessions_stay() {
        let folder = tempfile::tempdir().unwrap();
        assert_eq!(look(folder.path()).unwrap(), Crashes::default());
        let living = sentinel::Sentinel::create(folder.path()).unwrap();
        fs::write(folder.path().join("running-x"), "rubbish").unwrap();
        assert_eq!(look(folder.path()).unwrap(), Crashes::default());
        assert_eq!(marks(folder.path()).len(), 1);
        drop(living);
    }
}
