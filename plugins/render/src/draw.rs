//! Drawing of tiles.

use crate::normal::Normal;
use crate::spots::{ONE, Spot, support};
use crate::tiles::{Layout, PADDING, Sorted, TILE, Tile};
use pulp::{Arch, Simd, WithSimd};
use puncta_sdk::{Cancelled, Run};
use std::ops::Range;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

/// What is being done, for the progress.
const PHASE: &str = "rendering localisations";
/// Room for the edges of a tile's pixels.
const LINE: usize = TILE + 2 * PADDING;
/// Localisations between two looks at cancel.
const BATCH: usize = 16;

/// What a task needs to draw a tile, reused from tile to tile.
struct Scratch {
    tile: Vec<f64>,
    edges: [f64; LINE],
    along_x: [f64; LINE],
    along_y: [f64; LINE],
}

/// The image, drawn in one or more rounds.
pub(crate) struct Canvas<'a> {
    pub(crate) layout: &'a Layout<'a>,
    normal: Normal,
    arch: Arch,
    /// Rows of pixels of each row of tiles.
    bands: Vec<Mutex<&'a mut [f32]>>,
    /// Nothing is written yet.
    pub(crate) fresh: bool,
    pub(crate) sum: f64,
    pub(crate) run: &'a dyn Run,
}

impl<'a> Canvas<'a> {
    /// An image of which nothing is written yet.
    pub(crate) fn new(layout: &'a Layout<'a>, out: &'a mut [f32], run: &'a dyn Run) -> Self {
        let bands = out
            .chunks_mut(layout.field.x.count() << layout.shift)
            .map(Mutex::new)
            .collect();
        Self {
            layout,
            normal: Normal::new(),
            arch: Arch::new(),
            bands,
            fresh: true,
            sum: 0.0,
            run,
        }
    }

    /// Adds the sorted spots to the image, and reports progress over `span`.
    pub(crate) fn draw(&mut self, sorted: &[Sorted], span: [f64; 2]) -> Result<(), Cancelled> {
        let tiles = self.layout.tiles();
        let scratches: Mutex<Vec<Scratch>> = Mutex::default();
        let sums = Mutex::new(vec![0.0; tiles]);
        let count = |t: usize| {
            sorted
                .iter()
                .map(|s| (s.starts[t + 1] - s.starts[t]) as usize)
                .sum::<usize>()
        };
        // The fullest tiles first, so that no thread starts a long one at the end.
        let mut order: Vec<(usize, usize)> = (0..tiles)
            .map(|t| (count(t), t))
            .filter(|(n, _)| self.fresh || *n > 0)
            .collect();
        order.sort_unstable_by_key(|&(n, t)| (std::cmp::Reverse(n), t));
        let done = AtomicUsize::new(0);
        self.run.parallel(order.len(), &|i| {
            let part = done.fetch_add(1, Ordering::Relaxed) as f64 / order.len() as f64;
            let whole = span[0] + (span[1] - span[0]) * part;
            // Few reports: each costs the host a little.
            let report = i % 64 == 0 && self.run.progress(whole, PHASE).is_err();
            if report || self.run.cancelled() {
                return;
            }
            let (count, index) = order[i];
            let unused = scratches.lock().ok().and_then(|mut s| s.pop());
            let mut scratch = unused.unwrap_or_else(Scratch::new);
            let sum = self.draw_tile(sorted, index, count > 0, &mut scratch);
            if let Ok(mut s) = sums.lock() {
                s[index] = sum;
            }
            if let Ok(mut s) = scratches.lock() {
                s.push(scratch);
            }
        });
        if self.run.cancelled() {
            return Err(Cancelled);
        }
        self.sum += sums.into_inner().unwrap_or_default().iter().sum::<f64>();
        self.fresh = false;
        Ok(())
    }

    /// Draws one tile, if there is something in it; returns the sum of what it adds.
    fn draw_tile(&self, sorted: &[Sorted], index: usize, some: bool, scratch: &mut Scratch) -> f64 {
        let tile = self.layout.tile(index);
        scratch.tile.clear();
        scratch.tile.resize(tile.stride * tile.height, 0.0);
        if some {
            self.arch.dispatch(DrawTile {
                sorted,
                index,
                tile: &tile,
                normal: &self.normal,
                scratch,
                run: self.run,
            });
        }
        self.flush(index, &tile, scratch)
    }

    /// Adds a tile to the image, or writes it when nothing is written yet; returns its sum.
    fn flush(&self, index: usize, tile: &Tile, scratch: &Scratch) -> f64 {
        let Ok(mut band) = self.bands[index / self.layout.across].lock() else {
            return 0.0;
        };
        let rows = band
            .chunks_mut(self.layout.field.x.count())
            .zip(scratch.tile.chunks(tile.stride));
        rows.map(|(row, from)| {
            let (row, from) = (&mut row[tile.x..tile.x + tile.width], &from[..tile.width]);
            if self.fresh {
                row.iter_mut().zip(from).for_each(|(o, v)| *o = *v as f32);
            } else {
                row.iter_mut()
                    .zip(from)
                    .for_each(|(o, v)| *o = (f64::from(*o) + v) as f32);
            }
            sum(from)
        })
        .sum()
    }
}

