//! Sorting points by cell in two passes: chunks of rows into buckets of cells, then each bucket.
//!
//! Both passes write slices of their own only, and depend on the number of rows alone, so that the
//! order is the same for any number of threads: by cell, then by row.

use crate::Grid;
use crate::cells::{Cells, Kind, index, key};
use crate::source::{Extent, Source};
use puncta_sdk::run::{Run, map};
use puncta_sdk::{Cancelled, Failure};
use std::sync::{Mutex, PoisonError};

/// Most buckets; a bucket's points and cells then fit the second cache at ten million points.
const BUCKETS: usize = 1024;
/// Cells a point up to which all cells are kept as an array.
const CELLS_A_POINT: f64 = 6.0;
/// Few points may have this many cells.
const CELLS: f64 = (1 << 20) as f64;

impl<const D: usize> Grid<D> {
    /// Sorts points by cells of this edge (nm, or the unit of the points).
    ///
    /// # Errors
    /// When the columns differ in length, have more than 2^32 - 1 rows, or the edge is not a
    /// positive number; or cancelled.
    pub fn new(points: [&[f64]; D], edge: f64, run: &dyn Run) -> Result<Self, Failure> {
        Self::scaled(points, [1.0; D], edge, run)
    }

    /// As [`Grid::new`], with a factor that each axis is multiplied by first.
    ///
    /// # Errors
    /// As [`Grid::new`], and when a factor is not a finite number.
    pub fn scaled(
        points: [&[f64]; D],
        scale: [f64; D],
        edge: f64,
        run: &dyn Run,
    ) -> Result<Self, Failure> {
        const { assert!(D == 2 || D == 3, "grids have two or three dimensions") };
        check(&points, &scale, edge)?;
        let source = Source { points, scale };
        let inverse = (1.0 / edge).min(f64::MAX);
        let extent = Extent::of(&source, run)?;
        let low = extent.low.map(|x| index(x, inverse));
        let high = extent.high.map(|x| index(x, inverse));
        let layout = Layout::new(&source, extent.count, low, high, inverse, run)?;
        let chunks = scatter(&source, &layout, run)?;
        let (axes, rows, kind) = gather(&source, &layout, &chunks, extent.count, run)?;
        let cells = match kind {
            Gathered::Dense(shape, starts) => Cells {
                low,
                high,
                kind: Kind::Dense { shape, starts },
            },
            Gathered::Sparse(ends) => Cells::sparse(low, high, &ends),
        };
        Ok(Self {
            edge,
            scale,
            axes,
            rows,
            cells,
            input_rows: source.rows(),
        })
    }
}

pub(crate) fn check<const D: usize>(
    points: &[&[f64]; D],
    scale: &[f64; D],
    edge: f64,
) -> Result<(), Failure> {
    let rows = points[0].len();
    if let Some(other) = points.iter().find(|axis| axis.len() != rows) {
        let message = format!("one coordinate has {rows} rows, another {}", other.len());
        return Err(Failure::bad_input(message).remedy("columns of one table have equal lengths"));
    }
    if rows >= u32::MAX as usize {
        let message = format!("the table has {rows} rows, more than 4294967294");
        return Err(Failure::bad_input(message).remedy("split it first"));
    }
    if !(edge.is_finite() && edge > 0.0) {
        let message = format!("cells of edge {edge} cannot be made; the radius must be above 0");
        return Err(Failure::bad_input(message));
    }
    if let Some(factor) = scale.iter().find(|factor| !factor.is_finite()) {
        return Err(Failure::bad_input(format!(
            "an axis cannot be scaled by {factor}"
        )));
    }
    Ok(())
}

/// How cells are numbered and put into buckets.
enum Order<const D: usize> {
    Dense { shape: [usize; D], shift: u32 },
    Sparse { splitters: Vec<u128> },
}

struct Layout<const D: usize> {
    inverse: f64,
    low: [i64; D],
    buckets: usize,
    order: Order<D>,
}

