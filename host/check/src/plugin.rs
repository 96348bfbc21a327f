//! An opened library and its calls, by the bare tables.
#![allow(unsafe_code)]

use crate::host::{Finished, Left, Session};
use crate::raw::{self, Entry};
use crate::setting::Setting;
use puncta_abi::{self as abi, Str};
use puncta_engine::documents::call::{PLAN, REQUEST};
use puncta_engine::documents::manifest::PLUGIN;
use puncta_engine::documents::{self, Failure, FailureCode, Manifest, Plan};
use std::mem::ManuallyDrop;
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// An opened library. It is never closed, as in the host.
pub struct Plugin {
    _handle: ManuallyDrop<libloading::Library>,
    table: &'static abi::Plugin,
}

/// An instance of its plugin, with its manifest.
pub struct Instance {
    /// The library.
    pub plugin: Plugin,
    /// What it says of itself.
    pub manifest: Manifest,
    /// Its number.
    pub number: u64,
    call: Option<&'static abi::Call1>,
}

/// A prepared call.
pub struct Prepared {
    handle: u64,
    /// What it plans.
    pub plan: Arc<Plan>,
}

/// How a call ended.
#[derive(Debug)]
pub struct Ended {
    /// What it returned.
    pub status: u32,
    /// Its reason.
    pub failure: Option<Failure>,
    /// What it gave.
    pub finished: Vec<Finished>,
    /// What it did that the ABI does not allow.
    pub wrong: Vec<String>,
    /// Whether the host refused something.
    pub refused: bool,
    /// A progress that is no fraction.
    pub progress: Option<f64>,
    /// Time of the run.
    pub time: Duration,
    /// From being told to stop to being back.
    pub stopping: Option<Duration>,
}

impl Plugin {
    /// Opens a library.
    ///
    /// # Errors
    /// What the system says.
    pub fn open(path: &Path) -> Result<Plugin, String> {
        use libloading::os::unix::{Library, RTLD_LOCAL, RTLD_NOW};
        // SAFETY: opening runs the library's constructors: this process is there for that.
        let handle =
            unsafe { Library::open(Some(path), RTLD_NOW | RTLD_LOCAL) }.map_err(|error| {
                let words = std::error::Error::source(&error).map(ToString::to_string);
                let words = words.unwrap_or_else(|| error.to_string());
                format!("the system cannot open it: {words}")
            })?;
        let handle = libloading::Library::from(handle);
        // SAFETY: the symbol lives as long as the library, which stays open.
        let table = unsafe {
            handle
                .get::<*const abi::Plugin>(abi::SYMBOL.as_bytes())
                .ok()
                .and_then(|symbol| symbol.as_ref())
        };
        Ok(Plugin {
            table: table.ok_or("it does not export the symbol")?,
            _handle: ManuallyDrop::new(handle),
        })
    }

    /// The exported table. Only `size` may be read before it was compared.
    pub fn table(&self) -> &'static abi::Plugin {
        self.table
    }

    /// What it says of itself, as text.
    ///
    /// # Errors
    /// When it says nothing.
    pub fn text(&self) -> Result<String, String> {
        let describe = self.table.describe.ok_or("it has no function describe")?;
        let mut out = Str::EMPTY;
        // SAFETY: the place outlives the call; the text is valid until the process ends.
        let (status, text) = unsafe { (describe(&raw mut out), out.as_str()) };
        match (status, text) {
            (abi::STATUS_OK, Some(text)) => Ok(text.to_owned()),
            (abi::STATUS_OK, None) => Err("its description is no UTF-8".into()),
            (status, _) => Err(format!("describe returns {}", status_name(status))),
        }
    }

    /// What it says of itself.
    ///
    /// # Errors
    /// What is wrong with it.
    pub fn manifest(&self) -> Result<Manifest, String> {
        documents::parse(&self.text()?, PLUGIN).map_err(|why| format!("its description is {why}"))
    }

    /// The table with this id.
    pub fn get(&self, id: &[u8]) -> *const std::ffi::c_void {
        let text = Str {
            ptr: id.as_ptr(),
            len: id.len() as u64,
        };
        // SAFETY: the text outlives the call.
        self.table
            .get
            .map_or(std::ptr::null(), |get| unsafe { get(text) })
    }

    /// Makes an instance for a host.
    ///
    /// # Errors
    /// The status.
    pub fn create(&self, host: raw::Kind) -> Result<u64, u32> {
        let mut number = 0;
        let create = self.table.create.ok_or(abi::STATUS_MISUSE)?;
        // SAFETY: the host's table lives as long as the process.
        match unsafe { create(host.table(), &raw mut number) } {
            abi::STATUS_OK => Ok(number),
            status => Err(status),
        }
    }

    /// Ends an instance.
    pub fn destroy(&self, number: u64) {
        if let Some(destroy) = self.table.destroy {
            // SAFETY: a number that `create` gave, once.
            unsafe { destroy(number) };
        }
    }
}