/// Sum of a row, in eight parts so that one addition need not wait for the last.
fn sum(values: &[f64]) -> f64 {
    let (blocks, rest) = values.as_chunks::<8>();
    let mut sums = [0.0; 8];
    for block in blocks {
        sums.iter_mut().zip(block).for_each(|(s, v)| *s += v);
    }
    sums.iter().sum::<f64>() + rest.iter().sum::<f64>()
}

impl Scratch {
    fn new() -> Self {
        Self {
            tile: Vec::new(),
            edges: [0.0; LINE],
            along_x: [0.0; LINE],
            along_y: [0.0; LINE],
        }
    }
}

/// Draws the spots of tile `index` into `scratch`, in the order of the rows.
struct DrawTile<'a> {
    sorted: &'a [Sorted],
    index: usize,
    tile: &'a Tile,
    normal: &'a Normal,
    scratch: &'a mut Scratch,
    run: &'a dyn Run,
}

impl WithSimd for DrawTile<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        // 0, 1, 2, ...: the numbers of the edges.
        let numbers: [f64; LINE] = std::array::from_fn(|i| i as f64);
        for s in self.sorted {
            let entries =
                &s.entries[s.starts[self.index] as usize..s.starts[self.index + 1] as usize];
            for part in entries.chunks(BATCH) {
                if self.run.cancelled() {
                    return;
                }
                for spot in part {
                    draw_spot(simd, spot, self.tile, self.normal, &numbers, self.scratch);
                }
            }
        }
    }
}

#[inline(always)]
fn draw_spot<S: Simd>(
    simd: S,
    spot: &Spot,
    tile: &Tile,
    normal: &Normal,
    numbers: &[f64; LINE],
    scratch: &mut Scratch,
) {
    let Scratch {
        tile: pixels,
        edges,
        along_x,
        along_y,
    } = scratch;
    let xs = shares(
        simd,
        (spot.x, spot.sx),
        (tile.x, tile.width),
        normal,
        numbers,
        edges,
        along_x,
    );
    let ys = shares(
        simd,
        (spot.y, spot.sy),
        (tile.y, tile.height),
        normal,
        numbers,
        edges,
        along_y,
    );
    let blocks = xs.len().next_multiple_of(S::F64_LANES);
    let along_x = S::as_simd_f64s(&along_x[..blocks]).0;
    let weight = f64::from(spot.weight);
    let rows = pixels.chunks_exact_mut(tile.stride).skip(ys.start);
    for (row, share) in rows.zip(&along_y[..ys.len()]) {
        let factor = simd.splat_f64s(share * weight);
        let row = S::as_mut_simd_f64s(&mut row[xs.start..xs.start + blocks]).0;
        // Multiplied and added apart: a fused step would give other bits on other processors.
        for (o, s) in row.iter_mut().zip(along_x) {
            *o = simd.add_f64s(*o, simd.mul_f64s(factor, *s));
        }
    }
}

/// The pixels of a tile's axis that a spot reaches, and its shares of them in `shares`.
///
/// From the end of that range to the next block stand shares of pixels beyond: zero where the spot
/// ends, and otherwise for the padding beyond the tile.
#[inline(always)]
fn shares<S: Simd>(
    simd: S,
    (u, s): (i64, f32),
    (low, count): (usize, usize),
    normal: &Normal,
    numbers: &[f64; LINE],
    edges: &mut [f64; LINE],
    shares: &mut [f64; LINE],
) -> Range<usize> {
    let c = support(u, s);
    let low = low as i64;
    let start = (c.start - low).clamp(0, count as i64);
    let end = (c.end - low).clamp(start, count as i64);
    let range = start as usize..end as usize;
    if c.end - c.start == 1 {
        // All of it, also where a point lies on the pixel's low edge.
        shares[..PADDING].fill(0.0);
        shares[0] = 1.0;
        return range;
    }
    let inverse = simd.splat_f64s(1.0 / f64::from(s));
    let first = simd.splat_f64s((((low + start) << 32) - u) as f64 / ONE);
    let blocks = range.len().next_multiple_of(S::F64_LANES);
    let computed = (range.len() + 1).next_multiple_of(S::F64_LANES);
    let numbers = S::as_simd_f64s(&numbers[..computed]).0;
    for (e, n) in S::as_mut_simd_f64s(&mut edges[..computed])
        .0
        .iter_mut()
        .zip(numbers)
    {
        *e = normal.at(simd, simd.mul_f64s(simd.add_f64s(first, *n), inverse));
    }
    S::as_mut_simd_f64s(&mut edges[computed..computed + S::F64_LANES])
        .0
        .fill(normal.end(simd));
    let before = S::as_simd_f64s(&edges[..blocks]).0;
    let after = S::as_simd_f64s(&edges[1..=blocks]).0;
    for ((s, a), b) in S::as_mut_simd_f64s(&mut shares[..blocks])
        .0
        .iter_mut()
        .zip(after)
        .zip(before)
    {
        *s = simd.sub_f64s(*a, *b);
    }
    range
}
