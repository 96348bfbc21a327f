//! Drift of segments from their correlation: redundant, or with a single reference.

use puncta_sdk::{Failure, FailureCode, Run};

use crate::bins::Bins;
use crate::cloud::{Cloud, hash};
use crate::coarse::{Coarse, Pattern, segments};
use crate::curve::Interpolation;
use crate::estimate::{Estimate, Trials, note};
use crate::least_entropy::check;
use crate::steps::Steps;

/// What the person may choose.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// Duration of a segment; up to 20 segments with equal numbers of localisations if None.
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
/// Segments if nothing is said: at most, and at least.
const USUAL: [usize; 2] = [20, 4];
/// Localisations of a segment, where there are enough for the least number of segments.
const CLEAR: usize = 500;

/// Estimates the drift.
///
/// # Errors
/// When the localisations are too few, the segments too many, or there is no structure that repeats;
/// or cancelled.
pub fn estimate(
    cloud: &Cloud,
    settings: &Settings,
    steps: &Steps,
    run: &dyn Run,
) -> Result<Estimate, Failure> {
    check(cloud)?;
    let mut last = None;
    let mut estimate = steps.estimate(cloud, run, |breaks| {
        let (bins, trials, whole) = trials(cloud, settings, breaks, run)?;
        last = Some(whole);
        Ok((bins, trials))
    })?;
    estimate.interpolation = settings.interpolation;
    let segments = estimate.curve.times.len() as f64;
    estimate.notes = vec![note("segments", segments, "1", "Segments of time")];
    if let Some(whole) = last {
        estimate.notes.extend(whole.notes());
        let meaning = "Root mean square residual of those pairs";
        estimate
            .notes
            .push(note("residual", whole.residual, "nm", meaning));
    }
    estimate.scale_z(cloud.z_scale);
    Ok(estimate)
}

/// The drift of segments that end at the breaks, from all localisations and from both halves. Where
/// nothing is said of the segments and they show no structure, fewer and longer ones are taken.
fn trials(
    cloud: &Cloud,
    settings: &Settings,
    breaks: &[f64],
    run: &dyn Run,
) -> Result<(Bins, Trials, Coarse), Failure> {
    let [most, least] = USUAL;
    if let Some(span) = settings.segment {
        let bins = Bins::by_span(cloud, span, 50.0).cut(cloud, breaks);
        if bins.len() > MOST {
            let message = format!("{} segments are more than {MOST}", bins.len());
            return Err(Failure::bad_parameter("segment", message).remedy("give a longer segment"));
        }
        return trial(cloud, settings, bins, run);
    }
    let mut count = (cloud.len() / CLEAR).clamp(least, most);
    loop {
        let bins = Bins::equal(cloud, count).cut(cloud, breaks);
        match trial(cloud, settings, bins, run) {
            Err(failure) if failure.code == FailureCode::BadInput && count > least => {
                count = (count / 2).max(least);
            }
            other => return other,
        }
    }
}

fn trial(
    cloud: &Cloud,
    settings: &Settings,
    bins: Bins,
    run: &dyn Run,
) -> Result<(Bins, Trials, Coarse), Failure> {
    run.progress(0.0, "correlating segments")?;
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
        whole: whole.drift.clone(),
        halves,
    };
    Ok((bins, trials, whole))
}
