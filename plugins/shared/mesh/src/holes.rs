//! Filling holes.

use crate::mesh::{Mesh, NONE};
use crate::topology::boundary_loops;
use crate::vector::{Point, add, area_vector, dot, norm, scale, unit};
use puncta_sdk::{Cancelled, Run};

/// Loops of up to this many edges get the triangulation of least area; longer ones a vertex in the
/// middle.
const EXACT: usize = 100;

/// Fills holes of up to `edges` edges; gives how many were filled and how many are left. The rim of
/// a single triangle is no hole.
///
/// # Errors
/// When cancelled.
pub fn fill_holes(
    mesh: &mut Mesh,
    edges: usize,
    run: &dyn Run,
) -> Result<(usize, usize), Cancelled> {
    let loops = boundary_loops(mesh);
    let mut filled = 0;
    let count = loops.len();
    for ring in loops {
        if run.cancelled() {
            return Err(Cancelled);
        }
        if ring.len() <= edges && ring.len() >= 3 && !is_whole(mesh, &ring) {
            fill(mesh, &ring);
            filled += 1;
        }
    }
    Ok((filled, count - filled))
}

/// Whether all triangles along the loop are one and the same.
fn is_whole(mesh: &Mesh, ring: &[u32]) -> bool {
    ring.iter().all(|h| h / 3 == ring[0] / 3) || mesh.is_empty()
}

fn fill(mesh: &mut Mesh, ring: &[u32]) {
    // Seen from the hole, the loop runs the other way.
    let around: Vec<u32> = ring.iter().rev().map(|&h| mesh.to(h)).collect();
    let triangles = if around.len() <= EXACT {
        least_area(mesh, &around)
    } else {
        None
    };
    let triangles = triangles.unwrap_or_else(|| {
        let places = around.iter().map(|&v| mesh.position(v));
        let total = places.fold([0.0; 3], add);
        let centre = mesh.positions.len() as u32;
        mesh.positions.push(scale(total, 1.0 / around.len() as f64));
        mesh.out.push(NONE);
        mesh.vertices += 1;
        let next = around.iter().cycle().skip(1);
        around
            .iter()
            .zip(next)
            .map(|(&a, &b)| [a, b, centre])
            .collect()
    });
    attach(mesh, &triangles, &around);
}

/// Adds triangles to a loop that they fill: each of their edges is one of the loop, or shared.
fn attach(mesh: &mut Mesh, triangles: &[[u32; 3]], around: &[u32]) {
    let first = mesh.half_edges();
    mesh.corner.extend(triangles.as_flattened());
    mesh.twin.resize(mesh.corner.len(), NONE);
    mesh.triangles += triangles.len();
    let mut open: Vec<(u32, u32, u32)> = (first..mesh.half_edges())
        .map(|h| (mesh.from(h), mesh.to(h), h))
        .collect();
    open.sort_unstable();
    let find = |a: u32, b: u32| {
        let place = open
            .binary_search_by_key(&(a, b), |&(a, b, _)| (a, b))
            .ok()?;
        Some(open[place].2)
    };
    let pairs: Vec<(u32, u32)> = open
        .iter()
        .map(|&(a, b, h)| {
            // Within the patch, or the rim: the half-edge from b, which begins at the boundary.
            (h, find(b, a).unwrap_or_else(|| mesh.out(b)))
        })
        .collect();
    for (h, other) in pairs {
        mesh.set_twins(h, other);
    }
    for &vertex in around {
        mesh.settle_out(vertex, mesh.out(vertex));
    }
    for h in first..mesh.half_edges() {
        let vertex = mesh.from(h);
        if mesh.out(vertex) == NONE {
            mesh.settle_out(vertex, h);
        }
    }
}

