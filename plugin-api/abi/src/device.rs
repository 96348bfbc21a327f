use crate::Str;

/// Id of [`DeviceCore1`]. Reserved: it may still change until the first release.
pub const DEVICE_CORE_1: &str = "device.core/1";

/// Instruments: the plugin's side. Everything that moves or settles is started, then polled, so
/// that no call blocks for longer than the deadline it was given.
///
/// Each device is called on one thread of its own, except `halt`, which any thread may call. On
/// failure `message` receives a sentence that stays valid until the next call on that device.
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
            device: *mut u64,
            message: *mut Str,
        ) -> u32,
    >,
    /// Writes the document (`puncta.device/1`) of its properties: unit, limits, read-only.
    pub describe: Option<unsafe extern "C" fn(device: u64, document: *mut Str) -> u32>,
    /// Reads a property, waiting for the device at most `seconds`.
    pub read: Option<
        unsafe extern "C" fn(
            device: u64,
            property: Str,
            seconds: f64,
            value: *mut f64,
            message: *mut Str,
        ) -> u32,
    >,
    /// Starts bringing a property to `value` and returns at once with a token.
    pub start: Option<
        unsafe extern "C" fn(
            device: u64,
            property: Str,
            value: f64,
            token: *mut u64,
            message: *mut Str,
        ) -> u32,
    >,
    /// Waits at most `seconds` for a token: 0 while it runs, 1 when it is done.
    pub poll: Option<
        unsafe extern "C" fn(
            device: u64,
            token: u64,
            seconds: f64,
            done: *mut u32,
            message: *mut Str,
        ) -> u32,
    >,
    /// Stops what runs, now. Any thread.
    pub halt: Option<unsafe extern "C" fn(device: u64) -> u32>,
    /// Brings the device to a state that harms nobody and nothing.
    pub safe_state: Option<unsafe extern "C" fn(device: u64, message: *mut Str) -> u32>,
    /// Closes the device; its number is not used again.
    pub close: Option<unsafe extern "C" fn(device: u64)>,
}

#[allow(unsafe_code)]
// SAFETY: numbers and function pointers only; never written after the build.
unsafe impl Sync for DeviceCore1 {}
