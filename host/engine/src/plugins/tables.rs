//! The host's tables `data/1` and `job/1`: the functions that plugins call.
#![allow(unsafe_code)]

use super::context::{FIRST_OUTPUT, JobContext};
use crate::store::object::ColumnData;
use crate::store::region::Region;
use puncta_abi::{self as abi, Column, Data1, Job1, Str, Task};
use puncta_documents::call::OUTPUT;
use puncta_documents::failure::FAILURE;
use puncta_documents::header::HEADER;
use puncta_documents::{Failure, FailureCode, Header, Output};
use rayon::prelude::*;
use std::collections::HashMap;
use std::ffi::c_void;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicU32, AtomicU64, Ordering};
use std::sync::{Arc, LazyLock, PoisonError, RwLock};

/// The calls that are running. A C callback carries only a number, so that this table is the
/// one piece of state that belongs to the process; a number that is not in it is refused.
static JOBS: LazyLock<RwLock<HashMap<u64, Arc<JobContext>>>> = LazyLock::new(RwLock::default);
static NEXT: AtomicU64 = AtomicU64::new(1);

/// A running call's entry in the table; removed when dropped.
pub(super) struct Entry(pub(super) u64);

impl Entry {
    pub(super) fn new(context: &Arc<JobContext>) -> Entry {
        let number = NEXT.fetch_add(1, Ordering::Relaxed);
        let mut jobs = JOBS.write().unwrap_or_else(PoisonError::into_inner);
        jobs.insert(number, Arc::clone(context));
        Entry(number)
    }
}

impl Drop for Entry {
    fn drop(&mut self) {
        JOBS.write()
            .unwrap_or_else(PoisonError::into_inner)
            .remove(&self.0);
    }
}

fn job(number: u64) -> Option<Arc<JobContext>> {
    JOBS.read()
        .unwrap_or_else(PoisonError::into_inner)
        .get(&number)
        .cloned()
}

/// What the host gives to a plugin's `create`.
pub(super) static HOST: abi::Host = abi::Host {
    size: size_of::<abi::Host>() as u32,
    major: 0,
    minor: 1,
    number: abi::ABI_NUMBER,
    get: Some(get),
};

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

/// Whether this host has a table.
pub(super) fn gives(id: &str) -> bool {
    // SAFETY: the text outlives the call.
    !unsafe { get(Str::new(id)) }.is_null()
}

unsafe extern "C" fn get(id: Str) -> *const c_void {
    // SAFETY: the plugin's text outlives the call.
    match unsafe { id.as_str() } {
        Some(abi::DATA_1) => std::ptr::from_ref(&DATA).cast(),
        Some(abi::JOB_1) => std::ptr::from_ref(&JOB).cast(),
        _ => std::ptr::null(),
    }
}

/// Runs a host function's work: nothing unwinds into the plugin, and a failure is remembered.
fn answer(number: u64, work: impl FnOnce(&JobContext) -> Result<(), Failure>) -> u32 {
    let Some(context) = job(number) else {
        return abi::STATUS_MISUSE;
    };
    match catch_unwind(AssertUnwindSafe(|| work(&context))) {
        Ok(Ok(())) => abi::STATUS_OK,
        Ok(Err(failure)) => {
            let status = match failure.code {
                FailureCode::Cancelled => return abi::STATUS_CANCELLED,
                FailureCode::Resources => abi::STATUS_NO_MEMORY,
                _ => abi::STATUS_MISUSE,
            };
            context.refuse(failure);
            status
        }
        Err(_) => abi::STATUS_PANICKED,
    }
}

/// Reads a plugin's text.
///
/// # Safety
/// The text must outlive `'a`.
unsafe fn text<'a>(from: Str) -> Result<&'a str, Failure> {
    // SAFETY: passed on.
    unsafe { from.as_str() }
        .ok_or_else(|| Failure::internal("the plugin gave a text that is no UTF-8"))
}

fn show(column: &ColumnData) -> Column {
    let pointer = |region: &Option<Region>| {
        region
            .as_ref()
            .map_or(std::ptr::null_mut(), Region::pointer)
    };
    Column {
        data: pointer(&column.data),
        offsets: pointer(&column.offsets).cast(),
        text: pointer(&column.text),
        rows: column.rows,
        entries: column.entries,
        text_bytes: column.text.as_ref().map_or(0, Region::bytes),
        kind: column.type_.element.code(),
        width: column.type_.width,
    }
}

unsafe extern "C" fn columns(
    number: u64,
    object: u64,
    part: u32,
    out: *mut Column,
    capacity: u32,
    count: *mut u32,
) -> u32 {
    answer(number, |context| {
        let found: Vec<Column> = if object < FIRST_OUTPUT {
            let columns = context.input_columns(object as usize, part as usize)?;
            columns.iter().map(show).collect()
        } else {
            let columns = context.output_columns(object, part as usize)?;
            columns
                .into_iter()
                .map(|(info, place, base, rows)| {
                    let at = |offset: u64, there: bool| {
                        if there {
                            base.wrapping_add(offset as usize)
                        } else {
                            std::ptr::null_mut()
                        }
                    };
                    let is_text = info.type_.element.is_text();
                    Column {
                        data: at(place.data, place.row_bytes > 0),
                        offsets: at(place.offsets, is_text).cast(),
                        text: at(place.text, is_text),
                        rows,
                        entries: info.entries.unwrap_or(0),
                        text_bytes: place.text_bytes,
                        kind: info.type_.element.code(),
                        width: info.type_.width,
                    }
                })
                .collect()
        };
        if count.is_null() || (out.is_null() && capacity > 0) {
            return Err(Failure::internal(
                "the plugin gave no place for the columns",
            ));
        }
        // SAFETY: the plugin gives room for `capacity` columns and one number.
        unsafe {
            count.write(found.len() as u32);
            for (i, column) in found.into_iter().take(capacity as usize).enumerate() {
                out.add(i).write(column);
            }
        }
        Ok(())
    })
}

