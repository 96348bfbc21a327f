//! A plugin whose operations misbehave, each in one way, when they are told to.
//!
//! Its tables are written by hand around those of the SDK, whose shims would catch or hide part of
//! what is to be shown. What every `unsafe` in this file relies on: the host keeps the rules of the
//! ABI (its texts and places live as long as the call, numbers come back as they were given), and
//! what breaks them does so on purpose, in a process that is there to be lost.
#![allow(unsafe_code)]

mod faults;
mod lies;
mod operations;
mod orders;
mod readers;

use faults::Fault;
use orders::Phase;
use puncta_sdk::abi::{self, Call1, Str};
use puncta_sdk::{FromValue, serde_json::Value, shim};
use std::cell::UnsafeCell;
use std::collections::HashMap;
use std::ffi::c_void;
use std::sync::{Mutex, MutexGuard, OnceLock, PoisonError};

/// The table, in memory that the library's constructor can write.
#[repr(transparent)]
pub struct Table(UnsafeCell<abi::Plugin>);

// SAFETY: written by the constructor only, before the host has the library's address.
unsafe impl Sync for Table {}

/// What this library exports. It has no door, as a plugin in C.
#[unsafe(export_name = "puncta_plugin_v0_1")]
pub static PUNCTA_PLUGIN: Table = Table(UnsafeCell::new(abi::Plugin {
    create: Some(create),
    ..OURS
}));

const OURS: abi::Plugin = shim::table(describe, get);

// SAFETY: the linker's list of functions that the loader calls, each without arguments.
#[used]
#[unsafe(link_section = ".init_array")]
static LOADED: extern "C" fn() = loaded;

extern "C" fn loaded() {
    let Some(fault) = orders::beside_library(Phase::Load) else {
        return;
    };
    // SAFETY: nobody else has the table yet.
    let table = unsafe { &mut *PUNCTA_PLUGIN.0.get() };
    match fault {
        Fault::WildSize => table.size = 3,
        Fault::WildNumber => table.number = 77,
        Fault::NullTable => (table.describe, table.get) = (None, None),
        fault => _ = fault.commit(),
    }
}

extern "C" fn describe(out: *mut Str) -> u32 {
    static MANIFEST: OnceLock<String> = OnceLock::new();
    let fault = orders::beside_library(Phase::Describe);
    if let Some(text) = fault.and_then(lies::document) {
        // SAFETY: the host gives a place for one text.
        unsafe { out.write(text) };
        return abi::STATUS_OK;
    }
    shim::describe(&MANIFEST, out, || {
        if let Some(fault) = fault {
            _ = fault.commit();
        }
        let description = "Operations that misbehave, each in one way, when they are told to.";
        let mut manifest = shim::manifest(
            "test.fault",
            "Faults",
            env!("CARGO_PKG_VERSION"),
            env!("CARGO_PKG_LICENSE"),
            description,
        );
        manifest.reentrant = true;
        manifest
    })
}

unsafe extern "C" fn create(host: *const abi::Host, out: *mut u64) -> u32 {
    lies::remember(host);
    match orders::beside_library(Phase::Create) {
        Some(Fault::WildStatus) => return 77,
        Some(fault) => _ = fault.commit(),
        None => {}
    }
    // SAFETY: passed on.
    OURS.create
        .map_or(abi::STATUS_MISUSE, |create| unsafe { create(host, out) })
}

extern "C" fn get(id: Str) -> *const c_void {
    // SAFETY: the host's text outlives the call.
    if unsafe { id.as_str() } != Some(abi::CALL_1) {
        return shim::get(id, &[]);
    }
    let size = match orders::beside_library(Phase::Describe) {
        Some(Fault::NullTable) => return std::ptr::null(),
        Some(Fault::WildSize) => 3,
        _ => size_of::<Call1>() as u32,
    };
    static TABLE: OnceLock<Call1> = OnceLock::new();
    let table = TABLE.get_or_init(|| Call1 {
        size,
        reserved: 0,
        prepare: Some(prepare),
        run: Some(run),
        drop: Some(drop_plan),
    });
    std::ptr::from_ref(table).cast()
}

/// The SDK's functions.
fn sdk() -> Option<&'static Call1> {
    // SAFETY: the SDK's table is a constant.
    unsafe {
        shim::get(Str::new(abi::CALL_1), &[])
            .cast::<Call1>()
            .as_ref()
    }
}

/// Operation and parameters of prepared calls, for lies that the SDK would not tell.
fn requests() -> MutexGuard<'static, HashMap<u64, Value>> {
    static REQUESTS: OnceLock<Mutex<HashMap<u64, Value>>> = OnceLock::new();
    let requests = REQUESTS.get_or_init(Mutex::default);
    requests.lock().unwrap_or_else(PoisonError::into_inner)
}

/// The fault that a request asks for at a phase.
fn told(request: &Value, phase: Phase) -> Option<Fault> {
    let id = request["operation"].as_str()?;
    let name = id.strip_prefix("fault.")?.strip_suffix("/1")?;
    orders::told(
        Fault::from_value(&name.replace('-', "_").into()),
        &request["parameters"],
        phase,
    )
}

unsafe extern "C" fn prepare(instance: u64, job: u64, request: Str, plan: *mut abi::Plan) -> u32 {
    let Some(prepare) = sdk().and_then(|table| table.prepare) else {
        return abi::STATUS_MISUSE;
    };
    // SAFETY: passed on; the host's text outlives the call.
    let (status, text) = unsafe {
        let status = prepare(instance, job, request, plan);
        (status, request.as_str().unwrap_or_default())
    };
    let request: Value = puncta_sdk::serde_json::from_str(text).unwrap_or_default();
    // SAFETY: the host gives a place for one plan.
    let plan = unsafe { &mut *plan };
    let lie = told(&request, Phase::Prepare);
    if status == abi::STATUS_OK {
        requests().insert(plan.handle, request);
    }
    match lie {
        Some(Fault::WildStatus) => 77,
        Some(Fault::NoReason) => abi::STATUS_FAILED,
        Some(Fault::Unwind) => panic!("nobody catches this"),
        lie => {
            plan.document = lie.and_then(lies::document).unwrap_or(plan.document);
            status
        }
    }
}

unsafe extern "C" fn run(instance: u64, job: u64, plan: u64) -> u32 {
    let Some(run) = sdk().and_then(|table| table.run) else {
        return abi::STATUS_MISUSE;
    };
    // SAFETY: passed on.
    let status = unsafe { run(instance, job, plan) };
    let request = requests().get(&plan).cloned().unwrap_or_default();
    match told(&request, Phase::Run) {
        Some(Fault::WildStatus) => 77,
        Some(Fault::NoReason) => abi::STATUS_FAILED,
        Some(Fault::Unwind) => panic!("nobody catches this"),
        Some(Fault::BadReason) => lies::bad_reason(job),
        Some(Fault::Misuse) => lies::misuse(job),
        Some(Fault::Scribble) => lies::scribble(job),
        _ => status,
    }
}

unsafe extern "C" fn drop_plan(instance: u64, plan: u64) {
    requests().remove(&plan);
    if let Some(drop) = sdk().and_then(|table| table.drop) {
        // SAFETY: passed on.
        unsafe { drop(instance, plan) };
    }
}
