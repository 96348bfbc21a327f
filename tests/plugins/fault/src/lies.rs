//! Lies to the host: documents, statuses and arguments that the ABI excludes.
//!
//! What every `unsafe` in this file relies on: the host's tables are as the ABI says. What it is
//! given here is wrong on purpose, within what the host can notice.
#![allow(unsafe_code)]

use crate::faults::Fault;
use puncta_sdk::abi::{self, Column, Data1, Host, Job1, Str};
use std::ptr::{null, null_mut};
use std::sync::OnceLock;

/// A document that is wrong.
pub fn document(fault: Fault) -> Option<Str> {
    Some(match fault {
        Fault::BadDocument => Str::new("{\"format\": \"puncta.plan/1\", \"read\": [7"),
        Fault::NullDocument => Str {
            ptr: null(),
            len: 100,
        },
        Fault::NotUtf8 => Str {
            ptr: b"\xff\xfe\xfd".as_ptr(),
            len: 3,
        },
        _ => return None,
    })
}

static TABLES: OnceLock<(&'static Data1, &'static Job1)> = OnceLock::new();

/// Keeps the host's tables for later lies.
pub fn remember(host: *const Host) {
    // SAFETY: the host's tables live until the process ends.
    unsafe {
        let Some(get) = host.as_ref().and_then(|host| host.get) else {
            return;
        };
        let data = get(Str::new(abi::DATA_1)).cast::<Data1>().as_ref();
        let job = get(Str::new(abi::JOB_1)).cast::<Job1>().as_ref();
        if let (Some(data), Some(job)) = (data, job) {
            _ = TABLES.set((data, job));
        }
    }
}

/// Gives a reason that is no document, and fails.
pub fn bad_reason(job: u64) -> u32 {
    if let Some(fail) = TABLES.get().and_then(|(_, jobs)| jobs.fail) {
        // SAFETY: the text outlives the call.
        unsafe { fail(job, Str::new("all is lost")) };
    }
    abi::STATUS_FAILED
}

/// Writes into the first column of the first input.
pub fn scribble(job: u64) -> u32 {
    const EMPTY: Column = Column {
        data: null_mut(),
        offsets: null_mut(),
        text: null_mut(),
        rows: 0,
        entries: 0,
        text_bytes: 0,
        kind: 0,
        width: 1,
    };
    let Some(columns) = TABLES.get().and_then(|(data, _)| data.columns) else {
        return abi::STATUS_MISUSE;
    };
    let (mut column, mut count) = (EMPTY, 0);
    // SAFETY: room for one column; then the memory of the host is written, which it must prevent.
    unsafe {
        let status = columns(job, 0, 0, &raw mut column, 1, &raw mut count);
        if status == abi::STATUS_OK && !column.data.is_null() {
            column.data.write_volatile(77);
        }
    }
    abi::STATUS_OK
}

/// Calls the host's functions with arguments that it must refuse. Fails with the number of the
/// first that it took.
pub fn misuse(job: u64) -> u32 {
    let Some((data, jobs)) = TABLES.get() else {
        return abi::STATUS_MISUSE;
    };
    let statuses = wrong_calls(job, data, jobs).unwrap_or_default();
    let taken = statuses.iter().position(|status| *status == abi::STATUS_OK);
    if let (Some(taken), Some(fail)) = (taken, jobs.fail) {
        let reason = format!(
            "{{\"format\": \"puncta.failure/1\", \"code\": \"internal\", \
             \"message\": \"the host took wrong call {taken}\"}}"
        );
        // SAFETY: the text outlives the call.
        unsafe { fail(job, Str::new(&reason)) };
    }
    match (taken, statuses.len()) {
        (Some(_), _) | (None, 0) => abi::STATUS_FAILED,
        _ => abi::STATUS_OK,
    }
}

fn wrong_calls(job: u64, data: &Data1, jobs: &Job1) -> Option<Vec<u32>> {
    let (columns, begin, grow) = (data.columns?, data.begin?, data.grow?);
    let (commit, finish, emit) = (data.commit?, data.finish?, data.emit?);
    let (progress, parallel) = (jobs.progress?, jobs.parallel_for?);
    let wild = Str {
        ptr: null(),
        len: 1 << 40,
    };
    let (mut count, mut object) = (0, 0);
    let (count, object) = (&raw mut count, &raw mut object);
    let first_output = 1 << 32;
    let rows = [u64::MAX; 4];
    let table = Str::new(
        "{\"format\": \"puncta.output/1\", \"output\": \"more\", \"header\": {\"format\": \
         \"puncta.header/1\", \"kind\": \"table\", \"name\": \"more\", \"parts\": [{\"name\": \
         \"rows\", \"rows\": 18446744073709551615, \"columns\": [{\"name\": \"x\", \"type\": \
         \"f64\", \"unit\": \"nm\"}]}]}}",
    );
    // SAFETY: places are there or null; numbers, texts and sizes are wrong within what can be told.
    Some(unsafe {
        vec![
            columns(job, 99, 0, null_mut(), 0, count),
            columns(job, u64::MAX, 0, null_mut(), 0, count),
            columns(job, first_output + 99, 0, null_mut(), 0, count),
            columns(job, first_output, u32::MAX, null_mut(), 0, count),
            columns(job, first_output, 0, null_mut(), 0, null_mut()),
            columns(job, 0, 0, null_mut(), 5, count),
            columns(job + 1_000_000, 0, 0, null_mut(), 0, count),
            begin(job, wild, object),
            begin(job, Str::new("{"), object),
            begin(job, Str::EMPTY, object),
            begin(job, table, object),
            begin(job, table, null_mut()),
            grow(job, first_output + 99, 0, 1),
            commit(job, first_output + 99, 0, 1),
            commit(job, u64::MAX, u32::MAX, u64::MAX),
            finish(job, first_output + 99, rows.as_ptr(), 1, Str::EMPTY),
            finish(job, 0, rows.as_ptr(), 4, Str::EMPTY),
            finish(job, u64::MAX, null(), 4, wild),
            emit(job, Str::new("[]")),
            emit(job, Str::new("{\"format\": \"puncta.none/1\"}")),
            emit(job, wild),
            progress(0, f64::NAN, wild),
            parallel(job, 10, 1, None, null_mut()),
            parallel(0, 10, 1, None, null_mut()),
        ]
    })
}
