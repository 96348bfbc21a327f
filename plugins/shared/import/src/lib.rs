//! How columns of a file become columns of the host: the same rules in every reader.
//!
//! A reader says what its format knows of each column ([`Source`]); the person's explicit mapping
//! ([`Mapping`], the parameters [`MappingParams`]) wins over it; [`Mapping::apply`] gives names,
//! units, roles, and what to do with the values. A unit that nobody says stays `unknown`.

pub mod apply;
pub mod mapping;
pub mod names;
pub mod params;
pub mod units;

pub use apply::{Mapped, Source, remedy};
pub use mapping::{Columns, Mapping};
pub use names::Named;
pub use params::{FrameBase, MappingParams};
pub use units::{UNKNOWN, Unit};
