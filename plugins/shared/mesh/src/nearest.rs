//! The place of a triangle that is nearest to a point.

use crate::vector::{Point, add, along, dot, scale, squared, sub};

/// Part of a triangle that the nearest place lies on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Feature {
    /// Inside.
    Face,
    /// On the edge from this corner (0 to 2) to the next.
    Edge(u8),
    /// At this corner (0 to 2).
    Corner(u8),
}

/// The place of the triangle nearest to `p`, and what it lies on (Ericson, Real-Time Collision
/// Detection, 2005, 5.1.5). A triangle without area gives a place on it, too.
#[must_use]
#[inline]
pub fn on_triangle(p: Point, [a, b, c]: [Point; 3]) -> (Point, Feature) {
    let (ab, ac, ap) = (sub(b, a), sub(c, a), sub(p, a));
    let (d1, d2) = (dot(ab, ap), dot(ac, ap));
    if d1 <= 0.0 && d2 <= 0.0 {
        return (a, Feature::Corner(0));
    }
    let bp = sub(p, b);
    let (d3, d4) = (dot(ab, bp), dot(ac, bp));
    if d3 >= 0.0 && d4 <= d3 {
        return (b, Feature::Corner(1));
    }
    let vc = d1 * d4 - d3 * d2;
    if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
        return (along(a, ab, ratio(d1, d1 - d3)), Feature::Edge(0));
    }
    let cp = sub(p, c);
    let (d5, d6) = (dot(ab, cp), dot(ac, cp));
    if d6 >= 0.0 && d5 <= d6 {
        return (c, Feature::Corner(2));
    }
    let vb = d5 * d2 - d1 * d6;
    if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
        return (along(a, ac, ratio(d2, d2 - d6)), Feature::Edge(2));
    }
    let va = d3 * d6 - d5 * d4;
    let (to_c, to_b) = (d4 - d3, d5 - d6);
    if va <= 0.0 && to_c >= 0.0 && to_b >= 0.0 {
        let place = along(b, sub(c, b), ratio(to_c, to_c + to_b));
        return (place, Feature::Edge(1));
    }
    let total = va + vb + vc;
    if total > 0.0 {
        let place = add(a, add(scale(ab, vb / total), scale(ac, vc / total)));
        return (place, Feature::Face);
    }
    best_corner(p, [a, b, c])
}

#[inline]
fn ratio(part: f64, whole: f64) -> f64 {
    if whole > 0.0 { part / whole } else { 0.0 }
}

/// What is left of a triangle of no area after rounding.
#[cold]
fn best_corner(p: Point, corners: [Point; 3]) -> (Point, Feature) {
    let mut best = (corners[0], Feature::Corner(0));
    for (i, corner) in (0..).zip(corners) {
        if squared(sub(p, corner)) < squared(sub(p, best.0)) {
            best = (corner, Feature::Corner(i));
        }
    }
    best
}

#[cfg(test)]
mod tests {
    use super::*;

    const FLAT: [Point; 3] = [[0.0; 3], [4.0, 0.0, 0.0], [0.0, 3.0, 0.0]];

    #[test]
    fn all_seven_parts() {
        for (p, place, feature) in [
            ([1.0, 1.0, 5.0], [1.0, 1.0, 0.0], Feature::Face),
            ([-1.0, -1.0, 2.0], [0.0; 3], Feature::Corner(0)),
            ([6.0, -1.0, 0.0], [4.0, 0.0, 0.0], Feature::Corner(1)),
            ([-1.0, 5.0, 0.0], [0.0, 3.0, 0.0], Feature::Corner(2)),
            ([2.0, -3.0, 1.0], [2.0, 0.0, 0.0], Feature::Edge(0)),
            ([-3.0, 2.0, 1.0], [0.0, 2.0, 0.0], Feature::Edge(2)),
        ] {
            assert_eq!(on_triangle(p, FLAT), (place, feature), "{p:?}");
        }
        let (place, feature) = on_triangle([5.0, 5.5, 0.0], FLAT);
        assert_eq!(feature, Feature::Edge(1));
        assert!((place[0] / 4.0 + place[1] / 3.0 - 1.0).abs() < 1e-15);
    }

    #[test]
    fn triangles_without_area_give_places_on_them() {
        let line = [[0.0; 3], [2.0, 0.0, 0.0], [1.0, 0.0, 0.0]];
        let (place, _) = on_triangle([1.5, 2.0, 0.0], line);
        assert!(
            (place[0] - 1.5).abs() < 1e-12 && place[1] == 0.0,
            "{place:?}"
        );
        assert_eq!(on_triangle([1.0; 3], [[0.0; 3]; 3]).0, [0.0; 3]);
    }
}
