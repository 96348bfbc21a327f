//! Images from localisations: counts per pixel, and Gaussians of each localisation's precision.

mod draw;
pub mod field;
mod gaussian;
pub mod gaussian2d;
pub mod grid;
mod histogram;
pub mod histogram2d;
pub mod normal;
mod output;
pub mod spots;
#[cfg(test)]
mod testing;
mod tiles;

pub use gaussian::Gaussian;
pub use histogram::Histogram;

puncta_sdk::plugin! {
    id: "puncta.render",
    title: "Rendering",
    description: "Images from localisations: counts, and Gaussians of their precision.",
    isolation: "none",
    reentrant: true,
}
