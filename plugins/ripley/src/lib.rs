//! Pair distances, Ripley functions and nearest neighbours.

mod bands;
pub mod bins;
pub mod edges;
pub mod envelope;
pub mod flat;
pub mod nearest;
pub mod op_density;
pub mod op_k;
pub mod op_nearest;
pub mod op_pairs;
pub mod overlap;
pub mod pairs;
pub mod place;
pub mod polygon;
pub mod ripley;
pub mod simulate;
pub mod solid;
pub mod study;
#[cfg(test)]
mod testing;
pub mod window;

puncta_sdk::plugin! {
    id: "puncta.ripley",
    title: "Spatial statistics",
    description: "Pair distances, Ripley functions and nearest neighbours.",
    isolation: "none",
    reentrant: true
}
