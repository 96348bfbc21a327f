use crate::Str;

/// Id of [`Call1`]; a plugin with operations, readers or writers gives it.
pub const CALL_1: &str = "call/1";

/// What `prepare` returns.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct Plan {
    /// The plugin's own number for the prepared call.
    pub handle: u64,
    /// The plan document (`puncta.plan/1`), valid until `drop` of this plan.
    pub document: Str,
}

/// Calls of operations, readers and writers: the plugin's side.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct Call1 {
    /// `size_of::<Call1>()`.
    pub size: u32,
    /// 0.
    pub reserved: u32,
    /// Checks a request document (`puncta.request/1`) and plans the call without heavy work. A
    /// reader may look at the head of its file, and returns [`STATUS_NOT_MINE`](crate::STATUS_NOT_MINE)
    /// when it is of another kind.
    pub prepare:
        Option<unsafe extern "C" fn(instance: u64, job: u64, request: Str, plan: *mut Plan) -> u32>,
    /// Does what `plan` says. A plan may be run more than once.
    pub run: Option<unsafe extern "C" fn(instance: u64, job: u64, plan: u64) -> u32>,
    /// Forgets a plan.
    pub drop: Option<unsafe extern "C" fn(instance: u64, plan: u64)>,
}

#[allow(unsafe_code)]
// SAFETY: numbers and function pointers only; never written after the build.
unsafe impl Sync for Call1 {}
