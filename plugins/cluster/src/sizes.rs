//! The histogram of the sizes of clusters.

use puncta_sdk::{Figure, Series};

/// Bars for each factor of two.
const PER_OCTAVE: f64 = 2.0;

/// A histogram of sizes in steps of the square root of two.
#[must_use]
pub fn figure(sizes: &[u64], caption: &str) -> Figure {
    let bar = |size: u64| ((size.max(1) as f64).log2() * PER_OCTAVE).floor();
    let most = sizes.iter().map(|size| bar(*size)).fold(0.0, f64::max);
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
    let mut counts = vec![0.0; most as usize + 1];
    for size in sizes {
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
        let at = bar(*size) as usize;
        counts[at] += 1.0;
    }
    // Small sizes leave some steps without a whole number: such bars are no part of the figure.
    let edge = |at: usize| (at as f64 / PER_OCTAVE).exp2();
    let whole = |at: &usize| (edge(at + 1) - 1e-9).floor() >= (edge(*at) - 1e-9).ceil();
    let bars: Vec<usize> = (0..counts.len()).filter(whole).collect();
    let centres: Vec<f64> = bars
        .iter()
        .map(|at| edge(*at) * 2_f64.powf(0.5 / PER_OCTAVE))
        .collect();
    let heights: Vec<f64> = bars.iter().map(|at| counts[*at]).collect();
    let mut figure = Figure::new(
        "figure",
        "Sizes of clusters",
        ["localisations of the cluster", "1"],
        ["clusters", "1"],
    )
    .with(Series::numbers("clusters", "bars", &centres, &heights));
    figure.logarithmic = "x".into();
    figure.caption = format!("{} clusters; {caption}.", sizes.len());
    figure
}
