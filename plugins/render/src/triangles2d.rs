//! Jittered triangulation of the plane: density from the Delaunay triangles of random samples.
//!
//! Each localisation is shared equally among the triangles that meet in it, and a triangle has the
//! density of its shares over its area (Baddeley, Cannell and Soeller 2010, where the intensity goes
//! with the inverse area). Each pixel gets the exact integral over it: an edge between triangles of
//! different density adds its area to the right, row by row, and sums along the rows give the image.
//! So small triangles are not missed and the image of a sample adds up to its localisations.

use crate::field::Field;
use crate::samples::{Cloud, Sampling, distinct};
use puncta_sdk::run::{chunks_mut, map};
use puncta_sdk::{Cancelled, Run};
use spade::{DelaunayTriangulation, HasPosition, Point2, Triangulation};

/// Triangles with less area (in pixels) give to the pixels of the middles of their sides: their
/// densities would drown the digits of others.
const LEAST_AREA: f64 = 1e-7;
/// Bands of rows that are drawn in parallel.
const BANDS: usize = 32;

/// Positions nearer to zero than this are zero: the triangulation takes no smaller ones.
const LEAST_POSITION: f64 = 1e-30;

/// A corner of triangles.
#[derive(Clone, Copy)]
struct Corner {
    at: Point2<f64>,
    /// Localisations there.
    count: u32,
}

impl HasPosition for Corner {
    type Scalar = f64;

    fn position(&self) -> Point2<f64> {
        self.at
    }
}

/// An edge of the triangulation, with the density on its right less that on its left.
#[derive(Clone, Copy, Default)]
struct Edge {
    from: [f64; 2],
    to: [f64; 2],
    step: f64,
}

/// What a sample draws: edges by band, and weights in single pixels.
#[derive(Default)]
struct Drawing {
    edges: Vec<Edge>,
    /// First edge of each band, and the end of the last.
    starts: Vec<usize>,
    weights: Vec<(u32, f64)>,
    /// Localisations that it shows.
    shown: u64,
}

/// Rows of pixels in bands.
struct Layout<'a> {
    field: &'a Field,
    rows: usize,
    bands: usize,
}

/// Averages the densities of the samples into `out` (x fastest, `field.pixels()` long; overwritten):
/// localisations per pixel times `factor`. Gives the number of localisations that were shown per
/// sample, on average; 0 when no sample has three that are not on a line.
///
/// # Errors
/// `Cancelled` when the person cancelled; `out` is then undefined.
pub fn triangles2d(
    cloud: &Cloud<2>,
    sampling: &Sampling,
    field: &Field,
    factor: f64,
    out: &mut [f32],
    run: &dyn Run,
) -> Result<f64, Cancelled> {
    let width = field.x.count();
    let rows = field.y.count().div_ceil(BANDS);
    let layout = Layout {
        field,
        rows,
        bands: field.y.count().div_ceil(rows),
    };
    // One more column, for what lies to the right of an edge in the last.
    let mut sums = vec![0.0_f64; (width + 2) * field.y.count()];
    let (mut shown, mut from) = (0, 0);
    while from < sampling.samples {
        let group = (run.threads().max(1) as u32).min(sampling.samples - from);
        let done = f64::from(from) / f64::from(sampling.samples);
        run.progress(done, "triangulating samples")?;
        let drawings = map(run, group as usize, &|i| {
            draw(cloud, sampling, from + i as u32, &layout, run)
        });
        let drawings: Vec<Drawing> = drawings.into_iter().collect::<Result<_, _>>()?;
        chunks_mut(run, &mut sums, rows * (width + 2), &|band, sums| {
            for drawing in &drawings {
                if run.cancelled() {
                    return;
                }
                let edges = drawing.starts[band]..drawing.starts[band + 1];
                let first = band * rows;
                drawing.edges[edges]
                    .iter()
                    .for_each(|edge| add(edge, first, width, sums));
            }
        });
        for drawing in &drawings {
            for (pixel, weight) in &drawing.weights {
                let (row, column) = (*pixel as usize / width, *pixel as usize % width);
                let at = row * (width + 2) + column;
                sums[at] += weight;
                sums[at + 1] -= weight;
            }
            shown += drawing.shown;
        }
        if run.cancelled() {
            return Err(Cancelled);
        }
        from += group;
    }
    let scale = factor / f64::from(sampling.samples.max(1)) / sampling.keep;
    chunks_mut(run, out, rows * width, &|band, out| {
        for (row, out) in out.chunks_mut(width).enumerate() {
            let at = (band * rows + row) * (width + 2);
            let mut sum = 0.0;
            for (out, step) in out.iter_mut().zip(&sums[at..at + width]) {
                sum += step;
                // Rounding leaves a trace of what lies to the left.
                *out = if sum < 1e-10 {
                    0.0
                } else {
                    (sum * scale) as f32
                };
            }
        }
    });
    run.progress(1.0, "triangulating samples")?;
    Ok(shown as f64 / f64::from(sampling.samples.max(1)) / sampling.keep)
}

