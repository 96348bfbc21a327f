//! Fourier ring and shell correlation, and decorrelation.

puncta_sdk::plugin! {
    id: "puncta.frc",
    title: "Resolution",
    description: "Fourier ring and shell correlation, and decorrelation.",
    isolation: "none",
    reentrant: true
}
