//! Nearest neighbours, exact: shells of cells until nothing nearer can follow.

use crate::Grid;
use crate::cells::index;
use crate::source::{Extent, Source};
use pulp::{Arch, Simd, WithSimd};
use puncta_sdk::run::Run;
use puncta_sdk::{Cancelled, Failure};
use std::ops::Range;

/// Points about a cell above which a search that ends at distance 0 is better than one that looks at
/// all, so that coincident points are not quadratic.
const CROWD: usize = 2048;

/// The k nearest points found so far, nearest first. Points at the same distance are ordered by
/// row; among points at distance 0, those that are found first are taken.
#[derive(Clone, Debug)]
pub struct Nearest {
    k: usize,
    found: Vec<(f64, u32, usize)>,
}

impl Nearest {
    /// Room for the k nearest, at least one.
    #[must_use]
    pub fn new(k: usize) -> Self {
        let k = k.max(1);
        Self {
            k,
            found: Vec::with_capacity(k.min(1 << 16) + 1),
        }
    }

    /// Squared distance and sorted index of each, nearest first.
    pub fn iter(&self) -> impl Iterator<Item = (f64, usize)> + '_ {
        self.found.iter().map(|&(squared, _, i)| (squared, i))
    }

    /// Squared distance and sorted index of the k-th, if there are k.
    #[must_use]
    pub fn last(&self) -> Option<(f64, usize)> {
        let &(squared, _, i) = self.found.get(self.k - 1)?;
        Some((squared, i))
    }

    #[inline]
    fn limit(&self) -> f64 {
        self.found
            .get(self.k - 1)
            .map_or(f64::INFINITY, |last| last.0)
    }

    #[inline(never)]
    fn insert(&mut self, squared: f64, row: u32, i: usize) {
        let place = self
            .found
            .partition_point(|one| (one.0, one.1) < (squared, row));
        self.found.insert(place, (squared, row, i));
        self.found.truncate(self.k);
    }
}

impl<const D: usize> Grid<D> {
    /// Sorts points by cells that suit queries for the k nearest: a few points in the cell of most
    /// points, however they cluster.
    ///
    /// # Errors
    /// As [`Grid::scaled`].
    pub fn for_nearest(
        points: [&[f64]; D],
        scale: [f64; D],
        k: usize,
        run: &dyn Run,
    ) -> Result<Self, Failure> {
        let wanted = (k.max(1) as f64).max(2.0);
        crate::build::check(&points, &scale, 1.0)?;
        let extent = Extent::of(&Source { points, scale }, run)?;
        let mut grid = Self::scaled(points, scale, spread(&extent, wanted), run)?;
        for _ in 0..16 {
            let crowd = grid.crowd(run)?;
            if crowd <= 6.0 * wanted {
                break;
            }
            let edge = grid.edge * (2.0 * wanted / crowd).powf(1.0 / D as f64).max(1e-3);
            let finer = Self::scaled(points, scale, edge, run)?;
            // Coincident points share a cell of any size.
            let better = finer.crowd(run)? < 0.9 * crowd;
            if better {
                grid = finer;
            } else {
                break;
            }
        }
        Ok(grid)
    }

    /// Points in the cell of a point, on average over the points.
    ///
    /// # Errors
    /// When cancelled.
    pub fn crowd(&self, run: &dyn Run) -> Result<f64, Cancelled> {
        let sums = self.map_blocks(run, |block| {
            self.cells(block)
                .map(|cell| (cell.len() as f64).powi(2))
                .sum::<f64>()
        })?;
        Ok(sums.iter().sum::<f64>() / (self.len().max(1) as f64))
    }

