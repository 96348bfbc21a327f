//! The engine: installed plugins, and calls of their operations in this process or in workers.

mod aftermath;
mod call;
mod check;
mod choose;
mod manage;
mod read;
mod recipe;
mod relay;
mod save;
mod write;

pub use call::{Called, Invocation, PreparedCall};
pub use check::Converted;
pub use manage::Trusted;
pub use read::ReadFile;
pub use recipe::{SourceFile, Steps, lineage};
pub use write::Written;

use crate::cache::ResultCache;
use crate::plugins::catalogue::{Catalogue, Describer, Folder, Installed};
use crate::plugins::context::Resources;
use crate::plugins::crashes::Crashes;
use crate::plugins::library::Library;
use crate::plugins::sentinel::{Marker, Sentinel};
use crate::room::Room;
use crate::settings::{self, Mode, Settings};
use crate::store::SegmentPool;
use crate::worker;
use puncta_documents::{Failure, FailureCode, Operation};
use std::collections::HashMap;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

/// Memory of dropped results that is kept for the next ones.
const KEPT_BYTES: u64 = 1 << 30;

/// Where calls run.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Isolation {
    /// Plugins of the bundle that allow it in this process, all others in workers.
    #[default]
    ByPlugin,
    /// All in workers.
    Always,
    /// All in this process that do not insist on a worker.
    InProcess,
    /// All in this process; what insists on a worker is refused.
    OnlyInProcess,
}

/// What an engine is made with.
#[derive(Clone, Debug)]
pub struct Options {
    /// Folders with plugins, the most important first.
    pub folders: Vec<Folder>,
    /// Folder for private copies of libraries.
    pub cache: PathBuf,
    /// The person's configuration folder, with the settings; without one there are none.
    pub config: Option<PathBuf>,
    /// Folder for what is remembered of sessions that ended inside a plugin.
    pub state: Option<PathBuf>,
    /// Bytes of results that are kept in the cache folder for later sessions; 0 keeps none.
    pub results: u64,
    /// Program that serves as worker when it is called with `worker`.
    pub program: PathBuf,
    /// Threads for calls; 0 means as many as the machine has.
    pub threads: usize,
    /// Where calls run.
    pub isolation: Isolation,
    /// Bytes that a call may use for its outputs and its work.
    pub memory: u64,
    /// Bytes of private memory that a worker process may have.
    pub worker_memory: u64,
}

impl Options {
    /// The usual options: plugins of `$PUNCTA_PLUGIN_PATH`, of the person's own folder, and of the
    /// bundle that `program` lies in.
    #[must_use]
    pub fn usual(program: PathBuf) -> Options {
        let mut folders = Vec::new();
        if let Some(paths) = std::env::var_os("PUNCTA_PLUGIN_PATH") {
            folders.extend(std::env::split_paths(&paths).map(|path| Folder {
                path,
                bundled: false,
            }));
        }
        let (config, state) = settings::folders();
        if let Some(config) = &config {
            folders.push(Folder {
                path: config.join("plugins"),
                bundled: false,
            });
        }
        if let Some(bundle) = program.parent() {
            folders.push(Folder {
                path: bundle.join("plugins"),
                bundled: true,
            });
        }
        let installed = crate::store::installed_memory().unwrap_or(64 << 30);
        let cache = std::env::var_os("PUNCTA_CACHE").map(PathBuf::from);
        let cache = cache.or_else(|| dirs::cache_dir().map(|folder| folder.join("puncta")));
        Options {
            folders,
            cache: cache.unwrap_or_else(|| std::env::temp_dir().join("puncta")),
            config,
            state,
            worker_memory: worker::Start::new(program.clone()).memory,
            program,
            threads: 0,
            isolation: Isolation::ByPlugin,
            memory: installed,
            results: kept_results(),
        }
    }
}

