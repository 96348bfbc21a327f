//! Arithmetic of points and vectors as `[f64; 3]`.

/// A place or a vector, nm.
pub type Point = [f64; 3];

/// `a + b`.
#[must_use]
#[inline]
pub fn add(a: Point, b: Point) -> Point {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

/// `a - b`.
#[must_use]
#[inline]
pub fn sub(a: Point, b: Point) -> Point {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

/// `a` times `factor`.
#[must_use]
#[inline]
pub fn scale(a: Point, factor: f64) -> Point {
    a.map(|x| x * factor)
}

/// `a + factor b`.
#[must_use]
#[inline]
pub fn along(a: Point, b: Point, factor: f64) -> Point {
    [
        a[0] + factor * b[0],
        a[1] + factor * b[1],
        a[2] + factor * b[2],
    ]
}

/// `a` moved by a share of the way to `b`.
#[must_use]
#[inline]
pub fn between(a: Point, b: Point, share: f64) -> Point {
    along(a, sub(b, a), share)
}

/// Scalar product.
#[must_use]
#[inline]
pub fn dot(a: Point, b: Point) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// Vector product.
#[must_use]
#[inline]
pub fn cross(a: Point, b: Point) -> Point {
    [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]
}

/// Length squared.
#[must_use]
#[inline]
pub fn squared(a: Point) -> f64 {
    dot(a, a)
}

/// Length.
#[must_use]
#[inline]
pub fn norm(a: Point) -> f64 {
    squared(a).sqrt()
}

/// Distance of two places.
#[must_use]
#[inline]
pub fn distance(a: Point, b: Point) -> f64 {
    norm(sub(a, b))
}

/// `a` at length 1; zero if it has no direction.
#[must_use]
#[inline]
pub fn unit(a: Point) -> Point {
    // Divided by its largest coordinate first, so that squares neither overflow nor vanish.
    let largest = a[0].abs().max(a[1].abs()).max(a[2].abs());
    if !(largest > 0.0 && finite(a)) {
        return [0.0; 3];
    }
    let a = a.map(|x| x / largest);
    scale(a, 1.0 / norm(a))
}

/// The place midway.
#[must_use]
#[inline]
pub fn middle(a: Point, b: Point) -> Point {
    [
        0.5 * (a[0] + b[0]),
        0.5 * (a[1] + b[1]),
        0.5 * (a[2] + b[2]),
    ]
}

/// Two unit vectors that form a right-handed frame with the unit vector `n` as the third (Duff et
/// al., J. Comput. Graph. Tech. 6, 2017).
#[must_use]
pub fn frame(n: Point) -> [Point; 2] {
    let sign = 1f64.copysign(n[2]);
    let a = -1.0 / (sign + n[2]);
    let b = n[0] * n[1] * a;
    [
        [1.0 + sign * n[0] * n[0] * a, sign * b, -sign * n[0]],
        [b, sign + n[1] * n[1] * a, -n[1]],
    ]
}

/// Angle between two vectors, 0 to pi, accurate at both ends (Kahan).
#[must_use]
#[inline]
pub fn angle(a: Point, b: Point) -> f64 {
    norm(cross(a, b)).atan2(dot(a, b))
}

/// Twice the area vector of a triangle.
#[must_use]
#[inline]
pub fn area_vector([a, b, c]: [Point; 3]) -> Point {
    cross(sub(b, a), sub(c, a))
}

/// Whether all coordinates are numbers.
#[must_use]
#[inline]
pub fn finite(a: Point) -> bool {
    a.iter().all(|x| x.is_finite())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_are_orthonormal_and_right_handed() {
        for n in [
            [0.0, 0.0, 1.0],
            [0.0, 0.0, -1.0],
            [0.6, 0.0, -0.8],
            [1.0, 0.0, 0.0],
        ] {
            let [u, v] = frame(n);
            assert!(distance(cross(u, v), n) < 1e-15, "{n:?}");
            assert!(dot(u, n).abs() < 1e-15 && (norm(u) - 1.0).abs() < 1e-15);
        }
    }

    #[test]
    fn units_of_extreme_lengths() {
        assert_eq!(unit([0.0; 3]), [0.0; 3]);
        assert_eq!(unit([f64::NAN, 0.0, 1.0]), [0.0; 3]);
        assert_eq!(unit([f64::INFINITY, 0.0, 1.0]), [0.0; 3]);
        assert!((norm(unit([1e300, 1e300, 0.0])) - 1.0).abs() < 1e-15);
        assert!((norm(unit([3e-320, 0.0, 0.0])) - 1.0).abs() < 1e-9);
        assert!((angle([1.0, 0.0, 0.0], [1.0, 1e-12, 0.0]) - 1e-12).abs() < 1e-20);
    }
}
