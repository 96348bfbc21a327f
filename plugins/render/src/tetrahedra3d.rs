//! Jittered triangulation of space: density from the Delaunay tetrahedra of random samples.
//!
//! As in the plane, each localisation is shared equally among the tetrahedra that meet in it, and a
//! tetrahedron has the density of its shares over its volume. A large one gives it to the voxels
//! whose centres it holds, scaled so that they add up to its shares; a small one gives equal parts
//! of its shares to the voxels of points that are spread evenly in it.

use crate::field::Volume;
use crate::samples::{Cloud, Sampling, distinct};
use puncta_sdk::run::{chunks_mut, map};
use puncta_sdk::{Cancelled, Run};
use puncta_shared_delaunay::tetrahedra;
use puncta_shared_vector::{cross, dot, sub};
use std::ops::Range;

/// Voxels from which on a tetrahedron is large.
const LARGE: f64 = 24.0;
/// Groups of slices that are drawn in parallel.
const BANDS: usize = 16;
/// Tetrahedra between two looks at cancel.
const BATCH: usize = 1 << 10;

/// A tetrahedron with its share of localisations.
#[derive(Clone, Copy)]
struct Piece {
    corners: [u32; 4],
    /// Large: density per voxel. Small: localisations.
    value: f64,
    large: bool,
}

/// What a sample draws.
struct Drawing {
    points: Vec<[f64; 3]>,
    pieces: Vec<Piece>,
    /// Localisations that it shows.
    shown: u64,
}

/// The half-spaces of a tetrahedron: r is inside where n r <= c for all four.
type Faces = [([f64; 3], f64); 4];

/// Averages the densities of the samples into `out` (x fastest, z slowest, `volume.voxels()` long;
/// overwritten): localisations per voxel times `factor`. Gives the number of localisations that were
/// shown per sample, on average; 0 when no sample has four that are not in a plane.
///
/// # Errors
/// `Cancelled` when the person cancelled; `out` is then undefined.
pub fn tetrahedra3d(
    cloud: &Cloud<3>,
    sampling: &Sampling,
    volume: &Volume,
    factor: f64,
    out: &mut [f32],
    run: &dyn Run,
) -> Result<f64, Cancelled> {
    let (width, height) = (volume.plane.x.count(), volume.plane.y.count());
    let slices = volume.z.count().div_ceil(BANDS);
    let slab = (width + 1) * height * slices;
    let mut sums = vec![0.0_f64; (width + 1) * height * volume.z.count()];
    let (mut shown, mut from) = (0, 0);
    while from < sampling.samples {
        let group = (run.threads().max(1) as u32).min(sampling.samples - from);
        let done = f64::from(from) / f64::from(sampling.samples);
        run.progress(done, "triangulating samples")?;
        let drawings = map(run, group as usize, &|i| {
            draw(cloud, sampling, from + i as u32, volume, run)
        });
        let drawings: Vec<Drawing> = drawings.into_iter().collect::<Result<_, _>>()?;
        chunks_mut(run, &mut sums, slab, &|band, sums| {
            let slices = band * slices..band * slices + sums.len() / ((width + 1) * height);
            let mut slab = Slab {
                width,
                height,
                slices,
                sums,
            };
            for drawing in &drawings {
                for (i, piece) in drawing.pieces.iter().enumerate() {
                    if i % BATCH == 0 && run.cancelled() {
                        return;
                    }
                    slab.add(piece, &drawing.points);
                }
            }
        });
        if run.cancelled() {
            return Err(Cancelled);
        }
        shown += drawings.iter().map(|drawing| drawing.shown).sum::<u64>();
        from += group;
    }
    let samples = f64::from(sampling.samples.max(1)) * sampling.keep;
    let scale = factor / samples;
    chunks_mut(run, out, width * height, &|slice, out| {
        for (row, out) in out.chunks_mut(width).enumerate() {
            let at = (slice * height + row) * (width + 1);
            let mut sum = 0.0;
            for (out, step) in out.iter_mut().zip(&sums[at..at + width]) {
                sum += step;
                // Rounding leaves a trace of what lies to the left.
                *out = if sum < 1e-12 {
                    0.0
                } else {
                    (sum * scale) as f32
                };
            }
        }
    });
    run.progress(1.0, "triangulating samples")?;
    Ok(shown as f64 / samples)
}