/// Triangulates a sample.
fn draw(
    cloud: &Cloud<2>,
    sampling: &Sampling,
    number: u32,
    layout: &Layout<'_>,
    run: &dyn Run,
) -> Result<Drawing, Cancelled> {
    let (points, counts) = distinct(cloud.sample(sampling, number, run)?);
    if run.cancelled() {
        return Err(Cancelled);
    }
    let near_zero = |v: f64| if v.abs() < LEAST_POSITION { 0.0 } else { v };
    let corners = points
        .into_iter()
        .zip(counts)
        .map(|([x, y], count)| Corner {
            at: Point2::new(near_zero(x), near_zero(y)),
            count,
        });
    // Positions are finite and not too small, so that it cannot fail.
    let mesh = DelaunayTriangulation::<Corner>::bulk_load(corners.collect()).unwrap_or_default();
    if run.cancelled() {
        return Err(Cancelled);
    }
    let mut drawing = Drawing::default();
    let mut meeting = vec![0_u32; mesh.num_vertices()];
    for face in mesh.inner_faces() {
        face.vertices()
            .iter()
            .for_each(|corner| meeting[corner.index()] += 1);
    }
    let used = mesh.vertices().filter(|corner| meeting[corner.index()] > 0);
    drawing.shown = used.map(|corner| u64::from(corner.data().count)).sum();
    // Faces are numbered from the one outside, which has none.
    let mut densities = vec![0.0; mesh.num_all_faces()];
    for face in mesh.inner_faces() {
        let corners = face.vertices();
        let share = |corner: &Corner, meeting: u32| f64::from(corner.count) / f64::from(meeting);
        let shares = corners.iter().map(|c| share(c.data(), meeting[c.index()]));
        let weight = shares.sum::<f64>();
        let [a, b, c] = corners.map(|corner| corner.position());
        let area = 0.5 * ((b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x));
        if area.abs() < LEAST_AREA {
            for (p, q) in [(a, b), (b, c), (c, a)] {
                let middle = [0.5 * (p.x + q.x), 0.5 * (p.y + q.y)];
                drawing
                    .weights
                    .extend(layout.pixel(middle).map(|pixel| (pixel, weight / 3.0)));
            }
        } else {
            // Edges run with the triangle on the left, and add what lies to the right.
            densities[face.index()] = -weight / area;
        }
    }
    let mut edges = Vec::with_capacity(mesh.num_undirected_edges());
    for edge in mesh.undirected_edges() {
        let edge = edge.as_directed();
        let step = densities[edge.face().index()] - densities[edge.rev().face().index()];
        let [from, to] = [edge.from(), edge.to()].map(|corner| corner.position());
        edges.push(Edge {
            from: [from.x, from.y],
            to: [to.x, to.y],
            step,
        });
    }
    layout.sort(&edges, &mut drawing);
    Ok(drawing)
}

