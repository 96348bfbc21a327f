//! Chains the repeats of one molecule across frames and merges them.

puncta_sdk::plugin! {
    id: "puncta.chaining",
    title: "Repeats",
    description: "Chains the repeats of one molecule across frames and merges them.",
    isolation: "none",
    reentrant: true
}
