//! The validator of built plugins: `puncta plugins check`.
//!
//! A library is looked at from outside, as the host meets it: its tables, its manifest, and what its
//! calls do with good, odd and hostile requests and data. Each [`Check`] runs in a process of its
//! own with a time limit, so that a crash is a finding and costs nothing else.
//!
//! The host of these processes is not the engine's: [`host`] gives columns with guard pages, refuses
//! what it is told to refuse, and notes what a plugin does that the ABI does not allow. Only the
//! comparison with a worker goes through the engine.
#![cfg(unix)]

mod calls;
pub mod check;
mod child;
mod data;
mod documents;
mod files;
mod host;
mod item;
mod library;
mod manifest;
mod material;
mod memory;
mod odd;
mod plugin;
mod process;
mod raw;
mod run;
mod setting;

pub use check::{Check, Outcome, Status};
pub use child::{Orders, child};
pub use run::{Order, Report, check};
