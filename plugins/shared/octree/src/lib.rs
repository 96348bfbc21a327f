//! A linear octree over points: cells of a cube, cut where they hold more than so many points.
//!
//! [`Points`] are the points' Morton keys, sorted; [`Octree`] is the leaves in the order of their
//! keys (key, level, number of points), which fill the cube without gaps; [`Tree`] is the same with
//! inner nodes and pointers to children, and can be balanced. Keys have 20 bits an axis, x lowest.
//!
//! ```
//! use puncta_sdk::run::Serial;
//! use puncta_shared_octree::{Cube, Limits, Octree, Points};
//!
//! let (x, y, z) = ([1.0, 2.0, 9.0, f64::NAN], [1.0, 1.0, 9.0, 0.0], [1.0, 2.0, 9.0, 0.0]);
//! let cube = Cube { low: [0.0; 3], side: 16.0 };
//! let points = Points::new([&x, &y, &z], cube, &Serial)?;
//! assert_eq!((points.len(), points.left_out()), (3, 1));
//!
//! let limits = Limits { capacity: 1, max_level: 20 };
//! let octree = Octree::new(&points, limits, &Serial)?;
//! let leaf = octree.leaf_at([9.0, 9.0, 9.0]).unwrap();
//! assert_eq!((octree.level(leaf), octree.count(leaf)), (2, 1));
//! # Ok::<(), puncta_sdk::Failure>(())
//! ```

mod linear;
mod morton;
mod points;
mod tree;

pub use linear::{Boxes, Limits, Octree};
pub use morton::{BITS, Key, decode, encode};
pub use points::{Cube, Points, bounds};
pub use tree::{NONE, Node, Tree};

#[cfg(test)]
mod tests;
