//! Triangle meshes: a half-edge structure, its repair, measures, curvature, remeshing and exact
//! distances.
//!
//! ```
//! use puncta_sdk::run::Serial;
//! use puncta_shared_mesh::curvature::{Method, curvatures};
//! use puncta_shared_mesh::remesh::{Remeshing, remesh};
//! use puncta_shared_mesh::repair::{Repair, repair};
//! use puncta_shared_mesh::{Distance, Mesh, measure, shapes, topology};
//!
//! // Any triangles become an oriented manifold; sound ones can be taken as they are.
//! let (positions, triangles) = shapes::sphere(100.0, 2);
//! let (mut mesh, _, mended) = repair(&positions, &triangles, Repair::default(), &Serial)?;
//! assert_eq!((mended.dropped, mended.holes), (0, 0));
//! assert!(Mesh::new(positions, &triangles).is_ok());
//!
//! remesh(&mut mesh, Remeshing::to(20.0), &Serial)?;
//! assert_eq!(topology::euler(&mesh), 2);
//! assert!(measure::area(&mesh, &Serial)? > 1.2e5);
//! for one in curvatures(&mesh, Method::default(), &Serial)? {
//!     assert!((one.mean() * 100.0 - 1.0).abs() < 0.05);
//! }
//!
//! // Negative inside; bitwise the distance that a search through all triangles would find.
//! let distance = Distance::new(&mesh, &Serial)?;
//! assert!((distance.signed([0.0, 0.0, 150.0]) - 50.0).abs() < 1.0);
//! # Ok::<(), puncta_sdk::Failure>(())
//! ```
//!
//! Edits ([`Mesh::split`], [`Mesh::collapse`], [`Mesh::flip`]) leave dead vertices and triangles
//! behind until [`Mesh::compact`]; arrays by vertex have an entry for dead ones, too.

// A comparison that NaN must fail, too, is written as the negation of its opposite.
#![allow(clippy::neg_cmp_op_on_partial_ord)]

mod blocks;
mod build;
pub mod bvh;
pub mod check;
pub mod curvature;
pub mod curved;
pub mod decimate;
mod edit;
pub mod energy;
mod groups;
pub mod holes;
mod jet;
pub mod measure;
mod mesh;
pub mod nearest;
mod orient;
pub mod remesh;
pub mod repair;
pub mod sample;
pub mod shapes;
mod signed;
pub mod smooth;
pub mod subdivide;
pub mod topology;

pub mod weld;

pub use bvh::Bvh;
pub use groups::Groups;
pub use mesh::{Mesh, NONE, next, prev};
pub use puncta_shared_vector::{self as vector, Point};
pub use signed::Distance;
