//! The stand-in for the host's tables. It is strict: what the real host refuses, it refuses.
#![allow(unsafe_code)]

use crate::memory::Memory;
use crate::object::{Done, Object};
use puncta_sdk::abi::{self, Column, Data1, Job1, Str, Task};
use puncta_sdk::documents::call::OUTPUT;
use puncta_sdk::documents::failure::FAILURE;
use puncta_sdk::documents::header::HEADER;
use puncta_sdk::documents::{self, Output};
use puncta_sdk::host::HostCalls;
use puncta_sdk::operation::Prepared;
use puncta_sdk::serde_json::Value;
use puncta_sdk::{Failure, Header, Job, Plan, Request};
use std::ffi::c_void;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

pub(crate) struct Setting {
    pub(crate) request: Arc<Request>,
    pub(crate) plan: Arc<Plan>,
    pub(crate) inputs: Vec<Object>,
    pub(crate) threads: usize,
    pub(crate) cancel_after: Option<u64>,
    pub(crate) prepared: Box<dyn Prepared>,
}

/// The call's state; its address is the job's number.
struct State {
    plan: Arc<Plan>,
    threads: usize,
    cancel_after: Option<u64>,
    polls: AtomicU64,
    inner: Mutex<Inner>,
}

#[derive(Default)]
struct Inner {
    inputs: Vec<Object>,
    open: Vec<Option<(Output, Vec<Vec<Memory>>)>>,
    done: Done,
    failure: Option<Failure>,
}

const FIRST_OUTPUT: u64 = 1 << 32;

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

pub(crate) fn run(setting: Setting) -> Result<Done, Failure> {
    let state = Box::new(State {
        plan: Arc::clone(&setting.plan),
        threads: setting.threads,
        cancel_after: setting.cancel_after,
        polls: AtomicU64::new(0),
        inner: Mutex::new(Inner {
            inputs: setting.inputs,
            ..Inner::default()
        }),
    });
    let number = std::ptr::from_ref::<State>(&state) as u64;
    let job = Job::new(
        HostCalls::new(number, &DATA, &JOB),
        setting.request,
        setting.plan,
    )?;
    let result = setting.prepared.run(&job);
    drop(job);
    let mut inner = lock(&state);
    result?;
    match inner.failure.take() {
        Some(failure) => Err(failure),
        None => Ok(std::mem::take(&mut inner.done)),
    }
}

fn lock(state: &State) -> MutexGuard<'_, Inner> {
    state.inner.lock().unwrap_or_else(PoisonError::into_inner)
}

/// # Safety
/// `job` must be the number that `run` made, and `run` must not have returned.
unsafe fn state<'a>(job: u64) -> &'a State {
    // SAFETY: the caller's promise.
    unsafe { &*(job as *const State) }
}

unsafe extern "C" fn columns(
    job: u64,
    object: u64,
    part: u32,
    out: *mut Column,
    capacity: u32,
    count: *mut u32,
) -> u32 {
    // SAFETY: called during `run`.
    let state = unsafe { state(job) };
    let mut inner = lock(state);
    let part = part as usize;
    let mut found: Vec<Column> = Vec::new();
    if object < FIRST_OUTPUT {
        let place = object as usize;
        let read = state
            .plan
            .read
            .iter()
            .find(|read| read.input == place && read.part == part);
        let (Some(read), Some(object)) = (read, inner.inputs.get_mut(place)) else {
            return abi::STATUS_MISUSE;
        };
        let Some(group) = object.header.parts.get(part) else {
            return abi::STATUS_MISUSE;
        };
        for name in &read.columns {
            let Some(i) = group.columns.iter().position(|column| &column.name == name) else {
                return abi::STATUS_MISUSE;
            };
            found.push(object.memory[part][i].column(&group.columns[i], group.rows));
        }
    } else {
        let Some(Some((output, memory))) = inner.open.get_mut((object - FIRST_OUTPUT) as usize)
        else {
            return abi::STATUS_MISUSE;
        };
        let Some(group) = output.header.parts.get(part) else {
            return abi::STATUS_MISUSE;
        };
        for (info, memory) in group.columns.iter().zip(&mut memory[part]) {
            found.push(memory.column(info, group.rows));
        }
    }
    // SAFETY: the caller gives room for `capacity` columns and one number.
    unsafe {
        count.write(found.len() as u32);
        for (i, column) in found.into_iter().take(capacity as usize).enumerate() {
            out.add(i).write(column);
        }
    }
    abi::STATUS_OK
}

unsafe extern "C" fn begin(job: u64, document: Str, object: *mut u64) -> u32 {
    // SAFETY: called during `run`, with a text that outlives the call.
    let (state, text) = unsafe { (state(job), document.as_str()) };
    let Some(output) = text.and_then(|text| documents::parse::<Output>(text, OUTPUT).ok()) else {
        return abi::STATUS_MISUSE;
    };
    let mut inner = lock(state);
    if let Some(of) = output.of
        && inner.inputs.get(of).map(|input| input.header.rows()) != Some(output.header.rows())
    {
        return abi::STATUS_MISUSE;
    }
    let room = |part: &documents::Part| -> Vec<Memory> {
        let rows = usize::try_from(part.rows).unwrap_or(0);
        part.columns
            .iter()
            .map(|info| Memory::room(info, rows))
            .collect()
    };
    let memory = output.header.parts.iter().map(room).collect();
    inner.open.push(Some((output, memory)));
    // SAFETY: the caller gives a place for one number.
    unsafe { object.write(FIRST_OUTPUT + inner.open.len() as u64 - 1) };
    abi::STATUS_OK
}