impl Instance {
    /// Opens a library and makes an instance for a host.
    ///
    /// # Errors
    /// What is in the way.
    pub fn open(path: &Path, host: raw::Kind) -> Result<Instance, String> {
        let plugin = Plugin::open(path)?;
        let manifest = plugin.manifest()?;
        let number = plugin
            .create(host)
            .map_err(|status| format!("create returns {}", status_name(status)))?;
        // SAFETY: a table that starts with its size, valid until the process ends.
        let call = unsafe {
            plugin
                .get(abi::CALL_1.as_bytes())
                .cast::<abi::Call1>()
                .as_ref()
        };
        let call = call.filter(|call| call.size as usize >= size_of::<abi::Call1>());
        if call.is_none() && !manifest.operations.is_empty() {
            return Err("it has operations but no table call/1 of the right size".into());
        }
        Ok(Instance {
            plugin,
            manifest,
            number,
            call,
        })
    }

    /// Asks it to prepare what a text says.
    ///
    /// # Errors
    /// How that ended.
    pub fn prepare_text(
        &self,
        session: &Arc<Session>,
        text: &[u8],
    ) -> Result<Prepared, Box<Ended>> {
        let begin = Instant::now();
        let entry = Entry::new(session);
        let mut plan = abi::Plan {
            handle: 0,
            document: Str::EMPTY,
        };
        let request = Str {
            ptr: text.as_ptr(),
            len: text.len() as u64,
        };
        let prepare = self.call.and_then(|call| call.prepare);
        // SAFETY: text and plan outlive the call.
        let status = prepare.map_or(abi::STATUS_MISUSE, |prepare| unsafe {
            prepare(self.number, entry.0, request, &raw mut plan)
        });
        drop(entry);
        if status != abi::STATUS_OK {
            return Err(Box::new(Ended::new(status, session.end(), begin.elapsed())));
        }
        // SAFETY: valid until the plan is dropped.
        let text = unsafe { plan.document.as_str() }.unwrap_or_default();
        match documents::parse::<Plan>(text, PLAN) {
            Ok(parsed) => Ok(Prepared {
                handle: plan.handle,
                plan: Arc::new(parsed),
            }),
            Err(why) => {
                session.note(format!("its plan is {why}"));
                Err(Box::new(Ended::new(status, session.end(), begin.elapsed())))
            }
        }
    }

    /// Prepares a call.
    ///
    /// # Errors
    /// How that ended.
    pub fn prepare(
        &self,
        session: &Arc<Session>,
        setting: &Setting,
    ) -> Result<Prepared, Box<Ended>> {
        let text = documents::write(&setting.request(), REQUEST);
        let prepared = self.prepare_text(session, text.as_bytes())?;
        // The engine refuses a plan that reads what there is not, and the plugin hears of it no more.
        for read in &prepared.plan.read {
            let header = setting.headers().nth(read.input);
            let part = header.and_then(|header| header.parts.get(read.part));
            let missing = match part {
                Some(part) => read
                    .columns
                    .iter()
                    .find(|name| *name != "row" && part.column(name).is_none())
                    .cloned(),
                None => Some(format!("of input {}", read.input)),
            };
            if let Some(name) = missing {
                self.drop(prepared);
                let why = Failure::bad_input(format!("the input has no column {name}"));
                session.refused();
                session.fail(why);
                let end = session.end();
                return Err(Box::new(Ended::new(
                    abi::STATUS_FAILED,
                    end,
                    Duration::ZERO,
                )));
            }
        }
        Ok(prepared)
    }

