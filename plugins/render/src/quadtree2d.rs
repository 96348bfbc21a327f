//! Density of localisations in squares that adapt to it (Baddeley, Cannell and Soeller 2010).
//!
//! The localisations are counted per pixel, and the counts are summed up to squares of twice, four
//! times, ... the side, aligned to the absolute grid of pixels. From the largest square down, one
//! with more than the leaf's number is divided into four. There is no tree of points: the counts of
//! all squares take a third of the image, and each is touched once.

use crate::field::Field;
use crate::histogram2d::{Counted, histogram2d};
use puncta_sdk::run::chunks_mut;
use puncta_sdk::{Cancelled, Run};
use std::ops::Range;
use std::sync::Mutex;

/// log2 of the side of the squares of pixels that one task fills row by row.
const TILE: usize = 6;
/// Entries of sums that one task computes.
const CHUNK: usize = 1 << 15;

/// The counts of all squares of one side.
struct Level {
    /// Squares along x.
    width: usize,
    counts: Vec<u32>,
}

/// All squares of the field, beginning with those of two pixels.
struct Squares<'a> {
    field: &'a Field,
    levels: Vec<Level>,
    leaf: u32,
    factor: f64,
}

/// Renders the density into `out` (x fastest, `field.pixels()` long; overwritten): localisations per
/// pixel times `factor`. A square with at most `leaf` localisations is not divided.
///
/// # Errors
/// `Cancelled` when the person cancelled; `out` is then undefined.
pub fn quadtree2d(
    [x, y]: [&[f64]; 2],
    field: &Field,
    leaf: u32,
    factor: f64,
    out: &mut [f32],
    run: &dyn Run,
) -> Result<Counted, Cancelled> {
    let counted = histogram2d(x, y, field, out, run)?;
    let mut squares = Squares {
        field,
        levels: Vec::new(),
        leaf,
        factor,
    };
    run.progress(1.0, "summing up squares")?;
    while 1_usize << squares.levels.len() < field.x.count().max(field.y.count()) {
        let level = squares.next(out, run)?;
        squares.levels.push(level);
    }
    squares.fill(out, run)?;
    run.progress(1.0, "filling squares")?;
    Ok(counted)
}

