//! What the person decided about plugins, in `settings.json` of the configuration folder.

use crate::kept::Kept;
use puncta_documents::Map;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Format of the settings.
pub const SETTINGS: &str = "puncta.settings/1";
/// Names the configuration folder in place of the system's.
pub const CONFIG: &str = "PUNCTA_CONFIG";
/// Names the folder for what the program remembers of its own runs.
pub const STATE: &str = "PUNCTA_STATE";

/// The settings. Members that this version does not know are kept.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Settings {
    /// Decisions by plugin id.
    #[serde(default)]
    pub plugins: BTreeMap<String, Choice>,
    /// Libraries that the person trusts, by BLAKE3.
    #[serde(default)]
    pub trusted: BTreeMap<String, Consent>,
    /// The reader of files of which several readers know the format: its id by the format's name
    /// or by a suffix with its dot.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub readers: BTreeMap<String, String>,
    /// Members that this version does not know.
    #[serde(flatten)]
    pub rest: Map,
}

/// What the person decided about one plugin.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Choice {
    /// Whether it is used.
    #[serde(default = "yes")]
    pub enabled: bool,
    /// Where its calls run.
    #[serde(default)]
    pub mode: Mode,
    /// Members that this version does not know.
    #[serde(flatten)]
    pub rest: Map,
}

fn yes() -> bool {
    true
}

impl Default for Choice {
    fn default() -> Choice {
        Choice {
            enabled: true,
            mode: Mode::Default,
            rest: Map::new(),
        }
    }
}

/// Where the calls of a plugin run.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Mode {
    /// As the host decides.
    #[default]
    Default,
    /// In a process of its own.
    Worker,
    /// In the host's process.
    InProcess,
}

/// The person trusts a library.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Consent {
    /// Where the library was.
    pub path: PathBuf,
    /// When, in UTC.
    pub date: String,
    /// Its size in bytes.
    #[serde(default)]
    pub size: u64,
    /// Address that it was downloaded from, as the system remembers it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub origin: Option<String>,
    /// Id of the plugin in it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub plugin: Option<String>,
    /// Members that this version does not know.
    #[serde(flatten)]
    pub rest: Map,
}

impl Settings {
    /// What was decided about a plugin; nothing is the default.
    #[must_use]
    pub fn choice(&self, id: &str) -> Choice {
        self.plugins.get(id).cloned().unwrap_or_default()
    }

    /// The reader that the person chose for files of this name in which these formats were found.
    /// A format counts before a suffix, a long suffix before a short one.
    #[must_use]
    pub fn reader<'a>(
        &self,
        name: &str,
        formats: impl IntoIterator<Item = &'a str>,
    ) -> Option<&str> {
        let by_format = formats
            .into_iter()
            .find_map(|format| self.readers.get(format));
        let name = name.to_lowercase();
        let suffixes = self
            .readers
            .iter()
            .filter(|(key, _)| key.starts_with('.') && name.ends_with(key.to_lowercase().as_str()));
        let by_suffix = || suffixes.max_by_key(|(key, _)| key.len()).map(|(_, id)| id);
        by_format.or_else(by_suffix).map(String::as_str)
    }

    /// The last consent to a library at this place, or of this plugin, whatever its hash was.
    #[must_use]
    pub fn earlier(&self, library: &Path, plugin: Option<&str>) -> Option<&Consent> {
        let same = |one: &&Consent| {
            one.path == library || (plugin.is_some() && one.plugin.as_deref() == plugin)
        };
        let found = self.trusted.values().filter(same);
        found.max_by(|a, b| a.date.cmp(&b.date))
    }
}

/// The settings of a configuration folder.
#[must_use]
pub fn file(config: &Path) -> Kept<Settings> {
    Kept::new(config.join("settings.json"), SETTINGS, "settings")
}

/// The person's configuration folder, and the one for what the program remembers of its own runs.
/// A system without a home has neither.
#[must_use]
pub fn folders() -> (Option<PathBuf>, Option<PathBuf>) {
    let named = |name| std::env::var_os(name).filter(|path| !path.is_empty());
    let own = named(CONFIG).map(PathBuf::from);
    let ours = |folder: PathBuf| folder.join("puncta");
    let state = named(STATE)
        .map(PathBuf::from)
        .or_else(|| own.as_ref().map(|config| config.join("state")))
        .or_else(|| {
            let system = dirs::state_dir().or_else(dirs::data_local_dir);
            system.map(ours)
        });
    let config = own.or_else(|| dirs::config_dir().map(ours));
    (config, state)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn unknown_members_survive_a_change() {
        let folder = tempfile::tempdir().unwrap();
        let file = file(folder.path());
        let text = r#"{"format": "puncta.settings/1", "viewer": {"theme": "dark"},
            "plugins": {"a": {"later": 1}, "b": {"mode": "in-process"}},
            "trusted": {"00": {"path": "/x", "date": "2026-01-01T00:00:00Z", "by": "me"}}}"#;
        std::fs::write(file.path(), text).unwrap();
        file.change(|settings| {
            assert_eq!(settings.choice("b").mode, Mode::InProcess);
            assert!(settings.choice("a").enabled && settings.choice("c").enabled);
            settings.plugins.entry("a".into()).or_default().enabled = false;
            Ok(())
        })
        .unwrap();
        let text = std::fs::read_to_string(file.path()).unwrap();
        for kept in ["\"theme\"", "\"later\": 1", "\"by\": \"me\"", SETTINGS] {
            assert!(text.contains(kept), "no {kept} in {text}");
        }
        let settings = file.read().unwrap();
        assert!(!settings.choice("a").enabled);
    }

    #[test]
    fn the_latest_consent_to_a_place_or_plugin_counts() {
        let mut settings = Settings::default();
        let mut add = |hash: &str, path: &str, plugin: &str, date: &str| {
            let consent = Consent {
                path: path.into(),
                date: date.into(),
                plugin: Some(plugin.into()),
                ..Consent::default()
            };
            settings.trusted.insert(hash.into(), consent);
        };
        add("1", "/a", "p", "2026-01-01T00:00:00Z");
        add("2", "/a", "p", "2026-03-01T00:00:00Z");
        add("3", "/b", "q", "2026-02-01T00:00:00Z");
        let date = |path: &str, plugin| {
            let found = settings.earlier(Path::new(path), plugin);
            found.map(|one| one.date.get(..7).unwrap().to_owned())
        };
        assert_eq!(date("/a", None).as_deref(), Some("2026-03"));
        assert_eq!(date("/elsewhere", Some("q")).as_deref(), Some("2026-02"));
        assert_eq!(date("/elsewhere", None), None);
    }
}
