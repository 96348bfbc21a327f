//! Estimates and corrects the drift of the sample.

puncta_sdk::plugin! {
    id: "puncta.drift",
    title: "Drift",
    description: "Estimates and corrects the drift of the sample.",
    isolation: "none",
    reentrant: true
}
