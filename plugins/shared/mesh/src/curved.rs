//! A smooth surface through the vertices of a mesh.

use crate::bvh::{Bvh, Nearest};
use crate::measure::vertex_normals;
use crate::mesh::Mesh;
use crate::vector::{
    Point, add, along, area_vector, cross, distance, dot, middle, scale, squared, sub, unit,
};
use puncta_sdk::{Failure, Run};

/// Height of the middle of an edge over its chord, so that the curvature of the surface stays: the
/// cubic through both ends with the tangents that their normals say (thesis D.1.4; positive where
/// the surface is convex). At most a quarter of the edge.
#[must_use]
pub fn edge_middle([a, b]: [Point; 2], [na, nb]: [Point; 2]) -> Point {
    let edge = sub(b, a);
    let up = unit(add(na, nb));
    let height = dot(sub(nb, na), edge) / 8.0;
    let most = 0.25 * squared(edge).sqrt();
    along(middle(a, b), up, height.clamp(-most, most))
}

/// Triangles of a mesh, each bent to a cubic patch by the normals at its corners (Vlachos et al.,
/// I3D 2001, curved PN triangles): the middle of an edge lies where [`edge_middle`] puts it.
#[derive(Clone, Debug)]
pub struct Curved {
    bvh: Bvh,
    positions: Vec<Point>,
    normals: Vec<Point>,
    triangles: Vec<[u32; 3]>,
}

/// Cosine of the angle between the normal of a triangle and that of a corner from which on the
/// corner counts as a crease and the triangle stays flat there.
const CREASE: f64 = 0.75;

impl Curved {
    /// The surface of a mesh as it is now.
    ///
    /// # Errors
    /// When cancelled.
    pub fn new(mesh: &Mesh, run: &dyn Run) -> Result<Curved, Failure> {
        let mut mesh = mesh.clone();
        mesh.compact();
        let normals = vertex_normals(&mesh, run)?;
        let bvh = Bvh::new(mesh.positions(), mesh.stored_triangles(), run)?;
        let triangles = mesh.stored_triangles().to_vec();
        Ok(Curved {
            bvh,
            positions: mesh.positions,
            normals,
            triangles,
        })
    }

    /// The place of the surface that belongs to the nearest place of the triangles, and the normal
    /// there. `None` if there is no surface. `hint` is that of [`Bvh::nearest_by`].
    #[must_use]
    pub fn project(&self, p: Point, hint: &mut u32) -> Option<(Point, Point)> {
        let nearest = self.bvh.nearest_by(p, hint)?;
        Some(self.lift(&nearest))
    }

    fn lift(&self, nearest: &Nearest) -> (Point, Point) {
        let Some(triangle) = self.triangles.get(nearest.triangle as usize) else {
            return (nearest.place, [0.0; 3]);
        };
        let p = triangle.map(|v| self.positions[v as usize]);
        let face = area_vector(p);
        let weights = barycentric(nearest.place, p, face);
        let flat = unit(face);
        let n = triangle.map(|v| {
            let normal = self.normals[v as usize];
            if dot(normal, flat) < CREASE {
                flat
            } else {
                normal
            }
        });
        (patch(p, n, weights), blend(n, weights))
    }
}

/// Weights of the corners at a place of the triangle's plane.
fn barycentric(place: Point, [a, b, c]: [Point; 3], face: Point) -> Point {
    let total = squared(face);
    if !(total > 0.0) {
        // Of a line, by distance to the ends.
        let (da, db) = (distance(place, a), distance(place, b));
        let sum = da + db;
        return if sum > 0.0 {
            [db / sum, da / sum, 0.0]
        } else {
            [1.0, 0.0, 0.0]
        };
    }
    let u = dot(cross(sub(c, b), sub(place, b)), face) / total;
    let v = dot(cross(sub(a, c), sub(place, c)), face) / total;
    [u, v, 1.0 - u - v]
}

fn blend(n: [Point; 3], [u, v, w]: Point) -> Point {
    unit(add(add(scale(n[0], u), scale(n[1], v)), scale(n[2], w)))
}

/// The place of a PN triangle at barycentric weights.
fn patch(p: [Point; 3], n: [Point; 3], [u, v, w]: Point) -> Point {
    // The control point a third of the way from corner i to corner j, in the tangent plane of i.
    let control = |i: usize, j: usize| {
        let edge = sub(p[j], p[i]);
        along(along(p[i], edge, 1.0 / 3.0), n[i], -dot(edge, n[i]) / 3.0)
    };
    let controls = [
        (control(0, 1), 3.0 * u * u * v),
        (control(1, 0), 3.0 * u * v * v),
        (control(1, 2), 3.0 * v * v * w),
        (control(2, 1), 3.0 * v * w * w),
        (control(2, 0), 3.0 * w * w * u),
        (control(0, 2), 3.0 * w * u * u),
    ];
    let corners = add(add(p[0], p[1]), p[2]);
    let sum = controls
        .iter()
        .fold([0.0; 3], |sum, (point, _)| add(sum, *point));
    // E + (E - V) / 2 with E the mean of the controls and V that of the corners.
    let centre = sub(scale(sum, 0.25), scale(corners, 1.0 / 6.0));
    let mut place = scale(centre, 6.0 * u * v * w);
    for (point, weight) in controls {
        place = along(place, point, weight);
    }
    for (corner, weight) in p.into_iter().zip([u, v, w]) {
        place = along(place, corner, weight * weight * weight);
    }
    place
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shapes;
    use crate::vector::norm;
    use puncta_sdk::run::Serial;

    #[test]
    fn coarse_spheres_are_round_again() {
        let (positions, triangles) = shapes::sphere(100.0, 2);
        let mesh = Mesh::new(positions, &triangles).unwrap();
        let curved = Curved::new(&mesh, &Serial).unwrap();
        let (fine, _) = shapes::sphere(101.0, 4);
        let worst = fine.iter().map(|p| {
            let (place, normal) = curved.project(*p, &mut 0).unwrap();
            assert!(dot(normal, unit(*p)) > 0.999);
            (norm(place) - 100.0).abs()
        });
        // The chords themselves lie up to 1.9 below the sphere.
        let worst = worst.fold(0.0, f64::max);
        assert!(worst < 0.1, "{worst}");
    }

    #[test]
    fn the_middle_of_an_edge_is_that_of_the_patch() {
        let p = [[0.0; 3], [2.0, 0.0, 0.0], [0.0, 2.0, 0.0]];
        let n = [[-0.3, 0.1, 1.0], [0.4, 0.0, 1.0], [0.0, 0.3, 1.0]].map(unit);
        let bent = patch(p, n, [0.5, 0.5, 0.0]);
        let split = edge_middle([p[0], p[1]], [n[0], n[1]]);
        // The same to the order in which normals differ.
        assert!(distance(bent, split) < 0.05 && split[2] > 0.1);
        assert_eq!(patch(p, n, [1.0, 0.0, 0.0]), p[0]);
    }

    #[test]
    fn cubes_stay_flat() {
        let (positions, triangles) = shapes::cube(10.0, 2);
        let mesh = Mesh::new(positions, &triangles).unwrap();
        let curved = Curved::new(&mesh, &Serial).unwrap();
        let (place, _) = curved.project([6.0, 1.0, 2.0], &mut 0).unwrap();
        assert!(distance(place, [5.0, 1.0, 2.0]) < 1e-12, "{place:?}");
    }
}
