//! Points sorted by cells of the x y plane, for finding all points near a point.
//!
//! The plane is folded onto a torus of cells, about one for each point, so that a stray point far
//! away costs no memory; what is folded together is told apart by the distance.

use std::ops::Range;

/// Points by cell.
#[derive(Debug, Default)]
pub struct Grid {
    /// Point numbers, sorted by cell, then by number.
    pub order: Vec<u32>,
    start: Vec<u32>,
    width: i64,
    height: i64,
    scale: f32,
}

/// The ranges of [`Grid::order`] that hold all points of the 3 x 3 cells about a cell.
pub type Around = [Range<usize>; 9];

impl Grid {
    /// Sorts points into cells of side `cell`; there are at most 2^32 - 2 points.
    pub fn new(at: &[[f32; 3]], cell: f32) -> Self {
        let mut low = [f32::INFINITY; 2];
        let mut high = [f32::NEG_INFINITY; 2];
        for p in at {
            for axis in 0..2 {
                low[axis] = low[axis].min(p[axis]);
                high[axis] = high[axis].max(p[axis]);
            }
        }
        let cells = |axis: usize| f64::from(high[axis] - low[axis]) / f64::from(cell) + 3.0;
        let most = (2 * at.len()).max(16) as f64;
        let (mut width, mut height) = (cells(0).max(3.0), cells(1).max(3.0));
        if width * height > most {
            // Fold the longer side first, then both.
            let side = most.sqrt();
            if width > height {
                width = width.min((most / height).max(side));
                height = height.min((most / width).max(3.0));
            } else {
                height = height.min((most / width).max(side));
                width = width.min((most / height).max(3.0));
            }
        }
        let mut grid = Self {
            order: vec![0; at.len()],
            start: Vec::new(),
            width: width as i64,
            height: height as i64,
            scale: 1.0 / cell,
        };
        grid.sort(at);
        grid
    }

    fn sort(&mut self, at: &[[f32; 3]]) {
        let cell: Vec<u32> = at.iter().map(|p| self.cell(*p) as u32).collect();
        let mut start = vec![0u32; (self.width * self.height) as usize + 1];
        for c in &cell {
            start[*c as usize + 1] += 1;
        }
        for i in 1..start.len() {
            start[i] += start[i - 1];
        }
        let mut next = start.clone();
        for (point, c) in cell.iter().enumerate() {
            let slot = &mut next[*c as usize];
            self.order[*slot as usize] = point as u32;
            *slot += 1;
        }
        self.start = start;
    }

    fn column_row(&self, p: [f32; 3]) -> (i64, i64) {
        let column = (p[0] * self.scale).floor() as i64;
        let row = (p[1] * self.scale).floor() as i64;
        (column.rem_euclid(self.width), row.rem_euclid(self.height))
    }

    fn cell(&self, p: [f32; 3]) -> usize {
        let (column, row) = self.column_row(p);
        (row * self.width + column) as usize
    }

    /// Ranges of `order` with all points whose x and y differ by at most a cell's side from those of
    /// `p`. Some ranges may be empty.
    pub fn around(&self, p: [f32; 3]) -> Around {
        let (column, row) = self.column_row(p);
        let whole = column > 0 && column + 1 < self.width;
        std::array::from_fn(|k| {
            let (k_row, k_column) = (k as i64 / 3, k as i64 % 3);
            let row = (row + k_row - 1).rem_euclid(self.height) * self.width;
            if whole {
                // The three cells of a row follow each other: one range, and two empty ones.
                let first = (row + column - 1) as usize;
                return match k_column {
                    0 => self.start[first] as usize..self.start[first + 3] as usize,
                    _ => 0..0,
                };
            }
            let cell = (row + (column + k_column - 1).rem_euclid(self.width)) as usize;
            self.start[cell] as usize..self.start[cell + 1] as usize
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cloud::hash;

    #[test]
    fn every_near_point_is_found_once() {
        for (count, span) in [(1usize, 1.0), (40, 5.0), (500, 100.0), (2000, 1e5)] {
            let value = |i: usize, seed| (hash(i as u64, seed) >> 40) as f32 / 16_777_216.0 * span;
            let mut at: Vec<[f32; 3]> = (0..count)
                .map(|i| [value(i, 1), value(i, 2), 0.0])
                .collect();
            at[0] = [1e9, -1e9, 0.0];
            let cell = span / 10.0;
            let grid = Grid::new(&at, cell);
            let mut sorted = grid.order.clone();
            sorted.sort_unstable();
            assert!(
                sorted
                    .iter()
                    .enumerate()
                    .all(|(i, point)| i == *point as usize)
            );
            for p in at.iter().take(50) {
                let near =
                    |q: &[f32; 3]| (q[0] - p[0]).abs() <= cell && (q[1] - p[1]).abs() <= cell;
                let mut found: Vec<u32> = grid
                    .around(*p)
                    .into_iter()
                    .flatten()
                    .map(|i| grid.order[i])
                    .collect();
                found.retain(|i| near(&at[*i as usize]));
                found.sort_unstable();
                let all: Vec<u32> = (0..count as u32)
                    .filter(|i| near(&at[*i as usize]))
                    .collect();
                assert_eq!(found, all);
            }
        }
    }
}
