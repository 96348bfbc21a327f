//! A coarse drift without a start: redundant correlation of long segments, then each short bin
//! against everything else.

use puncta_sdk::{Failure, Run};

use crate::bins::Bins;
use crate::cloud::Cloud;
use crate::curve::{Curve, Interpolation};
use crate::displacement::{Layout, Peak, histograms, peak, thin};
use crate::estimate::{Note, note};
use crate::network::{Link, Solution, solve};

/// Least score of a peak that is believed.
const LEAST_SCORE: f64 = 6.0;
/// Side of the cells of displacement, in standard deviations of a localisation.
const CELL: f64 = 2.0;
/// A bin that fits better this many cells away has jumped; nearer ones keep the smooth start.
const JUMP: f64 = 2.0;

/// Which pairs of segments are correlated.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pattern {
    /// All of them, redundantly.
    All,
    /// Each with the first.
    First,
}

/// A drift of segments.
#[derive(Clone, Debug)]
pub struct Coarse {
    /// Drift of each segment.
    pub drift: Vec<[f64; 3]>,
    /// Pairs of segments, and how many of them showed a peak and agreed.
    pub pairs: [usize; 2],
    /// Root mean square of the residuals of the pairs that agreed, nm.
    pub residual: f64,
}

impl Coarse {
    /// For the report: how many pairs there were, and how many agreed.
    pub fn notes(&self) -> [Note; 2] {
        let [pairs, used] = self.pairs.map(|count| count as f64);
        let meaning = "Pairs that showed a peak and agreed with the others";
        [
            note(
                "pairs",
                pairs,
                "1",
                "Pairs of segments that were correlated",
            ),
            note("pairs_used", used, "1", meaning),
        ]
    }
}

/// Drift between segments, from the displacements up to `reach` nm.
///
/// # Errors
/// When the localisations are too few or show no structure that repeats; or cancelled.
pub fn segments(
    cloud: &Cloud,
    bins: &Bins,
    reach: f64,
    pattern: Pattern,
    seed: u64,
    run: &dyn Run,
) -> Result<Coarse, Failure> {
    let few = thin(cloud, reach as f32, seed);
    let group = bins.of(&few);
    let n = bins.len();
    let layout = Layout::lateral(reach, CELL * cloud.sigma);
    let solution = correlate(&few.at, &group, n, &layout, pattern, run)?;
    let mut drift = solution.positions;
    if cloud.axes == 3 {
        let at = moved(&few, &group, &drift);
        let layout = Layout::axial(reach / cloud.z_scale, CELL * cloud.sigma, 5.0 * cloud.sigma);
        let axial = correlate(&at, &group, n, &layout, pattern, run)?;
        for (drift, z) in drift.iter_mut().zip(axial.positions) {
            drift[2] = z[2];
        }
    }
    let all = match pattern {
        Pattern::All => n * (n - 1) / 2,
        Pattern::First => n - 1,
    };
    Ok(Coarse {
        drift,
        pairs: [all, solution.used],
        residual: solution.residual,
    })
}

/// All pairs of groups: peaks of their displacements, then the robust network.
fn correlate(
    at: &[[f32; 3]],
    group: &[u32],
    n: usize,
    layout: &Layout,
    pattern: Pattern,
    run: &dyn Run,
) -> Result<Solution, Failure> {
    if n < 2 {
        return Err(too_few());
    }
    let place = |a: usize, b: usize| b * (b - 1) / 2 + a;
    let slot = |i: u32, j: u32| (j < i).then(|| place(j as usize, i as usize));
    let counts = histograms(at, group, layout, n * (n - 1) / 2, slot, run)?;
    let mut links = Vec::new();
    for b in 1..n {
        for a in 0..b {
            let counts = &counts[place(a, b) * layout.cells()..][..layout.cells()];
            let peak = peak(counts, layout);
            if peak.score >= LEAST_SCORE && (pattern == Pattern::All || a == 0) {
                links.push(Link {
                    from: a,
                    to: b,
                    shift: peak.shift,
                    weight: peak.score,
                });
            }
        }
    }
    let cell = layout
        .cell
        .iter()
        .fold(f32::INFINITY, |low, cell| low.min(*cell));
    solve(n, &links, 1.5 * f64::from(cell)).ok_or_else(no_structure)
}

fn too_few() -> Failure {
    Failure::bad_input("the localisations are too few, or of too few frames, to show a drift")
        .remedy("give a longer series, or correct with fiducials")
}

fn no_structure() -> Failure {
    Failure::bad_input("the localisations show no structure that repeats in time")
        .remedy("give more localisations, a larger reach, or correct with fiducials")
}

/// Positions with the drift of each group taken off.
pub fn moved(cloud: &Cloud, group: &[u32], drift: &[[f64; 3]]) -> Vec<[f32; 3]> {
    let moved = |(p, group): (&[f32; 3], &u32)| {
        let d = drift[*group as usize];
        [p[0] - d[0] as f32, p[1] - d[1] as f32, p[2] - d[2] as f32]
    };
    cloud.at.iter().zip(group).map(moved).collect()
}

/// Drift of each bin: that of the coarse curve, or the place where the bin fits better onto all the
/// others, such as after a jump.
///
/// # Errors
/// When cancelled.
pub fn bins(
    cloud: &Cloud,
    bins: &Bins,
    coarse: &Curve,
    reach: f64,
    seed: u64,
    run: &dyn Run,
) -> Result<Vec<[f64; 3]>, Failure> {
    let mut drift = coarse.at(&bins.centre, Interpolation::Linear);
    let few = thin(cloud, reach as f32, seed);
    let group = bins.of(&few);
    let lateral = Layout::lateral(reach, CELL * cloud.sigma);
    relocate(&few, &group, &lateral, &mut drift, run)?;
    if cloud.axes == 3 {
        let reach = reach / cloud.z_scale;
        let axial = Layout::axial(reach, CELL * cloud.sigma, 5.0 * cloud.sigma);
        relocate(&few, &group, &axial, &mut drift, run)?;
    }
    Ok(drift)
}

/// Moves each group to the peak of its displacements from all others, where it has a clear one.
fn relocate(
    few: &Cloud,
    group: &[u32],
    layout: &Layout,
    drift: &mut [[f64; 3]],
    run: &dyn Run,
) -> Result<(), Failure> {
    let at = moved(few, group, drift);
    let slot = |i: u32, j: u32| (i != j).then_some(i as usize);
    let counts = histograms(&at, group, layout, drift.len(), slot, run)?;
    for (drift, counts) in drift.iter_mut().zip(counts.chunks(layout.cells())) {
        let found: Peak = peak(counts, layout);
        let far = (0..3).any(|k| found.shift[k].abs() > JUMP * f64::from(layout.cell[k]));
        if found.score >= LEAST_SCORE && far {
            for (value, shift) in drift.iter_mut().zip(found.shift) {
                *value += shift;
            }
        }
    }
    Ok(())
}
