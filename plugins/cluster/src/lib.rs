//! Clusters of localisations and their measures.
//!
//! [`cells`] sorts points into a grid, [`density`] is DBSCAN on it. The operations are one file
//! each.

pub mod cells;
pub mod columns;
pub mod condense;
pub mod dbscan;
pub mod density;
pub mod hdbscan;
pub mod sizes;
pub mod spanning;
#[cfg(test)]
mod testing;
pub mod tree;
pub mod union;

puncta_sdk::plugin! {
    id: "puncta.cluster",
    title: "Clusters",
    description: "Clusters of localisations and their measures.",
    isolation: "none",
    reentrant: true
}
