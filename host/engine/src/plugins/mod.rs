//! Plugins: finding, checking, opening and calling them.

pub mod bundle;
pub mod catalogue;
pub mod context;
pub mod crashes;
pub mod held;
pub mod inspect;
pub mod library;
pub mod library_file;
pub mod outputs;
pub mod packed;
pub mod sentinel;
mod tables;

pub use catalogue::{Catalogue, Installed};
pub use context::JobContext;
pub use held::{Held, Why};
pub use library::{Library, Prepared};
pub use outputs::Finished;
