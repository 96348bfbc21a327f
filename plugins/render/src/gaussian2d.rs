//! Localisations as Gaussians integrated over each pixel.
//!
//! A localisation at u with standard deviation s (pixels, per axis) gives pixel [i, i+1) the weight
//! times F((i + 1 - u) / s) - F((i - u) / s) along each axis, F being the normal distribution cut
//! off at 4 s and renormalised (see `normal`). So a localisation far enough inside sums to its
//! weight, however small s is: s = 0 is a point in one pixel, and no lower limit of s is needed to
//! keep the total (compare the pixel integration of Smith et al., Nature Methods 7, 373, 2010,
//! equation 1).
//!
//! The image is made in square tiles. Each tile adds up its localisations in the order of the rows
//! in f64 and is rounded to f32 once, so that the image does not depend on the number of threads, a
//! crop of the image is the image of the cropped field, and moving everything by whole pixels moves
//! the image, all bit for bit. Beyond `ROUND_ROWS` rows, and with localisations wider than a tile,
//! it is made in several rounds that each add to the f32 image.

use crate::draw::Canvas;
use crate::field::Field;
use crate::spots::Gaussians;
use crate::tiles::{Chunk, Layout, Sorted, Sorting, prepare, sort_piece};
use puncta_sdk::{Cancelled, Run};

/// Rows rendered at a time: bounds the memory (at most 100 bytes a row).
pub const ROUND_ROWS: usize = 1 << 22;

/// Numbers that bound the memory. An entry is a localisation in a tile and takes 32 bytes; wide
/// localisations have many.
struct Limits {
    /// Rows of a round.
    rows: usize,
    /// Entries drawn together.
    entries: usize,
    /// Bounds of the sorting.
    sorting: Sorting,
}

const LIMITS: Limits = Limits {
    rows: ROUND_ROWS,
    entries: 1 << 23,
    sorting: Sorting {
        piece: 1 << 20,
        together: 1 << 16,
    },
};

/// What became of the rows.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Rendered {
    /// Rows that give something to the image.
    pub rendered: u64,
    /// Rows of which nothing falls in the field of view.
    pub outside: u64,
    /// Rows whose position, standard deviation or weight is NaN or infinite, or whose standard
    /// deviation is negative.
    pub invalid: u64,
    /// Sum of the image before rounding to f32.
    pub sum: f64,
}

/// Renders `spots` into `out` (x fastest, `field.pixels()` long; overwritten). Localisations near
/// the border lose what falls outside the field of view; those outside give what falls inside.
///
/// # Errors
/// `Cancelled` when the person cancelled; `out` is then undefined.
pub fn gaussian2d(
    spots: &Gaussians<'_>,
    field: &Field,
    out: &mut [f32],
    run: &dyn Run,
) -> Result<Rendered, Cancelled> {
    within(spots, field, out, run, &LIMITS)
}

fn within(
    spots: &Gaussians<'_>,
    field: &Field,
    out: &mut [f32],
    run: &dyn Run,
    limits: &Limits,
) -> Result<Rendered, Cancelled> {
    let layout = Layout::new(field);
    let mut canvas = Canvas::new(&layout, out, run);
    let rows = spots.rows();
    let mut total = Rendered::default();
    for start in (0..rows).step_by(limits.rows) {
        let end = rows.min(start + limits.rows);
        run.progress(start as f64 / rows as f64, "sorting localisations")?;
        let chunks = prepare(spots, start..end, &layout, &limits.sorting, run)?;
        for c in &chunks {
            total.rendered += c.rendered;
            total.outside += c.outside;
            total.invalid += c.invalid;
        }
        // Two entries a row are usual; wide localisations have more, and are drawn in more parts.
        let most = (2 * (end - start)).max(limits.sorting.piece);
        let span = [start as f64 / rows as f64, end as f64 / rows as f64];
        draw(chunks, &mut canvas, limits.entries.min(most), span)?;
    }
    if canvas.fresh {
        canvas.draw(&[], [0.0, 1.0])?;
    }
    run.progress(1.0, "rendering localisations")?;
    Ok(Rendered {
        sum: canvas.sum,
        ..total
    })
}

/// Draws the chunks of a round, not more than `limit` entries at a time, in the order of the rows.
/// `span` is the part of the whole, for the progress.
fn draw(
    chunks: Vec<Chunk>,
    canvas: &mut Canvas<'_>,
    limit: usize,
    span: [f64; 2],
) -> Result<(), Cancelled> {
    let mut waiting: Vec<Sorted> = Vec::new();
    let mut entries = 0;
    let mut from = span[0];
    let count = chunks.len();
    for (i, chunk) in chunks.into_iter().enumerate() {
        let (spots, layout) = (&chunk.spots, canvas.layout);
        let pieces = chunk.pieces.into_iter();
        let later = pieces.map(|piece| sort_piece(&spots[piece], layout));
        for next in chunk.sorted.into_iter().chain(later) {
            if entries > 0 && entries + next.entries.len() > limit {
                let to = span[0] + (span[1] - span[0]) * i as f64 / count as f64;
                canvas.draw(&waiting, [from, to])?;
                waiting.clear();
                (entries, from) = (0, to);
            }
            entries += next.entries.len();
            waiting.push(next);
        }
    }
    canvas.draw(&waiting, [from, span[1]])
}

#[cfg(test)]
mod tests;
