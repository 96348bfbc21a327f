//! Localisation precision, photon and frame statistics.

pub mod distances;
pub mod frames;
pub mod histogram;
pub mod mixture;
mod operations;
pub mod simplex;
pub mod theory;

puncta_sdk::plugin! {
    id: "puncta.precision",
    title: "Precision",
    description: "Localisation precision, photon and frame statistics.",
    isolation: "none",
    reentrant: true
}
