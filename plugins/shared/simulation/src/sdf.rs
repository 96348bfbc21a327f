//! Constructive solid geometry of signed distance functions: negative inside, zero on the surface,
//! lengths in nm.
//!
//! The primitives and their plain unions are distances outside; smooth joins are not distances, but
//! no slope exceeds 1, so `|f|` is never larger than the distance to the surface.

use puncta_shared_vector::{Point, add, dot, norm, scale, sub};

/// A coordinate axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Axis {
    /// Second coordinate.
    Y,
    /// Third coordinate.
    Z,
}

/// A solid, by its signed distance function.
#[derive(Clone, Debug, PartialEq)]
pub enum Solid {
    /// A ball about the origin.
    Sphere {
        /// Radius, nm.
        radius: f64,
    },
    /// All points within `radius` of the segment from `from` to `to`.
    Capsule {
        /// One end of the axis.
        from: Point,
        /// The other end.
        to: Point,
        /// Radius, nm.
        radius: f64,
    },
    /// A torus about the origin.
    Torus {
        /// Axis of the ring.
        axis: Axis,
        /// Radius of the ring, nm.
        ring: f64,
        /// Radius of the tube, nm.
        tube: f64,
    },
    /// A box about the origin with rounded edges.
    RoundedBox {
        /// Half sides, nm, rounding included.
        half: Point,
        /// Radius of the edges, nm.
        rounding: f64,
    },
    /// An endless cylinder about the z axis.
    Cylinder {
        /// Radius, nm.
        radius: f64,
    },
    /// A solid moved by a vector.
    Moved(Box<Solid>, Point),
    /// All points of either.
    Union(Box<Solid>, Box<Solid>),
    /// Union with a fillet: `min(a, b) - h^2 / 4k`, `h = max(k - |a - b|, 0)`.
    SmoothUnion(Box<Solid>, Box<Solid>, f64),
    /// The first without the second, with a fillet: `-smooth_min(-a, b)`.
    SmoothDifference(Box<Solid>, Box<Solid>, f64),
}

impl Solid {
    /// The same solid moved by `by`.
    #[must_use]
    pub fn moved(self, by: Point) -> Self {
        Self::Moved(Box::new(self), by)
    }

    /// Union with `other`.
    #[must_use]
    pub fn union(self, other: Self) -> Self {
        Self::Union(Box::new(self), Box::new(other))
    }

    /// Union with `other` whose fillet is `k` nm wide.
    #[must_use]
    pub fn smooth_union(self, other: Self, k: f64) -> Self {
        Self::SmoothUnion(Box::new(self), Box::new(other), k)
    }

    /// This solid without `other`, with a fillet `k` nm wide.
    #[must_use]
    pub fn smooth_difference(self, other: Self, k: f64) -> Self {
        Self::SmoothDifference(Box::new(self), Box::new(other), k)
    }

    /// The function at `p`, nm.
    pub fn value(&self, p: Point) -> f64 {
        match self {
            Self::Sphere { radius } => norm(p) - radius,
            Self::Capsule { from, to, radius } => norm(from_axis(p, *from, *to)) - radius,
            Self::Torus { axis, ring, tube } => {
                let (u, v, w) = split(p, *axis);
                (u.hypot(v) - ring).hypot(w) - tube
            }
            Self::RoundedBox { half, rounding } => {
                let q = corner(p, *half, *rounding);
                let inside = q[0].max(q[1]).max(q[2]).min(0.0);
                norm(q.map(|c| c.max(0.0))) + inside - rounding
            }
            Self::Cylinder { radius } => p[0].hypot(p[1]) - radius,
            Self::Moved(solid, by) => solid.value(sub(p, *by)),
            Self::Union(a, b) => a.value(p).min(b.value(p)),
            Self::SmoothUnion(a, b, k) => smooth_min(a.value(p), b.value(p), *k).0,
            Self::SmoothDifference(a, b, k) => -smooth_min(-a.value(p), b.value(p), *k).0,
        }
    }

