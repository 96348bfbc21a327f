//! Set covariance: how much of a region it shares with its copy, moved by a difference.
//!
//! Of pixels the shared area is linear in each coordinate between moves by whole pixels, and those
//! are counted. Of a polygon it is the sum over pairs of edges of the integral along y of the larger
//! of their x, with the signs of the edges; it is computed so at the knots of a lattice of moves.

use crate::flat::{Edge, Flat, Inside};
use puncta_sdk::run::{Run, map};
use puncta_sdk::{Cancelled, Failure};
use std::ops::Range;

/// Most knots of a lattice of moves.
const MAX_KNOTS: f64 = 4e6;
/// Knots along an axis from 0 to the reach, for a polygon of few edges and of many. Between them the
/// share is off by less than 2 reach / (size knots), where it bends.
const KNOTS: [usize; 2] = [128, 64];
/// A polygon of few edges.
const FEW: usize = 256;

/// The share of a region that lies in its copy moved by a difference.
#[derive(Clone, Debug)]
pub enum Overlap<const D: usize> {
    /// Of a rectangle or box: one over its sides.
    Sides([f64; D]),
    /// Interpolated between knots, of moves from -half to half knots along each axis, x fastest.
    Lattice {
        /// Knots per nm.
        scale: [f64; D],
        /// Knots on each side of 0.
        half: [usize; D],
        /// Share at each knot.
        shares: Vec<f64>,
    },
}

impl<const D: usize> Overlap<D> {
    /// The share for a difference within reach.
    #[inline]
    #[must_use]
    pub fn share(&self, difference: &[f64; D]) -> f64 {
        match self {
            Self::Sides(inverse) => {
                let side = |(d, inverse): (&f64, &f64)| 1.0 - d.abs() * inverse;
                difference.iter().zip(inverse).map(side).product()
            }
            Self::Lattice {
                scale,
                half,
                shares,
            } => {
                let (mut base, mut stride) = (0, 1);
                let (mut part, mut strides) = ([0.0; D], [0; D]);
                for a in 0..D {
                    let knots = 2 * half[a] + 1;
                    let place = difference[a] * scale[a] + half[a] as f64;
                    let low = (place.max(0.0) as usize).min(knots.saturating_sub(2));
                    part[a] = (place - low as f64).clamp(0.0, 1.0);
                    base += low * stride;
                    strides[a] = stride;
                    stride *= knots;
                }
                let mut sum = 0.0;
                for corner in 0..1 << D {
                    let (mut weight, mut at) = (1.0, base);
                    for a in 0..D {
                        let up = corner >> a & 1 == 1;
                        weight *= if up { part[a] } else { 1.0 - part[a] };
                        at += if up { strides[a] } else { 0 };
                    }
                    sum += weight * shares.get(at).copied().unwrap_or(0.0);
                }
                sum
            }
        }
    }
}

/// A lattice of moves up to `reach` in steps of `step`; half of it is computed, as a move back shares
/// as much.
fn lattice<const D: usize>(
    step: [f64; D],
    reach: f64,
    run: &dyn Run,
    share: &(dyn Fn([i64; D]) -> f64 + Sync),
) -> Result<Overlap<D>, Failure> {
    let half = step.map(|step| (reach / step).ceil().min(1e9) as usize + 1);
    let spans = half.map(|half| 2 * half + 1);
    let count: f64 = spans.iter().map(|span| *span as f64).product();
    if count > MAX_KNOTS {
        let message = format!(
            "a largest distance of {reach} nm is too many pixels of the mask for the translation \
             correction"
        );
        let remedy = "take a smaller distance, a coarser mask, or another correction";
        return Err(Failure::bad_parameter("r_max", message).remedy(remedy));
    }
    let knots: usize = spans.iter().product();
    let row = spans[0];
    let of = |knot: usize| -> [i64; D] {
        let mut rest = knot;
        std::array::from_fn(|a| {
            let place = rest % spans[a];
            rest /= spans[a];
            place as i64 - half[a] as i64
        })
    };
    let first: Vec<Result<Vec<f64>, Cancelled>> =
        map(run, (knots / 2).div_ceil(row) + 1, &|line| {
            if run.cancelled() {
                return Err(Cancelled);
            }
            let line = line * row..((line + 1) * row).min(knots / 2 + 1);
            Ok(line.map(|knot| share(of(knot))).collect())
        });
    let mut shares: Vec<f64> = Vec::with_capacity(knots);
    for line in first {
        shares.extend(line?);
    }
    shares.truncate(knots / 2 + 1);
    let back: Vec<f64> = shares[..knots / 2].iter().rev().copied().collect();
    shares.extend(back);
    Ok(Overlap::Lattice {
        scale: step.map(|step| 1.0 / step),
        half,
        shares,
    })
}

/// Of a region of the plane, for differences up to `reach` nm.
///
/// # Errors
/// When the reach is too many pixels, or when cancelled.
pub fn flat(region: &Flat, reach: f64, run: &dyn Run) -> Result<Overlap<2>, Failure> {
    match &region.inside {
        Inside::Rectangle => Ok(Overlap::Sides(std::array::from_fn(|a| {
            1.0 / (region.high[a] - region.low[a])
        }))),
        Inside::Mask {
            shape,
            side,
            pixels,
            set,
        } => {
            let rows = Rows::new(pixels, [shape[0], shape[1], 1]);
            let total = set.len() as f64;
            let share = |[x, y]: [i64; 2]| rows.common([x, y, 0]) as f64 / total;
            lattice(*side, reach, run, &share)
        }
        Inside::Polygon => {
            let from = |p: [f64; 2]| [p[0] - region.low[0], p[1] - region.low[1]];
            let edges: Vec<Edge> = region
                .edges
                .iter()
                .map(|edge| Edge {
                    from: from(edge.from),
                    to: from(edge.to),
                })
                .collect();
            let sloped = Sloped::all(&edges);
            let step = reach / KNOTS[usize::from(sloped.len() > FEW)] as f64;
            let share = |move_: [i64; 2]| {
                let by = move_.map(|k| k as f64 * step);
                (common_area(&sloped, by) / region.area).clamp(0.0, 1.0)
            };
            lattice([step; 2], reach, run, &share)
        }
    }
}

