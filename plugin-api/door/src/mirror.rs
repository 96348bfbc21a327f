//! Mirrors of the ABI's tables that carry layout records. See `puncta-abi` for their meaning.
#![allow(missing_docs)]

use abi_stable::StableAbi;

type Void = u8;

#[repr(C)]
#[derive(StableAbi, Clone, Copy)]
pub struct Str {
    pub ptr: *const u8,
    pub len: u64,
}

#[repr(C)]
#[derive(StableAbi, Clone, Copy)]
pub struct Plugin {
    pub size: u32,
    pub major: u32,
    pub minor: u32,
    pub number: u32,
    pub describe: Option<unsafe extern "C" fn(out: *mut Str) -> u32>,
    pub create: Option<unsafe extern "C" fn(host: *const Host, out: *mut u64) -> u32>,
    pub destroy: Option<unsafe extern "C" fn(instance: u64)>,
    pub get: Option<unsafe extern "C" fn(id: Str) -> *const Void>,
}

#[repr(C)]
#[derive(StableAbi, Clone, Copy)]
pub struct Host {
    pub size: u32,
    pub major: u32,
    pub minor: u32,
    pub number: u32,
    pub get: Option<unsafe extern "C" fn(id: Str) -> *const Void>,
}

#[repr(C)]
#[derive(StableAbi, Clone, Copy)]
pub struct Plan {
    pub handle: u64,
    pub document: Str,
}

#[repr(C)]
#[derive(StableAbi, Clone, Copy)]
pub struct Call1 {
    pub size: u32,
    pub reserved: u32,
    pub prepare:
        Option<unsafe extern "C" fn(instance: u64, job: u64, request: Str, plan: *mut Plan) -> u32>,
    pub run: Option<unsafe extern "C" fn(instance: u64, job: u64, plan: u64) -> u32>,
    pub drop: Option<unsafe extern "C" fn(instance: u64, plan: u64)>,
}

#[repr(C)]
#[derive(StableAbi, Clone, Copy)]
pub struct Column {
    pub data: *mut u8,
    pub offsets: *mut u64,
    pub text: *mut u8,
    pub rows: u64,
    pub entries: u64,
    pub text_bytes: u64,
    pub kind: u32,
    pub width: u32,
}

#[repr(C)]
#[derive(StableAbi, Clone, Copy)]
pub struct Data1 {
    pub size: u32,
    pub reserved: u32,
    pub columns: Option<
        unsafe extern "C" fn(
            job: u64,
            object: u64,
            part: u32,
            out: *mut Column,
            capacity: u32,
            count: *mut u32,
        ) -> u32,
    >,
    pub begin: Option<unsafe extern "C" fn(job: u64, document: Str, object: *mut u64) -> u32>,
    pub grow: Option<unsafe extern "C" fn(job: u64, object: u64, part: u32, rows: u64) -> u32>,
    pub commit: Option<unsafe extern "C" fn(job: u64, object: u64, part: u32, rows: u64) -> u32>,
    pub finish: Option<
        unsafe extern "C" fn(
            job: u64,
            object: u64,
            rows: *const u64,
            parts: u32,
            header: Str,
        ) -> u32,
    >,
    pub emit: Option<unsafe extern "C" fn(job: u64, document: Str) -> u32>,
}

/// A function pointer of its own type, since layout records do not nest function types.
#[repr(transparent)]
#[derive(StableAbi, Clone, Copy)]
pub struct Task {
    pub call: Option<unsafe extern "C" fn(context: *mut Void, begin: u64, end: u64) -> u32>,
}

#[repr(C)]
#[derive(StableAbi, Clone, Copy)]
pub struct Job1 {
    pub size: u32,
    pub reserved: u32,
    pub progress: Option<unsafe extern "C" fn(job: u64, fraction: f64, phase: Str) -> u32>,
    pub cancelled: Option<unsafe extern "C" fn(job: u64) -> u32>,
    pub fail: Option<unsafe extern "C" fn(job: u64, document: Str)>,
    pub log: Option<unsafe extern "C" fn(job: u64, level: u32, message: Str)>,
    pub threads: Option<unsafe extern "C" fn(job: u64) -> u32>,
    pub parallel_for: Option<
        unsafe extern "C" fn(
            job: u64,
            count: u64,
            grain: u64,
            task: Task,
            context: *mut Void,
        ) -> u32,
    >,
}

macro_rules! same {
    ($table:ident: $($field:ident),*) => {
        const _: () = {
            use core::mem::{align_of, offset_of, size_of};
            assert!(size_of::<$table>() == size_of::<puncta_abi::$table>());
            assert!(align_of::<$table>() == align_of::<puncta_abi::$table>());
            $(assert!(offset_of!($table, $field) == offset_of!(puncta_abi::$table, $field));)*
        };
    };
}
same!(Str: ptr, len);
same!(Plugin: size, major, minor, number, describe, create, destroy, get);
same!(Host: size, major, minor, number, get);
same!(Plan: handle, document);
same!(Call1: size, reserved, prepare, run, drop);
same!(Column: data, offsets, text, rows, entries, text_bytes, kind, width);
same!(Data1: size, reserved, columns, begin, grow, commit, finish, emit);
const _: () = assert!(size_of::<Task>() == size_of::<Option<puncta_abi::Task>>());
same!(Job1: size, reserved, progress, cancelled, fail, log, threads, parallel_for);
