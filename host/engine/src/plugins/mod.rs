//! Plugins: finding, checking, opening and calling them.

pub mod catalogue;
pub mod context;
pub mod inspect;
pub mod library;
mod tables;

pub use catalogue::{Catalogue, Installed};
pub use context::{Finished, JobContext};
pub use library::{Library, Prepared};
