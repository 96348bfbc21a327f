//! Surfaces that are known: signed distance functions of the synthetic membranes.

use puncta_sdk::Choice;
use puncta_shared_simulation::sdf::Solid;
use puncta_shared_simulation::shape::Shape as Known;
use puncta_shared_vector::{Point, add, along, squared, sub, unit};

/// Which surface is the truth.
#[derive(Choice, Clone, Copy, Debug, PartialEq, Eq)]
pub enum Shape {
    /// The mesh on the port truth
    Mesh,
    /// A sphere about the origin
    Sphere,
    /// A torus about the z axis
    Torus,
    /// The synthetic membrane tori: two touching tori, rings in the x z plane
    Tori,
    /// The synthetic membrane tori_flat: two touching tori, rings in the x y plane
    ToriFlat,
    /// The synthetic membrane junction
    Junction,
    /// The synthetic membrane er
    Er,
}

impl Shape {
    /// The analytic surface; `radius` is that of a sphere or of a torus's ring, `tube` that of its
    /// tube, nm. None if a mesh is the truth.
    #[must_use]
    pub fn analytic(self, radius: f64, tube: f64) -> Option<Truth> {
        let shape = match self {
            Self::Mesh => return None,
            Self::Sphere => Known::Sphere { radius },
            Self::Torus => Known::Torus { ring: radius, tube },
            Self::Tori => Known::Tori,
            Self::ToriFlat => Known::ToriFlat,
            Self::Junction => Known::Junction,
            Self::Er => Known::Er,
        };
        Some(Truth::new(shape))
    }
}

/// An analytic surface. Lengths in nm.
#[derive(Clone, Debug, PartialEq)]
pub struct Truth {
    shape: Known,
    solid: Solid,
}

impl Truth {
    /// The surface of a synthetic membrane.
    #[must_use]
    pub fn new(shape: Known) -> Self {
        let solid = shape.solid();
        Self { shape, solid }
    }

    /// The signed distance function, negative inside. Where surfaces are joined smoothly it is no
    /// distance, but never larger than that.
    #[must_use]
    pub fn value(&self, p: Point) -> f64 {
        self.solid.value(p)
    }

    /// The place of the surface that Newton's steps along the gradient lead to.
    #[must_use]
    pub fn project(&self, mut p: Point) -> Point {
        for _ in 0..8 {
            let (value, gradient) = self.solid.gradient(p);
            if value.abs() < 1e-9 {
                break;
            }
            p = along(p, gradient, -value / squared(gradient).max(0.05));
        }
        p
    }

    /// Mean curvature at a place of the surface, 1/nm, positive on a sphere: half the divergence of
    /// the normal.
    #[must_use]
    pub fn mean_curvature(&self, p: Point) -> f64 {
        let step = 0.05;
        let divergence: f64 = (0..3)
            .map(|axis| {
                let mut e = [0.0; 3];
                e[axis] = step;
                let [high, low] =
                    [add(p, e), sub(p, e)].map(|p| unit(self.solid.gradient(p).1)[axis]);
                (high - low) / (2.0 * step)
            })
            .sum();
        divergence / 2.0
    }

    /// Low and high corner of a box that holds the surface.
    #[must_use]
    pub fn bounds(&self) -> [Point; 2] {
        self.shape.bounds()
    }

    /// Euler characteristic.
    #[must_use]
    pub fn euler(&self) -> i64 {
        self.shape.euler().into()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn curvature_is_that_of_sphere_and_torus() {
        let truth = |shape: Shape| shape.analytic(100.0, 30.0).expect("analytic");
        let sphere = truth(Shape::Sphere).mean_curvature([60.0, 0.0, 80.0]);
        assert!((sphere * 100.0 - 1.0).abs() < 1e-4, "{sphere}");
        let torus = truth(Shape::Torus).mean_curvature([130.0, 0.0, 0.0]);
        assert!(
            (torus / (160.0 / (2.0 * 30.0 * 130.0)) - 1.0).abs() < 1e-4,
            "{torus}"
        );
        let place = truth(Shape::Er).project([100.0, 20.0, 40.0]);
        assert!(truth(Shape::Er).value(place).abs() < 1e-9);
    }
}
