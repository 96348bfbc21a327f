//! Adaptive intersection (Ma et al., Science Advances 2024): the shift of a segment is where its
//! cells and those of a reference have most localisations in common.
//!
//! For each shift by whole cells within the region of search the intersection is the sum over cells
//! of min(reference, segment); the place of its maximum within a cell follows from the phase of the
//! first Fourier harmonic. In the first pass the reference is all that came before, in the second
//! everything but the segment itself.

use std::collections::HashMap;
use std::f64::consts::TAU;
use std::hash::{BuildHasherDefault, Hasher};

use puncta_sdk::run::map;
use puncta_sdk::{Failure, Run};

use crate::bins::Bins;
use crate::cloud::{Cloud, hash};
use crate::estimate::{Estimate, Trials, note};
use crate::least_entropy::check;
use crate::steps::Steps;

/// What the person may choose.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// Duration of a segment; 100 with equal numbers of localisations if None.
    pub segment: Option<f64>,
    /// Side of a cell, nm.
    pub cell: f64,
    /// Largest shift between a segment and the one before, nm.
    pub reach: f64,
    /// Seed of the halves.
    pub seed: u64,
}

/// Segments if nothing is said.
const USUAL: usize = 100;
/// Largest shift at a step that is looked for, nm.
const STEP: f64 = 500.0;

#[derive(Default)]
struct Mix(u64);

impl Hasher for Mix {
    fn finish(&self) -> u64 {
        self.0
    }
    fn write(&mut self, _: &[u8]) {}
    fn write_u64(&mut self, key: u64) {
        self.0 = hash(key, 0);
    }
}

/// Number of localisations of each cell.
type Counts = HashMap<u64, u32, BuildHasherDefault<Mix>>;

/// 21 bits for each axis: cells that are further apart than 2 million wrap, which costs a chance
/// match at most.
fn key(cell: [i64; 3]) -> u64 {
    cell.iter()
        .fold(0, |key, c| (key << 21) | (*c as u64 & 0x1F_FFFF))
}

/// A segment's localisations, and its cells at a drift.
fn cells(at: &[[f32; 3]], drift: [f64; 3], cell: f64) -> Vec<([i64; 3], u32)> {
    let place = |p: &[f32; 3]| -> [i64; 3] {
        std::array::from_fn(|k| ((f64::from(p[k]) - drift[k]) / cell).round() as i64)
    };
    let mut all: Vec<[i64; 3]> = at.iter().map(place).collect();
    all.sort_unstable();
    let same = all.chunk_by(|a, b| a == b);
    same.map(|group| (group[0], group.len() as u32)).collect()
}

/// Which axes a pass moves along, and by how many cells to each side.
#[derive(Clone, Copy)]
struct Search {
    axes: [bool; 3],
    side: i64,
    cell: f64,
}

impl Search {
    fn new(axes: [bool; 3], reach: f64, cell: f64) -> Self {
        let side = (reach / cell).round().max(1.0) as i64;
        Self { axes, side, cell }
    }

    /// Number of shifts along an axis.
    fn span(&self, axis: usize) -> i64 {
        if self.axes[axis] {
            2 * self.side + 1
        } else {
            1
        }
    }

    /// The shift with a number, in cells.
    fn of(&self, index: usize) -> [i64; 3] {
        let index = index as i64;
        let [x, y] = [0, 1].map(|axis| self.span(axis));
        let k = [index % x, index / x % y, index / x / y];
        std::array::from_fn(|axis| k[axis] - self.span(axis) / 2)
    }

    /// The intersection for each shift; less what the segment itself gives the reference, if it is
    /// part of that.
    fn common(
        &self,
        cells: &[([i64; 3], u32)],
        reference: &Counts,
        own: bool,
        run: &dyn Run,
    ) -> Vec<u64> {
        let count = (0..3).map(|axis| self.span(axis)).product::<i64>() as usize;
        let mine: Counts = match own {
            true => cells.iter().map(|(cell, n)| (key(*cell), *n)).collect(),
            false => Counts::default(),
        };
        map(run, count, &|index| {
            let shift = self.of(index);
            let both = |(cell, n): &([i64; 3], u32)| {
                let key = key(std::array::from_fn(|axis| cell[axis] - shift[axis]));
                let held = reference.get(&key).copied().unwrap_or(0);
                let other = held - mine.get(&key).copied().unwrap_or(0).min(held);
                u64::from(other.min(*n))
            };
            cells.iter().map(both).sum::<u64>()
        })
    }

    /// Shift of a segment against the reference from the phase of the first harmonic, nm.
    fn shift(
        &self,
        cells: &[([i64; 3], u32)],
        reference: &Counts,
        own: bool,
        run: &dyn Run,
    ) -> [f64; 3] {
        let common = self.common(cells, reference, own, run);
        std::array::from_fn(|axis| {
            if !self.axes[axis] {
                return 0.0;
            }
            let length = self.span(axis) as f64;
            let (mut re, mut im) = (0.0, 0.0);
            for (index, common) in common.iter().enumerate() {
                let angle = TAU * self.of(index)[axis] as f64 / length;
                re += *common as f64 * angle.cos();
                im += *common as f64 * angle.sin();
            }
            im.atan2(re) / TAU * length * self.cell
        })
    }

