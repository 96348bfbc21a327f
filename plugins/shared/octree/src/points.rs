//! Points as sorted Morton keys.

use crate::morton::{BITS, Key, decode, encode};
use puncta_sdk::Failure;
use puncta_sdk::run::{Cancelled, Run, map};
use std::sync::{Mutex, PoisonError};

/// Rows that a task reads at a time.
const CHUNK: usize = 1 << 16;
/// First pass of the sort: bits of the key that choose the bucket.
const BUCKET_BITS: u32 = 12;

/// The cube that an octree divides. Lengths in nm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cube {
    /// Its low corner.
    pub low: [f64; 3],
    /// Its side, above 0.
    pub side: f64,
}

impl Cube {
    /// Side of a cell of a level, nm.
    #[must_use]
    pub fn cell(&self, level: u32) -> f64 {
        self.side / f64::from(1u32 << level.min(BITS))
    }

    /// Coordinates of the finest cell that holds a point; points outside go to the nearest one.
    /// None when a coordinate is not finite.
    #[must_use]
    #[inline]
    pub fn place(&self, point: [f64; 3]) -> Option<[u32; 3]> {
        if !point.iter().all(|x| x.is_finite()) {
            return None;
        }
        let inverse = f64::from(1u32 << BITS) / self.side;
        let most = f64::from((1u32 << BITS) - 1);
        let mut place = [0; 3];
        for axis in 0..3 {
            place[axis] = ((point[axis] - self.low[axis]) * inverse).clamp(0.0, most) as u32;
        }
        Some(place)
    }

    /// Centre of the finest cell with these coordinates.
    #[must_use]
    #[inline]
    pub fn centre(&self, place: [u32; 3]) -> [f64; 3] {
        let size = self.side / f64::from(1u32 << BITS);
        std::array::from_fn(|axis| self.low[axis] + (f64::from(place[axis]) + 0.5) * size)
    }
}

/// Lowest and highest coordinates of the rows whose coordinates are all finite, and their number.
///
/// # Errors
/// When the columns differ in length, or cancelled.
pub fn bounds(columns: [&[f64]; 3], run: &dyn Run) -> Result<([[f64; 3]; 2], usize), Failure> {
    check(columns)?;
    let parts = map(run, columns[0].len().div_ceil(CHUNK), &|chunk| {
        let (mut low, mut high, mut count) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3], 0);
        if !run.cancelled() {
            for [x, y, z] in rows(columns, chunk) {
                if x.is_finite() && y.is_finite() && z.is_finite() {
                    for (axis, x) in [x, y, z].into_iter().enumerate() {
                        low[axis] = x.min(low[axis]);
                        high[axis] = x.max(high[axis]);
                    }
                    count += 1;
                }
            }
        }
        ([low, high], count)
    });
    if run.cancelled() {
        return Err(Cancelled.into());
    }
    let empty = ([[f64::INFINITY; 3], [f64::NEG_INFINITY; 3]], 0);
    Ok(parts.into_iter().fold(empty, |(all, count), (part, more)| {
        let low = std::array::from_fn(|a| all[0][a].min(part[0][a]));
        let high = std::array::from_fn(|a| all[1][a].max(part[1][a]));
        ([low, high], count + more)
    }))
}

fn rows(columns: [&[f64]; 3], chunk: usize) -> impl Iterator<Item = [f64; 3]> + '_ {
    let range = chunk * CHUNK..((chunk + 1) * CHUNK).min(columns[0].len());
    let [x, y, z] = columns.map(|column| column.get(range.clone()).unwrap_or_default());
    x.iter().zip(y).zip(z).map(|((x, y), z)| [*x, *y, *z])
}

fn check(columns: [&[f64]; 3]) -> Result<(), Failure> {
    let rows = columns[0].len();
    if let Some(other) = columns.iter().find(|column| column.len() != rows) {
        let message = format!("one coordinate has {rows} rows, another {}", other.len());
        return Err(Failure::bad_input(message).remedy("columns of one table have equal lengths"));
    }
    if rows >= u32::MAX as usize {
        let message = format!("the table has {rows} rows, more than 4294967294");
        return Err(Failure::bad_input(message).remedy("split it first"));
    }
    Ok(())
}

/// The sorted Morton keys of points in a cube.
#[derive(Clone, Debug)]
pub struct Points {
    cube: Cube,
    keys: Vec<Key>,
    left_out: usize,
}

