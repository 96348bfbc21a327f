//! Mesh files: STL, PLY, OBJ and OFF in and out, glTF (glb) and VTP out.
//!
//! One file a format. The readers are our own and not those of crates, because each count in a file
//! is held against the bytes that are there before memory is taken, each error names its row, and
//! cancel is polled; the formats themselves are small.

pub mod glb;
pub mod obj;
pub mod off;
pub mod ply;
pub mod reader;
pub mod sheet;
pub mod stl;
pub mod text;
pub mod unit;
pub mod vtp;
pub mod writer;

puncta_sdk::plugin! {
    id: "puncta.mesh-io",
    title: "Mesh files",
    description: "Reads and writes STL, PLY, OBJ and OFF; writes glTF and VTP.",
    isolation: "none",
    reentrant: true,
}

#[cfg(test)]
mod tests;
