//! What authors of Puncta plugins write against.
//!
//! A plugin is a library (`crate-type = ["cdylib", "rlib"]`) with one [`plugin!`] and, for each
//! operation, a parameter struct with `#[derive(Params)]`, an [`Operation`] implementation and a
//! [`register!`]:
//!
//! ```
//! use puncta_sdk::prelude::*;
//!
//! /// Adds the distance of each localisation from a point.
//! #[derive(Params)]
//! struct Distance {
//!     /// Position of the point along x.
//!     #[param(default = 0.0, unit = "nm")]
//!     x: f64,
//! }
//!
//! impl Operation for Distance {
//!     const ID: &'static str = "example.distance/1";
//!
//!     fn info() -> Info {
//!         Info::operation("Distance from a point")
//!             .input(Ports::table("table").column("x", "nm"))
//!             .output(Ports::columns("table", "table"))
//!     }
//!
//!     fn run(&self, job: &Job) -> Result<(), Failure> {
//!         let table = job.input("table")?;
//!         let x = table.f64("x")?;
//!         let mut out = job.add_columns("table", [ColumnInfo::new("distance", Element::F64, "nm")])?;
//!         for (distance, x) in out.f64_mut("distance")?.iter_mut().zip(x.iter()) {
//!             *distance = (x - self.x).abs();
//!         }
//!         out.finish()
//!     }
//! }
//!
//! register!(Distance);
//! # fn main() {}
//! ```

pub mod host;
pub mod info;
pub mod input;
pub mod job;
pub mod operation;
pub mod output;
pub mod params;
mod raw;
pub mod run;
pub mod shim;

pub use info::{Info, Ports};
pub use input::{Input, InputPart};
pub use job::Job;
pub use operation::{Operation, Registration};
pub use output::{ColumnMut, Committer, OutputObject, OutputPart};
pub use params::{Column, Columns, FromValue, Mapping, Params, Ranges, Seed};
pub use puncta_derive::{Choice, Params};
pub use puncta_documents as documents;
pub use puncta_documents::{
    ColumnInfo, ColumnType, Element, Failure, FailureCode, Figure, Header, ImageInfo, Kind, Map,
    Output, OutputForm, Part, Plan, Probe, Report, Request, Series,
};
pub use run::{Cancelled, Run};

#[doc(hidden)]
pub use inventory;
#[doc(hidden)]
pub use puncta_abi as abi;
#[doc(hidden)]
pub use puncta_door as door;
#[doc(hidden)]
pub use serde_json;

/// Everything that a plugin usually needs.
pub mod prelude {
    pub use crate::{
        Choice, Column, ColumnInfo, Columns, Element, Failure, FailureCode, Header, ImageInfo,
        Info, Job, Kind, Map, Mapping, Operation, Output, OutputForm, Params, Plan, Ports, Probe,
        Ranges, Report, Request, Run, Seed, plugin, register,
    };
}

/// Version of this SDK, written into the manifest.
pub const VERSION: &str = env!("CARGO_PKG_VERSION");

/// Registers operations with this plugin.
#[macro_export]
macro_rules! register {
    ($($operation:ty),+ $(,)?) => {
        $($crate::inventory::submit! { $crate::Registration::of::<$operation>() })+
    };
}

/// Exports this library as a plugin. Write it once, in `lib.rs`.
///
/// ```text
/// plugin! {
///     id: "lab.nearest",
///     title: "Nearest neighbours",
///     description: "Distances between localisations.",
///     isolation: "none",   // or "worker", the default: never in the host's own process
///     reentrant: true,     // `run` may be called on several threads at once
///     tables: my_tables,   // fn(&str) -> *const c_void: further tables by id, else null
/// }
/// ```
#[macro_export]
macro_rules! plugin {
    (id: $id:expr, title: $title:expr, description: $description:expr
     $(, isolation: $isolation:expr)? $(, reentrant: $reentrant:expr)?
     $(, tables: $tables:expr)? $(,)?) => {
        /// What this library exports.
        #[unsafe(export_name = "puncta_plugin_v0_1")]
        pub static PUNCTA_PLUGIN: $crate::abi::Plugin =
            $crate::shim::table(__puncta_describe, __puncta_get);

        extern "C" fn __puncta_get(id: $crate::abi::Str) -> *const ::std::ffi::c_void {
            $crate::shim::get(id, &[$($tables)?])
        }

        extern "C" fn __puncta_describe(out: *mut $crate::abi::Str) -> u32 {
            static MANIFEST: ::std::sync::OnceLock<::std::string::String> =
                ::std::sync::OnceLock::new();
            $crate::shim::describe(&MANIFEST, out, || {
                #[allow(unused_mut)]
                let mut manifest = $crate::shim::manifest(
                    $id,
                    $title,
                    env!("CARGO_PKG_VERSION"),
                    env!("CARGO_PKG_LICENSE"),
                    $description,
                );
                $(manifest.isolation = $isolation.into();)?
                $(manifest.reentrant = $reentrant;)?
                manifest
            })
        }

        #[doc(hidden)]
        #[unsafe(export_name = "_1as_0lib_1header_0root_bmodule_bloader")]
        pub static __PUNCTA_DOOR: $crate::door::abi_stable::library::LibHeader =
            $crate::door_header!($crate::door::door(&PUNCTA_PLUGIN));

        const _: () = $crate::shim::assert_symbol("puncta_plugin_v0_1");
    };
}

/// The loader record of the door, which `abi_stable`'s own attribute writes only into crates that
/// depend on it.
#[doc(hidden)]
#[macro_export]
macro_rules! door_header {
    ($door:expr) => {{
        fn door() -> $crate::door::DoorRef {
            $door
        }
        extern "C" fn load() -> $crate::door::abi_stable::library::RootModuleResult {
            $crate::door::abi_stable::library::__call_root_module_loader(door)
        }
        $crate::shim::header(load)
    }};
}