impl<const D: usize> Layout<D> {
    fn new(
        source: &Source<D>,
        count: usize,
        low: [i64; D],
        high: [i64; D],
        inverse: f64,
        run: &dyn Run,
    ) -> Result<Self, Cancelled> {
        let shape: [usize; D] = std::array::from_fn(|a| (high[a] - low[a]) as usize + 1);
        #[allow(clippy::cast_precision_loss)]
        let (cells, points) = (
            shape.iter().map(|n| *n as f64).product::<f64>(),
            count as f64,
        );
        let wanted = (count / 8192).clamp(1, BUCKETS);
        let mut layout = Self {
            inverse,
            low,
            buckets: wanted,
            order: Order::Sparse { splitters: vec![] },
        };
        if cells <= (CELLS_A_POINT * points).max((64.0 * points).min(CELLS)) {
            let cells: usize = shape.iter().product();
            let mut shift = 0;
            while (cells - 1) >> shift >= wanted {
                shift += 1;
            }
            layout.buckets = ((cells - 1) >> shift) + 1;
            layout.order = Order::Dense { shape, shift };
        } else if wanted > 1 {
            let step = (source.rows() / (16 * wanted)).max(1);
            let sample = (0..source.rows())
                .step_by(step)
                .filter_map(|row| source.point(row));
            let mut keys: Vec<u128> = sample.map(|point| layout.key(&point)).collect();
            keys.sort_unstable();
            let splitters = (1..wanted).filter_map(|b| keys.get(b * keys.len() / wanted).copied());
            layout.order = Order::Sparse {
                splitters: splitters.collect(),
            };
        }
        if run.cancelled() {
            return Err(Cancelled);
        }
        Ok(layout)
    }

    fn key(&self, point: &[f64; D]) -> u128 {
        key(&point.map(|x| index(x, self.inverse)))
    }

    /// Number of the cell in the array of all cells.
    #[inline]
    fn cell(&self, point: &[f64; D], shape: &[usize; D]) -> usize {
        let mut cell = 0;
        for a in (0..D).rev() {
            cell = cell * shape[a] + (index(point[a], self.inverse) - self.low[a]) as usize;
        }
        cell
    }

    #[inline]
    fn bucket(&self, point: &[f64; D]) -> usize {
        match &self.order {
            Order::Dense { shape, shift } => self.cell(point, shape) >> shift,
            Order::Sparse { splitters } if splitters.is_empty() => 0,
            Order::Sparse { splitters } => {
                let key = self.key(point);
                splitters.partition_point(|splitter| *splitter <= key)
            }
        }
    }
}

/// Rows of a chunk sorted by bucket, and where each bucket starts.
struct Chunk {
    rows: Vec<u32>,
    starts: Vec<u32>,
}

fn scatter<const D: usize>(
    source: &Source<D>,
    layout: &Layout<D>,
    run: &dyn Run,
) -> Result<Vec<Chunk>, Cancelled> {
    const NOWHERE: u16 = u16::MAX;
    let chunks = map(run, source.chunks(), &|chunk| {
        let rows = source.rows_of(chunk);
        let mut starts = vec![0; layout.buckets + 1];
        let mut buckets = Vec::with_capacity(rows.len());
        for row in rows.clone() {
            if row & 0xfff == 0 && run.cancelled() {
                return Chunk {
                    rows: vec![],
                    starts,
                };
            }
            buckets.push(source.point(row).map_or(NOWHERE, |point| {
                let bucket = layout.bucket(&point);
                starts[bucket + 1] += 1;
                bucket as u16
            }));
        }
        for bucket in 0..layout.buckets {
            starts[bucket + 1] += starts[bucket];
        }
        let mut sorted = vec![0; starts[layout.buckets] as usize];
        let mut next = starts.clone();
        for (row, bucket) in rows.zip(buckets) {
            if bucket != NOWHERE {
                let place = &mut next[usize::from(bucket)];
                sorted[*place as usize] = row as u32;
                *place += 1;
            }
        }
        Chunk {
            rows: sorted,
            starts,
        }
    });
    if run.cancelled() {
        Err(Cancelled)
    } else {
        Ok(chunks)
    }
}

/// A bucket's part of the result.
struct Segment<'a, const D: usize> {
    axes: [&'a mut [f64]; D],
    rows: &'a mut [u32],
    /// Dense: end of each cell of the bucket.
    ends: &'a mut [u32],
    begin: usize,
    /// Sparse: key and end of each occupied cell of the bucket.
    keys: Vec<(u128, u32)>,
}

enum Gathered<const D: usize> {
    Dense([usize; D], Vec<u32>),
    Sparse(Vec<(u128, u32)>),
}

type Sorted<const D: usize> = ([Vec<f64>; D], Vec<u32>, Gathered<D>);

