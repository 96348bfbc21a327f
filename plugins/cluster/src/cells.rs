//! Points sorted by the cells of a grid, so that the neighbours of a cell are a few runs of memory.
//!
//! Cells are ordered by y, then z, then x. Cells with the same y and z are a row; the points of
//! neighbouring cells of a row lie one after another.

use puncta_sdk::run::chunks_mut;
use puncta_sdk::{Cancelled, Failure, Run};
use std::ops::Range;
use std::sync::{Mutex, PoisonError};

/// Points of a task.
const CHUNK: usize = 1 << 14;
/// Most bands that the points are sorted into first.
const BANDS: u64 = 1 << 13;

/// A row of cells.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Row {
    y: u32,
    z: u32,
    first: u32,
}

/// Points by cell; D is 2 or 3.
#[derive(Debug)]
pub struct Cells<const D: usize> {
    /// Row of the table of each point.
    pub order: Vec<u32>,
    /// Positions of the points, along x, y, z.
    pub at: [Vec<f64>; D],
    /// Cell c has the points `starts[c]..starts[c + 1]`.
    pub starts: Vec<u32>,
    columns: Vec<u32>,
    rows: Vec<Row>,
    /// Cells to each side in which neighbours are looked for.
    reach: u32,
}

/// The cell of a position along one axis.
struct Axis {
    low: f64,
    side: f64,
}

impl Axis {
    #[inline]
    fn cell(&self, at: f64) -> u64 {
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
        let cell = ((at - self.low) / self.side) as u64;
        cell
    }
}

impl<const D: usize> Cells<D> {
    /// Sorts the finite points into cells with the given sides. Two points whose cells differ by
    /// more than `reach` along an axis count as no neighbours.
    ///
    /// # Errors
    /// When cancelled, or when the positions span too many cells.
    pub fn new(
        at: [&[f64]; D],
        sides: [f64; D],
        reach: u32,
        run: &dyn Run,
    ) -> Result<Cells<D>, Failure> {
        let bits = if D == 2 { 30 } else { 21 };
        let axes = axes(at, sides, bits)?;
        run.progress(0.0, "sorting into cells")?;
        let (mut order, ends) = by_bands(at, &axes[1], run)?;
        let key = |row: u32| {
            let cell = |axis: usize| axes[axis].cell(at[axis][row as usize]);
            match D {
                2 => cell(1) << 32 | cell(0),
                _ => cell(1) << 42 | cell(D - 1) << 21 | cell(0),
            }
        };
        let keys = sort_bands(&mut order, &ends, &key, run)?;
        let mut cells = Cells {
            at: at.map(|values| gather(values, &order, run)),
            order,
            starts: Vec::new(),
            columns: Vec::new(),
            rows: Vec::new(),
            reach,
        };
        cells.set_cells(&keys);
        if run.cancelled() {
            Err(Cancelled.into())
        } else {
            Ok(cells)
        }
    }

    /// Lists the cells and rows; `keys` are the keys and sizes of the cells, in order.
    fn set_cells(&mut self, keys: &[Vec<(u64, u32)>]) {
        let count = keys.iter().map(Vec::len).sum();
        self.starts.reserve_exact(count + 1);
        self.columns.reserve_exact(count);
        let mut start = 0;
        for &(key, size) in keys.iter().flatten() {
            #[allow(clippy::cast_possible_truncation)]
            let (x, y, z) = match D {
                2 => (key as u32, (key >> 32) as u32, 0),
                _ => {
                    let part = |shift: u32| (key >> shift) as u32 & ((1 << 21) - 1);
                    (part(0), part(42), part(21))
                }
            };
            if self.rows.last().is_none_or(|row| (row.y, row.z) != (y, z)) {
                #[allow(clippy::cast_possible_truncation)]
                let first = self.columns.len() as u32;
                self.rows.push(Row { y, z, first });
            }
            self.columns.push(x);
            self.starts.push(start);
            start += size;
        }
        self.starts.push(start);
    }

    /// Number of points.
    #[must_use]
    pub fn len(&self) -> usize {
        self.order.len()
    }

