//! Bending energy.

use crate::blocks::sum;
use crate::curvature::Curvature;
use crate::measure::{angle_deficits, vertex_areas};
use crate::mesh::Mesh;
use puncta_sdk::{Cancelled, Run};

/// Moduli of a membrane (Helfrich, Z. Naturforsch. C 28, 1973).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Membrane {
    /// Bending rigidity, in the unit that the energy shall have.
    pub rigidity: f64,
    /// Saddle splay modulus, in the same unit.
    pub saddle_splay: f64,
    /// Spontaneous curvature c0, 1/nm.
    pub spontaneous: f64,
}

impl Default for Membrane {
    fn default() -> Membrane {
        Membrane {
            rigidity: 1.0,
            saddle_splay: 0.0,
            spontaneous: 0.0,
        }
    }
}

/// The integral of rigidity / 2 (2 H - c0)^2 + saddle splay K over the surface, with the curvature
/// at the vertices, the mixed Voronoi area of each, and the exact integral of K. A sphere has
/// 8 pi rigidity + 4 pi saddle splay at any radius. Vertices of unknown curvature count nothing.
///
/// # Errors
/// When cancelled.
pub fn bending_energy(
    mesh: &Mesh,
    curvatures: &[Curvature],
    membrane: Membrane,
    run: &dyn Run,
) -> Result<f64, Cancelled> {
    let areas = vertex_areas(mesh, run)?;
    let count = areas.len().min(curvatures.len());
    let bent = sum(run, count, |v| {
        let excess = 2.0 * curvatures[v].mean() - membrane.spontaneous;
        if excess.is_nan() {
            return 0.0;
        }
        0.5 * excess * excess * areas[v]
    })?;
    let mut energy = membrane.rigidity * bent;
    if membrane.saddle_splay != 0.0 {
        let total: f64 = angle_deficits(mesh, run)?.iter().sum();
        energy += membrane.saddle_splay * total;
    }
    Ok(energy)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::curvature::{Method, curvatures};
    use crate::shapes;
    use puncta_sdk::run::Serial;
    use std::f64::consts::PI;

    fn energy(shape: shapes::Shape, membrane: Membrane) -> f64 {
        let mesh = Mesh::new(shape.0, &shape.1).unwrap();
        let curvatures = curvatures(&mesh, Method::default(), &Serial).unwrap();
        bending_energy(&mesh, &curvatures, membrane, &Serial).unwrap()
    }

    #[test]
    fn spheres_of_any_radius() {
        for radius in [1e-3, 50.0, 1e6] {
            let found = energy(shapes::sphere(radius, 4), Membrane::default());
            assert!((found / (8.0 * PI) - 1.0).abs() < 0.02, "{found}");
        }
        // Spontaneous curvature 2 H: nothing but the saddle splay is left.
        let membrane = Membrane {
            rigidity: 20.0,
            saddle_splay: -1.5,
            spontaneous: 0.04,
        };
        let found = energy(shapes::sphere(50.0, 4), membrane);
        assert!((found + 6.0 * PI).abs() < 0.01, "{found}");
    }

    #[test]
    fn the_clifford_torus_has_the_least_energy_of_a_torus() {
        let at = |ratio: f64| energy(shapes::torus(ratio, 1.0, 120, 80), Membrane::default());
        let least = at(2f64.sqrt());
        assert!((least / (4.0 * PI * PI) - 1.0).abs() < 0.005, "{least}");
        assert!(at(1.2) > least && at(1.7) > least);
    }
}
