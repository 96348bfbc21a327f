//! Localisations counted per pixel or voxel.
//!
//! A scatter of single counts into an image larger than the cache waits for memory at each row.
//! Here each chunk of rows is first sorted by bands of pixel rows (counting sort, in cache), then
//! each band is counted in a tile of its own that fits in the cache and is written to the image
//! once. Counts are whole numbers, so that order and threads do not matter.

use crate::field::{Field, Volume};
use crate::grid::Axis;
use puncta_sdk::{Cancelled, Run};
use std::ops::Range;
use std::sync::Mutex;

/// Rows that one sorting task takes.
const CHUNK: usize = 1 << 16;
/// Chunks sorted before the bands are counted: bounds the memory (4 bytes a row).
const ROUND: usize = 256;
/// Pixels of a band: a tile of u32 of half a mebibyte.
const BAND_PIXELS: usize = 1 << 17;

/// What became of the rows.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Counted {
    /// Rows counted in a pixel.
    pub inside: u64,
    /// Rows with finite positions outside the field of view.
    pub outside: u64,
    /// Rows with a position that is NaN or infinite.
    pub invalid: u64,
}

/// Pixel numbers of a chunk of rows, sorted by band; those of rows outside are at the end and mean
/// nothing.
#[derive(Default)]
struct Sorted {
    pixels: Vec<u32>,
    /// First entry of each band, and of the rows outside.
    starts: Vec<u32>,
    counted: Counted,
}

/// Positions in nm. The shortest column decides.
#[derive(Clone, Copy)]
struct Points<'a> {
    x: &'a [f64],
    y: &'a [f64],
    /// Depths, and their axis.
    z: Option<(&'a [f64], Axis)>,
}

impl<'a> Points<'a> {
    fn rows(&self) -> usize {
        let z = self.z.map_or(usize::MAX, |(z, _)| z.len());
        self.x.len().min(self.y.len()).min(z)
    }

    fn part(&self, rows: Range<usize>) -> Points<'a> {
        Points {
            x: &self.x[rows.clone()],
            y: &self.y[rows.clone()],
            z: self.z.map(|(z, axis)| (&z[rows], axis)),
        }
    }

    fn finite(&self, i: usize) -> bool {
        let z = self.z.is_none_or(|(z, _)| z[i].is_finite());
        self.x[i].is_finite() && self.y[i].is_finite() && z
    }
}

struct Layout<'a> {
    field: &'a Field,
    /// log2 of the pixel rows in a band.
    shift: u32,
    bands: usize,
}

/// Counts the positions in each pixel of `field` into `out` (x fastest, `field.pixels()` long;
/// overwritten).
///
/// `x` and `y` are nm and equally long; the shorter decides. A pixel holds its low edges. Counts
/// above 2^24 are rounded to the nearest f32. The image does not depend on the order of rows nor on
/// the number of threads.
///
/// # Errors
/// `Cancelled` when the person cancelled; `out` is then undefined.
pub fn histogram2d(
    x: &[f64],
    y: &[f64],
    field: &Field,
    out: &mut [f32],
    run: &dyn Run,
) -> Result<Counted, Cancelled> {
    counts(&Points { x, y, z: None }, field, 1, out, run)
}

/// As [`histogram2d`], for the voxels of a volume (x fastest, z slowest).
///
/// # Errors
/// `Cancelled` when the person cancelled; `out` is then undefined.
pub fn histogram3d(
    [x, y, z]: [&[f64]; 3],
    volume: &Volume,
    out: &mut [f32],
    run: &dyn Run,
) -> Result<Counted, Cancelled> {
    let z = Some((z, volume.z));
    counts(
        &Points { x, y, z },
        &volume.plane,
        volume.z.count(),
        out,
        run,
    )
}

/// Counts in a stack of planes, whose pixel rows are numbered through.
fn counts(
    points: &Points<'_>,
    field: &Field,
    slices: usize,
    out: &mut [f32],
    run: &dyn Run,
) -> Result<Counted, Cancelled> {
    let (width, lines) = (field.x.count(), field.y.count() * slices);
    let shift = (BAND_PIXELS / width)
        .max(1)
        .min(lines.div_ceil(8).next_power_of_two())
        .ilog2();
    let layout = Layout {
        field,
        shift,
        bands: lines.div_ceil(1 << shift),
    };
    let bands: Vec<Mutex<&mut [f32]>> = out.chunks_mut(width << shift).map(Mutex::new).collect();
    let rows = points.rows();
    let chunks: Vec<Points<'_>> = (0..rows)
        .step_by(CHUNK)
        .map(|from| points.part(from..rows.min(from + CHUNK)))
        .collect();
    let mut counted = Counted::default();
    let rounds = chunks.len().div_ceil(ROUND).max(1);
    for round in 0..rounds {
        let part = &chunks[round * ROUND..chunks.len().min((round + 1) * ROUND)];
        run.progress(round as f64 / rounds as f64, "sorting localisations")?;
        let sorted = sort(part, &layout, run)?;
        run.progress(
            (round as f64 + 0.6) / rounds as f64,
            "counting localisations",
        )?;
        count(&sorted, &layout, &bands, round == 0, run)?;
        for s in &sorted {
            counted.inside += s.counted.inside;
            counted.outside += s.counted.outside;
            counted.invalid += s.counted.invalid;
        }
    }
    run.progress(1.0, "counting localisations")?;
    Ok(counted)
}

