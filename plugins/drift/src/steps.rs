//! Sudden steps of the sample, between which a drift is smooth.
//!
//! A step shows where the bins about a bin are fitted by a cubic with a step, and the step is much
//! larger than the scatter of neighbouring bins explains. Its time within the bins is the most likely
//! one: each localisation is compared with the density of all those that lie farther off in time, once
//! with the drift before and once with that after. A steep but steady drift does not pass for a step,
//! because it must also be more likely than a ramp.

use std::ops::Range;

use puncta_sdk::prelude::*;

use crate::bins::Bins;
use crate::cloud::{Cloud, hash};
use crate::curve::pieces;
use crate::displacement::MOST_POINTS;
use crate::estimate::{Estimate, Trials, combine};
use crate::grid::Grid;

/// Bins on each side that are looked at.
const SIDE: usize = 5;
/// And at least.
const LEAST_SIDE: usize = 3;
/// Size of a step in its standard deviations that is looked into.
const SCORE: f64 = 6.0;
/// Least step that matters, in standard deviations of a localisation.
const LEAST: f64 = 0.3;
/// By how much a step must be more likely than a ramp: natural logarithm.
const GAIN: f64 = 12.0;
/// Reach of the density, in standard deviations of a localisation.
const KERNEL: f64 = 5.0;
/// Searches for further steps.
const ROUNDS: usize = 4;

/// Steps that are known, and whether others are looked for.
#[derive(Params)]
pub struct Steps {
    /// Times of known sudden steps, in the unit of t: each is the first time after a step.
    #[param(default = [], advanced)]
    pub breaks: Vec<f64>,
    /// Look for sudden steps, which are not smoothed.
    #[param(default = true, advanced)]
    pub find_breaks: bool,
}

impl Default for Steps {
    fn default() -> Self {
        Self {
            breaks: Vec::new(),
            find_breaks: true,
        }
    }
}

impl Steps {
    /// The known steps, increasing.
    ///
    /// # Errors
    /// When one is not a number.
    pub fn known(&self) -> Result<Vec<f64>, Failure> {
        if let Some(time) = self.breaks.iter().find(|time| !time.is_finite()) {
            let message = format!("{time} is not a time of a step");
            return Err(Failure::bad_parameter("breaks", message).remedy("give finite numbers"));
        }
        let mut breaks = self.breaks.clone();
        breaks.sort_unstable_by(f64::total_cmp);
        breaks.dedup();
        Ok(breaks)
    }

    /// Estimates with the steps that are known; where the result shows others, again with these.
    /// `trials` estimates the drift of bins between steps.
    ///
    /// # Errors
    /// Those of `trials`, and when a known step is not a number or cancelled.
    pub fn estimate(
        &self,
        cloud: &Cloud,
        run: &dyn Run,
        mut trials: impl FnMut(&[f64]) -> Result<(Bins, Trials), Failure>,
    ) -> Result<Estimate, Failure> {
        let mut breaks = self.known()?;
        let mut last = trials(&breaks)?;
        if self.find_breaks {
            for _ in 0..ROUNDS {
                let found = find(cloud, &last.0, &last.1.whole, &breaks, run)?;
                if found.is_empty() {
                    break;
                }
                let mut more = breaks.clone();
                more.extend(found);
                more.sort_unstable_by(f64::total_cmp);
                // A piece between steps may be too short to be placed: then they stay in the curve.
                match trials(&more) {
                    Ok(next) => (breaks, last) = (more, next),
                    Err(failure) if failure.is_cancelled() => return Err(failure),
                    Err(_) => break,
                }
            }
        }
        let (bins, trials) = last;
        Ok(combine(&bins, trials, cloud.axes, breaks))
    }
}

/// A node that may hold a step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Candidate {
    /// The node.
    pub node: usize,
    /// Size of the step in its standard deviations, along the axis where that is largest.
    pub score: f64,
    /// The drift about the node.
    pub model: Model,
}

/// A drift that is a cubic of time with a step: 1, u, u^2, u^3 and the step, u from the time of the
/// step in units of `span`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Model {
    time: f64,
    span: f64,
    terms: [[f64; 3]; 5],
    /// Variance of the step for nodes of variance 1.
    variance: f64,
}

impl Model {
    /// The least squares fit to nodes, with a step at `time`; None where they do not determine it.
    fn fit(times: &[f64], values: &[[f64; 3]], time: f64) -> Option<Self> {
        let span = (times.last()? - times.first()?).max(f64::MIN_POSITIVE);
        // Normal equations, the three axes, and the inverse's last column.
        let mut rows = [[0.0; 9]; 5];
        rows[4][8] = 1.0;
        for (t, value) in times.iter().zip(values) {
            let basis = basis((t - time) / span);
            for (row, own) in rows.iter_mut().zip(basis) {
                for (slot, other) in row.iter_mut().zip(basis.iter().chain(value)) {
                    *slot += own * other;
                }
            }
        }
        for pivot in 0..5 {
            let own = rows[pivot];
            if own[pivot].is_nan() || own[pivot].abs() <= 1e-12 {
                return None;
            }
            for (_, row) in rows.iter_mut().enumerate().filter(|(k, _)| *k != pivot) {
                let factor = row[pivot] / own[pivot];
                row.iter_mut()
                    .zip(own)
                    .for_each(|(slot, own)| *slot -= factor * own);
            }
        }
        let solved = |row: usize, column: usize| rows[row][column] / rows[row][row];
        Some(Self {
            time,
            span,
            terms: std::array::from_fn(|row| std::array::from_fn(|axis| solved(row, 5 + axis))),
            variance: solved(4, 8).max(0.0),
        })
    }

