//! Meshes: repair, remeshing, smoothing, subdivision, decimation, components, curvature, measures,
//! distances of localisations, points drawn from a surface, and shapes to try them on.
//!
//! The algorithms are those of `puncta-shared-mesh`; here are their operations.

pub mod columns;
pub mod exchange;
pub mod operations;

puncta_sdk::plugin! {
    id: "puncta.mesh",
    title: "Meshes",
    description: "Repairs, remeshes, smooths and measures triangle meshes, and localisations by them.",
    isolation: "none",
    reentrant: true,
}
