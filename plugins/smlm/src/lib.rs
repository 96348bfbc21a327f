//! The `.smlm` container of ShareLoc: a zip archive of a manifest and tables.

mod manifest;
mod reader;
#[cfg(test)]
mod tests;

pub use reader::ReadSmlm;

puncta_sdk::plugin! {
    id: "puncta.smlm",
    title: "SMLM containers",
    description: "Reads the .smlm containers of ShareLoc.",
    isolation: "none",
    reentrant: true,
}

puncta_sdk::register!(ReadSmlm);
