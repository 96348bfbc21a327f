//! Clusters of localisations and their measures.
//!
//! [`cells`] sorts points into a grid, [`density`] is DBSCAN on it. The operations are one file
//! each.

pub mod assign;
pub mod boundaries;
pub mod cells;
pub mod columns;
pub mod condense;
pub mod dbscan;
pub mod density;
pub mod groups;
pub mod hdbscan;
pub mod measures;
pub mod plane;
pub mod polygons;
pub mod shape;
pub mod sizes;
pub mod space;
pub mod spanning;
pub mod tessellation;
#[cfg(test)]
mod testing;
pub mod tiles;
pub mod tree;
pub mod union;
pub mod voronoi;

puncta_sdk::plugin! {
    id: "puncta.cluster",
    title: "Clusters",
    description: "Clusters of localisations and their measures.",
    isolation: "none",
    reentrant: true
}
