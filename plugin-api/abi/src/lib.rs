//! The C tables that Puncta's host and its plugins exchange.
//!
//! A plugin exports one data symbol, [`SYMBOL`], a [`Plugin`]. The host hands the plugin a
//! [`Host`]. Everything else grows by tables that either side asks the other for by a string
//! `name/revision`; a table is frozen on release, so nothing here ever changes size within 1.x.
//!
//! Rules that hold for every function below:
//!
//! * Text and documents are UTF-8 in a [`Str`], never NUL-terminated. Documents are JSON.
//! * A pointer that a function receives is valid until that function returns, unless the function
//!   says otherwise. Whoever allocates, frees; nothing that owns memory crosses.
//! * No function unwinds. A panic becomes [`STATUS_PANICKED`].
//! * `describe`, `create` and `destroy` are called on one thread. `run` is called on several
//!   threads at once only if the plugin's manifest says `reentrant`. The host's functions may be
//!   called from any thread while the call that received the `job` has not returned.
#![no_std]

mod call;
mod data;
mod device;
mod job;
mod layout;

pub use call::{CALL_1, Call1, Plan};
pub use data::{Column, DATA_1, Data1};
pub use device::{DEVICE_CORE_1, DeviceCore1};
pub use job::{JOB_1, Job1, Task};
pub use layout::{FieldLayout, LAYOUTS, TableLayout};

use core::ffi::c_void;

/// The number `n` of the current ABI `v0_<n>`; a change of layout bumps it.
pub const ABI_NUMBER: u32 = 1;
/// The symbol that a plugin exports: a data symbol of type [`Plugin`].
pub const SYMBOL: &str = "puncta_plugin_v0_1";
/// Beginning of the symbol of every ABI number; tells "built for another number" from "no plugin".
pub const SYMBOL_PREFIX: &str = "puncta_plugin_v";

/// The call did what it should.
pub const STATUS_OK: u32 = 0;
/// The call failed; the reason was given to `job/1.fail`.
pub const STATUS_FAILED: u32 = 1;
/// The call stopped because the host asked it to.
pub const STATUS_CANCELLED: u32 = 2;
/// The plugin panicked; the text was given to `job/1.fail` where that was possible.
pub const STATUS_PANICKED: u32 = 3;
/// `prepare` of a reader: the file is not of a kind that this reader knows.
pub const STATUS_NOT_MINE: u32 = 4;
/// A handle, index or pointer that the callee does not know.
pub const STATUS_MISUSE: u32 = 5;
/// The host has no room for what was asked.
pub const STATUS_NO_MEMORY: u32 = 6;

/// Element kind of a column or image: unsigned 8 bit (also a boolean).
pub const KIND_U8: u32 = 1;
/// Signed 8 bit.
pub const KIND_I8: u32 = 2;
/// Unsigned 16 bit.
pub const KIND_U16: u32 = 3;
/// Signed 16 bit.
pub const KIND_I16: u32 = 4;
/// Unsigned 32 bit.
pub const KIND_U32: u32 = 5;
/// Signed 32 bit.
pub const KIND_I32: u32 = 6;
/// Unsigned 64 bit.
pub const KIND_U64: u32 = 7;
/// Signed 64 bit.
pub const KIND_I64: u32 = 8;
/// IEEE 754 binary32; NaN means "missing".
pub const KIND_F32: u32 = 9;
/// IEEE 754 binary64; NaN means "missing".
pub const KIND_F64: u32 = 10;
/// Truth value in one byte, 0 or 1.
pub const KIND_BOOL: u32 = 11;
/// UTF-8 text, addressed by `rows + 1` offsets.
pub const KIND_UTF8: u32 = 12;
/// u32 codes into a table of UTF-8 texts.
pub const KIND_DICTIONARY: u32 = 13;

/// UTF-8 text: `len` bytes at `ptr`. `ptr` may be null when `len` is 0.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct Str {
    /// First byte.
    pub ptr: *const u8,
    /// Number of bytes.
    pub len: u64,
}

impl Str {
    /// The empty text.
    pub const EMPTY: Str = Str {
        ptr: core::ptr::null(),
        len: 0,
    };

    /// Borrows `text`; valid as long as `text` is.
    #[must_use]
    pub const fn new(text: &str) -> Str {
        Str {
            ptr: text.as_ptr(),
            len: text.len() as u64,
        }
    }

    /// The text, or `None` if it is no UTF-8 or has a null pointer with a length.
    ///
    /// # Safety
    /// `ptr` must point to `len` bytes that stay valid and unchanged for `'a`.
    #[must_use]
    #[allow(unsafe_code)]
    pub unsafe fn as_str<'a>(self) -> Option<&'a str> {
        if self.len == 0 {
            return Some("");
        }
        if self.ptr.is_null() || self.len > isize::MAX as u64 {
            return None;
        }
        // SAFETY: non-null, and the caller promises `len` valid bytes.
        let bytes = unsafe { core::slice::from_raw_parts(self.ptr, self.len as usize) };
        core::str::from_utf8(bytes).ok()
    }
}

/// What a plugin exports under [`SYMBOL`]. Frozen per major number.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct Plugin {
    /// `size_of::<Plugin>()` at the plugin's build.
    pub size: u32,
    /// Major ABI version; 0 until the first release.
    pub major: u32,
    /// Minor ABI version; informs messages only.
    pub minor: u32,
    /// [`ABI_NUMBER`] of the plugin's build while `major` is 0.
    pub number: u32,
    /// Writes the manifest document (`puncta.plugin/1`) to `out`; valid until the process ends.
    pub describe: Option<unsafe extern "C" fn(out: *mut Str) -> u32>,
    /// Makes an instance. `host` is valid until `destroy` returns.
    pub create: Option<unsafe extern "C" fn(host: *const Host, out: *mut u64) -> u32>,
    /// Ends an instance that `create` made.
    pub destroy: Option<unsafe extern "C" fn(instance: u64)>,
    /// The table with this id, valid until the process ends, or null.
    pub get: Option<unsafe extern "C" fn(id: Str) -> *const c_void>,
}

#[allow(unsafe_code)]
// SAFETY: numbers and function pointers only; nothing in it is ever written after the build.
unsafe impl Sync for Plugin {}

/// What the host gives to a plugin's `create`. Frozen per major number.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct Host {
    /// `size_of::<Host>()` at the host's build.
    pub size: u32,
    /// Major ABI version.
    pub major: u32,
    /// Minor ABI version.
    pub minor: u32,
    /// [`ABI_NUMBER`] of the host's build while `major` is 0.
    pub number: u32,
    /// The table with this id, valid until the process ends, or null.
    pub get: Option<unsafe extern "C" fn(id: Str) -> *const c_void>,
}

#[allow(unsafe_code)]
// SAFETY: numbers and function pointers only; nothing in it is ever written after the build.
unsafe impl Sync for Host {}
