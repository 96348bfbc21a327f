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
use crate::estimate::{Estimate, Trials, combine, note};
use crate::least_entropy::check;

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
    /// Shift of a segment against the reference, nm.
    fn shift(
        &self,
        cells: &[([i64; 3], u32)],
        reference: &Counts,
        own: bool,
        run: &dyn Run,
    ) -> [f64; 3] {
        let length = 2 * self.side + 1;
        let span = |axis: usize| if self.axes[axis] { length } else { 1 };
        let count = (span(0) * span(1) * span(2)) as usize;
        let of = |index: usize| -> [i64; 3] {
            let index = index as i64;
            let k = [
                index % span(0),
                index / span(0) % span(1),
                index / span(0) / span(1),
            ];
            std::array::from_fn(|axis| k[axis] - span(axis) / 2)
        };
        let mine: Counts = match own {
            true => cells.iter().map(|(cell, n)| (key(*cell), *n)).collect(),
            false => Counts::default(),
        };
        let common = map(run, count, &|index| {
            let shift = of(index);
            let both = |(cell, n): &([i64; 3], u32)| {
                let key = key(std::array::from_fn(|axis| cell[axis] - shift[axis]));
                let held = reference.get(&key).copied().unwrap_or(0);
                let other = held - mine.get(&key).copied().unwrap_or(0).min(held);
                u64::from(other.min(*n))
            };
            cells.iter().map(both).sum::<u64>()
        });
        std::array::from_fn(|axis| {
            if !self.axes[axis] {
                return 0.0;
            }
            let (mut re, mut im) = (0.0, 0.0);
            for (index, common) in common.iter().enumerate() {
                let angle = TAU * of(index)[axis] as f64 / length as f64;
                re += *common as f64 * angle.cos();
                im += *common as f64 * angle.sin();
            }
            im.atan2(re) / TAU * length as f64 * self.cell
        })
    }
}

/// Both passes over the segments along the axes of a search.
fn track(
    parts: &[Vec<[f32; 3]>],
    drift: &mut [[f64; 3]],
    search: &Search,
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
        let start: [f64; 3] = std::array::from_fn(|axis| drift[k][axis] + last[axis]);
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
    run: &dyn Run,
) -> Result<Vec<[f64; 3]>, Failure> {
    let mut parts: Vec<Vec<[f32; 3]>> = vec![Vec::new(); bins.len()];
    for (at, bin) in cloud.at.iter().zip(bins.of(cloud)) {
        parts[bin as usize].push(*at);
    }
    let mut drift = vec![[0.0; 3]; bins.len()];
    let side = (settings.reach / settings.cell).round().max(1.0) as i64;
    // In the x y plane first: cells are columns along z.
    let flat = |p: &[f32; 3]| [p[0], p[1], 0.0];
    let columns: Vec<Vec<_>> = parts.iter().map(|p| p.iter().map(flat).collect()).collect();
    let search = |axes| Search {
        axes,
        side,
        cell: settings.cell,
    };
    track(&columns, &mut drift, &search([true, true, false]), run)?;
    if cloud.axes == 3 {
        track(&parts, &mut drift, &search([false, false, true]), run)?;
    }
    Ok(drift)
}

/// Estimates the drift.
///
/// # Errors
/// When the localisations are too few; or cancelled.
pub fn estimate(cloud: &Cloud, settings: &Settings, run: &dyn Run) -> Result<Estimate, Failure> {
    check(cloud)?;
    let bins = match settings.segment {
        Some(span) => Bins::by_span(cloud, span, 10.0),
        None => Bins::equal(cloud, USUAL.min(cloud.len() / 20)),
    };
    let whole = drift(cloud, &bins, settings, run)?;
    let half = |which| {
        drift(
            &cloud.half(hash(5, settings.seed), which),
            &bins,
            settings,
            run,
        )
    };
    let halves = [half(false)?, half(true)?];
    let mut estimate = combine(&bins, Trials { whole, halves }, cloud.axes, Vec::new());
    estimate.notes = vec![note("segments", bins.len() as f64, "1", "Segments of time")];
    estimate.scale_z(cloud.z_scale);
    Ok(estimate)
}
