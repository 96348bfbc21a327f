//! Clusters of localisations and their measures.

puncta_sdk::plugin! {
    id: "puncta.cluster",
    title: "Clusters",
    description: "Clusters of localisations and their measures.",
    isolation: "none",
    reentrant: true
}
