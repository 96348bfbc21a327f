//! The store: segments of shared memory and the objects in them.

pub mod gather;
pub mod layout;
pub mod object;
pub mod segment;

pub use layout::Layout;
pub use object::{ColumnData, Object, Selection, Stored};
pub use segment::{Region, Segment};
