//! The operations, one file each.

pub mod components;
pub mod curvature;
pub mod decimate;
pub mod distance;
pub mod measures;
pub mod points;
pub mod remesh;
pub mod repair;
pub mod shape;
pub mod smooth;
pub mod subdivide;

#[cfg(test)]
mod tests;
