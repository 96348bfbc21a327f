//! Images from localisations: counts, Gaussians of each localisation's precision, and densities
//! from squares and triangles that adapt to them, in planes and volumes.

mod channels;
mod draw;
pub mod field;
mod gaussian;
pub mod gaussian2d;
mod gaussian3;
pub mod gaussian3d;
pub mod grid;
mod histogram;
pub mod histogram2d;
mod histogram3;
mod jitter;
pub mod normal;
#[cfg(test)]
mod operation_tests;
mod output;
mod parameters;
mod quadtree;
pub mod quadtree2d;
pub mod samples;
pub mod spots;
#[cfg(test)]
mod testing;
pub mod tetrahedra3d;
mod tiles;
pub mod triangles2d;
mod triangulation;
mod triangulation3;

pub use gaussian::Gaussian;
pub use gaussian3::Gaussian3d;
pub use histogram::Histogram;
pub use histogram3::Histogram3d;
pub use quadtree::Quadtree;
pub use triangulation::Triangulation;
pub use triangulation3::Triangulation3d;

puncta_sdk::plugin! {
    id: "puncta.render",
    title: "Rendering",
    description: "Images from localisations: counts, Gaussians of their precision, and densities.",
    isolation: "none",
    reentrant: true,
}
