//! Localisation precision, photon and frame statistics.

puncta_sdk::plugin! {
    id: "puncta.precision",
    title: "Precision",
    description: "Localisation precision, photon and frame statistics.",
    isolation: "none",
    reentrant: true
}
