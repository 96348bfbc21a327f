//! Area, volume, normals, angles and edge lengths.

use crate::blocks::{by_block, by_item, sum};
use crate::mesh::{Mesh, NONE, prev};
use crate::vector::{Point, add, angle, area_vector, cross, dot, norm, scale, squared, sub, unit};
use puncta_sdk::{Cancelled, Run};
use std::f64::consts::{PI, TAU};

/// Area of all triangles, in the square of the unit of the positions.
///
/// # Errors
/// When cancelled.
pub fn area(mesh: &Mesh, run: &dyn Run) -> Result<f64, Cancelled> {
    let of = |i: usize| {
        let corners = mesh.corners(i as u32);
        corners.map_or(0.0, |corners| 0.5 * norm(area_vector(corners)))
    };
    sum(run, mesh.half_edges() as usize / 3, of)
}

/// Volume inside, by signed tetrahedra: positive if the triangles face outwards. Meaningful for
/// closed meshes.
///
/// # Errors
/// When cancelled.
pub fn volume(mesh: &Mesh, run: &dyn Run) -> Result<f64, Cancelled> {
    let middle = centre(mesh);
    let of = |i: usize| {
        mesh.corners(i as u32).map_or(0.0, |corners| {
            dot(area_vector(corners), sub(corners[0], middle)) / 6.0
        })
    };
    sum(run, mesh.half_edges() as usize / 3, of)
}

/// Mean position of the live vertices.
#[must_use]
pub fn centre(mesh: &Mesh) -> Point {
    let total = mesh
        .live_vertices()
        .fold([0.0; 3], |total, v| add(total, mesh.position(v)));
    scale(total, 1.0 / mesh.vertex_count().max(1) as f64)
}

/// Unit normals of all triangles; zero where a triangle is dead or has no area.
///
/// # Errors
/// When cancelled.
pub fn triangle_normals(mesh: &Mesh, run: &dyn Run) -> Result<Vec<Point>, Cancelled> {
    by_item(run, mesh.half_edges() as usize / 3, |i| {
        let corners = mesh.corners(i as u32);
        corners.map_or([0.0; 3], |corners| unit(area_vector(corners)))
    })
}

/// Unit normal of a vertex, outwards: triangles are weighted so that it is exact on spheres (Max,
/// J. Graph. Tools 4, 1999). Zero if it has none.
#[must_use]
pub fn normal(mesh: &Mesh, vertex: u32) -> Point {
    let centre = mesh.position(vertex);
    let mut total = [0.0; 3];
    let mut plain = [0.0; 3];
    for h in mesh.outgoing(vertex) {
        let ahead = sub(mesh.position(mesh.to(h)), centre);
        let back = sub(mesh.position(mesh.from(prev(h))), centre);
        let normal = cross(ahead, back);
        let weight = squared(ahead) * squared(back);
        plain = add(plain, normal);
        if weight > 0.0 {
            total = add(total, scale(normal, 1.0 / weight));
        }
    }
    let smooth = unit(total);
    // Needles of almost no length outweigh the rest: then by area.
    if dot(smooth, plain) > 0.0 {
        smooth
    } else {
        unit(plain)
    }
}

/// [`normal`] of all vertices; zero for dead ones.
///
/// # Errors
/// When cancelled.
pub fn vertex_normals(mesh: &Mesh, run: &dyn Run) -> Result<Vec<Point>, Cancelled> {
    by_item(run, mesh.positions().len(), |v| normal(mesh, v as u32))
}

/// Angle deficit of each vertex in rad: 2 pi minus the angles of its triangles, or pi minus them
/// at the boundary. It is the integral of the Gaussian curvature, and sums to 2 pi times the Euler
/// characteristic (Gauss-Bonnet). Zero for dead vertices.
///
/// # Errors
/// When cancelled.
pub fn angle_deficits(mesh: &Mesh, run: &dyn Run) -> Result<Vec<f64>, Cancelled> {
    by_item(run, mesh.positions().len(), |v| {
        let v = v as u32;
        if mesh.out(v) == NONE {
            return 0.0;
        }
        let centre = mesh.position(v);
        let angles = mesh.outgoing(v).map(|h| {
            let ahead = sub(mesh.position(mesh.to(h)), centre);
            let back = sub(mesh.position(mesh.from(prev(h))), centre);
            angle(ahead, back)
        });
        (if mesh.at_boundary(v) { PI } else { TAU }) - angles.sum::<f64>()
    })
}

/// Area that belongs to each vertex: the mixed Voronoi area (Meyer et al., 2003). The areas sum to
/// that of the mesh. Zero for dead vertices.
///
/// # Errors
/// When cancelled.
pub fn vertex_areas(mesh: &Mesh, run: &dyn Run) -> Result<Vec<f64>, Cancelled> {
    by_item(run, mesh.positions().len(), |v| {
        mesh.outgoing(v as u32)
            .map(|h| {
                let [a, b, c] = [h, crate::next(h), prev(h)].map(|h| mesh.position(mesh.from(h)));
                corner_area(a, b, c)
            })
            .sum()
    })
}

/// Part of the triangle that belongs to its corner `a`.
fn corner_area(a: Point, b: Point, c: Point) -> f64 {
    let (ab, ac, bc) = (sub(b, a), sub(c, a), sub(c, b));
    let double = norm(cross(ab, ac));
    if dot(ab, ac) < 0.0 {
        return double / 4.0;
    }
    let (at_b, at_c) = (-dot(ab, bc), dot(ac, bc));
    if at_b < 0.0 || at_c < 0.0 {
        return double / 8.0;
    }
    if double == 0.0 {
        return 0.0;
    }
    (squared(ab) * at_c + squared(ac) * at_b) / double / 8.0
}

