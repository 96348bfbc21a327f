//! Moves a surface about a shell of localisations into the middle of the shell.

use crate::field::each_mut;
use crate::surface::Surface;
use puncta_sdk::Failure;
use puncta_sdk::run::{Cancelled, Run};
use puncta_shared_neighbours::{Grid, Nearest};
use puncta_shared_octree::Points;
use puncta_shared_vector::{Point, along, cross, dot, sub, unit};

/// Localisations that are looked at, per vertex.
const PER_VERTEX: usize = 12;
/// No vertex.
const NOTHING: u32 = u32::MAX;
/// Rounds of smoothing and moving.
const ROUNDS: usize = 4;
/// Passes over neighbours that average the distances about a vertex.
const SPREAD: usize = 3;
/// Localisations further from a vertex than so many leaves do not move it.
const REACH: f64 = 2.5;

/// Vertices that share an edge with each vertex.
struct Rings {
    starts: Vec<u32>,
    others: Vec<u32>,
}

impl Rings {
    /// Of a closed, oriented surface: each neighbour comes once.
    fn new(surface: &Surface) -> Rings {
        let mut starts = vec![0; surface.positions.len() + 1];
        for v in surface.triangles.as_flattened() {
            starts[*v as usize + 1] += 1;
        }
        for i in 1..starts.len() {
            starts[i] += starts[i - 1];
        }
        let mut next: Vec<u32> = starts.clone();
        let mut others = vec![0; 3 * surface.triangles.len()];
        for triangle in &surface.triangles {
            for k in 0..3 {
                let place = &mut next[triangle[k] as usize];
                others[*place as usize] = triangle[(k + 1) % 3];
                *place += 1;
            }
        }
        Rings { starts, others }
    }

    fn of(&self, v: usize) -> &[u32] {
        &self.others[self.starts[v] as usize..self.starts[v + 1] as usize]
    }
}

/// Normals of the vertices, weighted by the areas about them.
fn normals(surface: &Surface) -> Vec<Point> {
    let mut normals = vec![[0.0; 3]; surface.positions.len()];
    for triangle in &surface.triangles {
        let [a, b, c] = triangle.map(|v| surface.positions[v as usize]);
        let normal = cross(sub(b, a), sub(c, a));
        for v in triangle {
            normals[*v as usize] = along(normals[*v as usize], normal, 1.0);
        }
    }
    for normal in &mut normals {
        *normal = unit(*normal);
    }
    normals
}

/// The nearest vertex of each of some localisations, and the distance along its normal; NaN for
/// those that are too far.
struct Distances {
    stride: usize,
    found: Vec<(u32, f64)>,
}

impl Distances {
    fn new(
        surface: &Surface,
        normals: &[Point],
        points: &Points,
        run: &dyn Run,
    ) -> Result<Distances, Failure> {
        let column = |axis: usize| surface.positions.iter().map(|p| p[axis]).collect();
        let columns: [Vec<f64>; 3] = [column(0), column(1), column(2)];
        let grid = Grid::for_nearest([&columns[0], &columns[1], &columns[2]], [1.0; 3], 1, run)?;
        let wanted = surface.positions.len().max(1) * PER_VERTEX;
        let stride = points.len().div_ceil(wanted).max(1);
        let mut found = vec![(NOTHING, f64::NAN); points.len().div_ceil(stride)];
        each_mut(run, &mut found, &|i, found| {
            let place = points.place(i * stride);
            let mut nearest = Nearest::new(1);
            grid.nearest(&place, None, &mut nearest);
            if let Some((squared, at)) = nearest.last() {
                let v = grid.rows()[at];
                if squared <= (REACH * f64::from(surface.sizes[v as usize])).powi(2) {
                    found.0 = v;
                }
            }
        })?;
        let mut distances = Distances { stride, found };
        distances.measure(surface, normals, points, run)?;
        Ok(distances)
    }

    /// Takes the distances anew, from the same vertices at their present places.
    fn measure(
        &mut self,
        surface: &Surface,
        normals: &[Point],
        points: &Points,
        run: &dyn Run,
    ) -> Result<(), Cancelled> {
        let stride = self.stride;
        each_mut(run, &mut self.found, &|i, (v, offset)| {
            if let Some(position) = surface.positions.get(*v as usize) {
                let place = points.place(i * stride);
                *offset = dot(sub(place, *position), normals[*v as usize]);
            }
        })
    }

