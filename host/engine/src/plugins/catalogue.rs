//! Which plugins are installed, and which of them may be used. Scanning opens no library: it reads
//! `plugin.json` files, and hashes the libraries that the bundle does not list.

use super::bundle::{self, Listed};
use super::held::{Held, Why};
use super::library_file::Facts;
pub use super::packed::{Describer, FILE_NAME, INSTALLED, Packed, describe, pack};
use super::packed::{private_copy, read, remembered};
use crate::settings::Settings;
use puncta_documents::{Failure, Operation, OperationKind};
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// An installed plugin.
#[derive(Clone, Debug)]
pub struct Installed {
    /// What `plugin.json` says.
    pub packed: Packed,
    /// The library.
    pub library: PathBuf,
    /// Whether the bundle that this program is in lists the library.
    pub bundled: bool,
    /// When the person consented to the library, if the bundle does not list it; in UTC.
    pub trusted: Option<String>,
}

/// Something in a plugin folder that is not used.
#[derive(Clone, Debug)]
pub struct Refused {
    /// Where.
    pub path: PathBuf,
    /// Why, in a sentence.
    pub why: String,
}

/// A folder to look for plugins in.
#[derive(Clone, Debug)]
pub struct Folder {
    /// Where.
    pub path: PathBuf,
    /// Whether it belongs to the bundle that this program is in: its list of libraries is believed.
    pub bundled: bool,
}

/// All installed plugins. The first of an id wins.
#[derive(Clone, Debug, Default)]
pub struct Catalogue {
    plugins: Vec<Arc<Installed>>,
    operations: BTreeMap<String, (usize, usize)>,
    refused: Vec<Refused>,
    held: Vec<Held>,
}

/// What decides whether a library is used.
struct Trust<'a> {
    listed: Listed,
    settings: &'a Settings,
    describer: &'a Describer,
}

impl Catalogue {
    /// Reads the folders in order. A library that is trusted and has no fitting `plugin.json` is
    /// described in a worker, once.
    #[must_use]
    pub fn scan(folders: &[Folder], settings: &Settings, describer: &Describer) -> Catalogue {
        let mut catalogue = Catalogue::default();
        let mut listed = Listed::default();
        for folder in folders.iter().filter(|folder| folder.bundled) {
            match bundle::read(&folder.path) {
                Ok(found) => listed.libraries.extend(found.libraries),
                Err(failure) => {
                    let path = folder.path.join(bundle::FILE_NAME);
                    catalogue.refuse(&path, &failure.to_string());
                }
            }
        }
        let trust = Trust {
            listed,
            settings,
            describer,
        };
        for folder in folders {
            for place in sorted(&folder.path) {
                if place.join(FILE_NAME).is_file() {
                    match read(&place) {
                        Ok(packed) => {
                            let library = place.join(&packed.library);
                            catalogue.judge(library, Some(packed), folder.bundled, &trust);
                        }
                        Err(failure) => catalogue.refuse(&place, &failure.to_string()),
                    }
                    continue;
                }
                let inside = if place.is_dir() {
                    sorted(&place)
                } else {
                    vec![place]
                };
                for library in inside.into_iter().filter(|path| is_library(path)) {
                    catalogue.judge(library, None, false, &trust);
                }
            }
        }
        catalogue
    }

    /// Decides on a library, without running anything of it unless it is trusted.
    fn judge(&mut self, library: PathBuf, claimed: Option<Packed>, own: bool, trust: &Trust<'_>) {
        let id = claimed.as_ref().map(|packed| packed.manifest.id.as_str());
        let earlier = trust
            .settings
            .earlier(&library, id)
            .map(|one| one.date.clone());
        // Libraries of the bundle are hashed when they are used, if nothing speaks of a change.
        if let Some(packed) = claimed.as_ref().filter(|_| own && earlier.is_none())
            && let Some(known) = trust.listed.libraries.get(&packed.hash)
            && fs::metadata(&library).is_ok_and(|found| found.len() == known.size)
        {
            let packed = packed.clone();
            return self.accept(library, packed, (true, None), trust);
        }
        let facts = match Facts::of(&library) {
            Ok(facts) => facts,
            Err(failure) => {
                self.refuse(&library, &failure.to_string());
                let why = Why::Broken(failure);
                return self.hold(library, None, claimed, why);
            }
        };
        let bundled = trust.listed.libraries.contains_key(&facts.hash);
        let consent = trust.settings.trusted.get(&facts.hash);
        if !bundled && consent.is_none() {
            let other = claimed
                .as_ref()
                .is_some_and(|packed| packed.hash != facts.hash);
            let why = match earlier {
                Some(date) => Why::Changed(crate::date::day(&date).to_owned()),
                None if other => Why::Repacked,
                None => Why::New,
            };
            return self.hold(library, Some(facts), claimed, why);
        }
        let packed = match claimed.filter(|packed| packed.hash == facts.hash) {
            Some(packed) => Ok(packed),
            None => remembered(&library, &facts, trust.describer),
        };
        match packed {
            Ok(packed) => {
                let date = consent.filter(|_| !bundled).map(|one| one.date.clone());
                self.accept(library, packed, (bundled, date), trust);
            }
            Err(failure) => self.refuse(&library, &failure.to_string()),
        }
    }

