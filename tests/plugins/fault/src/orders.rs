//! When to misbehave: at which point of a call, as parameters or a file with orders say.

use crate::faults::Fault;
use puncta_sdk::prelude::*;
use puncta_sdk::{FromValue, serde_json::Value};
use std::ffi::CStr;
use std::path::PathBuf;

/// A point in the life of a plugin or a call.
#[derive(Choice, Clone, Copy, Debug, PartialEq, Eq)]
pub enum Phase {
    /// At no time.
    Never,
    /// When the system loads the library.
    Load,
    /// When the plugin describes itself.
    Describe,
    /// When its instance is made.
    Create,
    /// When a call is prepared, of a reader when it looks at a file.
    Prepare,
    /// When it runs.
    Run,
    /// In a task of the host's threads.
    Task,
    /// In a thread of the plugin while another is inside the host.
    Callback,
    /// Between the commit and the finish of its output.
    Commit,
    /// After its output is finished.
    Finished,
    /// When a prepared call is dropped.
    Drop,
}

/// The fault that orders name for a phase and a step. Each line is a phase, a fault and a step.
pub fn find(orders: &str, phase: Phase, step: &str) -> Option<Fault> {
    orders.lines().find_map(|line| {
        let mut words = line.split_whitespace();
        let mut word = || words.next().map(Value::from);
        let (when, what, who) = (word()?, word()?, word()?);
        let here = Phase::from_value(&when) == Some(phase) && who == step;
        here.then(|| Fault::from_value(&what)).flatten()
    })
}

/// The fault that a request's parameters ask for: those of the operation of that `fault`, or of
/// one that follows orders.
pub fn told(fault: Option<Fault>, parameters: &Value, phase: Phase) -> Option<Fault> {
    let text = |name: &str| parameters[name].as_str().unwrap_or_default();
    if let Some(fault) = fault {
        let now = Phase::from_value(&parameters["phase"]) == Some(phase);
        let there = parameters["only_while"]
            .as_str()
            .is_none_or(|file| std::path::Path::new(file).exists());
        return (now && there).then_some(fault);
    }
    let orders = std::fs::read_to_string(text("orders")).ok()?;
    find(&orders, phase, text("step"))
}

/// The fault that `<library>.orders` names for a phase without parameters.
pub fn beside_library(phase: Phase) -> Option<Fault> {
    let mut path = own_path()?.into_os_string();
    path.push(".orders");
    find(&std::fs::read_to_string(path).ok()?, phase, "library")
}

#[allow(unsafe_code)]
fn own_path() -> Option<PathBuf> {
    let address: *const () = (own_path as fn() -> Option<PathBuf>) as *const ();
    let mut info = std::mem::MaybeUninit::<libc::Dl_info>::zeroed();
    // SAFETY: the place is large enough; zeroes are a valid value, and the name is the loader's.
    unsafe {
        libc::dladdr(address.cast(), info.as_mut_ptr());
        let name = info.assume_init().dli_fname;
        let name = (!name.is_null()).then(|| CStr::from_ptr(name))?;
        Some(name.to_str().ok()?.into())
    }
}
