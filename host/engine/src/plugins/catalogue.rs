//! Which plugins are installed. Scanning reads `plugin.json` files and opens no library.

use super::inspect::{hex, inspect};
use crate::worker::Pool;
use puncta_documents::{Failure, FailureCode, Manifest, Map, Operation};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Format of `plugin.json`.
pub const INSTALLED: &str = "puncta.installed/1";
/// Name of the file that `puncta plugins pack` writes beside a library.
pub const FILE_NAME: &str = "plugin.json";

/// What `plugin.json` says: the manifest, and which library it was taken from.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Packed {
    /// File name of the library, in the same folder.
    pub library: String,
    /// BLAKE3 of the library.
    pub hash: String,
    /// Whether the library has the door.
    pub door: bool,
    /// What the plugin is and offers.
    pub manifest: Manifest,
    /// Members that this version does not know.
    #[serde(flatten)]
    pub rest: Map,
}

/// An installed plugin.
#[derive(Clone, Debug)]
pub struct Installed {
    /// What `plugin.json` says.
    pub packed: Packed,
    /// The library.
    pub library: PathBuf,
    /// Whether it belongs to the bundle that this program is in.
    pub bundled: bool,
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
    /// Whether it belongs to the bundle that this program is in.
    pub bundled: bool,
}

/// All installed plugins. The first of an id wins.
#[derive(Clone, Debug, Default)]
pub struct Catalogue {
    plugins: Vec<Arc<Installed>>,
    operations: BTreeMap<String, (usize, usize)>,
    refused: Vec<Refused>,
}

impl Catalogue {
    /// Reads the folders in order.
    #[must_use]
    pub fn scan(folders: &[Folder]) -> Catalogue {
        let mut catalogue = Catalogue::default();
        for folder in folders {
            // A folder that is not there has no plugins.
            let Ok(entries) = fs::read_dir(&folder.path) else {
                continue;
            };
            let mut places: Vec<PathBuf> = entries.flatten().map(|entry| entry.path()).collect();
            places.sort();
            for place in places
                .into_iter()
                .filter(|place| place.join(FILE_NAME).is_file())
            {
                match read(&place, folder.bundled) {
                    Ok(installed) => catalogue.add(installed),
                    Err(failure) => catalogue.refused.push(Refused {
                        path: place,
                        why: failure.to_string(),
                    }),
                }
            }
        }
        catalogue
    }

    fn add(&mut self, installed: Installed) {
        let id = &installed.packed.manifest.id;
        if let Some(first) = self
            .plugins
            .iter()
            .find(|known| &known.packed.manifest.id == id)
        {
            let why = format!("{id} is already installed in {}", first.library.display());
            self.refused.push(Refused {
                path: installed.library,
                why,
            });
            return;
        }
        for operation in &installed.packed.manifest.operations {
            if let Some((plugin, _)) = self.operations.get(&operation.id) {
                let owner = &self.plugins[*plugin].packed.manifest.id;
                let why = format!("{} is already offered by {owner}", operation.id);
                self.refused.push(Refused {
                    path: installed.library,
                    why,
                });
                return;
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

fn read(place: &Path, bundled: bool) -> Result<Installed, Failure> {
    let path = place.join(FILE_NAME);
    let text = fs::read_to_string(&path).map_err(|error| Failure::io("read", &path, &error))?;
    let packed: Packed = puncta_documents::parse(&text, INSTALLED).map_err(|why| {
        Failure::bad_file(format!("{} is {why}", path.display()))
            .remedy("run puncta plugins pack on the library again")
    })?;
    let name = Path::new(&packed.library);
    if name.file_name() != Some(name.as_os_str()) {
        let message = format!("{} names a library in another folder", path.display());
        return Err(Failure::bad_file(message));
    }
    Ok(Installed {
        library: place.join(name),
        packed,
        bundled,
    })
}

/// Describes a library in a worker that is thrown away.
///
/// # Errors
/// One sentence: what the file is instead of a plugin, or how describing it failed.
pub fn describe(library: &Path, pool: &Pool) -> Result<Packed, Failure> {
    let bytes = fs::read(library).map_err(|error| Failure::io("read", library, &error))?;
    let inspected = inspect(library, &bytes)?;
    let manifest = pool.describe(library, inspected.door)?;
    let name = library
        .file_name()
        .map(|name| name.to_string_lossy().into_owned());
    Ok(Packed {
        library: name.unwrap_or_default(),
        hash: hex(&inspected.hash),
        door: inspected.door,
        manifest,
        rest: Map::new(),
    })
}

/// Describes a library and writes `plugin.json` beside it. Returns the file's path.
///
/// # Errors
/// As [`describe`], or when the file cannot be written.
pub fn pack(library: &Path, pool: &Pool) -> Result<(PathBuf, Packed), Failure> {
    let packed = describe(library, pool)?;
    let path = library.with_file_name(FILE_NAME);
    let text = puncta_documents::write(&packed, INSTALLED);
    crate::files::write_whole(&path, text.as_bytes())?;
    Ok((path, packed))
}

impl Installed {
    /// A private copy of the library, kept by its hash, so that nobody can change what is mapped.
    ///
    /// # Errors
    /// When the library is not the one that `plugin.json` was made from, or cannot be copied.
    pub fn private_copy(&self, cache: &Path) -> Result<PathBuf, Failure> {
        let bytes =
            fs::read(&self.library).map_err(|error| Failure::io("read", &self.library, &error))?;
        let inspected = inspect(&self.library, &bytes)?;
        if hex(&inspected.hash) != self.packed.hash {
            let message = format!("{} has changed since it was packed", self.library.display());
            return Err(Failure::new(FailureCode::Unsupported, message)
                .remedy("run puncta plugins pack on it again if you trust the change"));
        }
        let folder = cache.join("plugins").join(&self.packed.hash[..16]);
        let copy = folder.join(&self.packed.library);
        let same = fs::read(&copy).is_ok_and(|there| there == bytes);
        if !same {
            fs::create_dir_all(&folder).map_err(|e| Failure::io("create", &folder, &e))?;
            crate::files::write_whole(&copy, &bytes)?;
        }
        Ok(copy)
    }
}
