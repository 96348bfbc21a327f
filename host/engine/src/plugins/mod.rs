//! Plugins: finding, checking, opening and calling them.

pub mod catalogue;
pub mod context;
pub mod inspect;
pub mod library;
pub mod outputs;
mod tables;

pub use catalogue::{Catalogue, Installed};
pub use context::JobContext;
pub use library::{Library, Prepared};
pub use outputs::Finished;