    /// The function at `p` and its gradient, which points outwards. Where the function has a crease
    /// the gradient is that of one side.
    pub fn gradient(&self, p: Point) -> (f64, Point) {
        match self {
            Self::Sphere { radius } => radial(p, *radius),
            Self::Capsule { from, to, radius } => radial(from_axis(p, *from, *to), *radius),
            Self::Torus { axis, ring, tube } => torus_gradient(p, *axis, *ring, *tube),
            Self::RoundedBox { half, rounding } => box_gradient(p, *half, *rounding),
            Self::Cylinder { radius } => radial([p[0], p[1], 0.0], *radius),
            Self::Moved(solid, by) => solid.gradient(sub(p, *by)),
            Self::Union(a, b) => {
                let (a, b) = (a.gradient(p), b.gradient(p));
                if a.0 <= b.0 { a } else { b }
            }
            Self::SmoothUnion(a, b, k) => {
                let ((a, da), (b, db)) = (a.gradient(p), b.gradient(p));
                let (value, share) = smooth_min(a, b, *k);
                (value, blend(da, db, share))
            }
            Self::SmoothDifference(a, b, k) => {
                let ((a, da), (b, db)) = (a.gradient(p), b.gradient(p));
                let (value, share) = smooth_min(-a, b, *k);
                (-value, blend(da, scale(db, -1.0), share))
            }
        }
    }
}

/// The polynomial smooth minimum and its derivative by `a`; that by `b` is the rest to 1.
#[inline]
fn smooth_min(a: f64, b: f64, k: f64) -> (f64, f64) {
    let h = (k - (a - b).abs()).max(0.0);
    let share = h / (2.0 * k);
    (
        a.min(b) - h * h / (4.0 * k),
        if a <= b { 1.0 - share } else { share },
    )
}

/// `s a + (1 - s) b`
#[inline]
fn blend(a: Point, b: Point, s: f64) -> Point {
    add(scale(a, s), scale(b, 1.0 - s))
}

/// From the nearest point of the segment to `p`.
#[inline]
fn from_axis(p: Point, from: Point, to: Point) -> Point {
    let (along, p) = (sub(to, from), sub(p, from));
    let t = (dot(p, along) / dot(along, along)).clamp(0.0, 1.0);
    sub(p, scale(along, t))
}

/// `|v| - radius` and its gradient.
#[inline]
fn radial(v: Point, radius: f64) -> (f64, Point) {
    let length = norm(v);
    let direction = if length > 0.0 {
        scale(v, 1.0 / length)
    } else {
        [0.0, 0.0, 1.0]
    };
    (length - radius, direction)
}

/// The two coordinates across the axis and the one along it.
#[inline]
fn split(p: Point, axis: Axis) -> (f64, f64, f64) {
    match axis {
        Axis::Y => (p[0], p[2], p[1]),
        Axis::Z => (p[0], p[1], p[2]),
    }
}

fn torus_gradient(p: Point, axis: Axis, ring: f64, tube: f64) -> (f64, Point) {
    let (u, v, w) = split(p, axis);
    let out = u.hypot(v);
    let (value, d) = radial([out - ring, 0.0, w], tube);
    let (cos, sin) = if out > 0.0 {
        (u / out, v / out)
    } else {
        (1.0, 0.0)
    };
    let across = [d[0] * cos, d[0] * sin];
    match axis {
        Axis::Y => (value, [across[0], d[2], across[1]]),
        Axis::Z => (value, [across[0], across[1], d[2]]),
    }
}

/// From the corner of the sharp inner box to `p`, in the first octant.
#[inline]
fn corner(p: Point, half: Point, rounding: f64) -> Point {
    [0, 1, 2].map(|i| p[i].abs() - (half[i] - rounding))
}