    /// Whether there is no point.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.order.is_empty()
    }

    /// Number of cells with points.
    #[must_use]
    pub fn count(&self) -> usize {
        self.columns.len()
    }

    /// Points of a cell.
    #[must_use]
    pub fn points(&self, cell: usize) -> Range<usize> {
        self.starts[cell] as usize..self.starts[cell + 1] as usize
    }

    /// Cells of a row.
    fn row(&self, row: usize) -> Range<usize> {
        let end = self
            .rows
            .get(row + 1)
            .map_or(self.columns.len(), |next| next.first as usize);
        self.rows[row].first as usize..end
    }

    /// Runs of whole rows with at least `points` points each, for tasks.
    #[must_use]
    pub fn tasks(&self, points: usize) -> Vec<Range<usize>> {
        let mut tasks = Vec::new();
        let mut from = 0;
        for row in 0..self.rows.len() {
            let last = row + 1 == self.rows.len();
            let (begin, end) = (self.row(from).start, self.row(row).end);
            if last || (self.starts[end] - self.starts[begin]) as usize >= points {
                tasks.push(from..row + 1);
                from = row + 1;
            }
        }
        tasks
    }

    /// The cells of the rows of a task.
    #[must_use]
    pub fn of_task(&self, rows: &Range<usize>) -> Range<usize> {
        if rows.is_empty() {
            return 0..0;
        }
        self.row(rows.start).start..self.row(rows.end - 1).end
    }

    /// Calls `visit` for each cell of these rows with the runs of cells near it, its own row first.
    ///
    /// # Errors
    /// What `visit` says.
    pub fn sweep<E>(
        &self,
        rows: Range<usize>,
        mut visit: impl FnMut(usize, &[Range<usize>]) -> Result<(), E>,
    ) -> Result<(), E> {
        let mut near: Vec<Range<usize>> = Vec::new();
        for row in rows {
            near.clear();
            near.push(self.row(row));
            near.extend(
                self.rows_near(row)
                    .filter(|other| *other != row)
                    .map(|r| self.row(r)),
            );
            let ends: Vec<usize> = near.iter().map(|range| range.end).collect();
            near.iter_mut().for_each(|range| range.end = range.start);
            for cell in self.row(row) {
                let x = self.columns[cell];
                for (range, end) in near.iter_mut().zip(&ends) {
                    while range.start < *end && self.columns[range.start] + self.reach < x {
                        range.start += 1;
                    }
                    range.end = range.end.max(range.start);
                    while range.end < *end && self.columns[range.end] <= x + self.reach {
                        range.end += 1;
                    }
                }
                visit(cell, &near)?;
            }
        }
        Ok(())
    }

    /// Rows that are near a row, itself too.
    fn rows_near(&self, row: usize) -> impl Iterator<Item = usize> + '_ {
        let Row { y, z, .. } = self.rows[row];
        let reach = self.reach;
        (y.saturating_sub(reach)..=y + reach).flat_map(move |line| {
            let low = (line, z.saturating_sub(reach));
            let from = self.rows.partition_point(|other| (other.y, other.z) < low);
            let within = move |at: &usize| {
                let other = self.rows[*at];
                other.y == line && other.z <= z + reach
            };
            (from..self.rows.len()).take_while(within)
        })
    }

    /// Square of the distance between two points.
    #[inline]
    #[must_use]
    pub fn square(&self, a: usize, b: usize) -> f64 {
        self.square_from(&self.position(a), b)
    }

    /// Position of a point.
    #[inline]
    #[must_use]
    pub fn position(&self, point: usize) -> [f64; D] {
        std::array::from_fn(|axis| self.at[axis][point])
    }

    /// Square of the distance of a point from a position.
    #[inline]
    #[must_use]
    pub fn square_from(&self, from: &[f64; D], point: usize) -> f64 {
        let mut sum = 0.0;
        for (axis, from) in from.iter().enumerate() {
            let d = from - self.at[axis][point];
            sum += d * d;
        }
        sum
    }
}

fn poll(row: usize, run: &dyn Run) -> Result<(), Cancelled> {
    if row.is_multiple_of(1 << 18) && run.cancelled() {
        return Err(Cancelled);
    }
    Ok(())
}

