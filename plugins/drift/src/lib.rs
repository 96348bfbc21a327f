//! Estimates and corrects the drift of the sample.

pub mod aim;
pub mod anderson;
pub mod applied;
pub mod beads;
pub mod bins;
pub mod cloud;
pub mod coarse;
pub mod correction;
pub mod correlation;
pub mod curve;
pub mod displacement;
pub mod entropy;
pub mod estimate;
pub mod grid;
pub mod least_entropy;
pub mod network;
pub mod operations;
pub mod pairs;
pub mod smooth;
pub mod sort;
pub mod steps;
#[cfg(test)]
mod testing;

puncta_sdk::plugin! {
    id: "puncta.drift",
    title: "Drift",
    description: "Estimates and corrects the drift of the sample.",
    isolation: "none",
    reentrant: true
}