/// The triangulation of least area, with bends weighed in, that makes no edge which the mesh has
/// already (Barequet and Sharir, Comput. Aided Geom. Des. 12, 1995).
fn least_area(mesh: &Mesh, around: &[u32]) -> Option<Vec<[u32; 3]>> {
    let n = around.len();
    let places: Vec<Point> = around.iter().map(|&v| mesh.position(v)).collect();
    let middle = {
        let total = (0..n).fold([0.0; 3], |sum, i| {
            add(
                sum,
                area_vector([places[0], places[i], places[(i + 1) % n]]),
            )
        });
        unit(total)
    };
    let taken =
        |i: usize, j: usize| j - i > 1 && j - i < n - 1 && mesh.joined(around[i], around[j]);
    let mut blocked = vec![false; n * n];
    for i in 0..n {
        for j in i + 1..n {
            blocked[i * n + j] = taken(i, j);
        }
    }
    let cost = |i: usize, k: usize, j: usize| {
        let normal = area_vector([places[i], places[k], places[j]]);
        let area = norm(normal);
        // A triangle that faces away from the hole's plane costs twice its area.
        2.0 * area - dot(normal, middle).min(area)
    };
    let mut weight = vec![0.0; n * n];
    let mut split = vec![0; n * n];
    for span in 2..n {
        for i in 0..n - span {
            let j = i + span;
            let mut best = (f64::INFINITY, 0);
            if !blocked[i * n + j] {
                for k in i + 1..j {
                    let total = weight[i * n + k] + weight[k * n + j] + cost(i, k, j);
                    if total < best.0 {
                        best = (total, k);
                    }
                }
            }
            (weight[i * n + j], split[i * n + j]) = best;
        }
    }
    if !weight[n - 1].is_finite() {
        return None;
    }
    let mut triangles = Vec::with_capacity(n - 2);
    let mut stack = vec![(0, n - 1)];
    while let Some((i, j)) = stack.pop() {
        if j - i < 2 {
            continue;
        }
        let k = split[i * n + j];
        triangles.push([around[i], around[k], around[j]]);
        stack.extend([(i, k), (k, j)]);
    }
    Some(triangles)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::measure::volume;
    use crate::shapes;
    use crate::topology::{describe, keep_components};
    use puncta_sdk::run::Serial;

    /// The sphere without the triangles above a height.
    fn cap(height: f64, levels: u32) -> Mesh {
        let (positions, mut triangles) = shapes::sphere(1.0, levels);
        triangles.retain(|t| t.iter().any(|&v| positions[v as usize][2] < height));
        let mesh = Mesh::new(positions, &triangles).unwrap();
        keep_components(&mesh, |one| one.triangles > 1)
    }

    #[test]
    fn small_and_large_holes_are_closed() {
        for (height, levels) in [(0.8, 3), (0.3, 3), (0.0, 5)] {
            let mut mesh = cap(height, levels);
            let edges = boundary_loops(&mesh)[0].len();
            assert_eq!(fill_holes(&mut mesh, edges - 1, &Serial).unwrap(), (0, 1));
            assert_eq!(fill_holes(&mut mesh, edges, &Serial).unwrap(), (1, 0));
            mesh.verify().unwrap();
            let one = describe(&mesh).0[0];
            assert_eq!((one.euler, one.loops), (2, 0), "{edges}");
            // The rim lies less than an edge above the height.
            let below = |h: f64| std::f64::consts::PI * (2.0 / 3.0 + h - h * h * h / 3.0);
            let found = volume(&mesh, &Serial).unwrap();
            let edge = 1.3 / f64::from(1 << levels);
            assert!(found > 0.97 * below(height), "{found} {height}");
            assert!(found < below(height + edge), "{found} {height}");
            let (positions, triangles) = mesh.to_triangles();
            Mesh::new(positions, &triangles).unwrap();
        }
    }

    #[test]
    fn both_ends_of_a_tube_and_no_single_triangle() {
        let (positions, triangles) = shapes::torus(10.0, 3.0, 12, 8);
        let kept: Vec<[u32; 3]> = triangles[..96].to_vec();
        let mut mesh = Mesh::new(positions, &kept).unwrap();
        assert_eq!(fill_holes(&mut mesh, 50, &Serial).unwrap(), (2, 0));
        mesh.verify().unwrap();
        assert_eq!(describe(&mesh).0[0].euler, 2);
        let mut single = Mesh::new(vec![[0.0; 3]; 3], &[[0, 1, 2]]).unwrap();
        assert_eq!(fill_holes(&mut single, 50, &Serial).unwrap(), (0, 1));
    }
}
