//! MINFLUX localisations as NumPy arrays (.npy, also zipped) and JSON, in both of their layouts.

mod dtype;
mod json;
mod literal;
mod npy;
mod reader;
#[cfg(test)]
mod tests;
mod walk;

pub use json::ReadJson;
pub use reader::ReadNpy;

puncta_sdk::plugin! {
    id: "puncta.minflux",
    title: "MINFLUX localisations",
    description: "Reads MINFLUX localisations from .npy and .json files.",
    isolation: "none",
    reentrant: true,
}

puncta_sdk::register!(ReadNpy, ReadJson);