/// Bytes of kept results: gigabytes of `$PUNCTA_RESULTS`, or 8.
fn kept_results() -> u64 {
    let given = std::env::var("PUNCTA_RESULTS").ok();
    let gigabytes = given.and_then(|text| text.trim().parse::<f64>().ok());
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
    let bytes = (gigabytes.unwrap_or(8.0) * f64::from(1 << 30)) as u64;
    bytes
}

/// Installed plugins, and what is needed to call them.
pub struct Engine {
    catalogue: Catalogue,
    /// As they were when the engine was opened.
    settings: Settings,
    crashes: Crashes,
    crash_trouble: Option<Failure>,
    /// Marks of the calls in this process; made with the first one.
    sentinel: OnceLock<Option<Arc<Sentinel>>>,
    options: Options,
    pool: Arc<rayon::ThreadPool>,
    segments: Arc<SegmentPool>,
    room: Arc<Room>,
    results: ResultCache,
    workers: Arc<worker::Pool>,
    libraries: Mutex<HashMap<PathBuf, Arc<Library>>>,
    copies: Mutex<HashMap<PathBuf, PathBuf>>,
}

impl Engine {
    /// Scans the plugin folders. Runs nothing of a library, unless it is trusted and was never
    /// described.
    ///
    /// # Errors
    /// When the settings are damaged, or the system gives no threads.
    pub fn open(options: Options) -> Result<Engine, Failure> {
        let threads = match options.threads {
            0 => std::thread::available_parallelism().map_or(1, std::num::NonZero::get),
            threads => threads,
        };
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .map_err(|_| {
                Failure::new(
                    FailureCode::Resources,
                    "the system gives no threads for calculations",
                )
            })?;
        let settings = options.settings()?;
        let (crashes, crash_trouble) = options.crashes();
        let workers = Arc::new(worker::Pool::new(worker::Start {
            program: options.program.clone(),
            threads,
            memory: options.worker_memory,
        }));
        let describer = Describer {
            cache: options.cache.clone(),
            workers: Arc::clone(&workers),
        };
        Ok(Engine {
            catalogue: Catalogue::scan(&options.folders, &settings, &describer),
            crashes,
            crash_trouble,
            sentinel: OnceLock::new(),
            settings,
            workers,
            pool: Arc::new(pool),
            segments: Arc::new(SegmentPool::new(KEPT_BYTES)),
            room: Arc::new(Room::new(options.memory)),
            results: ResultCache::new(options.cache.join("results"), options.results),
            options,
            libraries: Mutex::default(),
            copies: Mutex::default(),
        })
    }

    /// What it was opened with.
    #[must_use]
    pub fn options(&self) -> &Options {
        &self.options
    }

    /// Installed plugins.
    #[must_use]
    pub fn catalogue(&self) -> &Catalogue {
        &self.catalogue
    }

    /// Workers, for describing libraries.
    #[must_use]
    pub fn workers(&self) -> &Arc<worker::Pool> {
        &self.workers
    }

    /// Threads for calculations.
    #[must_use]
    pub fn pool(&self) -> &Arc<rayon::ThreadPool> {
        &self.pool
    }

    fn resources(&self) -> Resources {
        Resources {
            threads: Arc::clone(&self.pool),
            memory: Arc::clone(&self.segments),
            budget: self.options.memory,
        }
    }

    /// The operation with this id; without a revision, the newest.
    ///
    /// # Errors
    /// When there is none; the sentence names the closest ids.
    pub fn operation(&self, id: &str) -> Result<(&Arc<Installed>, &Operation), Failure> {
        self.catalogue.find(id).ok_or_else(|| {
            if let Some(failure) = self.catalogue.withheld(id) {
                return failure;
            }
            let known = self.catalogue.operations();
            let known = known.map(|(_, operation)| operation.id.as_str());
            let near = crate::recipe::closest_names(id, known, 3);
            let remedy = if near.is_empty() {
                match self
                    .catalogue
                    .held()
                    .iter()
                    .filter(|held| held.waits())
                    .count()
                {
                    0 => "puncta ops lists those that there are".to_owned(),
                    _ => "a library waits for your consent: see puncta plugins list".to_owned(),
                }
            } else {
                format!("there is {}", near.join(", "))
            };
            Failure::new(
                FailureCode::Unsupported,
                format!("no operation {id} is installed"),
            )
            .remedy(remedy)
        })
    }

