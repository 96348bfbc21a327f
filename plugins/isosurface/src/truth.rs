//! Surfaces that are known: signed distance functions of the synthetic membranes and of a torus.

use crate::vector::{Point, add, dot, squared, sub};
use puncta_sdk::Choice;
use std::array::from_fn;

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

/// An analytic surface. Lengths in nm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Truth {
    /// Which one; not a mesh.
    pub shape: Shape,
    /// Radius of the sphere, or of the torus's ring.
    pub radius: f64,
    /// Radius of the torus's tube.
    pub tube: f64,
}

fn norm(a: Point) -> f64 {
    squared(a).sqrt()
}

fn torus(across: [f64; 2], along: f64, ring: f64, tube: f64) -> f64 {
    (across[0].hypot(across[1]) - ring).hypot(along) - tube
}

fn capsule(p: Point, from: Point, to: Point, radius: f64) -> f64 {
    let (along, p) = (sub(to, from), sub(p, from));
    let share = (dot(p, along) / squared(along)).clamp(0.0, 1.0);
    norm(sub(p, along.map(|x| x * share))) - radius
}

fn rounded_box(p: Point, half: Point, rounding: f64) -> f64 {
    let q: Point = from_fn(|a| p[a].abs() - (half[a] - rounding));
    let inside = q[0].max(q[1]).max(q[2]).min(0.0);
    norm(q.map(|x| x.max(0.0))) + inside - rounding
}

/// `min(a, b) - h^2 / 4k`, `h = max(k - |a - b|, 0)`.
fn smooth(a: f64, b: f64, k: f64) -> f64 {
    let h = (k - (a - b).abs()).max(0.0);
    a.min(b) - h * h / (4.0 * k)
}

fn junction(p: Point) -> f64 {
    let arm = |degrees: f64| {
        let (sin, cos) = degrees.to_radians().sin_cos();
        capsule(p, [0.0; 3], [250.0 * cos, 250.0 * sin, 0.0], 30.0)
    };
    smooth(smooth(arm(90.0), arm(210.0), 15.0), arm(330.0), 15.0)
}

fn er(p: Point) -> f64 {
    let hole = |x: f64| (p[0] - x).hypot(p[1]) - 45.0;
    let mut value = rounded_box(p, [200.0, 150.0, 28.0], 28.0);
    for x in [-85.0, 85.0] {
        value = -smooth(-value, hole(x), 20.0);
    }
    for (from, to) in [
        ([180.0, 100.0, 0.0], [420.0, 180.0, 0.0]),
        ([180.0, -100.0, 0.0], [420.0, -160.0, 0.0]),
        ([420.0, 180.0, 0.0], [420.0, -160.0, 0.0]),
        ([-180.0, 0.0, 0.0], [-450.0, 40.0, 30.0]),
    ] {
        value = smooth(value, capsule(p, from, to, 35.0), 25.0);
    }
    value
}

impl Truth {
    /// The signed distance function, negative inside. Where surfaces are joined smoothly it is no
    /// distance, but never larger than that.
    #[must_use]
    pub fn value(&self, p: Point) -> f64 {
        let [x, y, z] = p;
        match self.shape {
            Shape::Mesh => f64::NAN,
            Shape::Sphere => norm(p) - self.radius,
            Shape::Torus => torus([x, y], z, self.radius, self.tube),
            Shape::Tori => {
                let one = |x| torus([x, z], y, 100.0, 30.0);
                one(x + 100.0).min(one(x - 100.0))
            }
            Shape::ToriFlat => {
                let one = |x| torus([x, y], z, 100.0, 30.0);
                one(x + 100.0).min(one(x - 100.0))
            }
            Shape::Junction => junction(p),
            Shape::Er => er(p),
        }
    }

    /// The function's gradient by central differences.
    #[must_use]
    pub fn gradient(&self, p: Point) -> Point {
        let step = 1e-4;
        from_fn(|axis| {
            let mut e = [0.0; 3];
            e[axis] = step;
            (self.value(add(p, e)) - self.value(sub(p, e))) / (2.0 * step)
        })
    }

    /// The place of the surface that Newton's steps along the gradient lead to.
    #[must_use]
    pub fn project(&self, mut p: Point) -> Point {
        for _ in 0..8 {
            let value = self.value(p);
            if value.abs() < 1e-9 {
                break;
            }
            let gradient = self.gradient(p);
            let step = value / squared(gradient).max(0.05);
            p = from_fn(|axis| p[axis] - step * gradient[axis]);
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
                    [add(p, e), sub(p, e)].map(|p| crate::vector::unit(self.gradient(p))[axis]);
                (high - low) / (2.0 * step)
            })
            .sum();
        divergence / 2.0
    }

    /// Low and high corner of a box about the surface.
    #[must_use]
    pub fn bounds(&self) -> [Point; 2] {
        let about = |x: f64, y: f64, z: f64| [[-x, -y, -z], [x, y, z]];
        match self.shape {
            Shape::Mesh => about(0.0, 0.0, 0.0),
            Shape::Sphere => about(self.radius, self.radius, self.radius),
            Shape::Torus => {
                let out = self.radius + self.tube;
                about(out, out, self.tube)
            }
            Shape::Tori => about(230.0, 30.0, 130.0),
            Shape::ToriFlat => about(230.0, 130.0, 30.0),
            Shape::Junction => [[-260.0, -170.0, -40.0], [260.0, 290.0, 40.0]],
            Shape::Er => [[-500.0, -210.0, -45.0], [470.0, 230.0, 75.0]],
        }
    }

    /// Euler characteristic.
    #[must_use]
    pub fn euler(&self) -> i64 {
        match self.shape {
            Shape::Mesh | Shape::Torus => 0,
            Shape::Sphere | Shape::Junction => 2,
            Shape::Tori | Shape::ToriFlat => -2,
            Shape::Er => -4,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use puncta_plugin_synthetic::shape as synthetic;

    #[test]
    fn shapes_are_those_of_the_synthetic_membranes() {
        let pairs = [
            (Shape::Sphere, synthetic::Shape::Sphere { radius: 70.0 }),
            (Shape::Tori, synthetic::Shape::Tori),
            (Shape::ToriFlat, synthetic::Shape::ToriFlat),
            (Shape::Junction, synthetic::Shape::Junction),
            (Shape::Er, synthetic::Shape::Er),
        ];
        let mut random = puncta_testkit::Random(1);
        for (shape, other) in pairs {
            let truth = Truth {
                shape,
                radius: 70.0,
                tube: 1.0,
            };
            assert_eq!(truth.euler(), i64::from(other.euler()));
            let solid = other.solid();
            for _ in 0..2000 {
                let p: Point = from_fn(|_| 800.0 * random.unit() - 400.0);
                assert!(
                    (truth.value(p) - solid.value(p)).abs() < 1e-9,
                    "{shape:?} {p:?}"
                );
            }
        }
    }

    #[test]
    fn curvature_is_that_of_sphere_and_torus() {
        let truth = |shape| Truth {
            shape,
            radius: 100.0,
            tube: 30.0,
        };
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
