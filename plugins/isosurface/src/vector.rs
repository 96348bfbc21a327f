//! Vectors in space.

/// A place or a vector, nm.
pub type Point = [f64; 3];

/// Sum.
#[must_use]
#[inline]
pub fn add(a: Point, b: Point) -> Point {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

/// Difference.
#[must_use]
#[inline]
pub fn sub(a: Point, b: Point) -> Point {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

/// `a` moved by a share of the way to `b`.
#[must_use]
#[inline]
pub fn along(a: Point, b: Point, share: f64) -> Point {
    std::array::from_fn(|axis| a[axis] + (b[axis] - a[axis]) * share)
}

/// `a + b factor`.
#[must_use]
#[inline]
pub fn moved(a: Point, b: Point, factor: f64) -> Point {
    std::array::from_fn(|axis| a[axis] + b[axis] * factor)
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

/// Squared length.
#[must_use]
#[inline]
pub fn squared(a: Point) -> f64 {
    dot(a, a)
}

/// The vector of length 1; 0 of a vector without direction.
#[must_use]
#[inline]
pub fn unit(a: Point) -> Point {
    let length = squared(a).sqrt();
    if length > 0.0 {
        a.map(|x| x / length)
    } else {
        [0.0; 3]
    }
}
