//! Corrections for what lies beyond the boundary, as sums of weights in each bin.

use crate::bins::Bins;
use crate::overlap::Overlap;
use crate::pairs::{one_place, pairs_among, reach};
use crate::window::{Rim, Window};
use puncta_sdk::Cancelled;
use puncta_sdk::run::Run;
use puncta_shared_neighbours::Grid;
use std::ops::Range;
use std::sync::{Mutex, PoisonError};

/// The isotropic weight is at most this: a pair whose circle hardly meets the region says little.
pub const MAX_WEIGHT: f64 = 100.0;
/// Weighted pairs between two polls for cancel, some 20 ms.
const POLL: usize = 1 << 19;

/// Sums that do not depend on the order in which blocks come: fixed point, 40 binary places.
struct Totals(Mutex<Vec<i128>>);

impl Totals {
    const ONE: f64 = (1_u64 << 40) as f64;

    fn new(bins: usize) -> Self {
        Self(Mutex::new(vec![0; bins]))
    }

    fn add(&self, part: &[f64]) {
        let mut totals = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        for (total, part) in totals.iter_mut().zip(part) {
            *total += (part * Self::ONE).round() as i128;
        }
    }

    fn take(self) -> Vec<f64> {
        let totals = self.0.into_inner().unwrap_or_else(PoisonError::into_inner);
        totals
            .iter()
            .map(|total| *total as f64 / Self::ONE)
            .collect()
    }
}

/// Ripley's isotropic correction: the sum over ordered pairs (i, j) in each bin of w - 1, where 1/w
/// is the share of the circle about i through j that lies in the region. Zero for points further
/// from the boundary than the last bin, which are not looked at.
///
/// # Errors
/// When cancelled.
pub fn isotropic<const D: usize>(
    source: &Grid<D>,
    target: Option<&Grid<D>>,
    window: &dyn Window<D>,
    bins: &Bins,
    run: &dyn Run,
) -> Result<Vec<f64>, Cancelled> {
    let totals = Totals::new(bins.len());
    let other = target.unwrap_or(source);
    source.map_blocks(run, |block| {
        let mut sums = vec![0.0; bins.len()];
        let (mut rim, mut slices, mut work) = (Rim::default(), Vec::new(), 0);
        for cell in source.cells(block) {
            let (low, high) = ends(source, cell.clone());
            let pieces = window.pieces(&low, &high, bins.radius());
            if pieces.is_empty() {
                continue;
            }
            slices.clear();
            reach(other, source.cell_of(cell.start), bins.radius(), |slice| {
                slices.push(slice)
            });
            if target.is_none() && one_place(source, &cell) {
                without(&mut slices, &cell);
            }
            for i in cell {
                let point = source.point(i);
                window.about(&point, &pieces, bins.radius(), &mut rim);
                if rim.distance >= bins.radius() {
                    continue;
                }
                work += slices.iter().map(ExactSizeIterator::len).sum::<usize>();
                if work > POLL {
                    work = 0;
                    if run.cancelled() {
                        return;
                    }
                }
                // A point at distance 0 is met by no circle, itself included.
                let nearest = rim.distance * rim.distance;
                for slice in &slices {
                    beyond(
                        other,
                        &point,
                        slice.clone(),
                        nearest,
                        bins.limit(),
                        |squared| {
                            let share = window.share(&rim, squared.sqrt());
                            if let Some(sum) = sums.get_mut(bins.bin(squared)) {
                                *sum += 1.0 / share.max(1.0 / MAX_WEIGHT) - 1.0;
                            }
                        },
                    );
                }
            }
        }
        totals.add(&sums);
    })?;
    Ok(totals.take())
}

/// Takes a cell out of slices.
fn without(slices: &mut Vec<Range<usize>>, cell: &Range<usize>) {
    let parts = slices.drain(..).flat_map(|slice| {
        if slice.start <= cell.start && cell.end <= slice.end {
            [slice.start..cell.start, cell.end..slice.end]
        } else {
            [slice.clone(), slice.end..slice.end]
        }
    });
    *slices = parts.filter(|part| !part.is_empty()).collect();
}

