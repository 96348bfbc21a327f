//! Arrow IPC (files and streams) and Parquet, both ways.
//!
//! Units, roles and metadata are kept in the fields' and the schema's metadata, so that a table of
//! the host comes back as it was. Tables of other programs open with the units that they state.

mod array;
mod fields;
mod guard;
mod ipc;
mod parquet_file;
mod place;
mod reader;
mod schema;
#[cfg(test)]
mod tests;
mod writer;

pub use reader::{ReadIpc, ReadParquet};
pub use writer::{WriteIpc, WriteParquet};

puncta_sdk::plugin! {
    id: "puncta.arrow-io",
    title: "Arrow and Parquet",
    description: "Reads and writes tables as Arrow IPC (Feather) and Parquet.",
    isolation: "worker",
    reentrant: true,
}

puncta_sdk::register!(ReadIpc, ReadParquet, WriteIpc, WriteParquet);
