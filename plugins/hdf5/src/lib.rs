//! Localisation tables in HDF5 files: Picasso `.hdf5` with its `.yaml`, and PYME `.h5r`.
//!
//! Only this plugin links libhdf5. The library decodes structures and rare compression; plain
//! records, and chunks that are shuffled and deflated, are read straight from the file on all
//! threads. The one module with `unsafe` code is the one that calls libhdf5 for types that are
//! known only at run time.

mod attributes;
mod column;
mod columns;
mod error;
mod info;
mod open;
mod picasso;
mod pickle;
mod pyme;
mod raw;
mod read;
mod reader;
mod recognise;
mod record;
mod source;
mod split;
mod storage;
#[cfg(test)]
mod tests;
mod yaml;

pub use reader::ReadHdf5;

puncta_sdk::plugin! {
    id: "puncta.hdf5",
    title: "HDF5 localisations",
    description: "Reads Picasso .hdf5 files with their .yaml, and PYME .h5r fit results.",
    isolation: "worker",
    reentrant: false,
}

puncta_sdk::register!(ReadHdf5);
