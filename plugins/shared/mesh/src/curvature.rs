//! Curvature at the vertices: principal values and directions, mean, Gaussian. Convex surfaces
//! (a sphere seen from outside) have positive curvature.

use crate::blocks::by_item;
use crate::jet;
use crate::measure::{normal, vertex_normals};
use crate::mesh::{Mesh, NONE, prev};
use crate::vector::{Point, add, along, area_vector, dot, frame, norm, scale, squared, sub, unit};
use puncta_sdk::{Cancelled, Run};

/// Curvature of a surface at a place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Curvature {
    /// Principal curvatures, the larger first, 1/nm.
    pub principal: [f64; 2],
    /// Their directions: unit vectors along the surface.
    pub directions: [Point; 2],
}

impl Curvature {
    /// What a dead vertex has, and one where the surface has no direction.
    pub const UNKNOWN: Curvature = Curvature {
        principal: [f64::NAN; 2],
        directions: [[f64::NAN; 3]; 2],
    };

    /// Mean curvature H, 1/nm.
    #[must_use]
    pub fn mean(&self) -> f64 {
        f64::midpoint(self.principal[0], self.principal[1])
    }

    /// Gaussian curvature K, 1/nm^2.
    #[must_use]
    pub fn gaussian(&self) -> f64 {
        self.principal[0] * self.principal[1]
    }
}

/// How curvature is estimated.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Method {
    /// The curvature tensor of the one-ring (thesis D.2.1 after Taubin, ICCV 1995): fast, its
    /// mean exact on spheres, rough on irregular or noisy triangles.
    Tensor,
    /// A polynomial of `degree` (2 to 4) over the neighbours within `rings` edges, by least squares
    /// in which near ones count more (Cazals and Pouget, Comput. Aided Geom. Des. 22, 2005).
    Jet {
        /// Degree of the polynomial: 2, 3 or 4.
        degree: u8,
        /// Edges between the vertex and its farthest neighbours: 1 to 8.
        rings: u8,
    },
}

impl Default for Method {
    fn default() -> Method {
        Method::Jet {
            degree: 4,
            rings: 3,
        }
    }
}

/// Curvature at each vertex; [`Curvature::UNKNOWN`] at dead ones.
///
/// # Errors
/// When cancelled.
pub fn curvatures(mesh: &Mesh, method: Method, run: &dyn Run) -> Result<Vec<Curvature>, Cancelled> {
    match method {
        Method::Tensor => by_item(run, mesh.positions().len(), |v| tensor(mesh, v as u32)),
        Method::Jet { degree, rings } => {
            let normals = vertex_normals(mesh, run)?;
            by_item(run, mesh.positions().len(), |v| {
                jet::curvature(mesh, &normals, v as u32, degree, rings.clamp(1, 8))
            })
        }
    }
}

/// Taubin's tensor: the curvatures towards the neighbours, each weighted by the area of the
/// triangles beside its edge.
fn tensor(mesh: &Mesh, vertex: u32) -> Curvature {
    let n = normal(mesh, vertex);
    if squared(n) == 0.0 {
        return Curvature::UNKNOWN;
    }
    let [u, v] = frame(n);
    let centre = mesh.position(vertex);
    let (mut uu, mut uv, mut vv, mut total) = (0.0, 0.0, 0.0, 0.0);
    let mut take = |neighbour: Point, weight: f64| {
        let edge = sub(neighbour, centre);
        let flat = unit(along(edge, n, -dot(edge, n)));
        let (length, x, y) = (squared(edge), dot(flat, u), dot(flat, v));
        if length > 0.0 && weight > 0.0 {
            let kappa = -2.0 * dot(n, edge) / length;
            uu += weight * kappa * x * x;
            uv += weight * kappa * x * y;
            vv += weight * kappa * y * y;
            total += weight;
        }
    };
    for h in mesh.outgoing(vertex) {
        let area = |h: u32| {
            let corners = if h == NONE { None } else { mesh.corners(h / 3) };
            corners.map_or(0.0, |corners| norm(area_vector(corners)))
        };
        take(mesh.position(mesh.to(h)), area(h) + area(mesh.twin(h)));
        let inward = prev(h);
        if mesh.twin(inward) == NONE {
            take(mesh.position(mesh.from(inward)), area(h));
        }
    }
    if total == 0.0 {
        return Curvature::UNKNOWN;
    }
    let (values, [c, s]) = eigen(uu / total, uv / total, vv / total);
    let [m1, m2] = values;
    // The mean over all directions is (3 k1 + k2) / 8 along the first; the weights sum to 1.
    let one = (3.0 * m1 - m2, add(scale(u, c), scale(v, s)));
    let two = (3.0 * m2 - m1, add(scale(u, -s), scale(v, c)));
    Curvature {
        principal: [one.0, two.0],
        directions: [one.1, two.1],
    }
}