impl Points {
    /// Sorts points by key: a radix sort by the top 12 bits, then each bucket by itself, all on the
    /// threads of the pool. Rows with a coordinate that is not finite are left out.
    ///
    /// # Errors
    /// When the columns differ in length, there are more than 2^32 - 2 rows, the cube's side is no
    /// positive number, or cancelled.
    pub fn new(columns: [&[f64]; 3], cube: Cube, run: &dyn Run) -> Result<Points, Failure> {
        check(columns)?;
        if !(cube.side.is_finite() && cube.side > 0.0 && cube.low.iter().all(|x| x.is_finite())) {
            let message = format!("an octree cannot have a side of {} nm", cube.side);
            return Err(Failure::bad_input(message).remedy("check the coordinates' range"));
        }
        let rows_of = |chunk| rows(columns, chunk);
        let chunks = map(run, columns[0].len().div_ceil(CHUNK), &|chunk| {
            if run.cancelled() {
                return Bucketed::default();
            }
            let places = rows_of(chunk).filter_map(|point| cube.place(point));
            Bucketed::new(places.map(encode).collect())
        });
        if run.cancelled() {
            return Err(Cancelled.into());
        }
        let count = chunks.iter().map(|chunk| chunk.keys.len()).sum();
        let keys = merge(&chunks, count, run)?;
        Ok(Points {
            cube,
            keys,
            left_out: columns[0].len() - count,
        })
    }

    /// The cube.
    #[must_use]
    pub fn cube(&self) -> Cube {
        self.cube
    }

    /// The keys, sorted.
    #[must_use]
    pub fn keys(&self) -> &[Key] {
        &self.keys
    }

    /// Number of points.
    #[must_use]
    pub fn len(&self) -> usize {
        self.keys.len()
    }

    /// Whether there is none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.keys.is_empty()
    }

    /// Rows without a place.
    #[must_use]
    pub fn left_out(&self) -> usize {
        self.left_out
    }

    /// Place of a point in the order of the keys, to 2^-21 of the cube's side. NaN if there is none.
    #[must_use]
    #[inline]
    pub fn place(&self, i: usize) -> [f64; 3] {
        let key = self.keys.get(i);
        key.map_or([f64::NAN; 3], |key| self.cube.centre(decode(*key)))
    }
}

/// A chunk's keys by bucket.
#[derive(Default)]
struct Bucketed {
    keys: Vec<Key>,
    starts: Vec<u32>,
}

impl Bucketed {
    fn new(keys: Vec<Key>) -> Bucketed {
        let mut starts = vec![0; (1 << BUCKET_BITS) + 1];
        for key in &keys {
            starts[bucket(*key) + 1] += 1;
        }
        for i in 1..starts.len() {
            starts[i] += starts[i - 1];
        }
        let (mut next, mut sorted) = (starts.clone(), vec![0; keys.len()]);
        for key in keys {
            let place = &mut next[bucket(key)];
            sorted[*place as usize] = key;
            *place += 1;
        }
        Bucketed {
            keys: sorted,
            starts,
        }
    }

    fn members(&self, bucket: usize) -> &[Key] {
        self.starts
            .get(bucket..=bucket + 1)
            .and_then(|ends| self.keys.get(ends[0] as usize..ends[1] as usize))
            .unwrap_or_default()
    }
}

#[inline]
fn bucket(key: Key) -> usize {
    (key >> (3 * BITS - BUCKET_BITS)) as usize
}

fn merge(chunks: &[Bucketed], count: usize, run: &dyn Run) -> Result<Vec<Key>, Cancelled> {
    let mut keys = vec![0; count];
    let mut rest = keys.as_mut_slice();
    let mut slots = Vec::new();
    for bucket in 0..1 << BUCKET_BITS {
        let size = chunks
            .iter()
            .map(|c| c.members(bucket).len())
            .sum::<usize>();
        if let Some(slice) = rest.split_off_mut(..size)
            && size > 0
        {
            slots.push((bucket, Mutex::new(slice)));
        }
    }
    run.parallel(slots.len(), &|i| {
        if !run.cancelled() {
            let (bucket, slot) = &slots[i];
            let mut slot = slot.lock().unwrap_or_else(PoisonError::into_inner);
            let members = chunks.iter().flat_map(|chunk| chunk.members(*bucket));
            for (to, from) in slot.iter_mut().zip(members) {
                *to = *from;
            }
            slot.sort_unstable();
        }
    });
    drop(slots);
    if run.cancelled() {
        return Err(Cancelled);
    }
    Ok(keys)
}
