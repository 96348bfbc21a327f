//! MATLAB files of version 5 to 7 (`.mat`): localisations of SMAP and MINFLUX, tracks, and any
//! vectors of equal length.

mod container;
mod find;
mod matrix;
mod reader;
#[cfg(test)]
mod tests;
mod tracks;
mod unpack;

pub use reader::ReadMat;

puncta_sdk::plugin! {
    id: "puncta.matlab",
    title: "MATLAB files",
    description: "Reads localisations and tracks from MATLAB files of version 5 to 7.",
    isolation: "none",
    reentrant: true,
}

puncta_sdk::register!(ReadMat);