/// Triangulates a sample.
fn draw(
    cloud: &Cloud<3>,
    sampling: &Sampling,
    number: u32,
    volume: &Volume,
    run: &dyn Run,
) -> Result<Drawing, Cancelled> {
    let (points, counts) = distinct(cloud.sample(sampling, number, run)?);
    let cells = tetrahedra(&points, run)?;
    let mut meeting = vec![0_u32; points.len()];
    cells
        .iter()
        .flatten()
        .for_each(|corner| meeting[*corner as usize] += 1);
    let share =
        |corner: u32| f64::from(counts[corner as usize]) / f64::from(meeting[corner as usize]);
    let size = [
        volume.plane.x.count(),
        volume.plane.y.count(),
        volume.z.count(),
    ];
    let used = meeting
        .iter()
        .zip(&counts)
        .filter(|(meeting, _)| **meeting > 0);
    let shown = used.map(|(_, count)| u64::from(*count)).sum();
    let mut pieces = Vec::with_capacity(cells.len());
    for (i, corners) in cells.iter().enumerate() {
        if i % BATCH == 0 && run.cancelled() {
            return Err(Cancelled);
        }
        let weight: f64 = corners.iter().map(|corner| share(*corner)).sum();
        let at = corners.map(|corner| points[corner as usize]);
        pieces.extend(piece(*corners, at, weight, size));
    }
    Ok(Drawing {
        points,
        pieces,
        shown,
    })
}

/// What a tetrahedron gives to which voxels; None where it lies outside.
fn piece(corners: [u32; 4], at: [[f64; 3]; 4], weight: f64, size: [usize; 3]) -> Option<Piece> {
    let (mut low, mut high) = (at[0], at[0]);
    for corner in &at[1..] {
        for a in 0..3 {
            low[a] = low[a].min(corner[a]);
            high[a] = high[a].max(corner[a]);
        }
    }
    if (0..3).any(|a| high[a] <= 0.0 || low[a] >= size[a] as f64) {
        return None;
    }
    let volume = volume(&at);
    let within = (0..3).all(|a| low[a] >= 0.0 && high[a] <= size[a] as f64);
    let (value, large) = if volume < LARGE {
        (weight, false)
    } else if within {
        let faces = faces(&at);
        let mut count = 0;
        each_row(&at, &faces, [size[0], size[1]], 0..size[2], |_, _, row| {
            count += row.len()
        });
        // Flat ones may hold no centre.
        if count == 0 {
            (weight, false)
        } else {
            (weight / count as f64, true)
        }
    } else {
        (weight / volume, true)
    };
    Some(Piece {
        corners,
        value,
        large,
    })
}

fn volume(at: &[[f64; 3]; 4]) -> f64 {
    let [u, v, w]: [[f64; 3]; 3] = std::array::from_fn(|i| sub(at[i + 1], at[0]));
    dot(u, cross(v, w)).abs() / 6.0
}

fn faces(at: &[[f64; 3]; 4]) -> Faces {
    std::array::from_fn(|i| {
        let [a, b, c] = [at[(i + 1) % 4], at[(i + 2) % 4], at[(i + 3) % 4]];
        let normal = cross(sub(b, a), sub(c, a));
        let outward = if dot(normal, sub(at[i], a)) > 0.0 {
            -1.0
        } else {
            1.0
        };
        let normal = normal.map(|n| n * outward);
        (normal, dot(normal, a))
    })
}

/// Voxels whose centres lie between two positions.
fn centres(low: f64, high: f64, limit: Range<usize>) -> Range<usize> {
    let from = (low - 0.5)
        .ceil()
        .clamp(limit.start as f64, limit.end as f64) as usize;
    let to = ((high - 0.5).floor() + 1.0).clamp(from as f64, limit.end.max(from) as f64) as usize;
    from..to
}

