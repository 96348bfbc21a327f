//! Localisations sorted by the tiles of the image that they reach.

use crate::field::Field;
use crate::spots::{Fate, Gaussians, Spot, support};
use puncta_sdk::{Cancelled, Run};
use std::ops::Range;
use std::sync::Mutex;

/// Rows that one sorting task takes.
const CHUNK: usize = 1 << 15;
/// Largest side of a tile in pixels: 128 x 128 f64 stay in the second-level cache.
pub(crate) const TILE: usize = 128;
/// Padding of a tile's rows, so that vectors of pixels may run over the end: the longest vector
/// there is.
pub(crate) const PADDING: usize = 8;

/// Bounds of what is sorted together.
pub(crate) struct Sorting {
    /// Entries (a localisation in a tile) of one piece.
    pub(crate) piece: usize,
    /// Entries up to which a chunk is sorted at once.
    pub(crate) together: usize,
}

/// A tile: its first pixel and its size.
pub(crate) struct Tile {
    pub(crate) x: usize,
    pub(crate) y: usize,
    pub(crate) width: usize,
    pub(crate) height: usize,
    /// Length of a row in the scratch.
    pub(crate) stride: usize,
}

/// A chunk of rows: sorted already, or, with spots so wide that this takes much memory, still to be
/// sorted in pieces.
#[derive(Default)]
pub(crate) struct Chunk {
    pub(crate) sorted: Option<Sorted>,
    pub(crate) spots: Vec<Spot>,
    pub(crate) pieces: Vec<Range<usize>>,
    pub(crate) rendered: u64,
    pub(crate) outside: u64,
    pub(crate) invalid: u64,
}

/// Spots sorted by tile, in the order of the rows within each tile; one that reaches several tiles
/// is in each.
#[derive(Default)]
pub(crate) struct Sorted {
    pub(crate) entries: Vec<Spot>,
    /// First entry of each tile, and the end of the last.
    pub(crate) starts: Vec<u32>,
}

/// The image cut into square tiles.
pub(crate) struct Layout<'a> {
    pub(crate) field: &'a Field,
    /// log2 of the side of a tile.
    pub(crate) shift: u32,
    pub(crate) across: usize,
    down: usize,
}

impl<'a> Layout<'a> {
    pub(crate) fn new(field: &'a Field) -> Self {
        let (w, h) = (field.x.count(), field.y.count());
        // Small images still give several tiles to share among threads.
        let side = w.max(h).div_ceil(6).next_power_of_two().clamp(16, TILE);
        Self {
            field,
            shift: side.ilog2(),
            across: w.div_ceil(side),
            down: h.div_ceil(side),
        }
    }

    /// Number of tiles.
    pub(crate) fn tiles(&self) -> usize {
        self.across * self.down
    }

    /// Tile `index`, counted along rows of tiles.
    pub(crate) fn tile(&self, index: usize) -> Tile {
        let side = 1 << self.shift;
        let (x, y) = ((index % self.across) * side, (index / self.across) * side);
        let (w, h) = (self.field.x.count(), self.field.y.count());
        Tile {
            x,
            y,
            width: side.min(w - x),
            height: side.min(h - y),
            stride: side + PADDING,
        }
    }

    /// Columns and rows of tiles that a spot reaches.
    #[inline(always)]
    fn reach(&self, s: &Spot) -> (Range<usize>, Range<usize>) {
        (
            tiles(s.x, s.sx, self.shift, self.across),
            tiles(s.y, s.sy, self.shift, self.down),
        )
    }
}

/// The tiles that a spot reaches along one axis.
#[inline(always)]
fn tiles(u: i64, s: f32, shift: u32, count: usize) -> Range<usize> {
    let c = support(u, s);
    let start = c.start.max(0) as usize >> shift;
    let end = ((c.end.max(1) - 1) as usize >> shift).min(count - 1) + 1;
    start..end
}

/// Brings rows to pixels and sorts them by tile, in chunks.
pub(crate) fn prepare(
    spots: &Gaussians<'_>,
    rows: Range<usize>,
    layout: &Layout<'_>,
    limits: &Sorting,
    run: &dyn Run,
) -> Result<Vec<Chunk>, Cancelled> {
    let chunks: Vec<Mutex<Chunk>> = (0..rows.len().div_ceil(CHUNK))
        .map(|_| Mutex::default())
        .collect();
    run.parallel(chunks.len(), &|c| {
        if run.cancelled() {
            return;
        }
        let start = rows.start + c * CHUNK;
        let chunk = prepare_chunk(spots, start..rows.end.min(start + CHUNK), layout, limits);
        if let Ok(mut slot) = chunks[c].lock() {
            *slot = chunk;
        }
    });
    if run.cancelled() {
        return Err(Cancelled);
    }
    Ok(chunks
        .into_iter()
        .map(|c| c.into_inner().unwrap_or_default())
        .collect())
}

fn prepare_chunk(
    spots: &Gaussians<'_>,
    rows: Range<usize>,
    layout: &Layout<'_>,
    limits: &Sorting,
) -> Chunk {
    let mut chunk = Chunk {
        spots: Vec::with_capacity(rows.len()),
        ..Chunk::default()
    };
    let (mut from, mut entries, mut total) = (0, 0, 0);
    for i in rows {
        match spots.spot(i, layout.field) {
            Fate::Outside => chunk.outside += 1,
            Fate::Invalid => chunk.invalid += 1,
            Fate::Spot(s) => {
                let (across, down) = layout.reach(&s);
                let n = across.len() * down.len();
                if entries > 0 && entries + n > limits.piece {
                    chunk.pieces.push(from..chunk.spots.len());
                    (from, entries) = (chunk.spots.len(), 0);
                }
                entries += n;
                total += n;
                chunk.spots.push(s);
            }
        }
    }
    if entries > 0 {
        chunk.pieces.push(from..chunk.spots.len());
    }
    chunk.rendered = chunk.spots.len() as u64;
    if total > 0 && total <= limits.together {
        chunk.sorted = Some(sort_piece(&chunk.spots, layout));
        chunk.spots = Vec::new();
        chunk.pieces = Vec::new();
    }
    chunk
}

/// Counting sort by tile.
pub(crate) fn sort_piece(spots: &[Spot], layout: &Layout<'_>) -> Sorted {
    // starts[t + 2] counts tile t; summed up, starts[t + 1] is where it starts, and grows to where
    // it ends.
    let mut starts = vec![0_u32; layout.tiles() + 2];
    each_tile(spots, layout, |_, t| starts[t + 2] += 1);
    let mut sum = 0;
    for s in &mut starts {
        sum += *s;
        *s = sum;
    }
    let mut entries = vec![Spot::default(); sum as usize];
    each_tile(spots, layout, |s, t| {
        entries[starts[t + 1] as usize] = *s;
        starts[t + 1] += 1;
    });
    Sorted { entries, starts }
}

/// Calls `task` for each spot and each tile that it reaches.
#[inline(always)]
fn each_tile(spots: &[Spot], layout: &Layout<'_>, mut task: impl FnMut(&Spot, usize)) {
    for s in spots {
        let (across, down) = layout.reach(s);
        for ty in down {
            for tx in across.clone() {
                task(s, ty * layout.across + tx);
            }
        }
    }
}