/// Of the pixels of a mask in space.
///
/// # Errors
/// As [`flat`].
pub fn voxels(
    rows: &Rows,
    side: [f64; 3],
    reach: f64,
    run: &dyn Run,
) -> Result<Overlap<3>, Failure> {
    let total = rows.common([0; 3]) as f64;
    lattice(side, reach, run, &|by| rows.common(by) as f64 / total)
}

/// The pixels of a mask as runs along x.
#[derive(Clone, Debug)]
pub struct Rows {
    shape: [usize; 3],
    starts: Vec<usize>,
    runs: Vec<Range<u32>>,
}

impl Rows {
    /// Of a mask, x fastest.
    #[must_use]
    pub fn new(pixels: &[bool], shape: [usize; 3]) -> Self {
        let mut rows = Self {
            shape,
            starts: vec![0],
            runs: Vec::new(),
        };
        for row in pixels.chunks(shape[0].max(1)) {
            let mut begin = 0;
            for same in row.chunk_by(|a, b| a == b) {
                let end = begin + same.len() as u32;
                if same.first() == Some(&true) {
                    rows.runs.push(begin..end);
                }
                begin = end;
            }
            rows.starts.push(rows.runs.len());
        }
        rows
    }

    fn row(&self, y: usize, z: usize) -> &[Range<u32>] {
        let row = z * self.shape[1] + y;
        match (self.starts.get(row), self.starts.get(row + 1)) {
            (Some(begin), Some(end)) => &self.runs[*begin..*end],
            _ => &[],
        }
    }

    /// Number of pixels that the mask shares with its copy moved by whole pixels.
    fn common(&self, [x, y, z]: [i64; 3]) -> u64 {
        let overlap = |side: usize, by: i64| {
            let side = side as i64;
            (by.max(0).min(side) as usize)..((side + by).clamp(0, side) as usize)
        };
        let mut total = 0;
        for k in overlap(self.shape[2], z) {
            for j in overlap(self.shape[1], y) {
                let other = self.row((j as i64 - y) as usize, (k as i64 - z) as usize);
                total += meet(self.row(j, k), other, x);
            }
        }
        total
    }
}

/// Length of what runs share with others moved by `by`.
fn meet(one: &[Range<u32>], two: &[Range<u32>], by: i64) -> u64 {
    let (mut i, mut j, mut total) = (0, 0, 0);
    while let (Some(a), Some(b)) = (one.get(i), two.get(j)) {
        let (low, high) = (i64::from(b.start) + by, i64::from(b.end) + by);
        let both = i64::from(a.end).min(high) - i64::from(a.start).max(low);
        total += both.max(0) as u64;
        if i64::from(a.end) < high {
            i += 1;
        } else {
            j += 1;
        }
    }
    total
}

/// An edge that is not level: x = at + slope y from low to high, 1 where it goes down.
#[derive(Clone, Copy, Debug)]
struct Sloped {
    low: f64,
    high: f64,
    at: f64,
    slope: f64,
    sign: f64,
}

impl Sloped {
    /// Sorted by their lower end.
    fn all(edges: &[Edge]) -> Vec<Self> {
        let sloped = |edge: &Edge| {
            let [from, to] = [edge.from, edge.to];
            let slope = (to[0] - from[0]) / (to[1] - from[1]);
            (from[1] != to[1]).then(|| Self {
                low: from[1].min(to[1]),
                high: from[1].max(to[1]),
                at: from[0] - slope * from[1],
                slope,
                sign: if to[1] < from[1] { 1.0 } else { -1.0 },
            })
        };
        let mut all: Vec<Self> = edges.iter().filter_map(sloped).collect();
        all.sort_by(|a, b| a.low.total_cmp(&b.low));
        all
    }
}

/// Area that a polygon shares with its copy moved by a difference.
///
/// With the region on the left of its edges, a point is inside where the signs of the edges to its
/// left add up to one. So the area is that of x > max(x1, x2) over all pairs with the product of the
/// signs; as the signs at each height add up to none, minus the integral of the maximum is left.
fn common_area(edges: &[Sloped], by: [f64; 2]) -> f64 {
    let mut area = 0.0;
    for one in edges {
        for two in edges {
            let (low, high) = (one.low.max(two.low + by[1]), one.high.min(two.high + by[1]));
            if two.low + by[1] >= one.high {
                break;
            }
            if low >= high {
                continue;
            }
            let at = two.at + by[0] - two.slope * by[1];
            let (first, second) = (one.at + one.slope * low, at + two.slope * low);
            let ends = (one.at + one.slope * high, at + two.slope * high);
            let (before, after) = (first - second, ends.0 - ends.1);
            let mut both = 0.5 * (first.max(second) + ends.0.max(ends.1));
            if before * after < 0.0 {
                // They cross: the maximum bends down there.
                let (before, after) = (before.abs(), after.abs());
                both -= 0.5 * before * after / (before + after);
            }
            area -= one.sign * two.sign * both * (high - low);
        }
    }
    area
}

#[cfg(test)]
mod tests;
