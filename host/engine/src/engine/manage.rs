//! What the person decides about plugins: consent, on and off, and where they run.

use super::{Engine, allows};
use crate::kept::Kept;
use crate::plugins::Held;
use crate::plugins::catalogue::{Describer, FILE_NAME, Installed, Packed};
use crate::plugins::library_file::Facts;
use crate::plugins::packed::{read, remembered};
use crate::settings::{self, Choice, Consent, Mode, Settings};
use puncta_documents::{Failure, FailureCode, OperationKind};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::SystemTime;

/// A library that the person trusts from now on.
#[derive(Clone, Debug)]
pub struct Trusted {
    /// The library.
    pub library: PathBuf,
    /// What it is.
    pub facts: Facts,
    /// What it offers.
    pub packed: Packed,
    /// Whether the bundle lists it, so that no consent was needed.
    pub bundled: bool,
    /// Whether it lies in a folder in which plugins are looked for.
    pub installed: bool,
}

impl Engine {
    fn settings_file(&self) -> Result<Kept<Settings>, Failure> {
        self.options
            .config
            .as_deref()
            .map(settings::file)
            .ok_or_else(|| {
                let message = "there is no folder for settings, since the system names no home";
                Failure::new(FailureCode::Io, message)
                    .remedy(format!("set {} to a folder", settings::CONFIG))
            })
    }

    /// Trusts a library, named by its path, its folder or the id of a plugin that waits for
    /// consent. Then it is described in a worker, which runs code of it.
    ///
    /// # Errors
    /// When there is no such library, it is no plugin, or the settings cannot be written.
    pub fn trust(&self, what: &str) -> Result<Trusted, Failure> {
        let library = self.library_named(what)?;
        let library =
            std::path::absolute(&library).map_err(|error| Failure::io("find", &library, &error))?;
        let facts = Facts::of(&library)?;
        let known = self.catalogue.plugins().iter();
        let bundled = known
            .filter(|one| one.bundled)
            .any(|one| one.packed.hash == facts.hash);
        let claimed = library.parent().and_then(|folder| read(folder).ok());
        let claimed = claimed.filter(|packed| packed.hash == facts.hash);
        let consent = Consent {
            path: library.clone(),
            date: crate::date::utc(SystemTime::now()),
            size: facts.size,
            origin: facts.origin.clone(),
            plugin: claimed.as_ref().map(|packed| packed.manifest.id.clone()),
            ..Consent::default()
        };
        if !bundled {
            self.consent(&facts.hash, consent)?;
        }
        let packed = match claimed {
            Some(packed) => packed,
            None => {
                let describer = Describer {
                    cache: self.options.cache.clone(),
                    workers: Arc::clone(&self.workers),
                };
                remembered(&library, &facts, &describer)?
            }
        };
        let id = packed.manifest.id.clone();
        if !bundled {
            // Only now is it known for certain which plugin it is.
            self.settings_file()?.change(|settings| {
                if let Some(consent) = settings.trusted.get_mut(&facts.hash) {
                    consent.plugin = Some(id);
                }
                Ok(())
            })?;
        }
        let installed = self.options.folders.iter().any(|folder| {
            let folder = std::path::absolute(&folder.path).unwrap_or_default();
            library.starts_with(folder)
        });
        Ok(Trusted {
            library,
            facts,
            packed,
            bundled,
            installed,
        })
    }

    fn consent(&self, hash: &str, consent: Consent) -> Result<(), Failure> {
        self.settings_file()?.change(|settings| {
            settings.trusted.insert(hash.to_owned(), consent);
            Ok(())
        })
    }

