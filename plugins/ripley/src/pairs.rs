//! Counting pairs by distance: sorted cells, whole rows of cells at a time.
//!
//! A source cell meets the target cells that a circle about it can reach; the points of a row of
//! cells are contiguous, so that distances and bins are computed for many at once. Pairs beyond the
//! last bin are met only in the cells at the rim.

use crate::bins::Bins;
use pulp::{Arch, Simd, WithSimd};
use puncta_sdk::run::Run;
use puncta_sdk::{Cancelled, Failure};
use puncta_shared_neighbours::Grid;
use std::ops::Range;
use std::sync::{Mutex, PoisonError};

/// Copies of the histogram, so that two increments seldom wait for each other.
const LANES: usize = 4;
/// Targets whose bins are computed at once; they stay in the first cache.
const CHUNK: usize = 256;
/// Candidates between two polls for cancel, some 10 ms.
const POLL: usize = 1 << 21;

/// Edge of the cells for pairs up to a radius among so many points in a box of these sides.
#[must_use]
pub fn cell_edge<const D: usize>(radius: f64, count: usize, sides: &[f64; D]) -> f64 {
    let share = if D == 2 { 6.0 } else { 3.0 };
    let sides = sides.iter().copied().filter(|side| *side > 0.0);
    let (volume, axes) = sides.fold((1.0, 0_i32), |(v, n), side| (v * side, n + 1));
    let crowd = (4.0 * volume / (count.max(1) as f64)).powf(1.0 / f64::from(axes.max(1)));
    (radius / share)
        .max(crowd.min(radius))
        .max(f64::MIN_POSITIVE)
}

/// Points sorted for pairs up to a radius.
///
/// # Errors
/// As [`Grid::new`].
pub fn grid<const D: usize>(
    points: [&[f64]; D],
    radius: f64,
    run: &dyn Run,
) -> Result<Grid<D>, Failure> {
    let sides = points.map(|axis| {
        let ends = axis
            .iter()
            .filter(|x| x.is_finite())
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), x| {
                (low.min(*x), high.max(*x))
            });
        ends.1 - ends.0
    });
    Grid::new(points, cell_edge(radius, points[0].len(), &sides), run)
}

/// The slices of targets that points of a source cell may reach. Both grids have the same edge.
pub(crate) fn reach<const D: usize>(
    target: &Grid<D>,
    cell: [i64; D],
    radius: f64,
    mut visit: impl FnMut(Range<usize>),
) {
    let edge = target.edge();
    let far = cell
        .iter()
        .fold(0.0_f64, |far, c| far.max(c.unsigned_abs() as f64));
    let slack = 1e-9 + far * 1e-14;
    let cells = |length: f64| (length / edge + slack).floor() as i64 + 1;
    let gap = |offset: i64| ((offset.abs() - 1).max(0) as f64 - slack).max(0.0) * edge;
    let most = cells(radius);
    let depth = if D == 3 { most } else { 0 };
    for dz in -depth..=depth {
        for dy in -most..=most {
            let left = radius * radius - gap(dz).powi(2) - gap(dy).powi(2);
            if left < 0.0 {
                continue;
            }
            let dx = cells(left.sqrt());
            let (mut low, mut high) = (cell, cell);
            (low[0], high[0]) = (cell[0] - dx, cell[0] + dx);
            (low[1], high[1]) = (cell[1] + dy, cell[1] + dy);
            if D == 3 {
                (low[D - 1], high[D - 1]) = (cell[D - 1] + dz, cell[D - 1] + dz);
            }
            target.in_cells(low, high, &mut visit);
        }
    }
}

/// Whether the many points of a cell share one place, so that their pairs need no looking at.
pub(crate) fn one_place<const D: usize>(grid: &Grid<D>, cell: &Range<usize>) -> bool {
    let first = |axis: &[f64]| match axis.get(cell.clone()) {
        Some([first, rest @ ..]) => rest.iter().all(|x| x == first),
        _ => false,
    };
    cell.len() > 256 && (0..D).all(|a| first(grid.axis(a)))
}

/// Number of pairs among so many.
pub(crate) fn pairs_among(count: usize) -> u64 {
    let count = count as u64;
    count * count.saturating_sub(1) / 2
}