    fn accept(
        &mut self,
        library: PathBuf,
        packed: Packed,
        (bundled, trusted): (bool, Option<String>),
        trust: &Trust<'_>,
    ) {
        let installed = Installed {
            packed,
            library,
            bundled,
            trusted,
        };
        let (library, packed) = (&installed.library, &installed.packed);
        if !trust.settings.choice(&packed.manifest.id).enabled {
            let (library, packed) = (library.clone(), packed.clone());
            let why = Why::Disabled(Arc::new(installed));
            return self.hold(library, None, Some(packed), why);
        }
        self.add(installed);
    }

    fn hold(&mut self, library: PathBuf, facts: Option<Facts>, claimed: Option<Packed>, why: Why) {
        self.held.push(Held {
            library,
            facts,
            claimed,
            why,
        });
    }

    fn refuse(&mut self, path: &Path, why: &str) {
        self.refused.push(Refused {
            path: path.to_path_buf(),
            why: why.to_owned(),
        });
    }

    fn add(&mut self, installed: Installed) {
        let id = &installed.packed.manifest.id;
        if let Some(first) = self
            .plugins
            .iter()
            .find(|known| &known.packed.manifest.id == id)
        {
            let why = format!("{id} is already installed in {}", first.library.display());
            return self.refuse(&installed.library, &why);
        }
        for operation in &installed.packed.manifest.operations {
            if let Some((plugin, _)) = self.operations.get(&operation.id) {
                let owner = &self.plugins[*plugin].packed.manifest.id;
                let why = format!("{} is already offered by {owner}", operation.id);
                return self.refuse(&installed.library, &why);
            }
        }
        for (place, operation) in installed.packed.manifest.operations.iter().enumerate() {
            self.operations
                .insert(operation.id.clone(), (self.plugins.len(), place));
        }
        self.plugins.push(Arc::new(installed));
    }

    /// Installed plugins.
    #[must_use]
    pub fn plugins(&self) -> &[Arc<Installed>] {
        &self.plugins
    }

    /// What is not used, and why.
    #[must_use]
    pub fn refused(&self) -> &[Refused] {
        &self.refused
    }

    /// Plugins that are there and are not used, since the person did not consent or switched them
    /// off; broken ones are among them.
    #[must_use]
    pub fn held(&self) -> &[Held] {
        &self.held
    }

    /// Why an operation that is not installed cannot be used, if a plugin that is held says that
    /// it has it.
    #[must_use]
    pub fn withheld(&self, id: &str) -> Option<Failure> {
        self.held
            .iter()
            .find(|held| held.offers(id))
            .map(Held::failure)
    }

    /// Why no plugin reads or writes a file of this name, if one that is held says that it does.
    #[must_use]
    pub fn withheld_file(&self, file: &str, kind: OperationKind) -> Option<Failure> {
        let found = self.held.iter().find(|held| held.handles(file, kind));
        found.map(Held::failure)
    }

    /// All operations, readers and writers, sorted by id.
    pub fn operations(&self) -> impl Iterator<Item = (&Arc<Installed>, &Operation)> {
        self.operations.values().map(|(plugin, place)| {
            let plugin = &self.plugins[*plugin];
            (plugin, &plugin.packed.manifest.operations[*place])
        })
    }

    /// The operation with this id. Without a revision: the newest.
    #[must_use]
    pub fn find(&self, id: &str) -> Option<(&Arc<Installed>, &Operation)> {
        if let Some((plugin, place)) = self.operations.get(id) {
            let plugin = &self.plugins[*plugin];
            return Some((plugin, &plugin.packed.manifest.operations[*place]));
        }
        let revision = |operation: &Operation| -> u64 {
            operation
                .id
                .split_once('/')
                .and_then(|(_, number)| number.parse().ok())
                .unwrap_or(0)
        };
        self.operations()
            .filter(|(_, operation)| operation.stem() == id)
            .max_by_key(|(_, operation)| revision(operation))
    }
}

/// What lies in a folder; a folder that is not there has nothing.
fn sorted(folder: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(folder).into_iter().flatten();
    let mut places: Vec<PathBuf> = entries.flatten().map(|entry| entry.path()).collect();
    places.sort();
    places
}

fn is_library(path: &Path) -> bool {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    name.ends_with(std::env::consts::DLL_SUFFIX) && path.is_file()
}

impl Installed {
    /// A private copy of the library, kept by its hash, so that nobody can change what is mapped.
    ///
    /// # Errors
    /// When the library is not the one that was trusted, or cannot be copied.
    pub fn private_copy(&self, cache: &Path) -> Result<PathBuf, Failure> {
        private_copy(&self.library, &self.packed.hash, cache)
    }
}
