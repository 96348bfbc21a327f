//! Triangle meshes: a half-edge structure, its repair, measures, curvature, remeshing and exact
//! distances.

mod blocks;
mod build;
pub mod bvh;
mod edit;
pub mod measure;
mod mesh;
pub mod nearest;
pub mod shapes;
mod signed;
pub mod topology;
pub mod vector;

pub use bvh::Bvh;
pub use mesh::{Mesh, NONE, next, prev};
pub use signed::Distance;
pub use vector::Point;
