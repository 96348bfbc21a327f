//! An opened library, and calls of its operations in this process.
#![allow(unsafe_code)]

use super::context::JobContext;
use super::sentinel::{Label, Marker};
use super::tables::{Entry, HOST, gives};
use puncta_abi::{self as abi, Str};
use puncta_documents::call::{PLAN, REQUEST};
use puncta_documents::manifest::PLUGIN;
use puncta_documents::{Failure, FailureCode, Manifest, Plan, Request};
use std::mem::ManuallyDrop;
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};

/// An opened plugin library. It is never closed: a library that has run leaves threads, thread-local
/// destructors and pointers behind.
pub struct Library {
    _handle: ManuallyDrop<libloading::Library>,
    plugin: &'static abi::Plugin,
    manifest: Manifest,
    instance: u64,
    call: Option<&'static abi::Call1>,
    /// Where calls are marked, in the host's process.
    marker: Option<Marker>,
    /// Held during `run` of a plugin that does not say it is reentrant.
    turn: Mutex<()>,
}

/// A prepared call of an opened library.
pub struct Prepared {
    library: Arc<Library>,
    handle: u64,
    plan: Arc<Plan>,
    label: Option<Label>,
}

fn broken(path: &Path, why: &str) -> Failure {
    let message = format!("{} {why}", path.display());
    Failure::new(FailureCode::Unsupported, message).remedy("build it with this host's SDK")
}

impl Library {
    /// Opens a library whose bytes were inspected before, and makes an instance of its plugin.
    ///
    /// # Errors
    /// When the system cannot load it, its tables differ from this build's, or it refuses.
    pub fn open(path: &Path, door: bool) -> Result<Library, Failure> {
        Library::open_marked(path, door, None)
    }

    /// As [`Library::open`]; whatever runs of the library is marked while it does.
    ///
    /// # Errors
    /// As [`Library::open`].
    pub fn open_marked(
        path: &Path,
        door: bool,
        marker: Option<Marker>,
    ) -> Result<Library, Failure> {
        let label = marker.as_ref().and_then(|marker| marker.label(""));
        let _running = label.as_ref().map(Label::enter);
        // SAFETY: loading runs the library's constructors: that is what a plugin is trusted with.
        let handle = unsafe { load(path) }?;
        if door {
            puncta_door::check(path)
                .map_err(|why| broken(path, &format!("was built with other tables: {why}")))?;
        }
        // SAFETY: the symbol is a `Plugin` that lives as long as the library, which stays open; its
        // frozen first member, the size, is checked before anything else is read.
        let plugin: &'static abi::Plugin = unsafe {
            let symbol: libloading::Symbol<'_, *const abi::Plugin> = handle
                .get(abi::SYMBOL.as_bytes())
                .map_err(|_| broken(path, "does not export the plugin's symbol"))?;
            symbol
                .as_ref()
                .ok_or_else(|| broken(path, "exports nothing"))?
        };
        if (plugin.size as usize) < size_of::<abi::Plugin>() || plugin.number != abi::ABI_NUMBER {
            return Err(broken(path, "has tables of another size than this host's"));
        }
        let manifest = describe(path, plugin)?;
        if let Some(need) = manifest.needs.iter().find(|need| !gives(need)) {
            let shown = path.display();
            let message = format!("{shown} needs {need}, which this host does not have");
            let failure = Failure::new(FailureCode::Unsupported, message);
            return Err(failure.remedy("update Puncta, or use an earlier version of the plugin"));
        }
        let instance = create(path, plugin)?;
        // SAFETY: `get` gives a table that starts with its size, valid until the process ends.
        let call = unsafe {
            let get = plugin
                .get
                .ok_or_else(|| broken(path, "has no function get"))?;
            get(Str::new(abi::CALL_1)).cast::<abi::Call1>().as_ref()
        };
        let call = call.filter(|call| call.size as usize >= size_of::<abi::Call1>());
        if call.is_none() && !manifest.operations.is_empty() {
            return Err(broken(path, "has operations but no table call/1"));
        }
        let handle = ManuallyDrop::new(handle);
        Ok(Library {
            _handle: handle,
            plugin,
            manifest,
            instance,
            call,
            marker,
            turn: Mutex::new(()),
        })
    }

    /// What it is and offers.
    #[must_use]
    pub fn manifest(&self) -> &Manifest {
        &self.manifest
    }

    /// The table `id` of the plugin, as its address; null if it has none.
    #[must_use]
    pub fn table(&self, id: &str) -> *const std::ffi::c_void {
        // SAFETY: the text outlives the call.
        self.plugin
            .get
            .map_or(std::ptr::null(), |get| unsafe { get(Str::new(id)) })
    }

    /// The number of the plugin's instance, for its tables.
    #[must_use]
    pub fn instance(&self) -> u64 {
        self.instance
    }

    /// Prepares a call.
    ///
    /// # Errors
    /// What the plugin refuses.
    pub fn prepare(
        self: &Arc<Self>,
        context: &Arc<JobContext>,
        request: &Request,
    ) -> Result<Prepared, Failure> {
        let missing = || Failure::internal("the plugin has no function prepare");
        let prepare = self
            .call
            .and_then(|call| call.prepare)
            .ok_or_else(missing)?;
        let text = puncta_documents::write(request, REQUEST);
        let mut plan = abi::Plan {
            handle: 0,
            document: Str::EMPTY,
        };
        let marker = self.marker.as_ref();
        let label = marker.and_then(|marker| marker.label(&request.operation));
        let entry = Entry::new(context);
        let running = label.as_ref().map(Label::enter);
        // SAFETY: the tables were checked at opening; text and plan outlive the call.
        let status = unsafe { prepare(self.instance, entry.0, Str::new(&text), &raw mut plan) };
        drop(running);
        drop(entry);
        check(status, context)?;
        // SAFETY: the document is valid until `drop` of this plan.
        let document = unsafe { plan.document.as_str() }.unwrap_or("");
        let parsed = puncta_documents::parse::<Plan>(document, PLAN);
        let mut prepared = Prepared {
            library: Arc::clone(self),
            handle: plan.handle,
            plan: Arc::default(),
            label,
        };
        let parsed =
            parsed.map_err(|why| Failure::internal(format!("the plugin's plan is {why}")))?;
        prepared.plan = Arc::new(parsed);
        Ok(prepared)
    }
}

