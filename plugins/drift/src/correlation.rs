//! Drift of segments from their correlation: redundant, or with a single reference.

use puncta_sdk::{Failure, Run};

use crate::bins::Bins;
use crate::cloud::{Cloud, hash};
use crate::coarse::{Pattern, segments};
use crate::curve::Interpolation;
use crate::estimate::{Estimate, Trials, combine, note};
use crate::least_entropy::check;

/// What the person may choose.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// Duration of a segment; 20 segments with equal numbers of localisations if None.
    pub segment: Option<f64>,
    /// Largest displacement that is looked for, nm.
    pub reach: f64,
    /// Which pairs are correlated.
    pub pattern: Pattern,
    /// Between the segments.
    pub interpolation: Interpolation,
    /// Seed of the halves and subsets.
    pub seed: u64,
}

/// Most segments: all their pairs are correlated.
const MOST: usize = 300;
/// Segments if nothing is said.
const USUAL: usize = 20;

/// Estimates the drift.
///
/// # Errors
/// When the localisations are too few, the segments too many, or there is no structure that repeats;
/// or cancelled.
pub fn estimate(cloud: &Cloud, settings: &Settings, run: &dyn Run) -> Result<Estimate, Failure> {
    check(cloud)?;
    run.progress(0.0, "correlating segments")?;
    let bins = match settings.segment {
        Some(span) => Bins::by_span(cloud, span, 50.0),
        None => Bins::equal(cloud, USUAL.min(cloud.len() / 50)),
    };
    if bins.len() > MOST {
        let message = format!("{} segments are more than {MOST}", bins.len());
        return Err(Failure::bad_parameter("segment", message).remedy("give a longer segment"));
    }
    let Settings {
        reach,
        pattern,
        seed,
        ..
    } = *settings;
    let drift = |cloud: &Cloud| segments(cloud, &bins, reach, pattern, hash(1, seed), run);
    let whole = drift(cloud)?;
    run.progress(0.4, "correlating halves")?;
    let half = |which| Ok::<_, Failure>(drift(&cloud.half(hash(5, seed), which))?.drift);
    let halves = [half(false)?, half(true)?];
    let trials = Trials {
        whole: whole.drift,
        halves,
    };
    let mut estimate = combine(&bins, trials, cloud.axes, Vec::new());
    let [pairs, used] = whole.pairs.map(|count| count as f64);
    estimate.interpolation = settings.interpolation;
    estimate.notes = vec![
        note("segments", bins.len() as f64, "1", "Segments of time"),
        note(
            "pairs",
            pairs,
            "1",
            "Pairs of segments that were correlated",
        ),
        note(
            "pairs_used",
            used,
            "1",
            "Pairs that showed a peak and agreed with the others",
        ),
        note(
            "residual",
            whole.residual,
            "nm",
            "Root mean square residual of those pairs",
        ),
    ];
    estimate.scale_z(cloud.z_scale);
    Ok(estimate)
}