    fn library_named(&self, what: &str) -> Result<PathBuf, Failure> {
        let path = Path::new(what);
        if path.is_file() {
            return Ok(path.to_path_buf());
        }
        if path.is_dir() && path.join(FILE_NAME).is_file() {
            return read(path).map(|packed| path.join(packed.library));
        }
        let held: Vec<&Held> = self
            .catalogue
            .held()
            .iter()
            .filter(|one| one.waits() && one.id() == Some(what))
            .collect();
        if let [one] = held.as_slice() {
            return Ok(one.library.clone());
        }
        let installed = self.catalogue.plugins().iter();
        if let Some(one) = installed
            .into_iter()
            .find(|one| one.packed.manifest.id == what)
        {
            return Ok(one.library.clone());
        }
        let message = match held.len() {
            0 => format!("{what} is no library and no plugin that waits for consent"),
            count => format!("{count} libraries say that they are {what}"),
        };
        let remedy = "give the library's path, as puncta plugins list shows it";
        Err(Failure::bad_parameter("what", message).remedy(remedy))
    }

    /// The plugin of this id, used or not.
    fn known(&self, id: &str) -> Result<Option<&Arc<Installed>>, Failure> {
        let plugins = self.catalogue.plugins();
        if let Some(found) = plugins.iter().find(|one| one.packed.manifest.id == id) {
            return Ok(Some(found));
        }
        let held = self.catalogue.held();
        let there = held.iter().any(|one| one.id() == Some(id));
        if there || self.settings.plugins.contains_key(id) {
            return Ok(None);
        }
        let known = plugins.iter().map(|one| one.packed.manifest.id.as_str());
        let near =
            crate::recipe::closest_names(id, known.chain(held.iter().filter_map(Held::id)), 3);
        let remedy = match near.as_slice() {
            [] => "puncta plugins list shows those that there are".to_owned(),
            near => format!("there is {}", near.join(", ")),
        };
        let message = format!("no plugin {id} is installed");
        Err(Failure::bad_parameter("id", message).remedy(remedy))
    }

    /// Switches a plugin on or off.
    ///
    /// # Errors
    /// When there is no such plugin, or the settings cannot be written.
    pub fn enable(&self, id: &str, enabled: bool) -> Result<Choice, Failure> {
        self.known(id)?;
        self.choose(id, |choice| choice.enabled = enabled)
    }

    /// Chooses where a plugin runs.
    ///
    /// # Errors
    /// When there is no such plugin, it insists on a worker, or the settings cannot be written.
    pub fn set_mode(&self, id: &str, mode: Mode) -> Result<Choice, Failure> {
        if let Some(plugin) = self.known(id)?
            && mode == Mode::InProcess
            && !allows(plugin)
        {
            let message = format!("the plugin {id} runs only in a process of its own");
            return Err(
                Failure::new(FailureCode::Unsupported, message).remedy("leave it in worker mode")
            );
        }
        self.choose(id, |choice| choice.mode = mode)
    }

    /// Chooses the reader of files of a format, or of a suffix with its dot; `None` forgets the
    /// choice.
    ///
    /// # Errors
    /// When there is no such reader, nothing was chosen, or the settings cannot be written.
    pub fn prefer_reader(&self, format: &str, reader: Option<&str>) -> Result<(), Failure> {
        let Some(id) = reader else {
            return self.settings_file()?.change(|settings| {
                settings.readers.remove(format).map(drop).ok_or_else(|| {
                    let message = format!("no reader was chosen for {format}");
                    Failure::bad_parameter("format", message)
                        .remedy("puncta readers list shows the choices")
                })
            });
        };
        let (_, operation) = self.operation(id)?;
        if operation.kind != OperationKind::Reader {
            let message = format!("{} is no reader", operation.id);
            return Err(
                Failure::bad_parameter("reader", message).remedy("puncta ops lists the readers")
            );
        }
        // Without its revision: a newer one of the same reader is meant too.
        let stem = operation.stem().to_owned();
        self.settings_file()?.change(|settings| {
            settings.readers.insert(format.to_owned(), stem);
            Ok(())
        })
    }

    fn choose(&self, id: &str, change: impl FnOnce(&mut Choice)) -> Result<Choice, Failure> {
        let choice = self.settings_file()?.change(|settings| {
            let choice = settings.plugins.entry(id.to_owned()).or_default();
            change(choice);
            Ok(choice.clone())
        })?;
        self.forget_crashes(id)?;
        Ok(choice)
    }
}
