//! The store: segments of shared memory and the objects in them.

pub mod gather;
pub mod layout;
pub mod object;
pub mod pool;
pub mod region;
pub mod segment;
pub mod stack;

pub use layout::Layout;
pub use object::{ColumnData, Object, Selection, Stored};
pub use pool::SegmentPool;
pub use region::Region;
pub use segment::{Segment, available as available_memory, installed_memory};
pub use stack::{row_of, stack};