impl Layout<'_> {
    /// The pixel that holds a point.
    fn pixel(&self, [x, y]: [f64; 2]) -> Option<u32> {
        let (width, height) = (self.field.x.count(), self.field.y.count());
        let inside = x >= 0.0 && y >= 0.0 && x < width as f64 && y < height as f64;
        inside.then(|| (y as usize * width + x as usize) as u32)
    }

    /// Bands that an edge crosses.
    fn bands(&self, edge: &Edge) -> std::ops::Range<usize> {
        let height = self.field.y.count() as f64;
        let (low, high) = (edge.from[1].min(edge.to[1]), edge.from[1].max(edge.to[1]));
        let right = edge.from[0].min(edge.to[0]) >= self.field.x.count() as f64;
        if high <= 0.0 || low >= height || low == high || edge.step == 0.0 || right {
            return 0..0;
        }
        let band = |y: f64| y.clamp(0.0, height - 1.0) as usize / self.rows;
        band(low)..(band(high) + 1).min(self.bands)
    }

    /// Sorts edges by band; one that crosses several is in each.
    fn sort(&self, edges: &[Edge], drawing: &mut Drawing) {
        let mut starts = vec![0_usize; self.bands + 2];
        for edge in edges {
            self.bands(edge).for_each(|band| starts[band + 2] += 1);
        }
        let mut sum = 0;
        for start in &mut starts {
            sum += *start;
            *start = sum;
        }
        drawing.edges = vec![Edge::default(); sum];
        for edge in edges {
            for band in self.bands(edge) {
                drawing.edges[starts[band + 1]] = *edge;
                starts[band + 1] += 1;
            }
        }
        drawing.starts = starts;
    }
}

/// Adds an edge to the rows of a band, which begins with row `first`.
fn add(edge: &Edge, first: usize, width: usize, sums: &mut [f64]) {
    let stride = width + 2;
    let rows = sums.len() / stride;
    let (sign, [x0, y0], [x1, y1]) = match edge.from[1] < edge.to[1] {
        true => (edge.step, edge.from, edge.to),
        false => (-edge.step, edge.to, edge.from),
    };
    let slope = (x1 - x0) / (y1 - y0);
    let (low, high) = (y0.max(first as f64), y1.min((first + rows) as f64));
    if low >= high {
        return;
    }
    let at = |y: f64| if y == y1 { x1 } else { x0 + (y - y0) * slope };
    let mut y = low;
    for row in low as usize..(high.ceil() as usize).min(first + rows) {
        let next = high.min((row + 1) as f64);
        let line = &mut sums[(row - first) * stride..(row - first + 1) * stride];
        part(line, width, [at(y), at(next)], sign * (next - y));
        y = next;
    }
}

/// Adds the part of an edge in one row: `[x, x]` where it enters and leaves, and its height times
/// the step of the density. Sums along the row then hold the area to its right.
fn part(line: &mut [f64], width: usize, x: [f64; 2], step: f64) {
    let (left, right) = (x[0].min(x[1]), x[0].max(x[1]));
    let end = width as f64;
    if right <= 0.0 {
        line[0] += step;
        return;
    }
    if left >= end {
        return;
    }
    if left < 0.0 {
        let share = -left / (right - left);
        line[0] += step * share;
        return part(line, width, [0.0, right], step * (1.0 - share));
    }
    if right > end {
        let share = (end - left) / (right - left);
        return part(line, width, [left, end], step * share);
    }
    let (first, last) = (
        left as usize,
        (right.ceil() as usize).max(left as usize + 1),
    );
    if last == first + 1 {
        let middle = 0.5 * (left + right) - first as f64;
        line[first] += step * (1.0 - middle);
        line[first + 1] += step * middle;
        return;
    }
    // The area to the right grows with the square of the way in the first pixel, then evenly.
    let per = 1.0 / (right - left);
    let covered = |pixel: usize| {
        // Of the pixels up to this one: height above the edge, as a mean over the pixel.
        let (a, b) = (
            (pixel as f64 - left) * per,
            ((pixel + 1) as f64 - left) * per,
        );
        let (a, b) = (a.max(0.0), b.min(1.0));
        let inside = (right.min((pixel + 1) as f64) - left.max(pixel as f64)).max(0.0);
        let after = ((pixel + 1) as f64 - right).max(0.0);
        0.5 * (a + b) * inside + after
    };
    let mut before = 0.0;
    for (pixel, sum) in line.iter_mut().enumerate().take(last).skip(first) {
        let now = covered(pixel);
        *sum += step * (now - before);
        before = now;
    }
    line[last] += step * (1.0 - before);
}

#[cfg(test)]
mod tests;
