//! Pair distances, Ripley functions and nearest neighbours.

pub mod bins;
pub mod pairs;

puncta_sdk::plugin! {
    id: "puncta.ripley",
    title: "Spatial statistics",
    description: "Pair distances, Ripley functions and nearest neighbours.",
    isolation: "none",
    reentrant: true
}