fn box_gradient(p: Point, half: Point, rounding: f64) -> (f64, Point) {
    let q = corner(p, half, rounding);
    let nearest = if q[0] >= q[1] && q[0] >= q[2] {
        [1.0, 0.0, 0.0]
    } else if q[1] >= q[2] {
        [0.0, 1.0, 0.0]
    } else {
        [0.0, 0.0, 1.0]
    };
    let deepest = dot(q, nearest);
    let (value, octant) = if deepest > 0.0 {
        radial(q.map(|c| c.max(0.0)), rounding)
    } else {
        (deepest - rounding, nearest)
    };
    (
        value,
        [0, 1, 2].map(|i| octant[i].copysign(octant[i] * p[i])),
    )
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// `p` moved to the surface along the gradient (six steps of Newton).
    pub(crate) fn project(solid: &Solid, mut p: Point) -> Point {
        for _ in 0..6 {
            let (value, gradient) = solid.gradient(p);
            let slope = dot(gradient, gradient).max(0.05);
            p = add(p, scale(gradient, -value / slope));
        }
        p
    }

    fn samples() -> Vec<Point> {
        let mut state = 1u64;
        let mut next = || {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1);
            (state >> 11) as f64 / (1u64 << 53) as f64 * 200.0 - 100.0
        };
        (0..3000).map(|_| [next(), next(), next()]).collect()
    }

    fn solids() -> Vec<Solid> {
        let capsule = Solid::Capsule {
            from: [-30.0, 0.0, 10.0],
            to: [50.0, 40.0, 0.0],
            radius: 12.0,
        };
        let torus = |axis| Solid::Torus {
            axis,
            ring: 50.0,
            tube: 20.0,
        };
        let rounded = Solid::RoundedBox {
            half: [60.0, 40.0, 20.0],
            rounding: 8.0,
        };
        let hole = Solid::Cylinder { radius: 15.0 }.moved([10.0, -5.0, 0.0]);
        vec![
            Solid::Sphere { radius: 40.0 },
            capsule.clone(),
            torus(Axis::Y),
            torus(Axis::Z).moved([5.0, 6.0, 7.0]),
            rounded.clone(),
            capsule.clone().union(torus(Axis::Z)),
            capsule.smooth_union(torus(Axis::Y), 25.0),
            rounded.smooth_difference(hole, 20.0),
        ]
    }

    #[test]
    fn values_are_the_analytic_distances() {
        let sphere = Solid::Sphere { radius: 40.0 };
        assert_eq!(sphere.value([0.0, 0.0, 50.0]), 10.0);
        let capsule = Solid::Capsule {
            from: [0.0; 3],
            to: [10.0, 0.0, 0.0],
            radius: 2.0,
        };
        assert_eq!(capsule.value([5.0, 3.0, 4.0]), 3.0);
        assert_eq!(capsule.value([13.0, 4.0, 0.0]), 3.0);
        let torus = Solid::Torus {
            axis: Axis::Y,
            ring: 100.0,
            tube: 30.0,
        };
        assert_eq!(torus.value([0.0, 40.0, 130.0]), 20.0);
        assert_eq!(torus.value([0.0; 3]), 70.0);
        let rounded = Solid::RoundedBox {
            half: [20.0, 15.0, 10.0],
            rounding: 5.0,
        };
        assert_eq!(rounded.value([0.0; 3]), -10.0);
        assert_eq!(rounded.value([18.0, 14.0, 0.0]), 0.0);
        assert_eq!(rounded.value([0.0, 0.0, -12.0]), 2.0);
        let pair = Solid::Sphere { radius: 5.0 }.moved([10.0, 0.0, 0.0]);
        let pair = pair.union(Solid::Sphere { radius: 5.0 });
        assert_eq!(pair.value([7.0, 0.0, 0.0]), -2.0);
        // Where both are equal the smooth minimum lies k / 4 below.
        assert_eq!(smooth_min(3.0, 3.0, 20.0).0, -2.0);
        assert_eq!(smooth_min(3.0, 30.0, 20.0), (3.0, 1.0));
        let drilled = rounded.smooth_difference(Solid::Cylinder { radius: 4.0 }, 0.5);
        assert_eq!(drilled.value([0.0; 3]), 4.0);
        assert_eq!(drilled.value([13.0, 0.0, 0.0]), -7.0);
    }

    #[test]
    fn gradients_are_the_difference_quotients() {
        let h = 1e-4;
        for solid in solids() {
            let mut close = 0;
            for p in samples() {
                let (value, gradient) = solid.gradient(p);
                assert!((value - solid.value(p)).abs() < 1e-12);
                assert!(norm(gradient) < 1.0 + 1e-12);
                let quotient = [0, 1, 2].map(|i| {
                    let mut e = [0.0; 3];
                    e[i] = h;
                    (solid.value(add(p, e)) - solid.value(sub(p, e))) / (2.0 * h)
                });
                close += usize::from(norm(sub(quotient, gradient)) < 1e-5);
            }
            // All but the few whose difference quotient crosses a crease.
            assert!(close >= 2998, "{solid:?}: {close}");
        }
    }
}