fn axes<const D: usize>(at: [&[f64]; D], sides: [f64; D], bits: i32) -> Result<[Axis; D], Failure> {
    let mut axes = sides.map(|side| Axis { low: 0.0, side });
    for (axis, values) in axes.iter_mut().zip(at) {
        let finite = values.iter().copied().filter(|value| value.is_finite());
        let (low, high) = finite.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), value| {
            (low.min(value), high.max(value))
        });
        if low > high {
            continue;
        }
        let cells = (high - low) / axis.side;
        // Beyond, rounding could put two points of a cell farther apart than they may be.
        if cells.is_nan() || cells >= 2_f64.powi(bits) - 4.0 {
            let span = high - low;
            return Err(Failure::bad_parameter(
                "eps",
                format!("positions span {span:.3e} nm, too far for the radius"),
            )
            .remedy("raise the radius, or leave out positions far away by a range filter"));
        }
        axis.low = low;
    }
    Ok(axes)
}

/// The rows with a finite position by bands of y, and the end of each band.
fn by_bands<const D: usize>(
    at: [&[f64]; D],
    axis: &Axis,
    run: &dyn Run,
) -> Result<(Vec<u32>, Vec<usize>), Cancelled> {
    let count = at[0].len();
    let finite = |row: usize| at.iter().all(|values| values[row].is_finite());
    let top = (0..count)
        .filter(|row| finite(*row))
        .map(|row| axis.cell(at[1][row]));
    let lines = top.max().unwrap_or(0) / BANDS + 1;
    #[allow(clippy::cast_possible_truncation)]
    let band = |row: usize| (axis.cell(at[1][row]) / lines) as usize;
    let mut ends = vec![0_usize; BANDS as usize + 2];
    for row in 0..count {
        poll(row, run)?;
        if finite(row) {
            ends[band(row) + 1] += 1;
        }
    }
    for k in 1..ends.len() {
        ends[k] += ends[k - 1];
    }
    // Now where each band begins; afterwards where it ends.
    let mut order = vec![0_u32; ends[BANDS as usize + 1]];
    for row in 0..count {
        poll(row, run)?;
        if finite(row) {
            let end = &mut ends[band(row)];
            #[allow(clippy::cast_possible_truncation)]
            let small = row as u32;
            order[*end] = small;
            *end += 1;
        }
    }
    Ok((order, ends))
}

fn gather(values: &[f64], order: &[u32], run: &dyn Run) -> Vec<f64> {
    let mut out = vec![0.0; order.len()];
    chunks_mut(run, &mut out, CHUNK, &|chunk, part| {
        let rows = &order[chunk * CHUNK..];
        for (slot, row) in part.iter_mut().zip(rows) {
            *slot = values[*row as usize];
        }
    });
    out
}

/// Rows to be sorted by key; then keys and sizes of their cells.
struct Band<'a> {
    rows: &'a mut [u32],
    cells: Vec<(u64, u32)>,
}

/// Sorts each band by key, then row, and gives the keys and sizes of its cells. Band b ends at
/// `ends[b]`.
fn sort_bands(
    order: &mut [u32],
    ends: &[usize],
    key: &(dyn Fn(u32) -> u64 + Sync),
    run: &dyn Run,
) -> Result<Vec<Vec<(u64, u32)>>, Cancelled> {
    // Several bands a task, so that tasks are of like size.
    let mut tasks: Vec<Mutex<Band<'_>>> = Vec::new();
    let (mut rest, mut from) = (order, 0);
    for end in ends {
        let whole = rest.len() == end - from;
        if *end > from && (end - from >= CHUNK || whole) {
            let (part, after) = rest.split_at_mut(end - from);
            tasks.push(Mutex::new(Band {
                rows: part,
                cells: Vec::new(),
            }));
            (rest, from) = (after, *end);
        }
    }
    run.parallel(tasks.len(), &|task| {
        if run.cancelled() {
            return;
        }
        let mut task = tasks[task].lock().unwrap_or_else(PoisonError::into_inner);
        let Band { rows: part, cells } = &mut *task;
        let mut pairs: Vec<(u64, u32)> = part.iter().map(|row| (key(*row), *row)).collect();
        pairs.sort_unstable();
        for (slot, (key, row)) in part.iter_mut().zip(&pairs) {
            *slot = *row;
            match cells.last_mut() {
                Some((last, size)) if last == key => *size += 1,
                _ => cells.push((*key, 1)),
            }
        }
    });
    if run.cancelled() {
        return Err(Cancelled);
    }
    let cells = |task: Mutex<Band<'_>>| {
        task.into_inner()
            .unwrap_or_else(PoisonError::into_inner)
            .cells
    };
    Ok(tasks.into_iter().map(cells).collect())
}
