//! Loop subdivision.

use crate::blocks::by_item;
use crate::mesh::{Mesh, NONE, prev};
use crate::smooth::mean_of_ring;
use crate::vector::{Point, add, along, scale, sub};
use puncta_sdk::{Failure, Run};
use std::f64::consts::TAU;

/// Cuts each triangle in four and smooths (Loop, master's thesis, University of Utah, 1987): new
/// vertices at 3/8 of the ends of their edge and 1/8 of the opposite corners, at the boundary
/// midway; old ones drawn towards the mean of their neighbours, at the boundary by a quarter.
///
/// # Errors
/// When the result would be too large; or cancelled.
pub fn subdivide(mesh: &Mesh, run: &dyn Run) -> Result<Mesh, Failure> {
    let mut mesh = mesh.clone();
    mesh.compact();
    let old = mesh.positions().len();
    let edges: Vec<u32> = mesh.edges().collect();
    crate::build::check_size(old + edges.len(), mesh.triangle_count() * 4)?;
    let mut number = vec![NONE; mesh.half_edges() as usize];
    for (i, &h) in (old as u32..).zip(&edges) {
        number[h as usize] = i;
        if let Some(slot) = number.get_mut(mesh.twin(h) as usize) {
            *slot = i;
        }
    }
    let mut positions = by_item(run, old, |v| even(&mesh, v as u32))?;
    positions.extend(by_item(run, edges.len(), |i| odd(&mesh, edges[i]))?);
    let mut triangles = Vec::with_capacity(mesh.triangle_count() * 4);
    for (i, [a, b, c]) in mesh.triangles() {
        let [ab, bc, ca] = [0, 1, 2].map(|side| number[(3 * i + side) as usize]);
        triangles.extend([[a, ab, ca], [b, bc, ab], [c, ca, bc], [ab, bc, ca]]);
    }
    Mesh::new(positions, &triangles)
}

fn even(mesh: &Mesh, v: u32) -> Point {
    let p = mesh.position(v);
    let Some(mean) = mean_of_ring(mesh, v) else {
        return p;
    };
    let weight = if mesh.at_boundary(v) {
        0.25
    } else {
        let n = mesh.valence(v) as f64;
        let inner = 0.375 + 0.25 * (TAU / n).cos();
        0.625 - inner * inner
    };
    along(p, sub(mean, p), weight)
}

fn odd(mesh: &Mesh, h: u32) -> Point {
    let ends = add(mesh.position(mesh.from(h)), mesh.position(mesh.to(h)));
    let twin = mesh.twin(h);
    if twin == NONE {
        return scale(ends, 0.5);
    }
    let [c, d] = [prev(h), prev(twin)].map(|h| mesh.position(mesh.from(h)));
    along(scale(ends, 0.375), add(c, d), 0.125)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::measure::area;
    use crate::shapes;
    use crate::topology::{describe, euler};
    use crate::vector::norm;
    use puncta_sdk::run::Serial;

    #[test]
    fn counts_and_topology() {
        for (shape, chi) in [
            (shapes::torus(5.0, 2.0, 12, 7), 0),
            (shapes::sphere(1.0, 1), 2),
        ] {
            let mesh = Mesh::new(shape.0, &shape.1).unwrap();
            let finer = subdivide(&mesh, &Serial).unwrap();
            finer.verify().unwrap();
            assert_eq!(finer.triangle_count(), 4 * mesh.triangle_count());
            assert_eq!(euler(&finer), chi);
        }
    }

    #[test]
    fn flat_sheets_keep_their_place_and_straight_rims() {
        let (positions, triangles) = shapes::grid(4, 4, 1.0);
        let mesh = Mesh::new(positions, &triangles).unwrap();
        let finer = subdivide(&mesh, &Serial).unwrap();
        assert!(finer.positions().iter().all(|p| p[2] == 0.0));
        // Each of the four corners loses a sixteenth of a square.
        let found = area(&finer, &Serial).unwrap();
        assert!((found - 15.75).abs() < 1e-12, "{found}");
        assert_eq!(describe(&finer).0[0].loops, 1);
    }

    #[test]
    fn spheres_converge_to_smooth_ones() {
        let (positions, triangles) = shapes::sphere(1.0, 2);
        let mut mesh = Mesh::new(positions, &triangles).unwrap();
        for _ in 0..2 {
            mesh = subdivide(&mesh, &Serial).unwrap();
        }
        let radii: Vec<f64> = mesh.positions().iter().map(|p| norm(*p)).collect();
        let (low, high) = (
            radii.iter().copied().fold(f64::INFINITY, f64::min),
            radii.iter().copied().fold(0.0, f64::max),
        );
        assert!(
            high / low < 1.005 && low > 0.97 && high < 1.0,
            "{low} {high}"
        );
    }
}
