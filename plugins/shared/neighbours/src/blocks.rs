//! Parallel work over the points of a grid, with results that do not depend on the threads.

use crate::Grid;
use crate::cells::index;
use puncta_sdk::Cancelled;
use puncta_sdk::run::{Run, map};
use std::ops::Range;

/// Sorted points of a block.
const BLOCK: usize = 2048;

impl<const D: usize> Grid<D> {
    /// Calls `task` for blocks of sorted indices in parallel and gives the results in order. A
    /// block is short enough that cancel is polled between blocks only.
    ///
    /// # Errors
    /// When cancelled.
    pub fn map_blocks<T: Send>(
        &self,
        run: &dyn Run,
        task: impl Fn(Range<usize>) -> T + Sync,
    ) -> Result<Vec<T>, Cancelled> {
        let parts = map(run, self.len().div_ceil(BLOCK), &|block| {
            let begin = block * BLOCK;
            (!run.cancelled()).then(|| task(begin..self.len().min(begin + BLOCK)))
        });
        let parts: Option<Vec<T>> = parts.into_iter().collect();
        parts.filter(|_| !run.cancelled()).ok_or(Cancelled)
    }

    /// Calls `task` with each sorted index in parallel and gives the results in the order of the
    /// input's rows; rows without a place get `missing`.
    ///
    /// # Errors
    /// When cancelled.
    pub fn by_row<T: Send + Clone>(
        &self,
        run: &dyn Run,
        missing: T,
        task: impl Fn(usize) -> T + Sync,
    ) -> Result<Vec<T>, Cancelled> {
        let blocks = self.map_blocks(run, |block| block.map(&task).collect::<Vec<T>>())?;
        let mut results = vec![missing; self.input_rows];
        for (&row, result) in self.rows.iter().zip(blocks.into_iter().flatten()) {
            results[row as usize] = result;
        }
        Ok(results)
    }

    /// The cells whose first point lies in a block of sorted indices, as slices of sorted indices:
    /// over all blocks each occupied cell comes once, whole.
    pub fn cells(&self, block: Range<usize>) -> impl Iterator<Item = Range<usize>> + '_ {
        let mut at = block.start;
        if at > 0 && at < self.len() {
            at = at.max(self.cell_end(at - 1));
        }
        std::iter::from_fn(move || {
            if at >= block.end {
                return None;
            }
            let cell = at..self.cell_end(at);
            at = cell.end;
            Some(cell)
        })
    }

    /// Numbers of the cell of a sorted index along each axis, from the origin of coordinates.
    ///
    /// # Panics
    /// When there is no such point.
    #[must_use]
    pub fn cell_of(&self, i: usize) -> [i64; D] {
        let inverse = (1.0 / self.edge).min(f64::MAX);
        self.point(i).map(|x| index(x, inverse))
    }

    /// Calls `visit` with the slices of sorted indices of a box of cells, both ends included.
    #[inline]
    pub fn in_cells(&self, low: [i64; D], high: [i64; D], visit: impl FnMut(Range<usize>)) {
        self.cells.runs(low, high, visit);
    }

    fn cell_end(&self, i: usize) -> usize {
        self.cells.end(&self.cell_of(i)).max(i + 1)
    }
}
