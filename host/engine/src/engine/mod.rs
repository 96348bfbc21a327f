//! The engine: installed plugins, and calls of their operations in this process or in workers.

mod call;
mod check;
mod read;
mod recipe;
mod relay;
mod save;
mod write;

pub use call::{Called, Invocation, PreparedCall};
pub use check::Converted;
pub use read::ReadFile;
pub use recipe::{SourceFile, Steps, lineage};
pub use write::Written;

use crate::plugins::catalogue::{Catalogue, Folder, Installed};
use crate::plugins::context::Resources;
use crate::plugins::library::Library;
use crate::store::SegmentPool;
use crate::worker;
use puncta_documents::{Failure, FailureCode, Operation};
use std::collections::HashMap;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};

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
}

/// What an engine is made with.
#[derive(Clone, Debug)]
pub struct Options {
    /// Folders with plugins, the most important first.
    pub folders: Vec<Folder>,
    /// Folder for private copies of libraries.
    pub cache: PathBuf,
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
        if let Some(config) = dirs::config_dir() {
            folders.push(Folder {
                path: config.join("puncta").join("plugins"),
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
            worker_memory: worker::Start::new(program.clone()).memory,
            program,
            threads: 0,
            isolation: Isolation::ByPlugin,
            memory: installed,
        }
    }
}

/// Installed plugins, and what is needed to call them.
pub struct Engine {
    catalogue: Catalogue,
    options: Options,
    pool: Arc<rayon::ThreadPool>,
    segments: Arc<SegmentPool>,
    workers: Arc<worker::Pool>,
    libraries: Mutex<HashMap<PathBuf, Arc<Library>>>,
    copies: Mutex<HashMap<PathBuf, PathBuf>>,
}

impl Engine {
    /// Scans the plugin folders. Opens no library.
    ///
    /// # Errors
    /// When the system gives no threads.
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
        Ok(Engine {
            catalogue: Catalogue::scan(&options.folders),
            workers: Arc::new(worker::Pool::new(worker::Start {
                program: options.program.clone(),
                threads,
                memory: options.worker_memory,
            })),
            pool: Arc::new(pool),
            segments: Arc::new(SegmentPool::new(KEPT_BYTES)),
            options,
            libraries: Mutex::default(),
            copies: Mutex::default(),
        })
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
            let known = self.catalogue.operations();
            let known = known.map(|(_, operation)| operation.id.as_str());
            let near = crate::recipe::closest_names(id, known, 3);
            let remedy = if near.is_empty() {
                "puncta ops lists those that there are".to_owned()
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
        let library = Arc::new(Library::open(&copy, plugin.packed.door)?);
        libraries.insert(copy, Arc::clone(&library));
        Ok(library)
    }

    /// Whether calls of a plugin run in this process.
    #[must_use]
    pub fn in_process(&self, plugin: &Installed) -> bool {
        let allows = plugin.packed.manifest.isolation == "none";
        match self.options.isolation {
            Isolation::ByPlugin => allows && plugin.bundled,
            Isolation::Always => false,
            Isolation::InProcess => allows,
        }
    }
}