    /// Runs a prepared call once.
    pub fn run(&self, session: &Arc<Session>, prepared: &Prepared) -> Ended {
        session.set_plan(&prepared.plan);
        let entry = Entry::new(session);
        let begin = Instant::now();
        let run = self.call.and_then(|call| call.run);
        // SAFETY: instance and plan are the plugin's own numbers, both still alive.
        let status = run.map_or(abi::STATUS_MISUSE, |run| unsafe {
            run(self.number, entry.0, prepared.handle)
        });
        let back = Instant::now();
        drop(entry);
        let left = session.end();
        let stopping = left.told_at.map(|told| back.duration_since(told));
        let mut ended = Ended::new(status, left, back.duration_since(begin));
        ended.stopping = stopping;
        ended
    }

    /// Drops a prepared call.
    #[allow(clippy::needless_pass_by_value)]
    pub fn drop(&self, prepared: Prepared) {
        if let Some(drop) = self.call.and_then(|call| call.drop) {
            // SAFETY: the plugin's own number, once.
            unsafe { drop(self.number, prepared.handle) };
        }
    }

    /// Prepares, runs and drops a call.
    pub fn call(&self, setting: &Setting) -> Ended {
        let session = Arc::new(Session::new(setting));
        match self.prepare(&session, setting) {
            Ok(prepared) => {
                let ended = self.run(&session, &prepared);
                self.drop(prepared);
                ended
            }
            Err(ended) => *ended,
        }
    }
}

impl Ended {
    fn new(status: u32, left: Left, time: Duration) -> Ended {
        Ended {
            status,
            failure: left.failure,
            finished: left.finished,
            wrong: left.wrong,
            refused: left.refused,
            progress: left.progress,
            time,
            stopping: None,
        }
    }

    /// Whether it did what it should.
    pub fn ok(&self) -> bool {
        self.status == abi::STATUS_OK
    }

    /// Fails unless it did what it should.
    ///
    /// # Errors
    /// How it ended instead.
    pub fn good(self) -> Result<Ended, String> {
        if self.ok() { Ok(self) } else { Err(self.how()) }
    }

    /// How it ended, as the end of a sentence.
    pub fn how(&self) -> String {
        let name = status_name(self.status);
        match &self.failure {
            Some(failure) => format!("it ends with {name}: {failure}"),
            None if self.wrong.is_empty() => format!("it ends with {name} and no reason"),
            None => format!("it ends with {name}; it {}", self.wrong.join("; it ")),
        }
    }

    /// Fails if it ended in a way that no input excuses.
    ///
    /// # Errors
    /// What no input excuses.
    pub fn decent(&self) -> Result<(), String> {
        if self.status == abi::STATUS_PANICKED || self.status > abi::STATUS_NO_MEMORY {
            return Err(self.how());
        }
        let blamed = self.failure.as_ref().map(|failure| failure.code);
        match blamed {
            Some(FailureCode::Crashed) => Err(self.how()),
            Some(FailureCode::Internal) if !self.refused => Err(self.how()),
            _ => Ok(()),
        }
    }
}

/// A status as people say it.
pub fn status_name(status: u32) -> String {
    match status {
        abi::STATUS_OK => "OK".into(),
        abi::STATUS_FAILED => "FAILED".into(),
        abi::STATUS_CANCELLED => "CANCELLED".into(),
        abi::STATUS_PANICKED => "PANICKED".into(),
        abi::STATUS_NOT_MINE => "NOT_MINE".into(),
        abi::STATUS_MISUSE => "MISUSE".into(),
        abi::STATUS_NO_MEMORY => "NO_MEMORY".into(),
        other => format!("the unknown status {other}"),
    }
}
