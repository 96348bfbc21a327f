use crate::Str;

/// Id of [`Data1`]; every host gives it.
pub const DATA_1: &str = "data/1";

/// One column of plain contiguous memory.
///
/// Numbers lie at `data`, `rows * width` of them. UTF-8 columns have `rows + 1` `offsets` into
/// `text` and no `data`. Dictionary columns have u32 codes at `data`, and `entries + 1` `offsets`
/// into `text`. Inputs are mapped read-only. Memory is aligned to 64 bytes and padded to a multiple of 64.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct Column {
    /// Numbers or codes; null for UTF-8.
    pub data: *mut u8,
    /// Offsets into `text`; null for numbers.
    pub offsets: *mut u64,
    /// Text bytes; null for numbers.
    pub text: *mut u8,
    /// Rows there are (input) or room for rows (output).
    pub rows: u64,
    /// Dictionary entries there are, or room for them.
    pub entries: u64,
    /// Text bytes there are, or room for them.
    pub text_bytes: u64,
    /// One of the `KIND_` numbers.
    pub kind: u32,
    /// Numbers per row: 1, or the length of a fixed-size list.
    pub width: u32,
}

/// Inputs and outputs of a running call: the host's side.
///
/// An input is addressed by its place in the request's `inputs`, an output by the number that
/// `begin` gives. `part` is 0 except for meshes (0 vertices, 1 triangles).
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct Data1 {
    /// `size_of::<Data1>()`.
    pub size: u32,
    /// 0.
    pub reserved: u32,
    /// Columns of an input, in the order in which the plan names them, or of an output, in the
    /// order of its document. Writes at most `capacity` and always the true number to `count`.
    /// Pointers stay valid until `run` returns, or until `grow` or `finish` of that output.
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
    /// Begins an output described by a document (`puncta.output/1`) and writes its number. The room
    /// may hold anything, except that the first offset of texts is 0.
    pub begin: Option<unsafe extern "C" fn(job: u64, document: Str, object: *mut u64) -> u32>,
    /// Makes room for `rows` rows in all. Ask for the columns again afterwards.
    pub grow: Option<unsafe extern "C" fn(job: u64, object: u64, part: u32, rows: u64) -> u32>,
    /// Makes the next `rows` rows usable; others may read them from now on.
    pub commit: Option<unsafe extern "C" fn(job: u64, object: u64, part: u32, rows: u64) -> u32>,
    /// Ends an output with `rows[part]` rows. `header` is a document whose members replace those
    /// of the output's header, or empty. An output that is not finished when `run` returns is dropped.
    pub finish: Option<
        unsafe extern "C" fn(
            job: u64,
            object: u64,
            rows: *const u64,
            parts: u32,
            header: Str,
        ) -> u32,
    >,
    /// Gives a figure or a report as a document (`puncta.figure/1`, `puncta.report/1`).
    pub emit: Option<unsafe extern "C" fn(job: u64, document: Str) -> u32>,
}

#[allow(unsafe_code)]
// SAFETY: numbers and function pointers only; never written after the build.
unsafe impl Sync for Data1 {}
