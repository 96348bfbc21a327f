//! Isosurfaces of the density of localisations: an octree that follows the localisations, its dual
//! grid, and marching cubes on the cells of that grid. Every surface is a closed, oriented
//! 2-manifold.

pub mod cells;
pub mod centre;
pub mod extract;
pub mod field;
pub mod march;
pub mod operation;
pub mod output;
pub mod quality;
pub mod score;
pub mod surface;
pub mod truth;

puncta_sdk::plugin! {
    id: "puncta.isosurface",
    title: "Isosurfaces",
    description: "Extracts closed surfaces from localisations, and scores surfaces.",
    isolation: "none",
    reentrant: true,
}

#[cfg(test)]
mod tests;