/// Low and high corner of the points of a slice.
pub(crate) fn ends<const D: usize>(grid: &Grid<D>, slice: Range<usize>) -> ([f64; D], [f64; D]) {
    let pick = |a: usize, pick: fn(f64, f64) -> f64| {
        let axis = grid.axis(a).get(slice.clone()).unwrap_or_default();
        axis.iter().copied().reduce(pick).unwrap_or(0.0)
    };
    (
        std::array::from_fn(|a| pick(a, f64::min)),
        std::array::from_fn(|a| pick(a, f64::max)),
    )
}

/// Squared distances above one limit and up to another.
#[inline]
#[allow(clippy::needless_range_loop)]
fn beyond<const D: usize>(
    target: &Grid<D>,
    point: &[f64; D],
    slice: Range<usize>,
    above: f64,
    limit: f64,
    mut visit: impl FnMut(f64),
) {
    let axes: [&[f64]; D] =
        std::array::from_fn(|a| target.axis(a).get(slice.clone()).unwrap_or_default());
    for k in 0..slice.len() {
        let mut squared = 0.0;
        for a in 0..D {
            let difference = axes[a][k] - point[a];
            squared += difference * difference;
        }
        if squared > above && squared <= limit {
            visit(squared);
        }
    }
}

/// Translation correction: the sum over pairs in each bin of the volume over that of the part that the
/// region and its copy, moved by the pair's difference, share.
///
/// # Errors
/// When cancelled.
pub fn translation<const D: usize>(
    source: &Grid<D>,
    target: Option<&Grid<D>>,
    overlap: &Overlap<D>,
    bins: &Bins,
    run: &dyn Run,
) -> Result<Vec<f64>, Cancelled> {
    let totals = Totals::new(bins.len());
    let other = target.unwrap_or(source);
    source.map_blocks(run, |block| {
        let mut sums = vec![0.0; bins.len()];
        let (mut slices, mut work) = (Vec::new(), 0);
        for cell in source.cells(block) {
            slices.clear();
            reach(other, source.cell_of(cell.start), bins.radius(), |slice| {
                slices.push(slice)
            });
            if target.is_none() && one_place(source, &cell) {
                without(&mut slices, &cell);
                sums[0] += pairs_among(cell.len()) as f64;
            }
            for i in cell {
                work += slices.iter().map(ExactSizeIterator::len).sum::<usize>();
                if work > POLL {
                    work = 0;
                    if run.cancelled() {
                        return;
                    }
                }
                for slice in &slices {
                    let begin = if target.is_some() {
                        slice.start
                    } else {
                        slice.start.max(i + 1)
                    };
                    if begin < slice.end {
                        let later = begin..slice.end;
                        shared(other, &source.point(i), later, overlap, bins, &mut sums);
                    }
                }
            }
        }
        totals.add(&sums);
    })?;
    Ok(totals.take())
}

fn shared<const D: usize>(
    target: &Grid<D>,
    point: &[f64; D],
    slice: Range<usize>,
    overlap: &Overlap<D>,
    bins: &Bins,
    sums: &mut [f64],
) {
    // A loop of its own for the sides of a rectangle, whose weight costs next to nothing.
    match overlap {
        Overlap::Sides(inverse) => weigh(target, point, slice, bins, sums, |difference| {
            let side = |(d, inverse): (&f64, &f64)| 1.0 - d.abs() * inverse;
            difference.iter().zip(inverse).map(side).product()
        }),
        Overlap::Lattice { .. } => weigh(target, point, slice, bins, sums, |difference| {
            overlap.share(difference).max(1.0 / MAX_WEIGHT)
        }),
    }
}

#[inline]
#[allow(clippy::needless_range_loop)]
fn weigh<const D: usize>(
    target: &Grid<D>,
    point: &[f64; D],
    slice: Range<usize>,
    bins: &Bins,
    sums: &mut [f64],
    share: impl Fn(&[f64; D]) -> f64,
) {
    let axes: [&[f64]; D] =
        std::array::from_fn(|a| target.axis(a).get(slice.clone()).unwrap_or_default());
    for k in 0..slice.len() {
        let difference: [f64; D] = std::array::from_fn(|a| axes[a][k] - point[a]);
        let squared = difference.iter().map(|d| d * d).sum();
        if squared <= bins.limit()
            && let Some(sum) = sums.get_mut(bins.bin(squared))
        {
            *sum += 1.0 / share(&difference);
        }
    }
}