    /// The shift about which the intersection with the neighbouring shifts is largest, nm: coarse,
    /// but without the pull of what lies far from it.
    fn peak(&self, cells: &[([i64; 3], u32)], reference: &Counts, run: &dyn Run) -> [f64; 3] {
        let mut sums = self.common(cells, reference, false, run);
        let mut stride = 1;
        for axis in 0..3 {
            let span = self.span(axis) as usize;
            let line = sums.clone();
            for (index, sum) in sums.iter_mut().enumerate() {
                let k = index / stride % span;
                *sum += if k > 0 { line[index - stride] } else { 0 };
                *sum += if k + 1 < span {
                    line[index + stride]
                } else {
                    0
                };
            }
            stride *= span;
        }
        let best = (0..sums.len()).max_by_key(|index| (sums[*index], sums.len() - index));
        best.map_or([0.0; 3], |index| {
            self.of(index).map(|k| k as f64 * self.cell)
        })
    }
}

/// Both passes over the segments along the axes of a search. Segments in `after` follow a step, and
/// are looked for farther away first.
fn track(
    parts: &[Vec<[f32; 3]>],
    drift: &mut [[f64; 3]],
    search: &Search,
    after: &[usize],
    run: &dyn Run,
) -> Result<(), Failure> {
    let add = |counts: &mut Counts, cells: &[([i64; 3], u32)]| {
        for (cell, n) in cells {
            *counts.entry(key(*cell)).or_default() += n;
        }
    };
    let mut reference = Counts::default();
    let mut last = [0.0; 3];
    for (k, part) in parts.iter().enumerate() {
        run.progress(0.5 * k as f64 / parts.len() as f64, "intersecting segments")?;
        let mut start: [f64; 3] = std::array::from_fn(|axis| drift[k][axis] + last[axis]);
        if after.contains(&k) {
            let reach = STEP.max(search.side as f64 * search.cell);
            let far = Search::new(search.axes, reach, search.cell);
            let shift = far.peak(&cells(part, start, far.cell), &reference, run);
            (0..3).for_each(|axis| last[axis] += shift[axis]);
            (0..3).for_each(|axis| start[axis] += shift[axis]);
        }
        let shift = search.shift(&cells(part, start, search.cell), &reference, false, run);
        if k > 0 {
            (0..3).for_each(|axis| last[axis] += shift[axis]);
        }
        (0..3).for_each(|axis| drift[k][axis] += last[axis]);
        add(&mut reference, &cells(part, drift[k], search.cell));
    }
    for (k, part) in parts.iter().enumerate() {
        run.progress(
            0.5 + 0.5 * k as f64 / parts.len() as f64,
            "intersecting segments",
        )?;
        let own = cells(part, drift[k], search.cell);
        let shift = search.shift(&own, &reference, true, run);
        (0..3).for_each(|axis| drift[k][axis] += shift[axis]);
    }
    Ok(())
}

fn drift(
    cloud: &Cloud,
    bins: &Bins,
    settings: &Settings,
    breaks: &[f64],
    run: &dyn Run,
) -> Result<Vec<[f64; 3]>, Failure> {
    let mut parts: Vec<Vec<[f32; 3]>> = vec![Vec::new(); bins.len()];
    for (at, bin) in cloud.at.iter().zip(bins.of(cloud)) {
        parts[bin as usize].push(*at);
    }
    let mut drift = vec![[0.0; 3]; bins.len()];
    let pieces = crate::curve::pieces(&bins.centre, breaks);
    let after: Vec<usize> = pieces.iter().skip(1).map(|piece| piece.start).collect();
    // In the x y plane first: cells are columns along z.
    let flat = |p: &[f32; 3]| [p[0], p[1], 0.0];
    let columns: Vec<Vec<_>> = parts.iter().map(|p| p.iter().map(flat).collect()).collect();
    let search = |axes| Search::new(axes, settings.reach, settings.cell);
    track(
        &columns,
        &mut drift,
        &search([true, true, false]),
        &after,
        run,
    )?;
    if cloud.axes == 3 {
        track(
            &parts,
            &mut drift,
            &search([false, false, true]),
            &after,
            run,
        )?;
    }
    Ok(drift)
}

/// Estimates the drift.
///
/// # Errors
/// When the localisations are too few; or cancelled.
pub fn estimate(
    cloud: &Cloud,
    settings: &Settings,
    steps: &Steps,
    run: &dyn Run,
) -> Result<Estimate, Failure> {
    check(cloud)?;
    let mut estimate = steps.estimate(cloud, run, |breaks| {
        let bins = match settings.segment {
            Some(span) => Bins::by_span(cloud, span, 10.0),
            None => Bins::equal(cloud, USUAL.min(cloud.len() / 20)),
        };
        let bins = bins.cut(cloud, breaks);
        let drift = |cloud: &Cloud| drift(cloud, &bins, settings, breaks, run);
        let half = |which| drift(&cloud.half(hash(5, settings.seed), which));
        let (whole, halves) = (drift(cloud)?, [half(false)?, half(true)?]);
        Ok((bins, Trials { whole, halves }))
    })?;
    let segments = estimate.curve.times.len() as f64;
    estimate.notes = vec![note("segments", segments, "1", "Segments of time")];
    estimate.scale_z(cloud.z_scale);
    Ok(estimate)
}