    /// The step.
    pub fn step(&self) -> [f64; 3] {
        self.terms[4]
    }

    /// The drift at a time, with a share of the step.
    fn at(&self, time: f64, share: f64) -> [f64; 3] {
        let mut basis = basis((time - self.time) / self.span);
        basis[4] = share;
        std::array::from_fn(|axis| basis.iter().zip(self.terms).map(|(b, t)| b * t[axis]).sum())
    }

    /// Sum of squared residuals of nodes.
    fn rest(&self, times: &[f64], values: &[[f64; 3]]) -> f64 {
        let square = |(t, value): (&f64, &[f64; 3])| {
            let at = self.at(*t, if *t < self.time { 0.0 } else { 1.0 });
            (0..3).map(|k| (value[k] - at[k]).powi(2)).sum::<f64>()
        };
        times.iter().zip(values).map(square).sum()
    }
}

fn basis(u: f64) -> [f64; 5] {
    [1.0, u, u * u, u * u * u, if u < 0.0 { 0.0 } else { 1.0 }]
}

/// Standard deviation of nodes about their neighbours, from the median second difference.
fn scatter(values: &[[f64; 3]], pieces: &[Range<usize>], axis: usize) -> f64 {
    let bend = |w: &[[f64; 3]]| (w[2][axis] - 2.0 * w[1][axis] + w[0][axis]).abs();
    let mut bends: Vec<f64> = pieces
        .iter()
        .flat_map(|piece| values[piece.clone()].windows(3).map(bend))
        .collect();
    if bends.is_empty() {
        return f64::INFINITY;
    }
    let middle = bends.len() / 2;
    // The median of |N(0, 1)| is 0.6745, and a second difference has six times the variance.
    *bends.select_nth_unstable_by(middle, f64::total_cmp).1 / 0.6745 / 6f64.sqrt()
}

/// Nodes at which the drift steps, the clearest of those that lie closer than `side`; up to `side`
/// nodes on each side are looked at. Along an axis a step below `least` does not count. `skip`: the
/// node itself belongs to neither side; else it is the first on the right.
pub fn candidates(
    times: &[f64],
    values: &[[f64; 3]],
    breaks: &[f64],
    side: usize,
    least: f64,
    skip: bool,
) -> Vec<Candidate> {
    let pieces = pieces(times, breaks);
    let noise: [f64; 3] = std::array::from_fn(|axis| scatter(values, &pieces, axis));
    let mut all: Vec<Candidate> = Vec::new();
    for piece in pieces {
        for node in piece.clone() {
            let before = node.saturating_sub(side).max(piece.start)..node;
            let after = node + usize::from(skip)..(node + side + usize::from(skip)).min(piece.end);
            if before.len() < LEAST_SIDE || after.len() < LEAST_SIDE {
                continue;
            }
            let sides = || before.clone().chain(after.clone());
            let near: Vec<f64> = sides().map(|i| times[i]).collect();
            let drift: Vec<[f64; 3]> = sides().map(|i| values[i]).collect();
            let time = match skip {
                true => times[node],
                false => f64::midpoint(times[node - 1], times[node]),
            };
            let Some(model) = Model::fit(&near, &drift, time) else {
                continue;
            };
            let score = (0..3).fold(0.0, |score: f64, axis| {
                let step = model.step()[axis].abs();
                let error = noise[axis] * model.variance.sqrt();
                let own = step / error.max(f64::MIN_POSITIVE);
                if step > least { score.max(own) } else { score }
            });
            if score >= SCORE {
                all.push(Candidate { node, score, model });
            }
        }
    }
    all.sort_by(|a, b| b.score.total_cmp(&a.score).then(a.node.cmp(&b.node)));
    let mut kept: Vec<Candidate> = Vec::new();
    for candidate in all {
        if kept.iter().all(|k| k.node.abs_diff(candidate.node) > side) {
            kept.push(candidate);
        }
    }
    kept
}

/// Times of the steps that nodes show which are each a single time: where a model with a step
/// leaves least.
pub fn sudden(times: &[f64], values: &[[f64; 3]], side: usize, least: f64) -> Vec<f64> {
    let time = |candidate: &Candidate| {
        let node = candidate.node;
        let window = node.saturating_sub(side)..(node + side).min(times.len());
        let (near, drift) = (&times[window.clone()], &values[window.clone()]);
        let rests = (1..near.len()).filter_map(|first| {
            let model = Model::fit(near, drift, f64::midpoint(near[first - 1], near[first]))?;
            Some((model.rest(near, drift), window.start + first))
        });
        let best = rests.min_by(|a, b| a.0.total_cmp(&b.0));
        times[best.map_or(node, |(_, first)| first)]
    };
    let found = candidates(times, values, &[], side, least, false);
    let mut breaks: Vec<f64> = found.iter().map(time).collect();
    breaks.sort_unstable_by(f64::total_cmp);
    breaks
}