/// Numbers of pairs in each bin: of the points of one grid, each pair once, or between the points
/// of two grids of the same edge.
///
/// # Errors
/// When cancelled.
pub fn count_pairs<const D: usize>(
    source: &Grid<D>,
    target: Option<&Grid<D>>,
    bins: &Bins,
    run: &dyn Run,
) -> Result<Vec<u64>, Cancelled> {
    let totals = Mutex::new(vec![0_u64; bins.len()]);
    let arch = Arch::new();
    source.map_blocks(run, |block| {
        let mut lanes = vec![0_u64; (bins.len() + 1) * LANES];
        let (mut work, mut stopped) = (0, false);
        for cell in source.cells(block) {
            let other = target.unwrap_or(source);
            let single = target.is_none() && one_place(source, &cell);
            if single {
                lanes[0] += pairs_among(cell.len());
            }
            let place = source.cell_of(cell.start);
            reach(other, place, bins.radius(), |targets| {
                let begin = match target {
                    Some(_) => targets.start,
                    None if single => targets.start.max(cell.end),
                    None => targets.start.max(cell.start),
                };
                let targets = begin..targets.end;
                if targets.is_empty() {
                    return;
                }
                let some = (POLL / targets.len()).max(1);
                for first in cell.clone().step_by(some) {
                    let sources = first..cell.end.min(first + some);
                    work += sources.len() * targets.len();
                    if work > POLL {
                        work = 0;
                        stopped = stopped || run.cancelled();
                    }
                    if stopped {
                        return;
                    }
                    arch.dispatch(Tally {
                        source,
                        cell: sources,
                        target: other,
                        targets: targets.clone(),
                        later: target.is_none(),
                        bins,
                        lanes: &mut lanes,
                    });
                }
            });
        }
        let mut totals = totals.lock().unwrap_or_else(PoisonError::into_inner);
        for (total, lanes) in totals.iter_mut().zip(lanes.chunks(LANES)) {
            *total += lanes.iter().sum::<u64>();
        }
    })?;
    Ok(totals.into_inner().unwrap_or_else(PoisonError::into_inner))
}

/// The pairs of a source cell with a slice of targets.
struct Tally<'a, const D: usize> {
    source: &'a Grid<D>,
    cell: Range<usize>,
    target: &'a Grid<D>,
    targets: Range<usize>,
    /// Only targets behind the source in the sorted order.
    later: bool,
    bins: &'a Bins,
    lanes: &'a mut [u64],
}

impl<const D: usize> WithSimd for Tally<'_, D> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _simd: S) {
        let inverse = 1.0 / self.bins.step();
        let last = self.bins.len() as f64;
        let mut squares = [0.0_f64; CHUNK];
        let mut guesses = [0_u32; CHUNK];
        for i in self.cell.clone() {
            let point = self.source.point(i);
            let begin = if self.later {
                self.targets.start.max(i + 1)
            } else {
                self.targets.start
            };
            let mut at = begin;
            while at < self.targets.end {
                let end = self.targets.end.min(at + CHUNK);
                let axes: [&[f64]; D] =
                    std::array::from_fn(|a| self.target.axis(a).get(at..end).unwrap_or_default());
                let count = end - at;
                distances(
                    &point,
                    &axes,
                    count,
                    inverse,
                    last,
                    &mut squares,
                    &mut guesses,
                );
                let pairs = squares.iter().zip(&guesses).take(count).enumerate();
                for (k, (&squared, &guess)) in pairs {
                    let bin = self.bins.settle(guess as usize, squared);
                    if let Some(lane) = self.lanes.get_mut(bin * LANES + k % LANES) {
                        *lane += 1;
                    }
                }
                at = end;
            }
        }
    }
}

