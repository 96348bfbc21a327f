//! Radius and pair queries.

use crate::Grid;
use crate::cells::index;
use std::ops::Range;

/// Adds what rounding of the squared distance can hide, so that no point at the radius is missed.
#[inline]
fn reach(x: f64, radius: f64) -> f64 {
    radius * (1.0 + 1e-12) + (x.abs() + radius) * 1e-15
}

impl<const D: usize> Grid<D> {
    /// Cell numbers of the box about a point.
    #[inline]
    fn cells_about(&self, point: &[f64; D], radius: f64) -> ([i64; D], [i64; D]) {
        let inverse = (1.0 / self.edge).min(f64::MAX);
        (
            point.map(|x| index(x - reach(x, radius), inverse)),
            point.map(|x| index(x + reach(x, radius), inverse)),
        )
    }

    /// Calls `visit` with slices of sorted indices, in increasing order, that hold all points
    /// within the radius of a point, and others of the same cells. For inner loops of one's own.
    #[inline]
    pub fn candidates(&self, point: &[f64; D], radius: f64, visit: impl FnMut(Range<usize>)) {
        if radius >= 0.0 {
            let (low, high) = self.cells_about(point, radius);
            self.cells.runs(low, high, visit);
        }
    }

    /// As [`Grid::candidates`], for the box between two corners.
    #[inline]
    pub fn in_box(&self, low: &[f64; D], high: &[f64; D], visit: impl FnMut(Range<usize>)) {
        let inverse = (1.0 / self.edge).min(f64::MAX);
        let low = low.map(|x| index(x - reach(x, 0.0), inverse));
        let high = high.map(|x| index(x + reach(x, 0.0), inverse));
        self.cells.runs(low, high, visit);
    }

    /// Calls `visit(sorted index, squared distance)` for each point not further than the radius
    /// from a point (in scaled coordinates), in increasing order. A point of the grid finds itself.
    #[inline]
    pub fn within(&self, point: &[f64; D], radius: f64, mut visit: impl FnMut(usize, f64)) {
        let limit = radius * radius;
        self.candidates(point, radius, |run| {
            let begin = run.start;
            self.squared(point, run, |k, squared| {
                if squared <= limit {
                    visit(begin + k, squared);
                }
            });
        });
    }

    /// As [`Grid::within`] about the sorted index `i`, with points of larger sorted index only: over
    /// all i each pair comes once.
    ///
    /// # Panics
    /// When there is no such point.
    #[inline]
    pub fn later_within(&self, i: usize, radius: f64, mut visit: impl FnMut(usize, f64)) {
        let (point, limit) = (self.point(i), radius * radius);
        if radius.is_nan() || radius < 0.0 {
            return;
        }
        let (mut low, high) = self.cells_about(&point, radius);
        // Rows of cells before that of the point hold smaller sorted indices only.
        low[D - 1] = index(point[D - 1], (1.0 / self.edge).min(f64::MAX));
        self.cells.runs(low, high, |run| {
            let begin = run.start.max(i + 1);
            if begin < run.end {
                self.squared(&point, begin..run.end, |k, squared| {
                    if squared <= limit {
                        visit(begin + k, squared);
                    }
                });
            }
        });
    }

    /// Number of points not further than the radius from a point, itself included.
    #[inline]
    #[must_use]
    pub fn count_within(&self, point: &[f64; D], radius: f64) -> usize {
        let (mut count, limit) = (0, radius * radius);
        self.candidates(point, radius, |run| {
            let mut inside = 0_u64;
            self.squared(point, run, |_, squared| {
                inside += u64::from(squared <= limit)
            });
            count += inside as usize;
        });
        count
    }

    /// Squared distances of a slice of sorted indices from a point.
    #[inline(always)]
    #[allow(clippy::needless_range_loop)]
    fn squared(&self, point: &[f64; D], run: Range<usize>, mut visit: impl FnMut(usize, f64)) {
        let axes: [&[f64]; D] = std::array::from_fn(|a| &self.axes[a][run.clone()]);
        for k in 0..run.len() {
            let mut squared = 0.0;
            for a in 0..D {
                let difference = axes[a][k] - point[a];
                squared += difference * difference;
            }
            visit(k, squared);
        }
    }
}