/// How long the edges are.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct EdgeLengths {
    /// Number of edges.
    pub count: usize,
    /// Shortest.
    pub least: f64,
    /// Median (the upper of two).
    pub median: f64,
    /// Mean.
    pub mean: f64,
    /// Standard deviation.
    pub deviation: f64,
    /// Longest.
    pub most: f64,
}

/// Lengths of the edges; all zero if there is none.
///
/// # Errors
/// When cancelled.
pub fn edge_lengths(mesh: &Mesh, run: &dyn Run) -> Result<EdgeLengths, Cancelled> {
    let parts = by_block(run, mesh.half_edges() as usize, |block| {
        let edges = block.map(|h| h as u32);
        let edges = edges.filter(|&h| mesh.is_live(h) && h < mesh.twin(h));
        edges.map(|h| length(mesh, h)).collect::<Vec<f64>>()
    })?;
    let mut lengths = parts.concat();
    if lengths.is_empty() {
        return Ok(EdgeLengths::default());
    }
    let count = lengths.len();
    let mean = lengths.iter().sum::<f64>() / count as f64;
    let spread = lengths.iter().map(|l| (l - mean) * (l - mean)).sum::<f64>() / count as f64;
    let (_, &mut median, _) = lengths.select_nth_unstable_by(count / 2, f64::total_cmp);
    Ok(EdgeLengths {
        count,
        least: lengths.iter().copied().fold(f64::INFINITY, f64::min),
        median,
        mean,
        deviation: spread.sqrt(),
        most: lengths.iter().copied().fold(0.0, f64::max),
    })
}

/// Length of the edge of a half-edge.
#[must_use]
#[inline]
pub fn length(mesh: &Mesh, h: u32) -> f64 {
    norm(sub(mesh.position(mesh.to(h)), mesh.position(mesh.from(h))))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shapes;
    use puncta_sdk::run::Serial;

    fn shape(shape: shapes::Shape) -> Mesh {
        Mesh::new(shape.0, &shape.1).unwrap()
    }

    #[test]
    fn spheres_and_tori_have_their_area_and_volume() {
        let mesh = shape(shapes::sphere(100.0, 5));
        let (area, volume) = (
            area(&mesh, &Serial).unwrap(),
            volume(&mesh, &Serial).unwrap(),
        );
        assert!((area / (4.0 * PI * 1e4) - 1.0).abs() < 1e-3, "{area}");
        assert!(
            (volume / (4.0 / 3.0 * PI * 1e6) - 1.0).abs() < 2e-3,
            "{volume}"
        );
        let areas: f64 = vertex_areas(&mesh, &Serial).unwrap().iter().sum();
        assert!((areas / area - 1.0).abs() < 1e-12);
        let mesh = shape(shapes::torus(100.0, 30.0, 400, 120));
        let (area, volume) = (super::area(&mesh, &Serial), super::volume(&mesh, &Serial));
        assert!((area.unwrap() / (4.0 * PI * PI * 3000.0) - 1.0).abs() < 1e-3);
        assert!((volume.unwrap() / (2.0 * PI * PI * 100.0 * 900.0) - 1.0).abs() < 1e-3);
    }

    #[test]
    fn angle_deficits_sum_to_the_euler_characteristic() {
        for (mesh, chi) in [
            (shape(shapes::sphere(3.0, 4)), 2.0),
            (shape(shapes::torus(5.0, 1.0, 70, 30)), 0.0),
            (shape(shapes::cube(5.0, 7)), 2.0),
            (shape(shapes::grid(9, 4, 2.0)), 1.0),
        ] {
            let total: f64 = angle_deficits(&mesh, &Serial).unwrap().iter().sum();
            assert!((total - TAU * chi).abs() < 1e-9, "{total}");
        }
    }

    #[test]
    fn normals_of_a_sphere_are_exact_on_irregular_triangles() {
        let (mut positions, triangles) = shapes::sphere(1.0, 3);
        for (i, p) in positions.iter_mut().enumerate() {
            let shake = 0.05 * ((i * 7919 % 101) as f64 / 101.0 - 0.5);
            *p = unit([p[0] + shake, p[1] - 0.7 * shake, p[2] + 0.3 * shake]);
        }
        let mesh = Mesh::new(positions, &triangles).unwrap();
        for (n, p) in vertex_normals(&mesh, &Serial)
            .unwrap()
            .iter()
            .zip(mesh.positions())
        {
            assert!(norm(sub(*n, *p)) < 1e-12);
        }
    }

    #[test]
    fn far_from_the_origin_the_volume_is_the_same() {
        let (mut positions, triangles) = shapes::cube(10.0, 3);
        positions.iter_mut().for_each(|p| p[0] += 1e7);
        let mesh = Mesh::new(positions, &triangles).unwrap();
        assert!((volume(&mesh, &Serial).unwrap() - 1000.0).abs() < 1e-6);
        let lengths = edge_lengths(&mesh, &Serial).unwrap();
        assert_eq!(lengths.count, 162);
        assert!((lengths.most - 200f64.sqrt() / 3.0).abs() < 1e-8);
    }
}
