//! Localisation tables in HDF5 files of the field's programs, such as Picasso and PYME.
//!
//! Only this plugin links libhdf5. The library decodes structures and rare compression; plain
//! records, and chunks that are shuffled and deflated, are read straight from the file on all
//! threads. The one module with `unsafe` code is the one that calls libhdf5 for types that are
//! known only at run time.

mod arrays;
mod attributes;
mod column;
mod columns;
mod decode;
mod derived;
mod error;
mod info;
mod mapped;
mod minflux;
mod named_records;
mod open;
mod picasso;
mod pickle;
mod pyme;
mod raw;
mod read;
mod reader;
mod recognise;
mod record;
mod smap;
mod source;
mod split;
mod storage;
mod storm_analysis;
#[cfg(test)]
mod tests;
mod write_picasso;
mod write_pyme;
mod write_records;
mod yaml;

pub use reader::ReadHdf5;
pub use write_picasso::WritePicasso;
pub use write_pyme::WritePyme;

puncta_sdk::plugin! {
    id: "puncta.hdf5",
    title: "HDF5 localisations",
    description: "Reads and writes HDF5 files of Picasso, PYME, DECODE, storm-analysis, SMAP, pyMINFLUX and others.",
    isolation: "worker",
    reentrant: false,
}

puncta_sdk::register!(ReadHdf5);
