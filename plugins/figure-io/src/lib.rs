//! Writes figures as SVG and PNG.

puncta_sdk::plugin! {
    id: "puncta.figure_io",
    title: "Figure files",
    description: "Writes figures as SVG and PNG.",
    isolation: "none",
    reentrant: true
}