/// Squared distances, and bins that are off by at most one.
#[inline(always)]
#[allow(clippy::needless_range_loop)]
fn distances<const D: usize>(
    point: &[f64; D],
    axes: &[&[f64]; D],
    count: usize,
    inverse: f64,
    last: f64,
    squares: &mut [f64; CHUNK],
    guesses: &mut [u32; CHUNK],
) {
    // Adding this number leaves the nearest integer in the low bits, without a conversion.
    const MAGIC: f64 = 6_755_399_441_055_744.0;
    let count = count.min(CHUNK);
    let axes: [&[f64]; D] = std::array::from_fn(|a| &axes[a][..count]);
    for k in 0..count {
        let mut squared = 0.0;
        for a in 0..D {
            let difference = axes[a][k] - point[a];
            squared += difference * difference;
        }
        squares[k] = squared;
        let place = squared.sqrt() * inverse;
        let place = if place < last { place } else { last };
        guesses[k] = (place - 0.5 + MAGIC).to_bits() as u32;
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use puncta_sdk::run::Serial;
    use puncta_testkit::{Stopped, Threads};

    /// Uniform points; coordinates are multiples of `grain`, so that many distances are equal.
    pub(crate) fn points(count: usize, side: f64, grain: f64, seed: u64) -> [Vec<f64>; 3] {
        let mut state = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1;
        let mut next = || {
            state ^= state << 13;
            state ^= state >> 7;
            state ^= state << 17;
            let x = (state >> 11) as f64 / (1_u64 << 53) as f64 * side;
            if grain > 0.0 {
                (x / grain).round() * grain
            } else {
                x
            }
        };
        std::array::from_fn(|_| (0..count).map(|_| next()).collect())
    }

    #[allow(clippy::needless_range_loop)]
    fn brute<const D: usize>(
        one: &[&[f64]; D],
        two: Option<&[&[f64]; D]>,
        bins: &Bins,
    ) -> Vec<u64> {
        let mut counts = vec![0; bins.len() + 1];
        for i in 0..one[0].len() {
            let other = two.unwrap_or(one);
            for j in if two.is_some() { 0 } else { i + 1 }..other[0].len() {
                let squared = (0..D).fold(0.0, |s, a| s + (other[a][j] - one[a][i]).powi(2));
                counts[bins.bin(squared)] += 1;
            }
        }
        counts.truncate(bins.len());
        counts
    }

    fn check<const D: usize>(one: [&[f64]; D], two: [&[f64]; D], bins: &Bins) {
        let run = Threads(2);
        let source = grid(one, bins.radius(), &run).expect("valid");
        let target = Grid::new(two, source.edge(), &run).expect("valid");
        let within = count_pairs(&source, None, bins, &run).expect("not cancelled");
        assert_eq!(within, brute(&one, None, bins));
        let between = count_pairs(&source, Some(&target), bins, &run).expect("not cancelled");
        assert_eq!(between, brute(&one, Some(&two), bins));
    }

    #[test]
    fn pairs_equal_brute_force() {
        for grain in [0.0, 5.0, 0.1] {
            let [x, y, z] = points(700, 1000.0, grain, 3);
            let [u, v, w] = points(300, 1500.0, grain, 4);
            for (step, count) in [(10.0, 20), (0.5, 7), (100.0, 30)] {
                for bins in [Bins::up_to(step, count), Bins::from(step, count)] {
                    check([&x, &y], [&u, &v], &bins);
                    check([&x, &y, &z], [&u, &v, &w], &bins);
                }
            }
        }
    }

    #[test]
    fn coincident_points_and_far_copies() {
        let bins = Bins::up_to(10.0, 5);
        let same = [3.0; 100];
        let all = grid([&same, &same], 50.0, &Serial).expect("valid");
        let pairs = count_pairs(&all, None, &bins, &Serial).expect("not cancelled");
        assert_eq!(pairs, [4950, 0, 0, 0, 0]);
        let [x, y, _] = points(500, 300.0, 1.0, 9);
        let twice = |axis: &[f64]| -> Vec<f64> {
            axis.iter()
                .copied()
                .chain(axis.iter().map(|x| x + 1e7))
                .collect()
        };
        let (xx, yy) = (twice(&x), twice(&y));
        let count = |x: &[f64], y: &[f64]| {
            let grid = grid([x, y], 50.0, &Threads(2)).expect("valid");
            count_pairs(&grid, None, &bins, &Threads(3)).expect("not cancelled")
        };
        let doubled: Vec<u64> = count(&x, &y).iter().map(|n| 2 * n).collect();
        assert_eq!(count(&xx, &yy), doubled);
    }

    #[test]
    fn many_at_one_place_among_others() {
        let [mut x, mut y, _] = points(600, 60.0, 0.0, 5);
        x.extend([30.0; 400]);
        y.extend([31.0; 400]);
        let bins = Bins::up_to(2.0, 10);
        check([&x, &y], [&y, &x], &bins);
        let same = vec![7.5; 300_000];
        let all = grid([&same, &same], 50.0, &Serial).expect("valid");
        let pairs = count_pairs(&all, None, &bins, &Serial).expect("not cancelled");
        assert_eq!(pairs[0], 300_000 * 299_999 / 2);
    }

    #[test]
    fn cancel_ends_the_count() {
        let [x, y, _] = points(5000, 10.0, 0.0, 1);
        let grid = grid([&x, &y], 50.0, &Serial).expect("valid");
        let bins = Bins::up_to(1.0, 50);
        assert_eq!(count_pairs(&grid, None, &bins, &Stopped), Err(Cancelled));
    }
}
