//! PLY: the polygon file format of Stanford, as text or binary of either byte order.

mod head;
mod read;
mod write;

pub use head::Encoding;
pub use read::{read, recognise};
pub use write::write;
