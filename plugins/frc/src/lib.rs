//! Fourier ring and shell correlation, and decorrelation.

pub mod crossing;
pub mod curve;
pub mod decorrelation;
pub mod grid;
mod operations;
pub mod points;
pub mod smooth;
pub mod split;
pub mod spurious;
pub mod window;

puncta_sdk::plugin! {
    id: "puncta.frc",
    title: "Resolution",
    description: "Fourier ring and shell correlation, and decorrelation.",
    isolation: "none",
    reentrant: true
}