unsafe extern "C" fn begin(number: u64, document: Str, object: *mut u64) -> u32 {
    answer(number, |context| {
        // SAFETY: the plugin's text outlives the call.
        let text = unsafe { text(document) }?;
        let output: Output = puncta_documents::parse(text, OUTPUT)
            .map_err(|why| Failure::internal(format!("the plugin began an output with {why}")))?;
        if object.is_null() {
            return Err(Failure::internal(
                "the plugin gave no place for the output's number",
            ));
        }
        let begun = context.begin(output)?;
        // SAFETY: non-null; the plugin gives a place for one number.
        unsafe { object.write(begun) };
        Ok(())
    })
}

unsafe extern "C" fn grow(number: u64, object: u64, part: u32, rows: u64) -> u32 {
    answer(number, |context| context.grow(object, part as usize, rows))
}

unsafe extern "C" fn commit(number: u64, object: u64, part: u32, rows: u64) -> u32 {
    answer(number, |context| {
        context.commit(object, part as usize, rows)
    })
}

unsafe extern "C" fn finish(
    number: u64,
    object: u64,
    rows: *const u64,
    parts: u32,
    header: Str,
) -> u32 {
    answer(number, |context| {
        let rows = if parts == 0 || rows.is_null() {
            &[]
        } else {
            // SAFETY: the plugin gives `parts` numbers.
            unsafe { std::slice::from_raw_parts(rows, parts as usize) }
        };
        // SAFETY: the plugin's text outlives the call.
        let header: Option<Header> = match unsafe { text(header) }? {
            "" => None,
            text => Some(puncta_documents::parse(text, HEADER).map_err(|why| {
                Failure::internal(format!("the plugin finished an output with {why}"))
            })?),
        };
        context.finish(object, rows, header)
    })
}

unsafe extern "C" fn emit(number: u64, document: Str) -> u32 {
    answer(number, |context| {
        // SAFETY: the plugin's text outlives the call.
        let text = unsafe { text(document) }?;
        let document = puncta_documents::json(text)
            .map_err(|why| Failure::internal(format!("the plugin gave {why}")))?;
        context.emit(document)
    })
}

fn stop_word(context: &JobContext) -> u32 {
    if context.progress().cancelled() {
        abi::STATUS_CANCELLED
    } else {
        abi::STATUS_OK
    }
}

unsafe extern "C" fn progress(number: u64, fraction: f64, phase: Str) -> u32 {
    let Some(context) = job(number) else {
        return abi::STATUS_MISUSE;
    };
    // SAFETY: the plugin's text outlives the call.
    let phase = unsafe { phase.as_str() }.unwrap_or("");
    let report = || context.progress().progress(fraction.clamp(0.0, 1.0), phase);
    if catch_unwind(AssertUnwindSafe(report)).is_err() {
        return abi::STATUS_PANICKED;
    }
    stop_word(&context)
}

unsafe extern "C" fn cancelled(number: u64) -> u32 {
    job(number).map_or(abi::STATUS_MISUSE, |context| stop_word(&context))
}

unsafe extern "C" fn fail(number: u64, document: Str) {
    answer(number, |context| {
        // SAFETY: the plugin's text outlives the call.
        let text = unsafe { text(document) }?;
        let failure = puncta_documents::parse(text, FAILURE).unwrap_or_else(|_| {
            Failure::internal(format!(
                "the plugin failed with an unreadable reason: {text}"
            ))
        });
        context.fail(failure);
        Ok(())
    });
}

unsafe extern "C" fn log(number: u64, level: u32, message: Str) {
    answer(number, |context| {
        // SAFETY: the plugin's text outlives the call.
        context.progress().message(level, unsafe { text(message) }?);
        Ok(())
    });
}

unsafe extern "C" fn threads(number: u64) -> u32 {
    job(number).map_or(1, |context| context.pool().current_num_threads() as u32)
}

struct Shared(*mut c_void);
// SAFETY: the plugin promises that its context may be used on several threads during the call.
unsafe impl Sync for Shared {}
// SAFETY: as above.
unsafe impl Send for Shared {}

unsafe extern "C" fn parallel_for(
    number: u64,
    count: u64,
    grain: u64,
    task: Option<Task>,
    context: *mut c_void,
) -> u32 {
    let (Some(job), Some(task)) = (job(number), task) else {
        return abi::STATUS_MISUSE;
    };
    let (grain, shared, status) = (grain.max(1), Shared(context), AtomicU32::new(0));
    let one = |i: u64| {
        let shared = &shared;
        if status.load(Ordering::Relaxed) == 0 {
            let begin = i * grain;
            // SAFETY: the plugin's function and context are valid until `parallel_for` returns.
            let result = unsafe { task(shared.0, begin, (begin + grain).min(count)) };
            if result != 0 {
                let _ = status.compare_exchange(0, result, Ordering::Relaxed, Ordering::Relaxed);
            }
        }
    };
    let tasks = count.div_ceil(grain);
    let all = 0..usize::try_from(tasks).unwrap_or(usize::MAX);
    job.pool().install(|| {
        all.into_par_iter()
            .with_max_len(1)
            .for_each(|i| one(i as u64))
    });
    status.into_inner()
}
