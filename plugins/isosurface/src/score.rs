//! How far a surface is from the true one (thesis 5.2.6).

use crate::truth::Truth;
use puncta_sdk::Failure;
use puncta_sdk::run::{Run, map};
use puncta_shared_mesh::{Bvh, Groups};
use puncta_shared_neighbours::{Grid, Nearest};
use puncta_shared_vector::{Point, between, cross, squared, sub};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

/// Most samples of a surface.
const MOST: f64 = 2e7;
/// Points that a task looks at.
const BLOCK: usize = 4096;

/// A triangle mesh with its hierarchy of boxes.
pub struct Triangles {
    /// Vertices, nm.
    pub positions: Vec<Point>,
    /// Corners.
    pub triangles: Vec<[u32; 3]>,
    /// For nearest places.
    pub bvh: Bvh,
}

impl Triangles {
    /// Prepares nearest places.
    ///
    /// # Errors
    /// When there is no triangle, one names a vertex that does not exist, or cancelled.
    pub fn new(
        positions: Vec<Point>,
        triangles: Vec<[u32; 3]>,
        run: &dyn Run,
    ) -> Result<Triangles, Failure> {
        let bvh = Bvh::new(&positions, &triangles, run)?;
        if bvh.is_empty() {
            return Err(Failure::bad_input(
                "the mesh has no triangle with finite corners",
            ));
        }
        Ok(Triangles {
            positions,
            triangles,
            bvh,
        })
    }

    /// Vertices in use minus edges plus triangles.
    #[must_use]
    pub fn euler(&self) -> i64 {
        let mut edges: Vec<u64> = Vec::with_capacity(3 * self.triangles.len());
        let mut used = vec![false; self.positions.len()];
        for t in &self.triangles {
            for k in 0..3 {
                let (a, b) = (t[k], t[(k + 1) % 3]);
                edges.push(u64::from(a.min(b)) << 32 | u64::from(a.max(b)));
                used[a as usize] = true;
            }
        }
        edges.sort_unstable();
        edges.dedup();
        let vertices = used.into_iter().filter(|used| *used).count();
        vertices as i64 - edges.len() as i64 + self.triangles.len() as i64
    }

    /// Number of components.
    #[must_use]
    pub fn components(&self) -> i64 {
        let mut groups = Groups::new(self.positions.len());
        for [a, b, c] in &self.triangles {
            groups.join(*a, *b);
            groups.join(*b, *c);
        }
        let corners = self.triangles.as_flattened();
        let mut roots: Vec<u32> = corners.iter().map(|v| groups.find(*v)).collect();
        roots.sort_unstable();
        roots.dedup();
        roots.len() as i64
    }

    /// Points uniform over the area, one for each square of the spacing, at least 1000.
    ///
    /// # Errors
    /// When there would be too many, or the mesh has no area.
    pub fn samples(&self, spacing: f64, seed: u64) -> Result<Vec<Point>, Failure> {
        let corners = |t: &[u32; 3]| t.map(|v| self.positions[v as usize]);
        let mut total = 0.0;
        let mut sums = Vec::with_capacity(self.triangles.len());
        for t in &self.triangles {
            let [a, b, c] = corners(t);
            let area = squared(cross(sub(b, a), sub(c, a))).sqrt() / 2.0;
            total += if area.is_finite() { area } else { 0.0 };
            sums.push(total);
        }
        if total <= 0.0 {
            return Err(Failure::bad_input("the mesh has no area"));
        }
        let count = limited(total, spacing)?.max(1000);
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let mut samples = Vec::with_capacity(count);
        for i in 0..count {
            let at = (i as f64 + unit(&mut random)) / count as f64 * total;
            let found = sums.partition_point(|sum| *sum <= at).min(sums.len() - 1);
            let [a, b, c] = corners(&self.triangles[found]);
            let (mut u, mut v) = (unit(&mut random), unit(&mut random));
            if u + v > 1.0 {
                (u, v) = (1.0 - u, 1.0 - v);
            }
            let ab = between(a, b, u);
            samples.push(std::array::from_fn(|axis| {
                ab[axis] + v * (c[axis] - a[axis])
            }));
        }
        Ok(samples)
    }
}

fn unit(random: &mut ChaCha8Rng) -> f64 {
    (random.next_u64() >> 11) as f64 / (1u64 << 53) as f64
}

fn limited(area: f64, spacing: f64) -> Result<usize, Failure> {
    let count = area / (spacing * spacing);
    if count > MOST {
        let message = format!("a spacing of {spacing} nm needs {count:.1e} samples");
        return Err(Failure::bad_parameter("spacing", message).remedy("raise it"));
    }
    Ok(count as usize)
}