impl Prepared {
    /// What the call will do.
    #[must_use]
    pub fn plan(&self) -> &Arc<Plan> {
        &self.plan
    }

    /// Runs it. Outputs are in the context afterwards.
    ///
    /// # Errors
    /// What the plugin fails with.
    pub fn run(&self, context: &Arc<JobContext>) -> Result<(), Failure> {
        let missing = || Failure::internal("the plugin has no function run");
        let run = self
            .library
            .call
            .and_then(|call| call.run)
            .ok_or_else(missing)?;
        context.set_plan(Arc::clone(&self.plan));
        let entry = Entry::new(context);
        let turn = (!self.library.manifest.reentrant).then(|| {
            self.library
                .turn
                .lock()
                .unwrap_or_else(PoisonError::into_inner)
        });
        let running = self.label.as_ref().map(Label::enter);
        // SAFETY: instance and plan are the plugin's own numbers, both still alive.
        let status = unsafe { run(self.library.instance, entry.0, self.handle) };
        drop(running);
        drop(turn);
        drop(entry);
        check(status, context)
    }
}

impl Drop for Prepared {
    fn drop(&mut self) {
        if let Some(drop) = self.library.call.and_then(|call| call.drop) {
            let _running = self.label.as_ref().map(Label::enter);
            // SAFETY: the plugin's own number, dropped once.
            unsafe { drop(self.library.instance, self.handle) }
        }
    }
}

fn check(status: u32, context: &JobContext) -> Result<(), Failure> {
    let given = context.take_failure();
    match status {
        abi::STATUS_OK => Ok(()),
        abi::STATUS_CANCELLED => Err(Failure::cancelled()),
        abi::STATUS_NOT_MINE => Err(given.unwrap_or_else(|| {
            Failure::new(FailureCode::NotMine, "the file is of another format")
        })),
        abi::STATUS_PANICKED => {
            Err(given.unwrap_or_else(|| Failure::new(FailureCode::Crashed, "the plugin panicked")))
        }
        _ => {
            Err(given.unwrap_or_else(|| Failure::internal("the plugin failed without saying why")))
        }
    }
}

#[cfg(unix)]
unsafe fn load(path: &Path) -> Result<libloading::Library, Failure> {
    use libloading::os::unix::{Library as Unix, RTLD_LOCAL, RTLD_NOW};
    // SAFETY: the caller's.
    let opened = unsafe { Unix::open(Some(path), RTLD_NOW | RTLD_LOCAL) };
    opened
        .map(Into::into)
        .map_err(|error| unloadable(path, &error))
}

#[cfg(not(unix))]
unsafe fn load(path: &Path) -> Result<libloading::Library, Failure> {
    // SAFETY: the caller's.
    unsafe { libloading::Library::new(path) }.map_err(|error| unloadable(path, &error))
}

/// The system's own words name the library that is missing.
fn unloadable(path: &Path, error: &libloading::Error) -> Failure {
    let words = std::error::Error::source(error).map(ToString::to_string);
    let words = words.unwrap_or_else(|| error.to_string());
    let message = format!("the system cannot load {}: {words}", path.display());
    Failure::new(FailureCode::Unsupported, message).remedy("install the library it needs")
}

fn describe(path: &Path, plugin: &'static abi::Plugin) -> Result<Manifest, Failure> {
    let describe = plugin
        .describe
        .ok_or_else(|| broken(path, "has no function describe"))?;
    let mut text = Str::EMPTY;
    // SAFETY: the place outlives the call; the text is valid until the process ends.
    let (status, text) = unsafe {
        let status = describe(&raw mut text);
        (status, text.as_str().unwrap_or(""))
    };
    if status != abi::STATUS_OK {
        return Err(broken(path, "cannot describe itself"));
    }
    puncta_documents::parse(text, PLUGIN)
        .map_err(|why| broken(path, &format!("describes itself by {why}")))
}

fn create(path: &Path, plugin: &'static abi::Plugin) -> Result<u64, Failure> {
    let create = plugin
        .create
        .ok_or_else(|| broken(path, "has no function create"))?;
    let mut instance = 0;
    // SAFETY: the host's table lives as long as the process, the place as long as the call.
    match unsafe { create(&raw const HOST, &raw mut instance) } {
        abi::STATUS_OK => Ok(instance),
        _ => Err(broken(
            path,
            "refuses to start: this host lacks a table that it needs",
        )),
    }
}