    /// Finds the nearest points to a point (scaled coordinates), without the sorted index `but`.
    /// `nearest` is cleared first.
    pub fn nearest(&self, point: &[f64; D], but: Option<usize>, nearest: &mut Nearest) {
        nearest.found.clear();
        if point.iter().any(|x| x.is_nan()) {
            return;
        }
        let but = but.unwrap_or(usize::MAX);
        let inverse = (1.0 / self.edge).min(f64::MAX);
        let centre = point.map(|x| index(x, inverse));
        let (mut inner, mut outer) = (-1, 1);
        loop {
            self.shell(&centre, inner, outer, |run| {
                self.scan(point, run, but, nearest)
            });
            let limit = nearest.limit();
            let free = self.free(point, &centre, outer);
            let all = (0..D).all(|a| {
                centre[a] - outer <= self.cells.low[a] && centre[a] + outer >= self.cells.high[a]
            });
            if all || limit == 0.0 || (free > 0.0 && limit < free * free) {
                return;
            }
            let next = outer + (outer / 2).max(1);
            // Skips shells that end before the first cell of the grid.
            let gap =
                (0..D).map(|a| (self.cells.low[a] - centre[a]).max(centre[a] - self.cells.high[a]));
            (inner, outer) = (outer, next.max(gap.max().unwrap_or(0)));
        }
    }

    /// Distance from the k-th nearest other point for each row of the input; infinite where there
    /// are fewer than k others, NaN for rows without a place.
    ///
    /// # Errors
    /// When cancelled.
    pub fn nearest_distances(&self, k: usize, run: &dyn Run) -> Result<Vec<f64>, Cancelled> {
        let arch = Arch::new();
        let blocks = self.map_blocks(run, |block| {
            let mut nearest = Nearest::new(k);
            let mut distance = |i: usize| {
                self.nearest(&self.point(i), Some(i), &mut nearest);
                nearest.limit().sqrt()
            };
            if k > 1 {
                return block.map(distance).collect::<Vec<f64>>();
            }
            let mut distances = Vec::with_capacity(block.len());
            let mut slices = Vec::new();
            for cell in self.cells(block) {
                let centre = self.cell_of(cell.start);
                slices.clear();
                self.shell(&centre, -1, 1, |slice| slices.push(slice));
                if slices.iter().map(ExactSizeIterator::len).sum::<usize>() > CROWD {
                    distances.extend(cell.map(&mut distance));
                    continue;
                }
                for i in cell {
                    let point = self.point(i);
                    let squared = arch.dispatch(Closest {
                        grid: self,
                        point,
                        but: i,
                        slices: &slices,
                    });
                    let free = self.free(&point, &centre, 1);
                    distances.push(if free > 0.0 && squared < free * free {
                        squared.sqrt()
                    } else {
                        distance(i)
                    });
                }
            }
            distances
        })?;
        let mut distances = vec![f64::NAN; self.input_rows];
        for (&row, distance) in self.rows.iter().zip(blocks.into_iter().flatten()) {
            distances[row as usize] = distance;
        }
        Ok(distances)
    }

    #[inline]
    #[allow(clippy::needless_range_loop)]
    fn scan(&self, point: &[f64; D], run: Range<usize>, but: usize, nearest: &mut Nearest) {
        let begin = run.start;
        let mut limit = nearest.limit();
        if limit == 0.0 {
            return;
        }
        let axes: [&[f64]; D] = std::array::from_fn(|a| &self.axes[a][run.clone()]);
        for k in 0..run.len() {
            let mut squared = 0.0;
            for a in 0..D {
                let difference = axes[a][k] - point[a];
                squared += difference * difference;
            }
            if squared <= limit && begin + k != but {
                nearest.insert(squared, self.rows[begin + k], begin + k);
                limit = nearest.limit();
                if limit == 0.0 {
                    return;
                }
            }
        }
    }

