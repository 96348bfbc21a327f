//! The whole method of least entropy: coarse start, refinement, two halves, smoothing.

use puncta_sdk::{Failure, Run};

use crate::bins::Bins;
use crate::cloud::{Cloud, hash};
use crate::coarse::{self, Coarse, Pattern};
use crate::curve::Curve;
use crate::entropy::refine;
use crate::estimate::{Estimate, Trials, note};
use crate::steps::Steps;

/// Most localisations that take part in the refinement: more would change the result by less than
/// its error.
const MOST: usize = 500_000;
/// Least localisations of a table.
pub const LEAST: usize = 200;
/// Localisations of a bin: at most, and at least where there are enough for [`BINS`] bins.
const PER_BIN: [f64; 2] = [10_000.0, 100.0];
/// Bins of a small table, and the most of a large one.
const BINS: [f64; 2] = [50.0, 2000.0];

/// What the person may choose.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// Largest displacement between two bins that is looked for, nm.
    pub reach: f64,
    /// Segments of the coarse start.
    pub segments: usize,
    /// Duration of a bin; chosen from the number of localisations if None.
    pub bin: Option<f64>,
    /// Seed of the halves and subsets.
    pub seed: u64,
}

/// Bins for a cloud: as long as asked for, or with enough localisations to be placed well.
pub fn bins(cloud: &Cloud, bin: Option<f64>) -> Bins {
    match bin {
        Some(span) => Bins::by_span(cloud, span, 1.0),
        None => {
            let count = cloud.len() as f64;
            let target = (count / BINS[0]).clamp(PER_BIN[1], PER_BIN[0]);
            Bins::by_count(cloud, target.max(count / BINS[1]))
        }
    }
}

/// Refuses a cloud that is too small.
///
/// # Errors
/// A sentence for the person.
pub fn check(cloud: &Cloud) -> Result<(), Failure> {
    let (count, times) = (cloud.len(), cloud.times.len());
    if count < LEAST || times < 2 {
        let message = format!(
            "{count} localisations with a position and a time, at {times} different times, are too \
             few to estimate a drift"
        );
        let remedy = format!("give at least {LEAST} over several frames, or use fiducials");
        return Err(Failure::bad_input(message).remedy(remedy));
    }
    Ok(())
}

/// Estimates the drift.
///
/// # Errors
/// When the localisations are too few or show no structure that repeats; or cancelled.
pub fn estimate(
    cloud: &Cloud,
    settings: &Settings,
    steps: &Steps,
    run: &dyn Run,
) -> Result<Estimate, Failure> {
    check(cloud)?;
    let mut start = None;
    let mut estimate = steps.estimate(cloud, run, |breaks| {
        let (bins, trials, coarse) = trials(cloud, settings, breaks, run)?;
        start = Some(coarse);
        Ok((bins, trials))
    })?;
    let bins = estimate.curve.times.len() as f64;
    let meaning = "Bins of time whose drift was estimated";
    estimate.notes = vec![note("bins", bins, "1", meaning)];
    if let Some(start) = start {
        let segments = start.drift.len() as f64;
        let meaning = "Segments of the coarse start";
        estimate
            .notes
            .push(note("segments", segments, "1", meaning));
        estimate.notes.extend(start.notes());
    }
    estimate.scale_z(cloud.z_scale);
    Ok(estimate)
}

/// The drift of bins that end at the breaks, from all localisations and from both halves, and the
/// coarse start.
fn trials(
    cloud: &Cloud,
    settings: &Settings,
    breaks: &[f64],
    run: &dyn Run,
) -> Result<(Bins, Trials, Coarse), Failure> {
    let Settings { reach, seed, .. } = *settings;
    run.progress(0.0, "correlating segments")?;
    let segments = settings.segments.min(cloud.len() / 50).max(3);
    let parts = Bins::equal(cloud, segments).cut(cloud, breaks);
    let start = coarse::segments(cloud, &parts, reach, Pattern::All, hash(1, seed), run)?;
    let curve = Curve {
        times: parts.centre,
        values: start.drift.clone(),
        breaks: breaks.to_vec(),
    };
    let bins = bins(cloud, settings.bin).cut(cloud, breaks);
    run.progress(0.0, "placing bins")?;
    let drift = coarse::bins(cloud, &bins, &curve, reach, hash(2, seed), run)?;
    let refine = |cloud: &Cloud| refine(cloud, &bins.of_frame, &drift, MOST, hash(4, seed), run);
    let cloud = &cloud.thinned(MOST, hash(3, seed));
    let whole = refine(cloud)?;
    let half = |which| refine(&cloud.half(hash(5, seed), which));
    let halves = [half(false)?, half(true)?];
    Ok((bins, Trials { whole, halves }, start))
}