fn gather<const D: usize>(
    source: &Source<D>,
    layout: &Layout<D>,
    chunks: &[Chunk],
    count: usize,
    run: &dyn Run,
) -> Result<Sorted<D>, Cancelled> {
    let mut axes: [Vec<f64>; D] = std::array::from_fn(|_| vec![0.0; count]);
    let mut rows = vec![0; count];
    let (cells, span) = match &layout.order {
        Order::Dense { shape, shift } => (shape.iter().product(), 1 << shift),
        Order::Sparse { .. } => (0, 1),
    };
    let mut starts = vec![0; cells + 1];
    let mut segments = Vec::with_capacity(layout.buckets);
    {
        let mut axes_left = axes.each_mut().map(Vec::as_mut_slice);
        let (mut rows_left, mut ends) = (rows.as_mut_slice(), starts[1..].chunks_mut(span));
        let mut begin = 0;
        for bucket in 0..layout.buckets {
            let size = |c: &Chunk| (c.starts[bucket + 1] - c.starts[bucket]) as usize;
            let points = chunks.iter().map(size).sum();
            segments.push(Mutex::new(Segment {
                axes: axes_left.each_mut().map(|axis| take(axis, points)),
                rows: take(&mut rows_left, points),
                ends: ends.next().unwrap_or_default(),
                begin,
                keys: Vec::new(),
            }));
            begin += points;
        }
    }
    run.parallel(segments.len(), &|bucket| {
        if !run.cancelled() {
            let mut segment = segments[bucket]
                .lock()
                .unwrap_or_else(PoisonError::into_inner);
            match &layout.order {
                Order::Dense { shape, shift } => {
                    let cell = |point: &[f64; D]| layout.cell(point, shape) - (bucket << shift);
                    segment.count(source, chunks, bucket, &cell);
                }
                Order::Sparse { .. } => {
                    segment.sort(source, chunks, bucket, &|point| layout.key(point));
                }
            }
        }
    });
    if run.cancelled() {
        return Err(Cancelled);
    }
    let keys = segments.into_iter().flat_map(|segment| {
        segment
            .into_inner()
            .unwrap_or_else(PoisonError::into_inner)
            .keys
    });
    let kind = match &layout.order {
        Order::Dense { shape, .. } => {
            drop(keys);
            Gathered::Dense(*shape, starts)
        }
        Order::Sparse { .. } => Gathered::Sparse(keys.collect()),
    };
    Ok((axes, rows, kind))
}

/// The first `count` items of a slice, which keeps the rest.
fn take<'a, T>(slice: &mut &'a mut [T], count: usize) -> &'a mut [T] {
    slice.split_off_mut(..count).unwrap_or_default()
}

fn members<'a>(chunks: &'a [Chunk], bucket: usize) -> impl Iterator<Item = u32> + 'a {
    chunks.iter().flat_map(move |chunk| {
        let range = chunk.starts[bucket] as usize..chunk.starts[bucket + 1] as usize;
        chunk.rows[range].iter().copied()
    })
}

impl<const D: usize> Segment<'_, D> {
    fn put(&mut self, place: usize, row: u32, point: &[f64; D]) {
        self.rows[place] = row;
        for (axis, x) in self.axes.iter_mut().zip(point) {
            axis[place] = *x;
        }
    }

    /// Counting sort by cell.
    fn count(
        &mut self,
        source: &Source<D>,
        chunks: &[Chunk],
        bucket: usize,
        cell: &dyn Fn(&[f64; D]) -> usize,
    ) {
        let mut points = Vec::with_capacity(self.rows.len());
        for row in members(chunks, bucket) {
            let point = source.point(row as usize).unwrap_or([0.0; D]);
            let cell = cell(&point);
            self.ends[cell] += 1;
            points.push((row, cell as u32, point));
        }
        let mut next = self.begin as u32;
        for end in self.ends.iter_mut() {
            next += std::mem::replace(end, next);
        }
        for (row, cell, point) in points {
            let place = self.ends[cell as usize] as usize - self.begin;
            self.ends[cell as usize] += 1;
            self.put(place, row, &point);
        }
    }

    /// Comparison sort by key and row.
    fn sort(
        &mut self,
        source: &Source<D>,
        chunks: &[Chunk],
        bucket: usize,
        key: &dyn Fn(&[f64; D]) -> u128,
    ) {
        let point = |row: u32| source.point(row as usize).unwrap_or([0.0; D]);
        let mut keys: Vec<(u128, u32)> = members(chunks, bucket)
            .map(|row| (key(&point(row)), row))
            .collect();
        keys.sort_unstable();
        for (place, &(key, row)) in keys.iter().enumerate() {
            self.put(place, row, &point(row));
            let end = (self.begin + place + 1) as u32;
            match self.keys.last_mut() {
                Some(last) if last.0 == key => last.1 = end,
                _ => self.keys.push((key, end)),
            }
        }
    }
}
