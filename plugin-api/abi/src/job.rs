use crate::Str;
use core::ffi::c_void;

/// Id of [`Job1`]; every host gives it.
pub const JOB_1: &str = "job/1";

/// A piece of work for the host's threads: rows `begin..end`. A result other than 0 stops the rest.
pub type Task = unsafe extern "C" fn(context: *mut c_void, begin: u64, end: u64) -> u32;

/// Progress, cancel, failure, messages and threads of a call: the host's side.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct Job1 {
    /// `size_of::<Job1>()`.
    pub size: u32,
    /// 0.
    pub reserved: u32,
    /// Says how far the call is (0 to 1) and what it is doing. Returns
    /// [`STATUS_CANCELLED`](crate::STATUS_CANCELLED) when the call should stop.
    pub progress: Option<unsafe extern "C" fn(job: u64, fraction: f64, phase: Str) -> u32>,
    /// 0, or [`STATUS_CANCELLED`](crate::STATUS_CANCELLED) when the call should stop. Cheap: poll
    /// it at least every 50 ms.
    pub cancelled: Option<unsafe extern "C" fn(job: u64) -> u32>,
    /// Says why the call is about to fail, as a document (`puncta.failure/1`). The last one counts.
    pub fail: Option<unsafe extern "C" fn(job: u64, document: Str)>,
    /// A message for the log: level 1 error, 2 warning, 3 information, 4 detail.
    pub log: Option<unsafe extern "C" fn(job: u64, level: u32, message: Str)>,
    /// Number of threads that `parallel_for` uses.
    pub threads: Option<unsafe extern "C" fn(job: u64) -> u32>,
    /// Calls `task` for ranges that together cover `0..count`, each at most `grain` long, on the
    /// host's threads, and returns when all are done, with the first result other than 0.
    // Written out, since generators of other languages' headers do not look through a type alias.
    #[allow(clippy::type_complexity)]
    pub parallel_for: Option<
        unsafe extern "C" fn(
            job: u64,
            count: u64,
            grain: u64,
            task: Option<unsafe extern "C" fn(context: *mut c_void, begin: u64, end: u64) -> u32>,
            context: *mut c_void,
        ) -> u32,
    >,
}

#[allow(unsafe_code)]
// SAFETY: numbers and function pointers only; never written after the build.
unsafe impl Sync for Job1 {}