impl Squares<'_> {
    /// Numbers of the squares of a level that the field has along an axis, on the absolute grid.
    fn range(&self, level: usize) -> [Range<i64>; 2] {
        [&self.field.x, &self.field.y].map(|axis| {
            let (first, count) = (axis.first(), axis.count() as i64);
            first >> level..((first + count - 1) >> level) + 1
        })
    }

    /// The sums of the squares of the next level; `pixels` are the counts of the pixels.
    fn next(&self, pixels: &[f32], run: &dyn Run) -> Result<Level, Cancelled> {
        let level = self.levels.len() + 1;
        let [across, down] = self.range(level);
        let [below_x, below_y] = self.range(level - 1);
        let width = (across.end - across.start) as usize;
        let height = (down.end - down.start) as usize;
        let below_width = (below_x.end - below_x.start) as usize;
        let mut counts = vec![0_u32; width * height];
        let rows = (CHUNK / width).max(1);
        chunks_mut(run, &mut counts, rows * width, &|chunk, counts| {
            if run.cancelled() {
                return;
            }
            for (row, counts) in counts.chunks_mut(width).enumerate() {
                let y = down.start + (chunk * rows + row) as i64;
                for below in (2 * y).max(below_y.start)..(2 * y + 2).min(below_y.end) {
                    let from = (below - below_y.start) as usize * below_width;
                    // The first square may hold one square of the level below only.
                    let odd = (below_x.start & 1) as usize;
                    match self.levels.last() {
                        Some(last) => {
                            let line = &last.counts[from..from + below_width];
                            let each = line.iter().enumerate();
                            each.for_each(|(i, n)| counts[(i + odd) / 2] += n);
                        }
                        None => {
                            let line = &pixels[from..from + below_width];
                            let each = line.iter().enumerate();
                            each.for_each(|(i, n)| counts[(i + odd) / 2] += *n as u32);
                        }
                    }
                }
            }
        });
        if run.cancelled() {
            return Err(Cancelled);
        }
        Ok(Level { width, counts })
    }

    /// Count of a square of a level above the pixels.
    fn count(&self, level: usize, x: i64, y: i64) -> u32 {
        let [across, down] = self.range(level);
        let of = &self.levels[level - 1];
        of.counts[(y - down.start) as usize * of.width + (x - across.start) as usize]
    }

    /// Pixels of a square that lie in the field, counted from its corner.
    fn pixels(&self, level: usize, x: i64, y: i64) -> [Range<usize>; 2] {
        let part = |axis: &crate::grid::Axis, place: i64| {
            let (first, count) = (axis.first(), axis.count() as i64);
            let low = ((place << level) - first).clamp(0, count) as usize;
            low..(((place + 1) << level) - first).clamp(0, count) as usize
        };
        [part(&self.field.x, x), part(&self.field.y, y)]
    }

    fn fill(&self, out: &mut [f32], run: &dyn Run) -> Result<(), Cancelled> {
        let top = self.levels.len();
        let tile = TILE.min(top);
        let [across, down] = self.range(tile);
        let width = self.field.x.count();
        // Rows of pixels of each row of tiles.
        let mut bands = Vec::new();
        let mut rest = out;
        for y in down.clone() {
            let lines = self.pixels(tile, across.start, y)[1].len();
            let (band, after) = rest.split_at_mut(lines * width);
            bands.push(Mutex::new(band));
            rest = after;
        }
        run.parallel(bands.len(), &|b| {
            let Ok(mut band) = bands[b].lock() else {
                return;
            };
            let y = down.start + b as i64;
            let begin = self.pixels(tile, across.start, y)[1].start;
            for x in across.clone() {
                if run.cancelled() {
                    return;
                }
                self.tile([tile, top], x, y, &mut band, begin);
            }
        });
        if run.cancelled() {
            Err(Cancelled)
        } else {
            Ok(())
        }
    }

    /// Fills a tile: with the density of the largest square about it that is a leaf, or its own
    /// squares.
    fn tile(&self, [tile, top]: [usize; 2], x: i64, y: i64, band: &mut [f32], begin: usize) {
        for level in (tile.max(1)..=top).rev() {
            let (sx, sy) = (x >> (level - tile), y >> (level - tile));
            let count = self.count(level, sx, sy);
            if count <= self.leaf {
                let [across, down] = self.pixels(level, sx, sy);
                let area = (across.len() * down.len()) as f64;
                let density = f64::from(count) / area * self.factor;
                return self.paint(self.pixels(tile, x, y), density as f32, band, begin);
            }
        }
        self.divide(tile, x, y, band, begin);
    }

    /// Fills a square that is no leaf, or one of a pixel.
    fn divide(&self, level: usize, x: i64, y: i64, band: &mut [f32], begin: usize) {
        let [across, down] = self.pixels(level, x, y);
        if across.is_empty() || down.is_empty() {
            return;
        }
        if level == 0 {
            let pixel = &mut band[(down.start - begin) * self.field.x.count() + across.start];
            *pixel = (f64::from(*pixel) * self.factor) as f32;
            return;
        }
        for (x, y) in [
            (2 * x, 2 * y),
            (2 * x + 1, 2 * y),
            (2 * x, 2 * y + 1),
            (2 * x + 1, 2 * y + 1),
        ] {
            let [across, down] = self.pixels(level - 1, x, y);
            if across.is_empty() || down.is_empty() {
                continue;
            }
            if level > 1 {
                let count = self.count(level - 1, x, y);
                if count <= self.leaf {
                    let area = (across.len() * down.len()) as f64;
                    let density = f64::from(count) / area * self.factor;
                    self.paint([across, down], density as f32, band, begin);
                    continue;
                }
            }
            self.divide(level - 1, x, y, band, begin);
        }
    }

    fn paint(&self, [across, down]: [Range<usize>; 2], value: f32, band: &mut [f32], begin: usize) {
        let width = self.field.x.count();
        for line in down {
            let from = (line - begin) * width;
            band[from + across.start..from + across.end].fill(value);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{Random, covering, plane, sum};
    use puncta_testkit::Threads;

    fn image(x: &[f64], y: &[f64], field: &Field, leaf: u32, threads: usize) -> Vec<f32> {
        let mut out = vec![f32::NAN; field.pixels()];
        quadtree2d([x, y], field, leaf, 1.0, &mut out, &Threads(threads)).unwrap();
        out
    }

    /// A quadtree by recursion over the points.
    fn plain(
        points: &[(f64, f64)],
        field: &Field,
        level: u32,
        cell: (i64, i64),
        leaf: usize,
        out: &mut [f32],
    ) {
        let side = f64::from(1 << level) * field.x.size();
        let inside = |v: f64, place: i64| (v / side).floor() as i64 == place;
        let points: Vec<(f64, f64)> = points
            .iter()
            .copied()
            .filter(|p| inside(p.0, cell.0) && inside(p.1, cell.1))
            .collect();
        let (width, height) = (field.x.count() as i64, field.y.count() as i64);
        let range = |first: i64, count: i64, place: i64| {
            ((place << level) - first).clamp(0, count)
                ..(((place + 1) << level) - first).clamp(0, count)
        };
        let (xs, ys) = (
            range(field.x.first(), width, cell.0),
            range(field.y.first(), height, cell.1),
        );
        if level == 0 || points.len() <= leaf {
            let density = points.len() as f64 / ((xs.end - xs.start) * (ys.end - ys.start)) as f64;
            for y in ys {
                xs.clone()
                    .for_each(|x| out[(y * width + x) as usize] = density as f32);
            }
            return;
        }
        for child in [(0, 0), (1, 0), (0, 1), (1, 1)] {
            plain(
                &points,
                field,
                level - 1,
                (2 * cell.0 + child.0, 2 * cell.1 + child.1),
                leaf,
                out,
            );
        }
    }

    #[test]
    fn it_is_the_tree_of_the_points() {
        let mut random = Random::new(3);
        let mut x = random.many(3000, -900.0, 1300.0);
        let mut y = random.many(3000, -210.0, 540.0);
        x.extend(random.many(2000, 200.0, 260.0));
        y.extend(random.many(2000, 100.0, 130.0));
        let field = covering(&x, &y, 10.0, 0.0);
        let points: Vec<(f64, f64)> = x.iter().copied().zip(y.iter().copied()).collect();
        for leaf in [1, 10, 100] {
            let found = image(&x, &y, &field, leaf, 2);
            assert!(found == image(&x, &y, &field, leaf, 1));
            assert!((sum(&found) - 5000.0).abs() < 0.05, "{}", sum(&found));
            let mut expected = vec![f32::NAN; field.pixels()];
            let top = field.x.count().next_power_of_two().ilog2();
            for cell in [(-1, -1), (-1, 0), (0, -1), (0, 0)] {
                plain(&points, &field, top, cell, leaf as usize, &mut expected);
            }
            assert!(found == expected, "{leaf}");
        }
    }

    #[test]
    fn a_uniform_density_is_found_and_few_points_are_one_square() {
        let mut random = Random::new(7);
        let [x, y] = [(); 2].map(|()| random.many(40_000, 0.0, 2560.0));
        let field = plane(0.0, 0.0, 10.0, 256, 256);
        let found = image(&x, &y, &field, 100, 2);
        let expected = 40_000.0 / 65_536.0;
        // Leaves hold 40 localisations on average, and so deviate by 16 % each.
        let deviation = found
            .iter()
            .map(|v| (f64::from(*v) / expected - 1.0).powi(2))
            .sum::<f64>();
        assert!((deviation / found.len() as f64).sqrt() < 0.2);
        let few = image(&x[..7], &y[..7], &field, 10, 2);
        assert!(few.iter().all(|v| *v == 7.0 / 65_536.0));
    }

    #[test]
    fn shifts_by_whole_squares_change_nothing() {
        let mut random = Random::new(8);
        let dyadic = |v: Vec<f64>| {
            v.into_iter()
                .map(|v| (v * 64.0).round() / 64.0)
                .collect::<Vec<f64>>()
        };
        let x = dyadic(random.many(4000, 0.0, 1000.0));
        let y = dyadic(random.many(4000, 0.0, 700.0));
        let before = image(&x, &y, &covering(&x, &y, 8.0, 0.0), 10, 2);
        let [x, y] = [(x, 8192.0), (y, -4096.0)]
            .map(|(v, by)| v.iter().map(|v| v + by).collect::<Vec<f64>>());
        assert!(before == image(&x, &y, &covering(&x, &y, 8.0, 0.0), 10, 2));
    }

    #[test]
    fn one_pixel_one_row_and_none_have_an_image() {
        assert_eq!(
            image(&[5.0; 30], &[5.0; 30], &plane(0.0, 0.0, 10.0, 1, 1), 10, 2),
            [30.0]
        );
        let field = plane(0.0, 0.0, 10.0, 5, 3);
        assert!(image(&[], &[], &field, 10, 2).iter().all(|v| *v == 0.0));
        assert!(
            image(&[7.0], &[7.0], &field, 10, 2)
                .iter()
                .all(|v| *v == (1.0 / 15.0) as f32)
        );
        let nan = image(&[f64::NAN, 12.0], &[1.0, 1.0], &field, 10, 2);
        assert!((sum(&nan) - 1.0).abs() < 1e-6);
    }
}