/// Times of the steps that a drift of bins shows, each the first after a step.
fn find(
    cloud: &Cloud,
    bins: &Bins,
    drift: &[[f64; 3]],
    breaks: &[f64],
    run: &dyn Run,
) -> Result<Vec<f64>, Failure> {
    let side = (bins.len() / 5).clamp(LEAST_SIDE, SIDE);
    let least = LEAST * cloud.sigma;
    let found = candidates(&bins.centre, drift, breaks, side, least, true);
    if found.is_empty() {
        return Ok(Vec::new());
    }
    run.progress(0.0, "placing steps")?;
    let density = Density::new(cloud, bins, drift);
    let mut times = Vec::new();
    for candidate in found {
        times.extend(density.step(cloud, bins, &candidate, breaks, run)?);
    }
    Ok(times)
}

/// The corrected localisations, as a density.
struct Density {
    at: Vec<[f32; 3]>,
    bin: Vec<u32>,
    grid: Grid,
    reach: f32,
    sigma: f32,
}

impl Density {
    fn new(cloud: &Cloud, bins: &Bins, drift: &[[f64; 3]]) -> Self {
        let some = cloud.thinned(MOST_POINTS, hash(7, 7));
        let bin = bins.of(&some);
        let at = crate::coarse::moved(&some, &bin, drift);
        let reach = KERNEL * cloud.sigma;
        Self {
            grid: Grid::new(&at, reach as f32),
            at,
            bin,
            reach: reach as f32,
            sigma: cloud.sigma as f32,
        }
    }

    /// Density at a place, of the localisations whose bins are not among `without`.
    fn at(&self, p: [f32; 3], without: &Range<u32>) -> f64 {
        let scale = -0.25 / (self.sigma * self.sigma);
        let mut sum = 0.0;
        for range in self.grid.around(p) {
            for &i in &self.grid.order[range] {
                let q = self.at[i as usize];
                let d = [p[0] - q[0], p[1] - q[1], p[2] - q[2]];
                let square = d[0] * d[0] + d[1] * d[1] + d[2] * d[2];
                if square < self.reach * self.reach && !without.contains(&self.bin[i as usize]) {
                    sum += f64::from((scale * square).exp());
                }
            }
        }
        sum
    }

    /// The most likely time of a step in the bin of a candidate or next to it; None where a ramp
    /// from before to after is about as likely.
    fn step(
        &self,
        cloud: &Cloud,
        bins: &Bins,
        candidate: &Candidate,
        breaks: &[f64],
        run: &dyn Run,
    ) -> Result<Option<f64>, Failure> {
        let node = candidate.node as u32;
        let without = node.saturating_sub(1)..node + 2;
        let first = bins.of_frame.partition_point(|bin| *bin < without.start);
        let end = bins.of_frame.partition_point(|bin| *bin < without.end);
        // A step has frames on both sides, and no other step near it.
        let frames = first..end;
        let time = |frame: usize| cloud.times[frame];
        let within = |t: &f64| *t > time(first) && *t <= time(end - 1);
        if frames.len() < 2 || breaks.iter().any(within) {
            return Ok(None);
        }
        let (begin, last) = (time(first), time(end - 1));
        let [mut left, mut right] = [0, 1].map(|_| vec![0.0; frames.len()]);
        let mut ramp = 0.0;
        let from = cloud
            .frame
            .partition_point(|frame| (*frame as usize) < first);
        let to = cloud.frame.partition_point(|frame| (*frame as usize) < end);
        for (k, (at, frame)) in cloud.at[from..to]
            .iter()
            .zip(&cloud.frame[from..to])
            .enumerate()
        {
            if k % 256 == 0 {
                run.progress(k as f64 / (to - from) as f64, "placing steps")?;
            }
            let t = time(*frame as usize);
            let log = |share: f64| {
                let drift = candidate.model.at(t, share);
                let p = std::array::from_fn(|axis| at[axis] - drift[axis] as f32);
                (1.0 + self.at(p, &without)).ln()
            };
            left[*frame as usize - first] += log(0.0);
            right[*frame as usize - first] += log(1.0);
            ramp += log((t - begin) / (last - begin));
        }
        let mut likely = right.iter().sum::<f64>();
        let mut best = (f64::NEG_INFINITY, 0);
        for k in 1..frames.len() {
            likely += left[k - 1] - right[k - 1];
            if likely > best.0 {
                best = (likely, k);
            }
        }
        Ok((best.0 > ramp + GAIN).then(|| time(first + best.1)))
    }
}

#[cfg(test)]
mod tests;
