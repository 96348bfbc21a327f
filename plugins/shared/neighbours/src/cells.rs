//! Which sorted points lie in which cell: an array of all cells, or a list of the occupied ones.

use std::ops::Range;

/// Cell numbers along an axis are kept within this limit, so that three of them make one key. What
/// lies further out shares the last cell: right still, only slower.
const LIMIT: i64 = (1 << 41) - 1;
const BITS: u32 = 42;

/// Cell number of a coordinate; `inverse` is one over the edge. Never decreases with `x`.
#[inline]
pub(crate) fn index(x: f64, inverse: f64) -> i64 {
    #[allow(clippy::cast_precision_loss)]
    let limit = LIMIT as f64;
    let place = (x * inverse).clamp(-limit, limit);
    // `floor` is a call where the compiler may not assume SSE 4.1.
    let whole = place as i64;
    #[allow(clippy::cast_precision_loss)]
    let above = whole as f64 > place;
    whole - i64::from(above)
}

/// Place of a cell in row-major order, for any cell numbers.
#[inline]
pub(crate) fn key<const D: usize>(cell: &[i64; D]) -> u128 {
    let mut key = 0;
    for &number in cell.iter().rev() {
        key = key << BITS | (number + LIMIT + 1) as u128;
    }
    key
}

/// Numbers of the row of a key: all axes but x, lowest first.
fn row_of(row: u128) -> [i64; 2] {
    let part = |shift: u32| ((row >> shift) & ((1 << BITS) - 1)) as i64 - LIMIT - 1;
    [part(0), part(BITS)]
}

/// Cells in row-major order.
#[derive(Clone, Debug)]
pub(crate) struct Cells<const D: usize> {
    /// Lowest and highest cell number of the points along each axis.
    pub(crate) low: [i64; D],
    pub(crate) high: [i64; D],
    pub(crate) kind: Kind<D>,
}

#[derive(Clone, Debug)]
pub(crate) enum Kind<const D: usize> {
    /// `starts[c]..starts[c + 1]` are the points of cell c of a box of `shape` cells.
    Dense { shape: [usize; D], starts: Vec<u32> },
    /// `starts[c]..starts[c + 1]` are the points of the cell `x[c]`; the cells of `rows[r]` are
    /// `row_cells[r]..row_cells[r + 1]`.
    Sparse {
        starts: Vec<u32>,
        x: Vec<i64>,
        rows: Vec<u128>,
        row_cells: Vec<u32>,
    },
}

impl<const D: usize> Cells<D> {
    /// The occupied cells, given the key and the end of each.
    pub(crate) fn sparse(low: [i64; D], high: [i64; D], ends: &[(u128, u32)]) -> Self {
        let mut starts = Vec::with_capacity(ends.len() + 1);
        let (mut x, mut rows, mut row_cells) = (Vec::with_capacity(ends.len()), vec![], vec![]);
        starts.push(0);
        for (cell, &(key, end)) in (0u32..).zip(ends) {
            starts.push(end);
            x.push((key & ((1 << BITS) - 1)) as i64 - LIMIT - 1);
            if rows.last() != Some(&(key >> BITS)) {
                rows.push(key >> BITS);
                row_cells.push(cell);
            }
        }
        row_cells.push(ends.len() as u32);
        let kind = Kind::Sparse {
            starts,
            x,
            rows,
            row_cells,
        };
        Self { low, high, kind }
    }

    /// Calls `visit` with the non-empty slices of sorted indices that make up the cells from `low`
    /// to `high`, both included, in increasing order.
    #[inline]
    pub(crate) fn runs(&self, low: [i64; D], high: [i64; D], mut visit: impl FnMut(Range<usize>)) {
        let low: [i64; D] = std::array::from_fn(|a| low[a].max(self.low[a]));
        let high: [i64; D] = std::array::from_fn(|a| high[a].min(self.high[a]));
        if (0..D).any(|a| low[a] > high[a]) {
            return;
        }
        match &self.kind {
            Kind::Dense { shape, starts } => {
                let from: [usize; D] = std::array::from_fn(|a| (low[a] - self.low[a]) as usize);
                let to: [usize; D] = std::array::from_fn(|a| (high[a] - self.low[a]) as usize);
                let (z_from, z_to) = if D > 2 { (from[2], to[2]) } else { (0, 0) };
                for z in z_from..=z_to {
                    for y in from[1]..=to[1] {
                        let row = (z * shape[1] + y) * shape[0];
                        let begin = starts[row + from[0]] as usize;
                        let end = starts[row + to[0] + 1] as usize;
                        if begin < end {
                            visit(begin..end);
                        }
                    }
                }
            }
            Kind::Sparse { .. } => self.sparse_runs(&low, &high, &mut visit),
        }
    }

    #[inline(never)]
    fn sparse_runs(&self, low: &[i64; D], high: &[i64; D], visit: &mut dyn FnMut(Range<usize>)) {
        let Kind::Sparse {
            starts,
            x,
            rows,
            row_cells,
        } = &self.kind
        else {
            return;
        };
        let (z_low, z_high) = if D > 2 { (low[2], high[2]) } else { (0, 0) };
        let place = |z: i64, y: i64| match D {
            2 => key(&[y]),
            _ => key(&[y, z]),
        };
        let seek = |from: usize, key: u128| from + rows[from..].partition_point(|row| *row < key);
        let mut at = seek(0, place(z_low, low[1]));
        while let Some(&row) = rows.get(at) {
            let [y, z] = row_of(row);
            let z = if D > 2 { z } else { 0 };
            if z > z_high || (z == z_high && y > high[1]) {
                break;
            }
            if y < low[1] {
                at = seek(at, place(z, low[1]));
            } else if y > high[1] {
                at = seek(at, place(z + 1, low[1]));
            } else {
                let (first, last) = (row_cells[at] as usize, row_cells[at + 1] as usize);
                let cells = &x[first..last];
                let begin = first + cells.partition_point(|x| *x < low[0]);
                let end = first + cells.partition_point(|x| *x <= high[0]);
                if begin < end {
                    visit(starts[begin] as usize..starts[end] as usize);
                }
                at += 1;
            }
        }
    }

    /// End of the sorted points of the cell, which has at least one.
    pub(crate) fn end(&self, cell: &[i64; D]) -> usize {
        let mut end = 0;
        self.runs(*cell, *cell, |run| end = run.end);
        end
    }
}
