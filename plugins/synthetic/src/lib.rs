//! Synthetic localisations of a membrane: test structures by constructive solid geometry, sites by
//! Monte-Carlo sampling on an octree, and blinking, background and localisation error after the
//! thesis, appendix C, "Point cloud simulation".

pub mod columns;
pub mod membrane;

puncta_sdk::plugin! {
    id: "puncta.synthetic",
    title: "Synthetic data",
    description: "Simulates localisations of membranes whose surface is known.",
    isolation: "none",
    reentrant: true,
}