    /// Half of the localisations lie further out than this.
    fn median(&self) -> f64 {
        let near = self.found.iter().map(|(_, offset)| *offset);
        let mut near: Vec<f64> = near.filter(|offset| !offset.is_nan()).collect();
        if near.is_empty() {
            return f64::NAN;
        }
        let middle = near.len() / 2;
        *near.select_nth_unstable_by(middle, f64::total_cmp).1
    }

    /// The mean distance about each vertex, averaged with its neighbours.
    fn spread(
        &self,
        surface: &Surface,
        rings: &Rings,
        run: &dyn Run,
    ) -> Result<Vec<f64>, Cancelled> {
        let mut sums = vec![[0.0; 2]; surface.positions.len()];
        for (v, offset) in self.found.iter().filter(|(_, offset)| !offset.is_nan()) {
            sums[*v as usize][0] += offset;
            sums[*v as usize][1] += 1.0;
        }
        for _ in 0..SPREAD {
            let old = sums.clone();
            each_mut(run, &mut sums, &|v, sum| {
                for other in rings.of(v) {
                    let other = old[*other as usize];
                    *sum = [sum[0] + other[0], sum[1] + other[1]];
                }
                let share = 1.0 / (1.0 + rings.of(v).len() as f64);
                *sum = sum.map(|x| x * share);
            })?;
        }
        let mean = |[sum, count]: [f64; 2]| if count > 0.0 { sum / count } else { 0.0 };
        Ok(sums.into_iter().map(mean).collect())
    }
}

/// Moves the vertices along their normals onto the localisations about them, in rounds of smoothing
/// and moving, and last all by one distance, so that half of the localisations lie outside. The
/// triangles stay what they are. Returns the median signed distance before and after.
///
/// # Errors
/// When cancelled.
pub fn centre(surface: &mut Surface, points: &Points, run: &dyn Run) -> Result<[f64; 2], Failure> {
    let rings = Rings::new(surface);
    let mut at = normals(surface);
    let mut distances = Distances::new(surface, &at, points, run)?;
    let first = distances.median();
    for round in 0..ROUNDS {
        let done = 0.6 + 0.1 * round as f64;
        run.progress(done, "moving the surface to the localisations")?;
        if round > 0 {
            smooth(surface, &rings, run)?;
            at = normals(surface);
            if round == 1 {
                // The first round brings the surface from a leaf away to the shell.
                distances = Distances::new(surface, &at, points, run)?;
            } else {
                distances.measure(surface, &at, points, run)?;
            }
        }
        let offsets = distances.spread(surface, &rings, run)?;
        each_mut(run, &mut surface.positions, &|v, p| {
            *p = along(*p, at[v], offsets[v]);
        })?;
    }
    at = normals(surface);
    distances.measure(surface, &at, points, run)?;
    let last = distances.median();
    if last.is_finite() {
        each_mut(run, &mut surface.positions, &|v, p| {
            *p = along(*p, at[v], last);
        })?;
        distances.measure(surface, &at, points, run)?;
    }
    Ok([first, distances.median()])
}

/// Median signed distance of the localisations near a surface, nm.
///
/// # Errors
/// When cancelled.
pub fn median_distance(surface: &Surface, points: &Points, run: &dyn Run) -> Result<f64, Failure> {
    Ok(Distances::new(surface, &normals(surface), points, run)?.median())
}

/// Moves each vertex half way to the middle of its neighbours.
fn smooth(surface: &mut Surface, rings: &Rings, run: &dyn Run) -> Result<(), Cancelled> {
    let old = surface.positions.clone();
    each_mut(run, &mut surface.positions, &|v, p| {
        let ring = rings.of(v);
        let mut middle = [0.0; 3];
        for other in ring {
            middle = along(middle, old[*other as usize], 1.0);
        }
        if !ring.is_empty() {
            let middle = middle.map(|x| x / ring.len() as f64);
            *p = along(p.map(|x| x / 2.0), middle, 0.5);
        }
    })
}
