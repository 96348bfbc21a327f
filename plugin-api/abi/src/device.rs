use crate::Str;

/// Id of [`DeviceCore1`]. Reserved: it may still change until the first release.
pub const DEVICE_CORE_1: &str = "device.core/1";

/// Instruments: the plugin's side. What moves or settles is started, then polled: a function with
/// `seconds` (finite, 0 or more) returns at most 50 ms after them, every other function at once.
///
/// One thread calls a device, and may call several. Only `halt` may come from any thread, after
/// `open` has returned and before `close` is called; the host sees to that order.
///
/// Where the status is not 0, `message` receives a sentence that stays valid until the next call of
/// a function of this table on the same thread. Every device is closed before its `instance` is
/// destroyed. When the host goes away, its worker calls `halt`, `safe_state` and `close`, and ends.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct DeviceCore1 {
    /// `size_of::<DeviceCore1>()`.
    pub size: u32,
    /// 0.
    pub reserved: u32,
    /// Opens the device that a document (`puncta.device-settings/1`) describes. Moves nothing.
    pub open: Option<
        unsafe extern "C" fn(
            instance: u64,
            settings: Str,
            seconds: f64,
            device: *mut u64,
            message: *mut Str,
        ) -> u32,
    >,
    /// Writes the document (`puncta.device/1`) of its properties: name, unit, min, max, read_only.
    /// Valid until the next `describe` of this device or its `close`. Asks the device nothing.
    pub describe: Option<unsafe extern "C" fn(device: u64, document: *mut Str) -> u32>,
    /// Reads a property; no answer in time is a failure. `STATUS_CANCELLED` after `halt`.
    pub read: Option<
        unsafe extern "C" fn(
            device: u64,
            property: Str,
            seconds: f64,
            value: *mut f64,
            message: *mut Str,
        ) -> u32,
    >,
    /// Starts bringing a property to `value` and writes a token, which is never 0. A value outside
    /// the limits, and a read-only property, are refused and change nothing.
    pub start: Option<
        unsafe extern "C" fn(
            device: u64,
            property: Str,
            value: f64,
            token: *mut u64,
            message: *mut Str,
        ) -> u32,
    >,
    /// Waits for a token: `done` is 0 while it runs, which is no failure, and 1 when the property
    /// has arrived and settled. 0 seconds: looks only. `STATUS_CANCELLED` after `halt`,
    /// `safe_state` or a later `start` of the property, whatever the token's motion came to.
    pub poll: Option<
        unsafe extern "C" fn(
            device: u64,
            token: u64,
            seconds: f64,
            done: *mut u32,
            message: *mut Str,
        ) -> u32,
    >,
    /// Stops what moves where it is, and ends every token. A function that runs on the device
    /// returns `STATUS_CANCELLED` within 50 ms. Any thread.
    pub halt: Option<unsafe extern "C" fn(device: u64, message: *mut Str) -> u32>,
    /// Brings the device to a state that harms nobody and nothing, and waits until it is there. It
    /// is told to go there even if it has stopped answering.
    pub safe_state:
        Option<unsafe extern "C" fn(device: u64, seconds: f64, message: *mut Str) -> u32>,
    /// Closes the device, which stays as it is.
    pub close: Option<unsafe extern "C" fn(device: u64)>,
}

#[allow(unsafe_code)]
// SAFETY: numbers and function pointers only; never written after the build.
unsafe impl Sync for DeviceCore1 {}