/// Eigenvalues of [[a, b], [b, c]], the larger first, and the unit eigenvector of the larger.
pub(crate) fn eigen(a: f64, b: f64, c: f64) -> ([f64; 2], [f64; 2]) {
    let (half, mean) = (0.5 * (a - c), 0.5 * (a + c));
    let radius = half.hypot(b);
    let turn = 0.5 * b.atan2(half);
    let (sin, cos) = turn.sin_cos();
    ([mean + radius, mean - radius], [cos, sin])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shapes;
    use puncta_sdk::run::Serial;
    use std::f64::consts::TAU;

    const METHODS: [Method; 3] = [
        Method::Tensor,
        Method::Jet {
            degree: 2,
            rings: 2,
        },
        Method::Jet {
            degree: 4,
            rings: 3,
        },
    ];

    #[test]
    fn spheres_are_round() {
        let (positions, triangles) = shapes::sphere(100.0, 4);
        let mesh = Mesh::new(positions, &triangles).unwrap();
        for method in METHODS {
            for one in curvatures(&mesh, method, &Serial).unwrap() {
                assert!(
                    (one.mean() * 100.0 - 1.0).abs() < 0.01,
                    "{method:?} {one:?}"
                );
                // Neighbours at unequal angles split the values of the tensor.
                let limit = if method == Method::Tensor { 0.06 } else { 0.02 };
                assert!(
                    (one.gaussian() * 1e4 - 1.0).abs() < limit,
                    "{method:?} {one:?}"
                );
            }
        }
    }

    #[test]
    fn a_torus_has_its_principal_curvatures_and_directions() {
        let (ring, tube, across) = (100.0, 40.0, 48);
        let (positions, triangles) = shapes::torus(ring, tube, 120, across);
        let mesh = Mesh::new(positions, &triangles).unwrap();
        let found = curvatures(&mesh, Method::default(), &Serial).unwrap();
        for (v, one) in (0..).zip(&found) {
            let (_, cos) = (TAU * f64::from(v % across) / f64::from(across)).sin_cos();
            let truth = [1.0 / tube, cos / (ring + tube * cos)];
            for side in 0..2 {
                let error = (one.principal[side] - truth[side]).abs() * tube;
                assert!(error < 0.005, "{one:?} {truth:?}");
            }
            // The flatter direction runs around the axis.
            let p = mesh.position(v);
            let around = unit([-p[1], p[0], 0.0]);
            assert!(dot(around, one.directions[1]).abs() > 0.999, "{one:?}");
        }
    }

    #[test]
    fn flat_sheets_are_flat_to_their_rim() {
        let (positions, triangles) = shapes::grid(8, 8, 2.0);
        let mesh = Mesh::new(positions, &triangles).unwrap();
        for method in METHODS {
            for one in curvatures(&mesh, method, &Serial).unwrap() {
                assert!(one.principal.iter().all(|k| k.abs() < 1e-12), "{one:?}");
            }
        }
    }

    #[test]
    fn scale_changes_curvature_as_it_must() {
        let at = |size: f64| {
            let (mut positions, triangles) = shapes::torus(5.0, 2.0, 40, 20);
            positions.iter_mut().for_each(|p| *p = scale(*p, size));
            let mesh = Mesh::new(positions, &triangles).unwrap();
            curvatures(&mesh, Method::default(), &Serial).unwrap()
        };
        for (a, b) in at(1.0).iter().zip(at(1024.0)) {
            assert!((a.mean() - 1024.0 * b.mean()).abs() < 1e-9 * a.mean().abs().max(0.1));
        }
    }

    #[test]
    fn degenerate_places_have_no_curvature_but_no_panic() {
        let mesh = Mesh::new(vec![[1.0; 3]; 4], &[[0, 1, 2], [0, 2, 3]]).unwrap();
        for method in METHODS {
            for one in curvatures(&mesh, method, &Serial).unwrap() {
                assert!(one.mean().is_nan());
            }
        }
    }
}
