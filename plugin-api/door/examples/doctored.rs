//! A library whose door differs in one member's type, to show that the check refuses it: its
//! `progress` takes the fraction as f32. It is otherwise what a plugin exports.
#![allow(non_camel_case_types, non_local_definitions, missing_docs, unsafe_code)]

use puncta_door::abi_stable::library::{CheckTypeLayout, LibHeader, RootModule, RootModuleResult};
use puncta_door::abi_stable::prefix_type::PrefixTypeTrait;
use puncta_door::abi_stable::sabi_types::VersionStrings;
use puncta_door::abi_stable::{self, StableAbi};
use puncta_door::mirror::{Call1, Data1, Host, Plugin, Str, Task};

#[repr(C)]
#[derive(StableAbi, Clone, Copy)]
pub struct Job1 {
    pub size: u32,
    pub reserved: u32,
    pub progress: Option<unsafe extern "C" fn(job: u64, fraction: f32, phase: Str) -> u32>,
    pub cancelled: Option<unsafe extern "C" fn(job: u64) -> u32>,
    pub fail: Option<unsafe extern "C" fn(job: u64, document: Str)>,
    pub log: Option<unsafe extern "C" fn(job: u64, level: u32, message: Str)>,
    pub threads: Option<unsafe extern "C" fn(job: u64) -> u32>,
    pub parallel_for: Option<
        unsafe extern "C" fn(job: u64, count: u64, grain: u64, task: Task, context: *mut u8) -> u32,
    >,
}

#[repr(C)]
#[derive(StableAbi)]
#[sabi(kind(Prefix(prefix_ref = DoorRef, prefix_fields = DoorPrefix)))]
#[sabi(missing_field(panic))]
pub struct Door {
    pub plugin: &'static Plugin,
    pub host: Option<&'static Host>,
    pub call: Option<&'static Call1>,
    pub data: Option<&'static Data1>,
    #[sabi(last_prefix_field)]
    pub job: Option<&'static Job1>,
}

impl RootModule for DoorRef {
    abi_stable::declare_root_module_statics! {DoorRef}
    const BASE_NAME: &'static str = "puncta_plugin";
    const NAME: &'static str = "puncta_plugin";
    const VERSION_STRINGS: VersionStrings = abi_stable::package_version_strings!();
}

fn door() -> DoorRef {
    Door {
        plugin: unsafe { &*(&raw const puncta_plugin_v0_1).cast() },
        host: None,
        call: None,
        data: None,
        job: None,
    }
    .leak_into_prefix()
}

extern "C" fn load() -> RootModuleResult {
    abi_stable::library::__call_root_module_loader(door)
}

#[unsafe(no_mangle)]
pub static _1as_0lib_1header_0root_bmodule_bloader: LibHeader =
    unsafe { LibHeader::from_constructor::<DoorRef>(load, CheckTypeLayout::Yes) };

unsafe extern "C" fn describe(_out: *mut puncta_abi::Str) -> u32 {
    puncta_abi::STATUS_FAILED
}

#[unsafe(no_mangle)]
pub static puncta_plugin_v0_1: puncta_abi::Plugin = puncta_abi::Plugin {
    size: size_of::<puncta_abi::Plugin>() as u32,
    major: 0,
    minor: 1,
    number: puncta_abi::ABI_NUMBER,
    describe: Some(describe),
    create: None,
    destroy: None,
    get: None,
};
