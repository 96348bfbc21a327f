//! Localisations and tracks as text: the tables of the field's programs, and any other table.
//!
//! A file is sniffed ([`sniff`]), its columns are mapped to names and units of the host
//! ([`mapping`]), and its rows are read in parallel pieces straight into the host's columns
//! ([`read`]). Nothing here knows the file's size in advance beyond its number of bytes; memory is
//! the columns and a few pieces of the file.

pub mod columns;
pub mod decode;
pub mod dialect;
pub mod encoding;
pub mod fault;
pub mod flavours;
pub mod footer;
pub mod headerless;
pub mod mapping;
pub mod notes;
pub mod number;
pub mod options;
pub mod piece;
pub mod rapidstorm;
pub mod read;
pub mod reader;
pub mod record;
pub mod rows;
pub mod sample;
pub mod schema;
pub mod sink;
pub mod sniff;
pub mod table;
pub mod tagged;
pub mod wording;
pub mod write;
pub mod writer;

puncta_sdk::plugin! {
    id: "puncta.text",
    title: "Text tables",
    description: "Reads and writes localisations as csv, tsv and other text with named columns.",
    isolation: "none",
    reentrant: true,
}
