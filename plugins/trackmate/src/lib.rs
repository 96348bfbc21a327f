//! TrackMate's XML: whole models and simple tracks.

mod parse;
mod reader;
#[cfg(test)]
mod tests;

pub use reader::ReadTrackMate;

puncta_sdk::plugin! {
    id: "puncta.trackmate",
    title: "TrackMate files",
    description: "Reads spots and tracks from TrackMate's XML files.",
    isolation: "none",
    reentrant: true,
}

puncta_sdk::register!(ReadTrackMate);