/// Points of an analytic surface, one for each square of the spacing: a point in each cell of a
/// grid, kept in the layer as thick as a cell about the surface and moved onto it.
///
/// # Errors
/// When there would be too many, or cancelled.
pub fn truth_samples(
    truth: &Truth,
    spacing: f64,
    seed: u64,
    run: &dyn Run,
) -> Result<Vec<Point>, Failure> {
    const SIDE: usize = 16;
    let [low, high] = truth.bounds();
    let low = low.map(|x| x - spacing);
    let block = spacing * SIDE as f64;
    let shape: [f64; 3] =
        std::array::from_fn(|axis| ((high[axis] + spacing - low[axis]) / block).ceil().max(1.0));
    let [nx, ny, nz] = shape;
    if nx * ny * nz > 1e6 {
        return Err(limited(f64::INFINITY, spacing)
            .err()
            .unwrap_or_else(Failure::cancelled));
    }
    let (nx, ny, nz) = (nx as usize, ny as usize, nz as usize);
    let parts = map(run, nx * ny * nz, &|number| {
        let mut found: Vec<Point> = Vec::new();
        let place = [number % nx, number / nx % ny, number / nx / ny];
        let corner: Point = std::array::from_fn(|a| low[a] + place[a] as f64 * block);
        let middle = corner.map(|x| x + block / 2.0);
        // No slope of the function exceeds 1.
        if run.cancelled() || truth.value(middle).abs() > block * 0.9 + spacing {
            return found;
        }
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        random.set_stream(number as u64 + 1);
        for cell in 0..SIDE * SIDE * SIDE {
            let place = [cell % SIDE, cell / SIDE % SIDE, cell / SIDE / SIDE];
            let p: Point = std::array::from_fn(|a| {
                corner[a] + (place[a] as f64 + unit(&mut random)) * spacing
            });
            if truth.value(p).abs() < spacing / 2.0 {
                found.push(truth.project(p));
            }
        }
        found
    });
    if run.cancelled() {
        return Err(Failure::cancelled());
    }
    Ok(parts.concat())
}

/// Distances of points from a mesh, exactly.
///
/// # Errors
/// When cancelled.
pub fn from_mesh(points: &[Point], mesh: &Triangles, run: &dyn Run) -> Result<Vec<f64>, Failure> {
    each(points, run, &|p| {
        mesh.bvh
            .nearest(p)
            .map_or(f64::NAN, |nearest| nearest.squared.sqrt())
    })
}

/// Distances of points from an analytic surface: to the place that Newton's steps lead to.
///
/// # Errors
/// When cancelled.
pub fn from_truth(points: &[Point], truth: &Truth, run: &dyn Run) -> Result<Vec<f64>, Failure> {
    each(points, run, &|p| squared(sub(p, truth.project(p))).sqrt())
}

/// Distance of each point from the nearest of others, the sampled form of the publication.
///
/// # Errors
/// When cancelled.
pub fn from_samples(
    points: &[Point],
    others: &[Point],
    run: &dyn Run,
) -> Result<Vec<f64>, Failure> {
    let columns: [Vec<f64>; 3] =
        std::array::from_fn(|axis| others.iter().map(|p| p[axis]).collect());
    let grid = Grid::for_nearest([&columns[0], &columns[1], &columns[2]], [1.0; 3], 1, run)?;
    each(points, run, &|p| {
        let mut nearest = Nearest::new(1);
        grid.nearest(&p, None, &mut nearest);
        nearest
            .last()
            .map_or(f64::NAN, |(squared, _)| squared.sqrt())
    })
}

/// Calls `of` for all points, in parallel.
///
/// # Errors
/// When cancelled.
pub fn each(
    points: &[Point],
    run: &dyn Run,
    of: &(dyn Fn(Point) -> f64 + Sync),
) -> Result<Vec<f64>, Failure> {
    let parts = map(run, points.len().div_ceil(BLOCK), &|block| {
        let range = block * BLOCK..points.len().min((block + 1) * BLOCK);
        let points = if run.cancelled() { &[] } else { &points[range] };
        points.iter().map(|p| of(*p)).collect::<Vec<f64>>()
    });
    if run.cancelled() {
        return Err(Failure::cancelled());
    }
    Ok(parts.concat())
}

/// Mean of the squares.
#[must_use]
pub fn mean_square(distances: &[f64]) -> f64 {
    distances.iter().map(|d| d * d).sum::<f64>() / distances.len().max(1) as f64
}

/// The distance that this share of all does not exceed. NaN of none.
#[must_use]
pub fn quantile(distances: &[f64], share: f64) -> f64 {
    let mut sorted = distances.to_vec();
    sorted.sort_unstable_by(f64::total_cmp);
    let place = (share * sorted.len() as f64).ceil() as usize;
    sorted
        .get(place.saturating_sub(1))
        .copied()
        .unwrap_or(f64::NAN)
}
