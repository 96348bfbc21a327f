//! Random points on a mesh.

use crate::mesh::Mesh;
use crate::vector::{Point, along, area_vector, norm, sub};
use puncta_sdk::run::{Run, chunks_mut, map};
use puncta_sdk::{Cancelled, Failure};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use rand_distr::{Distribution, StandardNormal};

/// Points of a stream of random numbers.
const BLOCK: usize = 4096;

/// `count` points, uniform over the area, and the triangle of each. The same seed gives the same
/// points on any number of threads.
///
/// # Errors
/// When the mesh has no area and points are asked for; or cancelled.
pub fn points(
    mesh: &Mesh,
    count: usize,
    seed: u64,
    run: &dyn Run,
) -> Result<(Vec<Point>, Vec<u32>), Failure> {
    let mut sums = Vec::with_capacity(mesh.half_edges() as usize / 3);
    let mut total = 0.0;
    for i in 0..mesh.half_edges() / 3 {
        total += mesh
            .corners(i)
            .map_or(0.0, |corners| norm(area_vector(corners)));
        sums.push(total);
    }
    if count > 0 && !(total > 0.0 && f64::is_finite(total)) {
        return Err(Failure::bad_input("there is no area to draw points from"));
    }
    let parts = map(run, count.div_ceil(BLOCK), &|block| {
        if run.cancelled() {
            return None;
        }
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        random.set_stream(block as u64 + 1);
        let size = BLOCK.min(count - block * BLOCK);
        let one = |_| draw(mesh, &sums, total, &mut random);
        Some((0..size).map(one).collect::<Vec<_>>())
    });
    let parts: Option<Vec<Vec<(Point, u32)>>> = parts.into_iter().collect();
    let parts = parts.filter(|_| !run.cancelled()).ok_or(Cancelled)?;
    Ok(parts.into_iter().flatten().unzip())
}

fn draw(mesh: &Mesh, sums: &[f64], total: f64, random: &mut ChaCha8Rng) -> (Point, u32) {
    let at = unit_interval(random) * total;
    let triangle = sums.partition_point(|sum| *sum <= at).min(sums.len() - 1) as u32;
    let (mut u, mut v) = (unit_interval(random), unit_interval(random));
    if u + v > 1.0 {
        (u, v) = (1.0 - u, 1.0 - v);
    }
    let [a, b, c] = mesh.corners(triangle).unwrap_or_default();
    (along(along(a, sub(b, a), u), sub(c, a), v), triangle)
}

/// Moves points by a normal error of this standard deviation along each axis, nm.
///
/// # Errors
/// When cancelled.
pub fn normal_errors(
    points: &mut [Point],
    deviation: f64,
    seed: u64,
    run: &dyn Run,
) -> Result<(), Cancelled> {
    chunks_mut(run, points, BLOCK, &|block, points| {
        if run.cancelled() {
            return;
        }
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        // Streams of their own, so that points lie at the same places with and without errors.
        random.set_stream(1 << 48 | block as u64);
        for coordinate in points.as_flattened_mut() {
            let error: f64 = StandardNormal.sample(&mut random);
            *coordinate += deviation * error;
        }
    });
    if run.cancelled() {
        return Err(Cancelled);
    }
    Ok(())
}

/// Uniform in [0, 1), 53 bits.
pub(crate) fn unit_interval(random: &mut impl Rng) -> f64 {
    (random.next_u64() >> 11) as f64 / (1_u64 << 53) as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Distance, shapes};
    use puncta_sdk::run::Serial;
    use puncta_testkit::Threads;

    #[test]
    fn points_are_uniform_by_area_and_on_the_surface() {
        // A sheet of one large and many small triangles: halves by area, not by number.
        let (mut positions, mut triangles) = shapes::grid(10, 10, 1.0);
        let first = positions.len() as u32;
        positions.extend([[10.0, 0.0, 0.0], [30.0, 0.0, 0.0], [10.0, 10.0, 0.0]]);
        triangles.push([first, first + 1, first + 2]);
        let mesh = Mesh::new(positions, &triangles).unwrap();
        let (points, of) = points(&mesh, 100_000, 5, &Serial).unwrap();
        let small = points.iter().filter(|p| p[0] < 10.0).count() as f64;
        assert!((small - 50_000.0).abs() < 4.0 * 158.0, "{small}");
        let low = points.iter().filter(|p| p[0] < 10.0 && p[1] < 5.0).count() as f64;
        assert!((low - small / 2.0).abs() < 500.0);
        let distance = Distance::new(&mesh, &Serial).unwrap();
        assert!(points.iter().all(|p| distance.unsigned(*p) < 1e-12));
        assert_eq!(of.len(), 100_000);
    }

    #[test]
    fn errors_have_their_deviation() {
        let mut points = vec![[1.0; 3]; 30_000];
        normal_errors(&mut points, 5.0, 3, &Threads(2)).unwrap();
        let errors: Vec<f64> = points.as_flattened().iter().map(|x| x - 1.0).collect();
        let mean = errors.iter().sum::<f64>() / 9e4;
        let square = errors.iter().map(|e| e * e).sum::<f64>() / 9e4;
        assert!(
            mean.abs() < 0.07 && (square / 25.0 - 1.0).abs() < 0.02,
            "{mean} {square}"
        );
    }

    #[test]
    fn seeds_decide_and_threads_do_not() {
        let (positions, triangles) = shapes::sphere(10.0, 3);
        let mesh = Mesh::new(positions, &triangles).unwrap();
        let at = |seed, run: &dyn Run| points(&mesh, 20_000, seed, run).unwrap().0;
        assert_eq!(at(1, &Serial), at(1, &Threads(3)));
        assert_ne!(at(1, &Serial), at(2, &Serial));
        assert!(points(&Mesh::default(), 1, 0, &Serial).is_err());
        assert!(points(&Mesh::default(), 0, 0, &Serial).is_ok());
    }
}
