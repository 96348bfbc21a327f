//! ASDF files as locan writes them (`.asdf`): a tree in YAML and an array of localisations.

mod block;
mod reader;
#[cfg(test)]
mod tests;
mod tree;

pub use reader::ReadAsdf;

puncta_sdk::plugin! {
    id: "puncta.asdf",
    title: "ASDF files of locan",
    description: "Reads localisations from the .asdf files of locan.",
    isolation: "none",
    reentrant: true,
}

puncta_sdk::register!(ReadAsdf);