    /// Distance from a point to the outside of the cells up to `outer` from its own.
    fn free(&self, point: &[f64; D], centre: &[i64; D], outer: i64) -> f64 {
        let mut free = f64::INFINITY;
        for a in 0..D {
            let low = point[a] - (centre[a] - outer) as f64 * self.edge;
            let high = (centre[a] + outer + 1) as f64 * self.edge - point[a];
            let rounding = 1e-12 * (point[a].abs() + self.edge * outer as f64);
            // Beyond the last cells there is nothing.
            if centre[a] - outer > self.cells.low[a] {
                free = free.min(low - rounding);
            }
            if centre[a] + outer < self.cells.high[a] {
                free = free.min(high - rounding);
            }
        }
        free
    }

    /// Visits the cells whose distance from the centre is above `inner` and at most `outer`.
    #[inline]
    fn shell(
        &self,
        centre: &[i64; D],
        inner: i64,
        outer: i64,
        mut visit: impl FnMut(Range<usize>),
    ) {
        let (mut low, mut high) = (centre.map(|c| c - outer), centre.map(|c| c + outer));
        if inner >= 0 {
            // Slabs along the slowest axis first, then what is left between them.
            for a in (0..D).rev() {
                let (from, to) = (low[a], high[a]);
                high[a] = centre[a] - inner - 1;
                self.cells.runs(low, high, &mut visit);
                (low[a], high[a]) = (centre[a] + inner + 1, to);
                self.cells.runs(low, high, &mut visit);
                debug_assert_eq!(from, centre[a] - outer);
                (low[a], high[a]) = (centre[a] - inner, centre[a] + inner);
            }
        } else {
            self.cells.runs(low, high, &mut visit);
        }
    }
}

/// Smallest squared distance from a point to those of some slices, but one.
struct Closest<'a, const D: usize> {
    grid: &'a Grid<D>,
    point: [f64; D],
    but: usize,
    slices: &'a [Range<usize>],
}

impl<const D: usize> WithSimd for Closest<'_, D> {
    type Output = f64;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _simd: S) -> f64 {
        // Independent minima, so that the compiler may use whole registers.
        const LANES: usize = 8;
        let mut least = [f64::INFINITY; LANES];
        for slice in self.slices {
            if slice.contains(&self.but) {
                self.scan(slice.start..self.but, &mut least);
                self.scan(self.but + 1..slice.end, &mut least);
            } else {
                self.scan(slice.clone(), &mut least);
            }
        }
        least
            .into_iter()
            .fold(f64::INFINITY, |a, b| if b < a { b } else { a })
    }
}

impl<const D: usize> Closest<'_, D> {
    #[inline(always)]
    #[allow(clippy::needless_range_loop)]
    fn scan<const LANES: usize>(&self, slice: Range<usize>, least: &mut [f64; LANES]) {
        let axes: [&[f64]; D] = std::array::from_fn(|a| &self.grid.axes[a][slice.clone()]);
        let squared = |k: usize| {
            let mut squared = 0.0;
            for a in 0..D {
                let difference = axes[a][k] - self.point[a];
                squared += difference * difference;
            }
            squared
        };
        let whole = slice.len() / LANES * LANES;
        for at in (0..whole).step_by(LANES) {
            for lane in 0..LANES {
                let squared = squared(at + lane);
                least[lane] = if squared < least[lane] {
                    squared
                } else {
                    least[lane]
                };
            }
        }
        for (k, least) in (whole..slice.len()).zip(least) {
            let squared = squared(k);
            *least = if squared < *least { squared } else { *least };
        }
    }
}

/// Edge of cells with so many points each, if they filled their bounding box.
fn spread<const D: usize>(extent: &Extent<D>, wanted: f64) -> f64 {
    let sides = (0..D).map(|a| extent.high[a] - extent.low[a]);
    let sides: Vec<f64> = sides.filter(|side| *side > 0.0).collect();
    let volume: f64 = sides.iter().product();
    let part = wanted / (extent.count.max(1) as f64);
    let edge = (volume * part).powf(1.0 / sides.len().max(1) as f64);
    if edge.is_finite() && edge > 0.0 {
        edge
    } else {
        1.0
    }
}
