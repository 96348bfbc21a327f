//! Puncta's engine: store, recipe graph, loader, worker, jobs. No window, no algorithm, no format.

pub mod batch;
pub mod cache;
pub mod date;
pub mod engine;
pub mod files;
pub mod headless;
pub mod job;
pub mod kept;
pub mod markup;
pub mod plugins;
pub mod provenance;
pub mod recipe;
pub mod replay;
pub mod room;
pub mod settings;
pub mod store;
pub mod summary;
#[cfg(unix)]
pub mod worker;

pub use engine::{Called, Engine, Invocation, Isolation, Options, PreparedCall, ReadFile, Written};
pub use job::{Cancel, Progress, Unwatched};
pub use puncta_documents as documents;
pub use store::Object;
