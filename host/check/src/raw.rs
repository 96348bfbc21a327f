//! The validator's tables `data/1` and `job/1`: the functions that the plugin calls.
#![allow(unsafe_code)]

use crate::host::Session;
use puncta_abi::{self as abi, Column, Data1, Job1, Str, Task};
use puncta_engine::documents::call::OUTPUT;
use puncta_engine::documents::failure::FAILURE;
use puncta_engine::documents::header::HEADER;
use puncta_engine::documents::{self, Failure, Header, Output};
use std::collections::HashMap;
use std::ffi::c_void;
use std::sync::atomic::{AtomicU32, AtomicU64, Ordering};
use std::sync::{Arc, LazyLock, PoisonError, RwLock};

/// The calls that run. A C callback carries only a number, so that this belongs to the process.
static SESSIONS: LazyLock<RwLock<HashMap<u64, Arc<Session>>>> = LazyLock::new(RwLock::default);
static NEXT: AtomicU64 = AtomicU64::new(1);
/// Calls for sessions that are over or never were.
static LATE: AtomicU64 = AtomicU64::new(0);

/// A running call's place in the table; removed when dropped.
pub struct Entry(pub u64);

impl Entry {
    /// Enters a session.
    pub fn new(session: &Arc<Session>) -> Entry {
        let number = NEXT.fetch_add(1, Ordering::Relaxed);
        let mut all = SESSIONS.write().unwrap_or_else(PoisonError::into_inner);
        all.insert(number, Arc::clone(session));
        Entry(number)
    }
}

impl Drop for Entry {
    fn drop(&mut self) {
        let mut all = SESSIONS.write().unwrap_or_else(PoisonError::into_inner);
        all.remove(&self.0);
    }
}

/// How often the host was called for a call that was over.
pub fn late_calls() -> u64 {
    LATE.load(Ordering::Relaxed)
}

fn session(number: u64) -> Option<Arc<Session>> {
    let all = SESSIONS.read().unwrap_or_else(PoisonError::into_inner);
    let found = all.get(&number).cloned();
    if found.is_none() {
        LATE.fetch_add(1, Ordering::Relaxed);
    }
    found
}

/// Which host a plugin meets.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// This version's.
    Present,
    /// A later one: a longer table, a later minor version, further tables.
    Future,
    /// One without tables.
    Poor,
}

/// A host's table with members behind those that this version knows.
#[repr(C)]
struct Longer {
    host: abi::Host,
    more: [u64; 8],
}

const fn host(
    minor: u32,
    size: usize,
    get: unsafe extern "C" fn(Str) -> *const c_void,
) -> abi::Host {
    abi::Host {
        size: size as u32,
        major: 0,
        minor,
        number: abi::ABI_NUMBER,
        get: Some(get),
    }
}

static PRESENT: abi::Host = host(1, size_of::<abi::Host>(), get);
static POOR: abi::Host = host(1, size_of::<abi::Host>(), get_nothing);
static FUTURE: Longer = Longer {
    host: host(99, size_of::<Longer>(), get_more),
    more: [0; 8],
};

impl Kind {
    /// Its table.
    pub fn table(self) -> *const abi::Host {
        match self {
            Kind::Present => &raw const PRESENT,
            Kind::Poor => &raw const POOR,
            Kind::Future => &raw const FUTURE.host,
        }
    }
}

static DATA: Data1 = Data1 {
    size: size_of::<Data1>() as u32,
    reserved: 0,
    columns: Some(columns),
    begin: Some(begin),
    grow: Some(grow),
    commit: Some(commit),
    finish: Some(finish),
    emit: Some(emit),
};

static JOB: Job1 = Job1 {
    size: size_of::<Job1>() as u32,
    reserved: 0,
    progress: Some(progress),
    cancelled: Some(cancelled),
    fail: Some(fail),
    log: Some(log),
    threads: Some(threads),
    parallel_for: Some(parallel_for),
};

unsafe extern "C" fn get(id: Str) -> *const c_void {
    // SAFETY: the plugin's text outlives the call.
    match unsafe { id.as_str() } {
        Some(abi::DATA_1) => std::ptr::from_ref(&DATA).cast(),
        Some(abi::JOB_1) => std::ptr::from_ref(&JOB).cast(),
        _ => std::ptr::null(),
    }
}

unsafe extern "C" fn get_nothing(_id: Str) -> *const c_void {
    std::ptr::null()
}

unsafe extern "C" fn get_more(id: Str) -> *const c_void {
    static OTHER: [u64; 4] = [32, 0, 0, 0];
    // SAFETY: the plugin's text outlives the call.
    match unsafe { id.as_str() } {
        Some("data/2" | "job/2" | "preview/1") => OTHER.as_ptr().cast(),
        // SAFETY: passed on.
        _ => unsafe { get(id) },
    }
}

/// Runs a host function's work; what the plugin did wrong is noted.
fn answer(number: u64, work: impl FnOnce(&Session) -> Result<bool, String>) -> u32 {
    let Some(session) = session(number) else {
        return abi::STATUS_MISUSE;
    };
    match work(&session) {
        Ok(true) => abi::STATUS_OK,
        Ok(false) => {
            session.refused();
            abi::STATUS_NO_MEMORY
        }
        Err(why) => {
            session.refused();
            session.note(why);
            abi::STATUS_MISUSE
        }
    }
}

/// Reads a plugin's text.
///
/// # Safety
/// The text must outlive `'a`.
unsafe fn text<'a>(from: Str) -> Result<&'a str, String> {
    // SAFETY: passed on.
    unsafe { from.as_str() }.ok_or_else(|| "gives a text that is no UTF-8".into())
}