unsafe extern "C" fn grow(job: u64, object: u64, part: u32, rows: u64) -> u32 {
    // SAFETY: called during `run`.
    let mut inner = lock(unsafe { state(job) });
    let place = object.wrapping_sub(FIRST_OUTPUT) as usize;
    let Some(Some((output, memory))) = inner.open.get_mut(place) else {
        return abi::STATUS_MISUSE;
    };
    let Some(group) = output.header.parts.get_mut(part as usize) else {
        return abi::STATUS_MISUSE;
    };
    group.rows = rows;
    for (info, memory) in group.columns.iter().zip(&mut memory[part as usize]) {
        *memory = memory.grown(info, usize::try_from(rows).unwrap_or(0));
    }
    abi::STATUS_OK
}

unsafe extern "C" fn commit(job: u64, object: u64, _part: u32, _rows: u64) -> u32 {
    // SAFETY: called during `run`.
    let inner = lock(unsafe { state(job) });
    let place = object.wrapping_sub(FIRST_OUTPUT) as usize;
    match inner.open.get(place) {
        Some(Some(_)) => abi::STATUS_OK,
        _ => abi::STATUS_MISUSE,
    }
}

unsafe extern "C" fn finish(
    job: u64,
    object: u64,
    rows: *const u64,
    parts: u32,
    header: Str,
) -> u32 {
    // SAFETY: called during `run`, with `parts` numbers and a text that outlive the call.
    let (state, rows, text) = unsafe {
        let rows = if parts == 0 {
            &[]
        } else {
            std::slice::from_raw_parts(rows, parts as usize)
        };
        (state(job), rows, header.as_str())
    };
    let mut inner = lock(state);
    let place = object.wrapping_sub(FIRST_OUTPUT) as usize;
    let Some(Some((mut output, mut memory))) = inner.open.get_mut(place).map(Option::take) else {
        return abi::STATUS_MISUSE;
    };
    if let Some(text) = text.filter(|text| !text.is_empty()) {
        match documents::parse::<Header>(text, HEADER) {
            Ok(header) => output.header = header,
            Err(_) => return abi::STATUS_MISUSE,
        }
    }
    if rows.len() != output.header.parts.len() || memory.len() != rows.len() {
        return abi::STATUS_MISUSE;
    }
    for ((part, rows), memory) in output.header.parts.iter_mut().zip(rows).zip(&mut memory) {
        if *rows > part.rows {
            return abi::STATUS_MISUSE;
        }
        part.rows = *rows;
        for (info, memory) in part.columns.iter().zip(memory) {
            memory.entries = info.entries.unwrap_or(memory.entries);
        }
    }
    let object = Object {
        header: output.header,
        memory,
    };
    inner.done.outputs.push((output.output, object));
    abi::STATUS_OK
}

unsafe extern "C" fn emit(job: u64, document: Str) -> u32 {
    // SAFETY: called during `run`, with a text that outlives the call.
    let (state, text) = unsafe { (state(job), document.as_str()) };
    match text.and_then(|text| puncta_sdk::serde_json::from_str::<Value>(text).ok()) {
        Some(value) => {
            lock(state).done.documents.push(value);
            abi::STATUS_OK
        }
        None => abi::STATUS_MISUSE,
    }
}

fn poll(state: &State) -> u32 {
    let polls = state.polls.fetch_add(1, Ordering::Relaxed) + 1;
    match state.cancel_after {
        Some(limit) if polls >= limit => abi::STATUS_CANCELLED,
        _ => abi::STATUS_OK,
    }
}

unsafe extern "C" fn progress(job: u64, _fraction: f64, _phase: Str) -> u32 {
    // SAFETY: called during `run`.
    poll(unsafe { state(job) })
}

unsafe extern "C" fn cancelled(job: u64) -> u32 {
    // SAFETY: called during `run`.
    poll(unsafe { state(job) })
}

unsafe extern "C" fn fail(job: u64, document: Str) {
    // SAFETY: called during `run`, with a text that outlives the call.
    let (state, text) = unsafe { (state(job), document.as_str().unwrap_or("")) };
    let failure = documents::parse(text, FAILURE).unwrap_or_else(Failure::internal);
    lock(state).failure = Some(failure);
}

unsafe extern "C" fn log(job: u64, level: u32, message: Str) {
    // SAFETY: called during `run`, with a text that outlives the call.
    let (state, text) = unsafe { (state(job), message.as_str().unwrap_or("")) };
    lock(state).done.messages.push((level, text.to_owned()));
}

unsafe extern "C" fn threads(job: u64) -> u32 {
    // SAFETY: called during `run`.
    unsafe { state(job) }.threads as u32
}

struct Shared(*mut c_void);
// SAFETY: the caller of `parallel_for` promises that its context may be used on several threads.
unsafe impl Sync for Shared {}

unsafe extern "C" fn parallel_for(
    job: u64,
    count: u64,
    grain: u64,
    task: Option<Task>,
    context: *mut c_void,
) -> u32 {
    let Some(task) = task else {
        return abi::STATUS_MISUSE;
    };
    // SAFETY: called during `run`.
    let state = unsafe { state(job) };
    let (next, status) = (AtomicU64::new(0), AtomicU64::new(0));
    let (grain, context) = (grain.max(1), Shared(context));
    let work = || {
        let context = &context;
        loop {
            let begin = next.fetch_add(grain, Ordering::Relaxed);
            if begin >= count || status.load(Ordering::Relaxed) != 0 {
                return;
            }
            // SAFETY: the caller's context is valid until `parallel_for` returns.
            let one = unsafe { task(context.0, begin, (begin + grain).min(count)) };
            if one != 0 {
                status.store(one.into(), Ordering::Relaxed);
            }
        }
    };
    std::thread::scope(|scope| {
        for _ in 1..state.threads {
            scope.spawn(work);
        }
        work();
    });
    status.load(Ordering::Relaxed) as u32
}
