//! Writes figures as SVG, PNG and text.
//!
//! A figure becomes a [`scene`], a list of lines, areas and texts, which is written as SVG or drawn
//! as pixels; both are the same picture.

mod axis;
mod colours;
pub mod csv_write;
mod curves;
mod data;
mod example;
pub mod histogram;
mod layout;
mod picture;
pub mod png_write;
mod raster;
mod scene;
mod svg;
pub mod svg_write;
mod text;
#[cfg(test)]
mod writer_tests;

/// CSS pixels of a length in mm.
fn pixels(mm: f64) -> f64 {
    mm * 96.0 / 25.4
}

puncta_sdk::plugin! {
    id: "puncta.figure_io",
    title: "Figure files",
    description: "Writes figures as SVG, PNG and text, and plots the distribution of a column.",
    isolation: "none",
    reentrant: true
}