fn sort(chunks: &[Points<'_>], layout: &Layout, run: &dyn Run) -> Result<Vec<Sorted>, Cancelled> {
    let sorted: Vec<Mutex<Sorted>> = chunks.iter().map(|_| Mutex::default()).collect();
    run.parallel(chunks.len(), &|i| {
        if run.cancelled() {
            return;
        }
        let result = sort_chunk(&chunks[i], layout);
        if let Ok(mut slot) = sorted[i].lock() {
            *slot = result;
        }
    });
    if run.cancelled() {
        return Err(Cancelled);
    }
    Ok(sorted
        .into_iter()
        .map(|s| s.into_inner().unwrap_or_default())
        .collect())
}

/// Counting sort by band. Rows outside are in a band of their own at the end, so that no row needs a
/// branch.
fn sort_chunk(points: &Points<'_>, layout: &Layout) -> Sorted {
    let rows = points.rows();
    let mut pixels = vec![0_u32; rows];
    let mut bands = vec![0_u32; rows];
    match points.z {
        None => pixels_of(points.x, points.y, layout, &mut pixels, &mut bands),
        Some((z, axis)) => voxels_of(points, z, &axis, layout, &mut pixels, &mut bands),
    }
    let mut starts = vec![0_u32; layout.bands + 1];
    for band in &bands {
        starts[*band as usize] += 1;
    }
    let outside = u64::from(starts[layout.bands]);
    let mut invalid = 0;
    if outside > 0 {
        invalid = (0..rows).filter(|i| !points.finite(*i)).count() as u64;
    }
    // Running sums: starts[b] becomes the end of band b, then counts down to its start.
    let mut sum = 0;
    for s in &mut starts {
        sum += *s;
        *s = sum;
    }
    let mut sorted = vec![0_u32; rows];
    for (pixel, band) in pixels.iter().zip(&bands) {
        let s = &mut starts[*band as usize];
        *s -= 1;
        sorted[*s as usize] = *pixel;
    }
    let inside = rows as u64 - outside;
    Sorted {
        pixels: sorted,
        starts,
        counted: Counted {
            inside,
            outside: outside - invalid,
            invalid,
        },
    }
}

/// 2^52: added to a whole f64 below it, the number stands in the low bits.
const WHOLE: f64 = 4_503_599_627_370_496.0;

/// Pixel number and band of each position; the band after the last one for those outside.
fn pixels_of(x: &[f64], y: &[f64], layout: &Layout, pixels: &mut [u32], bands: &mut [u32]) {
    let (ax, ay, width) = (
        layout.field.x,
        layout.field.y,
        layout.field.x.count() as f64,
    );
    let outside = layout.bands as u32;
    for (((&x, &y), pixel), band) in x.iter().zip(y).zip(pixels).zip(bands) {
        let inside = ax.holds(x) & ay.holds(y);
        let row = ay.index(y);
        *pixel = ((row * width + ax.index(x)) + WHOLE).to_bits() as u32;
        let b = ((row + WHOLE).to_bits() as u32) >> layout.shift;
        *band = if inside { b } else { outside };
    }
}

/// As [`pixels_of`], in a volume.
fn voxels_of(
    points: &Points<'_>,
    z: &[f64],
    az: &Axis,
    layout: &Layout,
    pixels: &mut [u32],
    bands: &mut [u32],
) {
    let (ax, ay) = (layout.field.x, layout.field.y);
    let (width, lines) = (ax.count() as f64, ay.count() as f64);
    let outside = layout.bands as u32;
    let rows = points.x.iter().zip(points.y).zip(z);
    for (((&x, &y), &z), (pixel, band)) in rows.zip(pixels.iter_mut().zip(bands)) {
        let inside = ax.holds(x) & ay.holds(y) & az.holds(z);
        let row = az.index(z) * lines + ay.index(y);
        *pixel = ((row * width + ax.index(x)) + WHOLE).to_bits() as u32;
        let b = ((row + WHOLE).to_bits() as u32) >> layout.shift;
        *band = if inside { b } else { outside };
    }
}

fn count(
    sorted: &[Sorted],
    layout: &Layout,
    bands: &[Mutex<&mut [f32]>],
    first: bool,
    run: &dyn Run,
) -> Result<(), Cancelled> {
    // Tiles that tasks have done with, so that their memory is touched once.
    let tiles: Mutex<Vec<Vec<u32>>> = Mutex::default();
    run.parallel(bands.len(), &|b| {
        if run.cancelled() {
            return;
        }
        let Ok(mut out) = bands[b].lock() else { return };
        let mut tile = tiles
            .lock()
            .ok()
            .and_then(|mut t| t.pop())
            .unwrap_or_default();
        tile.clear();
        tile.resize(out.len(), 0);
        let low = (b * layout.field.x.count()) << layout.shift;
        for s in sorted.iter().filter(|s| s.starts.len() > b + 1) {
            for &pixel in &s.pixels[s.starts[b] as usize..s.starts[b + 1] as usize] {
                tile[pixel as usize - low] += 1;
            }
        }
        if first {
            out.iter_mut().zip(&tile).for_each(|(o, &n)| *o = n as f32);
        } else {
            out.iter_mut()
                .zip(&tile)
                .for_each(|(o, &n)| *o = (f64::from(*o) + f64::from(n)) as f32);
        }
        if let Ok(mut t) = tiles.lock() {
            t.push(tile);
        }
    });
    if run.cancelled() {
        Err(Cancelled)
    } else {
        Ok(())
    }
}

#[cfg(test)]
mod tests;
