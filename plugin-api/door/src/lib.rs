//! The check at load that a Rust plugin and the host were built with the same tables.
//!
//! `abi_stable` records the layout of every type that a root module reaches and compares the two
//! builds' records when a library is opened. This crate mirrors the tables of `puncta-abi` as such
//! types, proves at compile time that the mirrors have the same sizes and offsets, and exports them
//! through a root module. Nothing else uses `abi_stable`, and no signature names it.
//!
//! The mirrors never grow: `abi_stable` refuses a plugin whose prefix types are shorter than the
//! host's, so that a new host would refuse old plugins. The ABI grows by new tables instead.
#![allow(non_camel_case_types, non_local_definitions)]

pub mod mirror;

pub use abi_stable;
use abi_stable::StableAbi;
use abi_stable::library::RootModule;
use abi_stable::package_version_strings;
use abi_stable::sabi_types::VersionStrings;
use std::path::Path;

/// The root module of a plugin library: it only leads to the mirrored tables.
#[repr(C)]
#[derive(StableAbi)]
#[sabi(kind(Prefix(prefix_ref = DoorRef, prefix_fields = DoorPrefix)))]
#[sabi(missing_field(panic))]
pub struct Door {
    /// The exported table, the same address as the plugin's symbol.
    pub plugin: &'static mirror::Plugin,
    /// For the comparison of their layouts only; empty.
    pub host: Option<&'static mirror::Host>,
    /// For the comparison of their layouts only; empty.
    pub call: Option<&'static mirror::Call1>,
    /// For the comparison of their layouts only; empty.
    pub data: Option<&'static mirror::Data1>,
    /// For the comparison of their layouts only; empty.
    #[sabi(last_prefix_field)]
    pub job: Option<&'static mirror::Job1>,
}

impl RootModule for DoorRef {
    abi_stable::declare_root_module_statics! {DoorRef}
    const BASE_NAME: &'static str = "puncta_plugin";
    const NAME: &'static str = "puncta_plugin";
    const VERSION_STRINGS: VersionStrings = package_version_strings!();
}

/// The root module that leads to `plugin`.
#[must_use]
#[allow(unsafe_code)]
pub fn door(plugin: &'static puncta_abi::Plugin) -> DoorRef {
    use abi_stable::prefix_type::PrefixTypeTrait;
    let plugin: *const puncta_abi::Plugin = plugin;
    Door {
        // SAFETY: the mirror has the same size, alignment and offsets, as `mirror` asserts.
        plugin: unsafe { &*plugin.cast() },
        host: None,
        call: None,
        data: None,
        job: None,
    }
    .leak_into_prefix()
}

/// Name of the symbol that `abi_stable` looks for.
pub const DOOR_SYMBOL: &str = "_1as_0lib_1header_0root_bmodule_bloader";

/// Opens the library at `path` through `abi_stable` and compares its tables with this build's.
///
/// # Errors
/// What differs, in a few lines.
pub fn check(path: &Path) -> Result<DoorRef, String> {
    let header = abi_stable::library::lib_header_from_path(path).map_err(|e| shorten(&e))?;
    header
        .init_root_module::<DoorRef>()
        .map_err(|e| shorten(&e))
}

/// The comparison's text is many pages long; what matters begins at the first error.
fn shorten(error: &abi_stable::library::LibraryError) -> String {
    let text = error.to_string();
    let lines: Vec<&str> = text
        .lines()
        .skip_while(|line| !line.trim_start().starts_with("Error:"))
        .map(str::trim)
        .filter(|line| !line.is_empty())
        .take(6)
        .collect();
    if lines.is_empty() {
        text.lines()
            .find(|line| !line.trim().is_empty())
            .unwrap_or("unknown")
            .trim()
            .to_owned()
    } else {
        lines.join(" ")
    }
}
