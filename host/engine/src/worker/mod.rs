//! Calls in a process of their own: the same binary, the same tables, the same bits.
//!
//! Host and worker share a Unix socket. Control messages are JSON frames; columns are never copied:
//! the descriptors of their segments travel with the frames, and the other side maps them.

mod client;
mod limits;
mod offspring;
mod output;
mod pool;
mod process;
mod protocol;
/// Objects and the memory that they lie in, as documents.
pub(crate) mod wire {
    pub use super::protocol::{Sent, WireFinished};
}
mod serve;
mod socket;

pub use client::Prepared;
pub use pool::Pool;
pub use process::{Start, Worker};
pub use serve::serve;