    /// The private copy of a plugin's library.
    fn copy(&self, plugin: &Installed) -> Result<PathBuf, Failure> {
        let mut copies = self.copies.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(copy) = copies.get(&plugin.library) {
            return Ok(copy.clone());
        }
        let copy = plugin.private_copy(&self.options.cache)?;
        copies.insert(plugin.library.clone(), copy.clone());
        Ok(copy)
    }

    /// The opened library of a plugin that runs in this process.
    fn library(&self, plugin: &Installed) -> Result<Arc<Library>, Failure> {
        let copy = self.copy(plugin)?;
        let mut libraries = self
            .libraries
            .lock()
            .unwrap_or_else(PoisonError::into_inner);
        if let Some(library) = libraries.get(&copy) {
            return Ok(Arc::clone(library));
        }
        let marker = self.sentinel().map(|sentinel| Marker {
            sentinel,
            plugin: plugin.packed.manifest.id.clone(),
            hash: plugin.packed.hash.clone(),
        });
        let library = Library::open_marked(&copy, plugin.packed.door, marker)?;
        let library = Arc::new(library);
        libraries.insert(copy, Arc::clone(&library));
        Ok(library)
    }

    /// The settings, as they were when the engine was opened.
    #[must_use]
    pub fn settings(&self) -> &Settings {
        &self.settings
    }

    /// Whether calls of a plugin run in this process, as far as the plugin decides it.
    #[must_use]
    pub fn in_process(&self, plugin: &Installed) -> bool {
        let manifest = &plugin.packed.manifest;
        let by_plugin = || match self.settings.choice(&manifest.id).mode {
            Mode::Default => plugin.bundled && !self.demoted(plugin),
            Mode::Worker => false,
            Mode::InProcess => true,
        };
        allows(plugin)
            && match self.options.isolation {
                Isolation::ByPlugin => by_plugin(),
                Isolation::Always => false,
                Isolation::InProcess | Isolation::OnlyInProcess => true,
            }
    }

    /// Where a call runs: whether in this process.
    ///
    /// # Errors
    /// When it is to run in this process only, and the plugin insists on a worker.
    fn place(&self, plugin: &Installed) -> Result<bool, Failure> {
        if self.options.isolation == Isolation::OnlyInProcess && !allows(plugin) {
            let message = format!(
                "the plugin {} runs only in a process of its own",
                plugin.packed.manifest.id
            );
            return Err(only_in_process(message));
        }
        Ok(self.in_process(plugin))
    }
}

/// Whether a plugin may run in the host's process at all.
fn allows(plugin: &Installed) -> bool {
    plugin.packed.manifest.isolation == "none"
}

fn only_in_process(message: String) -> Failure {
    Failure::new(FailureCode::Unsupported, message).remedy("leave out --in-process")
}

impl Options {
    /// Reads the person's settings.
    ///
    /// # Errors
    /// When they are damaged.
    pub fn settings(&self) -> Result<Settings, Failure> {
        let config = self.config.as_ref();
        config.map_or_else(
            || Ok(Settings::default()),
            |config| settings::file(config).read(),
        )
    }

    /// The plugins of the folders, without an engine to call them.
    ///
    /// # Errors
    /// When the settings are damaged.
    pub fn catalogue(&self) -> Result<Catalogue, Failure> {
        let describer = Describer {
            cache: self.cache.clone(),
            workers: Arc::new(worker::Pool::new(worker::Start::new(self.program.clone()))),
        };
        Ok(Catalogue::scan(
            &self.folders,
            &self.settings()?,
            &describer,
        ))
    }
}
