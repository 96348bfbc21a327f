//! Runs operations of a plugin without the host, in the plugin's own tests.
//!
//! ```text
//! let table = Table::new("locs").f64("x", "nm", &[1.0, 2.0]).f64("y", "nm", &[0.0, 0.0]);
//! let done = Call::of::<RangeFilter>().set("ranges", json!({"x": [0, 1.5]})).input("table", table).run()?;
//! assert_eq!(done.output("table")?.u32("row")?, [0]);
//! ```
//!
//! The kit stands in for the host's tables `data/1` and `job/1`: it gives plain columns, takes
//! outputs, can cancel after a number of polls, and runs on any number of threads.

pub mod damage;
mod host;
mod memory;
mod object;
mod pool;
mod random;

pub use object::{Done, Object, Table};
pub use pool::{Stopped, Threads};
pub use random::Random;

use puncta_sdk::documents::schema::canonical;
use puncta_sdk::documents::{FileRef, InputRef};
use puncta_sdk::serde_json::Value;
use puncta_sdk::{Failure, Map, Operation, Plan, Registration, Request};
use std::path::Path;
use std::sync::Arc;

/// A call of an operation, built step by step.
pub struct Call {
    registration: Registration,
    parameters: Map,
    inputs: Vec<(String, Object)>,
    file: Option<FileRef>,
    threads: usize,
    cancel_after: Option<u64>,
}

impl Call {
    /// A call with default parameters.
    #[must_use]
    pub fn of<O: Operation + Sync>() -> Call {
        Call {
            registration: Registration::of::<O>(),
            parameters: Map::new(),
            inputs: Vec::new(),
            file: None,
            threads: 2,
            cancel_after: None,
        }
    }

    /// Sets a parameter, as a recipe would.
    #[must_use]
    pub fn set(mut self, name: &str, value: impl Into<Value>) -> Call {
        self.parameters.insert(name.into(), value.into());
        self
    }

    /// Binds an input.
    #[must_use]
    pub fn input(mut self, port: &str, object: impl Into<Object>) -> Call {
        self.inputs.push((port.into(), object.into()));
        self
    }

    /// The file to read or to write.
    #[must_use]
    pub fn file(mut self, path: &Path) -> Call {
        self.file = Some(FileRef {
            path: path.display().to_string(),
            name: path
                .file_name()
                .map(|n| n.to_string_lossy().into_owned())
                .unwrap_or_default(),
            size: path.metadata().ok().map(|metadata| metadata.len()),
        });
        self
    }

    /// Number of threads of the stand-in pool; 2 if nothing is said.
    #[must_use]
    pub fn threads(mut self, threads: usize) -> Call {
        self.threads = threads.max(1);
        self
    }

    /// Cancels at the `polls`-th time that the operation asks or reports progress.
    #[must_use]
    pub fn cancel_after(mut self, polls: u64) -> Call {
        self.cancel_after = Some(polls);
        self
    }

    fn request(&self) -> Result<Request, Failure> {
        let document = self.registration.document();
        Ok(Request {
            operation: document.id.clone(),
            parameters: canonical(&document.parameters, &self.parameters)?,
            inputs: self
                .inputs
                .iter()
                .map(|(port, object)| InputRef {
                    port: port.clone(),
                    header: object.header.clone(),
                })
                .collect(),
            file: self.file.clone(),
            memory: None,
            rest: Map::new(),
        })
    }

    /// Only prepares.
    ///
    /// # Errors
    /// What the schema or the operation's `prepare` refuses.
    pub fn prepare(&self) -> Result<Plan, Failure> {
        self.registration
            .prepare(&self.request()?)
            .map(|(plan, _)| plan)
    }

    /// Prepares and runs.
    ///
    /// # Errors
    /// What the schema, `prepare` or `run` refuses.
    pub fn run(self) -> Result<Done, Failure> {
        let request = self.request()?;
        let (plan, prepared) = self.registration.prepare(&request)?;
        let objects = self.inputs.into_iter().map(|(_, object)| object).collect();
        host::run(host::Setting {
            request: Arc::new(request),
            plan: Arc::new(plan),
            inputs: objects,
            threads: self.threads,
            cancel_after: self.cancel_after,
            prepared,
        })
    }
}
