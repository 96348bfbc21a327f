//! Simulated localisations of membranes whose surface is known: test structures by constructive
//! solid geometry, sites by Monte-Carlo sampling on an octree, and blinking, background and
//! localisation error after the thesis, appendix C, "Point cloud simulation".

pub mod arrangement;
pub mod blink;
pub mod parameters;
pub mod random;
pub mod rotation;
pub mod sample;
pub mod sdf;
pub mod shape;
pub mod simulate;