/// Calls `visit` with the slice, the row, and the voxels in it whose centres a tetrahedron holds.
fn each_row(
    at: &[[f64; 3]; 4],
    faces: &Faces,
    [width, height]: [usize; 2],
    slices: Range<usize>,
    mut visit: impl FnMut(usize, usize, Range<usize>),
) {
    let ends = |a: usize| {
        let values = at.iter().map(|corner| corner[a]);
        values.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| {
            (l.min(v), h.max(v))
        })
    };
    let [x, y, z] = [0, 1, 2].map(ends);
    for k in centres(z.0, z.1, slices) {
        for j in centres(y.0, y.1, 0..height) {
            let (mut low, mut high) = x;
            for (normal, limit) in faces {
                let rest = limit - normal[1] * (j as f64 + 0.5) - normal[2] * (k as f64 + 0.5);
                if normal[0] > 0.0 {
                    high = high.min(rest / normal[0]);
                } else if normal[0] < 0.0 {
                    low = low.max(rest / normal[0]);
                } else if rest < 0.0 {
                    high = f64::NEG_INFINITY;
                }
            }
            if low <= high {
                let row = centres(low, high, 0..width);
                if !row.is_empty() {
                    visit(k, j, row);
                }
            }
        }
    }
}

/// Some slices of the sums: each voxel holds the step from the one before it.
struct Slab<'a> {
    width: usize,
    height: usize,
    slices: Range<usize>,
    sums: &'a mut [f64],
}

impl Slab<'_> {
    fn add(&mut self, piece: &Piece, points: &[[f64; 3]]) {
        let at = piece.corners.map(|corner| points[corner as usize]);
        let (low, high) = at
            .iter()
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), corner| {
                (l.min(corner[2]), h.max(corner[2]))
            });
        if high < self.slices.start as f64 || low >= self.slices.end as f64 {
            return;
        }
        if piece.large {
            let (slices, size) = (self.slices.clone(), [self.width, self.height]);
            each_row(&at, &faces(&at), size, slices, |k, j, row| {
                self.put([k, j], row, piece.value);
            });
        } else {
            self.spread(&at, piece.value);
        }
    }

    fn put(&mut self, [k, j]: [usize; 2], row: Range<usize>, value: f64) {
        let line = ((k - self.slices.start) * self.height + j) * (self.width + 1);
        self.sums[line + row.start] += value;
        self.sums[line + row.end] -= value;
    }

    /// Gives equal parts to points that are spread evenly, more of them in larger ones.
    fn spread(&mut self, at: &[[f64; 3]; 4], weight: f64) {
        let order: u32 = match volume(at) {
            v if v < 0.1 => 1,
            v if v < 2.0 => 2,
            _ => 4,
        };
        let count = (order + 1) * (order + 2) * (order + 3) / 6;
        let part = weight / f64::from(count);
        let of = |i: u32| (f64::from(i) + 0.5) / (f64::from(order) + 2.0);
        for a in 0..=order {
            for b in 0..=order - a {
                for c in 0..=order - a - b {
                    let shares = [of(a), of(b), of(c), of(order - a - b - c)];
                    let place: [f64; 3] =
                        std::array::from_fn(|axis| (0..4).map(|i| shares[i] * at[i][axis]).sum());
                    self.point(place, part);
                }
            }
        }
    }

    fn point(&mut self, place: [f64; 3], value: f64) {
        let size = [self.width as f64, self.height as f64];
        let [low, high] = [self.slices.start, self.slices.end].map(|k| k as f64);
        let inside = (0..2).all(|a| place[a] >= 0.0 && place[a] < size[a]);
        if inside && place[2] >= low && place[2] < high {
            let [i, j, k] = place.map(|v| v as usize);
            self.put([k, j], i..i + 1, value);
        }
    }
}

#[cfg(test)]
mod tests;
