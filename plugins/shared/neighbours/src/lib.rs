//! Neighbours of points in two and three dimensions: a grid of cells for radius, pair and
//! nearest-neighbour queries.
//!
//! [`Grid`] sorts the points by cell (row-major, x fastest) and keeps sorted copies of their
//! coordinates, so that the cells of one row that a query covers are one contiguous slice.
//! *Sorted index* means the place in this order; [`Grid::rows`] gives the row of the input.
//!
//! ```
//! use puncta_sdk::run::Serial;
//! use puncta_shared_neighbours::Grid;
//!
//! let (x, y) = ([0.0, 3.0, 50.0, f64::NAN], [0.0, 4.0, 0.0, 1.0]);
//! let grid = Grid::new([&x, &y], 10.0, &Serial)?;
//! assert_eq!((grid.len(), grid.left_out()), (3, 1));
//!
//! // All points within 5 nm of a place, their distance squared with them.
//! let mut found = Vec::new();
//! grid.within(&[0.0, 0.0], 5.0, |i, squared| found.push((grid.rows()[i], squared)));
//! assert_eq!(found, [(0, 0.0), (1, 25.0)]);
//! assert_eq!(grid.count_within(&[0.0, 0.0], 50.0), 3);
//!
//! // Each pair once: those of sorted index i with a later one. Blocks run in parallel, and their
//! // results come in order, whatever the number of threads.
//! let pairs = grid.map_blocks(&Serial, |block| {
//!     let mut pairs = 0;
//!     block.for_each(|i| grid.later_within(i, 5.0, |_j, _squared| pairs += 1));
//!     pairs
//! })?;
//! assert_eq!(pairs.iter().sum::<i32>(), 1);
//!
//! // A result for each row of the input, in its order; rows without a place keep the first value.
//! let counts = grid.by_row(&Serial, 0, |i| grid.count_within(&grid.point(i), 10.0))?;
//! assert_eq!(counts, [2, 2, 1, 0]);
//!
//! // Distance to the first neighbour; cells of a size that suits.
//! let nearest = Grid::for_nearest([&x, &y], [1.0; 2], 1, &Serial)?;
//! let distances = nearest.nearest_distances(1, &Serial)?;
//! assert_eq!(distances[..2], [5.0, 5.0]);
//! # Ok::<(), puncta_sdk::Failure>(())
//! ```
//!
//! Cost: building is O(n) in two passes over the rows; a query visits the cells that its box
//! covers, so a radius of about the edge of a cell visits O(points in 3^D cells). Memory: 8 bytes a
//! point and axis, 4 for its row and 4 a cell; at most six cells a point are kept as an array, in
//! wider fields only the occupied ones are (then a query costs a binary search a row of cells, and
//! nothing grows with the extent). Row numbers are 32 bits wide.

mod blocks;
mod build;
mod cells;
mod nearest;
mod query;
mod source;

pub use nearest::Nearest;

use cells::Cells;

/// Points sorted by the cells of a regular grid.
#[derive(Clone, Debug)]
pub struct Grid<const D: usize> {
    edge: f64,
    scale: [f64; D],
    axes: [Vec<f64>; D],
    rows: Vec<u32>,
    cells: Cells<D>,
    input_rows: usize,
}

impl<const D: usize> Grid<D> {
    /// Number of points in the grid.
    #[must_use]
    pub fn len(&self) -> usize {
        self.rows.len()
    }

    /// Whether there is no point.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.rows.is_empty()
    }

    /// Rows of the input that have no place: a coordinate is NaN or infinite.
    #[must_use]
    pub fn left_out(&self) -> usize {
        self.input_rows - self.rows.len()
    }

    /// Rows of the input, with those that are left out.
    #[must_use]
    pub fn input_rows(&self) -> usize {
        self.input_rows
    }

    /// Edge of a cell, in scaled coordinates.
    #[must_use]
    pub fn edge(&self) -> f64 {
        self.edge
    }

    /// What each axis was multiplied by.
    #[must_use]
    pub fn scale(&self) -> [f64; D] {
        self.scale
    }

    /// Row of the input of each sorted index. Inside a cell rows increase.
    #[must_use]
    pub fn rows(&self) -> &[u32] {
        &self.rows
    }

    /// Scaled coordinates of each sorted index along an axis.
    ///
    /// # Panics
    /// When there is no such axis.
    #[must_use]
    pub fn axis(&self, axis: usize) -> &[f64] {
        &self.axes[axis]
    }

    /// Scaled coordinates of a sorted index.
    ///
    /// # Panics
    /// When there is no such point.
    #[must_use]
    #[inline]
    pub fn point(&self, i: usize) -> [f64; D] {
        std::array::from_fn(|a| self.axes[a][i])
    }
}

#[cfg(test)]
mod tests;