unsafe extern "C" fn columns(
    number: u64,
    object: u64,
    part: u32,
    out: *mut Column,
    capacity: u32,
    count: *mut u32,
) -> u32 {
    answer(number, |session| {
        let found = session.columns(object, part as usize)?;
        if count.is_null() || (out.is_null() && capacity > 0) {
            return Err("gives no place for columns".into());
        }
        // SAFETY: the plugin gives room for `capacity` columns and one number.
        unsafe {
            count.write(found.len() as u32);
            for (i, column) in found.into_iter().take(capacity as usize).enumerate() {
                out.add(i).write(column);
            }
        }
        Ok(true)
    })
}

unsafe extern "C" fn begin(number: u64, document: Str, object: *mut u64) -> u32 {
    answer(number, |session| {
        // SAFETY: the plugin's text outlives the call.
        let text = unsafe { text(document) }?;
        let output: Output =
            documents::parse(text, OUTPUT).map_err(|why| format!("begins an output with {why}"))?;
        if object.is_null() {
            return Err("gives no place for an output's number".into());
        }
        let Some(begun) = session.begin(output)? else {
            return Ok(false);
        };
        // SAFETY: non-null; the plugin gives a place for one number.
        unsafe { object.write(begun) };
        Ok(true)
    })
}

unsafe extern "C" fn grow(number: u64, object: u64, part: u32, rows: u64) -> u32 {
    answer(number, |session| session.grow(object, part as usize, rows))
}

unsafe extern "C" fn commit(number: u64, object: u64, part: u32, _rows: u64) -> u32 {
    if session(number).is_some_and(|session| session.stop()) {
        return abi::STATUS_CANCELLED;
    }
    answer(number, |session| session.commit(object, part as usize))
}

unsafe extern "C" fn finish(
    number: u64,
    object: u64,
    rows: *const u64,
    parts: u32,
    header: Str,
) -> u32 {
    answer(number, |session| {
        let rows = if parts == 0 || rows.is_null() {
            &[]
        } else {
            // SAFETY: the plugin gives `parts` numbers.
            unsafe { std::slice::from_raw_parts(rows, parts as usize) }
        };
        // SAFETY: the plugin's text outlives the call.
        let header: Option<Header> = match unsafe { text(header) }? {
            "" => None,
            text => Some(
                documents::parse(text, HEADER)
                    .map_err(|why| format!("finishes an output with {why}"))?,
            ),
        };
        session.finish(object, rows, header).map(|()| true)
    })
}

unsafe extern "C" fn emit(number: u64, document: Str) -> u32 {
    answer(number, |session| {
        // SAFETY: the plugin's text outlives the call.
        let text = unsafe { text(document) }?;
        let document = documents::json(text).map_err(|why| format!("gives {why}"))?;
        session.emit(document).map(|()| true)
    })
}

fn stop_word(session: &Session) -> u32 {
    if session.stop() {
        abi::STATUS_CANCELLED
    } else {
        abi::STATUS_OK
    }
}

unsafe extern "C" fn progress(number: u64, fraction: f64, _phase: Str) -> u32 {
    session(number).map_or(abi::STATUS_MISUSE, |session| {
        session.progress(fraction);
        stop_word(&session)
    })
}

unsafe extern "C" fn cancelled(number: u64) -> u32 {
    session(number).map_or(abi::STATUS_MISUSE, |session| stop_word(&session))
}

unsafe extern "C" fn fail(number: u64, document: Str) {
    answer(number, |session| {
        // SAFETY: the plugin's text outlives the call.
        let text = unsafe { text(document) }?;
        let failure = documents::parse(text, FAILURE).map_err(|why| {
            session.fail(Failure::internal(format!("an unreadable reason: {text}")));
            format!("fails with a reason that is {why}")
        })?;
        session.fail(failure);
        Ok(true)
    });
}

unsafe extern "C" fn log(number: u64, level: u32, message: Str) {
    answer(number, |_| {
        // SAFETY: the plugin's text outlives the call.
        unsafe { text(message) }?;
        match level {
            1..=4 => Ok(true),
            level => Err(format!("logs with the unknown level {level}")),
        }
    });
}

unsafe extern "C" fn threads(number: u64) -> u32 {
    session(number).map_or(1, |session| session.threads() as u32)
}

struct Shared(*mut c_void);
// SAFETY: the plugin promises that its context may be used on several threads during the call.
unsafe impl Sync for Shared {}

unsafe extern "C" fn parallel_for(
    number: u64,
    count: u64,
    grain: u64,
    task: Option<Task>,
    context: *mut c_void,
) -> u32 {
    let (Some(session), Some(task)) = (session(number), task) else {
        return abi::STATUS_MISUSE;
    };
    let (next, status) = (AtomicU64::new(0), AtomicU32::new(0));
    let (grain, context) = (grain.max(1), Shared(context));
    let work = || {
        let context = &context;
        loop {
            let begin = next.fetch_add(grain, Ordering::Relaxed);
            if begin >= count || status.load(Ordering::Relaxed) != 0 {
                return;
            }
            // SAFETY: the plugin's context is valid until `parallel_for` returns.
            let one = unsafe { task(context.0, begin, (begin + grain).min(count)) };
            if one != 0 {
                let _ = status.compare_exchange(0, one, Ordering::Relaxed, Ordering::Relaxed);
            }
        }
    };
    std::thread::scope(|scope| {
        for _ in 1..session.threads() {
            scope.spawn(work);
        }
        work();
    });
    status.into_inner()
}
