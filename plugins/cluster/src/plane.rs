//! Hulls and alpha shapes of points in a plane.

use puncta_sdk::Failure;
use spade::{DelaunayTriangulation, Point2, Triangulation};
use std::collections::BTreeMap;

/// A closed polygon; the last vertex is joined to the first.
pub type Ring = Vec<[f64; 2]>;

/// Twice the signed area of a triangle, positive if it turns left.
fn turn(a: [f64; 2], b: [f64; 2], c: [f64; 2]) -> f64 {
    (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
}

/// The convex hull, to the left, without points within its edges (Andrew's monotone chain). Fewer
/// than three vertices if all points lie on a line.
#[must_use]
pub fn hull(points: &[[f64; 2]]) -> Ring {
    let mut sorted = points.to_vec();
    sorted.sort_by(|a, b| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])));
    sorted.dedup();
    if sorted.len() < 3 {
        return sorted;
    }
    let half = |points: &mut dyn Iterator<Item = &[f64; 2]>| {
        let mut chain: Ring = Vec::new();
        for point in points {
            while chain.len() > 1
                && turn(chain[chain.len() - 2], chain[chain.len() - 1], *point) <= 0.0
            {
                chain.pop();
            }
            chain.push(*point);
        }
        chain.pop();
        chain
    };
    let mut ring = half(&mut sorted.iter());
    ring.extend(half(&mut sorted.iter().rev()));
    ring
}

/// Area of a polygon, positive if it runs to the left.
#[must_use]
pub fn area(ring: &[[f64; 2]]) -> f64 {
    let Some(origin) = ring.first() else {
        return 0.0;
    };
    let edges = ring.windows(2).map(|pair| turn(*origin, pair[0], pair[1]));
    0.5 * edges.sum::<f64>()
}

/// Length of a polygon's edges.
#[must_use]
pub fn perimeter(ring: &[[f64; 2]]) -> f64 {
    let next = ring.iter().skip(1).chain(ring.first());
    ring.iter()
        .zip(next)
        .map(|(a, b)| (a[0] - b[0]).hypot(a[1] - b[1]))
        .sum()
}

/// The alpha shape: the union of the Delaunay triangles whose circumscribed circle has at most the
/// radius `alpha`, as polygons around it (to the left) and around its holes (to the right).
/// Edelsbrunner, Kirkpatrick and Seidel, IEEE Trans. Inf. Theory 29, 551 (1983).
///
/// # Errors
/// When the positions cannot be triangulated.
pub fn alpha_shape(points: &[[f64; 2]], alpha: f64) -> Result<Vec<Ring>, Failure> {
    let refuse = |why: &dyn std::fmt::Debug| {
        Failure::bad_input(format!("positions cannot be triangulated: {why:?}"))
    };
    // From their middle, so that far from zero no digits are lost.
    let middle = points.first().copied().unwrap_or_default();
    let vertices = points
        .iter()
        .map(|p| Point2::new(p[0] - middle[0], p[1] - middle[1]))
        .collect();
    let triangles: DelaunayTriangulation<Point2<f64>> =
        DelaunayTriangulation::bulk_load(vertices).map_err(|why| refuse(&why))?;
    let mut next: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
    let mut edges = Vec::new();
    let square = alpha * alpha;
    let kept = |face: &spade::handles::FaceHandle<'_, spade::handles::InnerTag, _, _, _, _>| {
        face.circumcircle().1 <= square
    };
    for face in triangles.inner_faces().filter(kept) {
        for edge in face.adjacent_edges() {
            let other = edge.rev().face().as_inner();
            if other.is_none_or(|other| !kept(&other)) {
                edges.push((edge.from().index(), edge.to().index()));
            }
        }
    }
    edges.sort_unstable();
    for (from, to) in edges {
        next.entry(from).or_default().push(to);
    }
    let positions: Vec<[f64; 2]> = triangles
        .vertices()
        .map(|vertex| {
            [
                vertex.position().x + middle[0],
                vertex.position().y + middle[1],
            ]
        })
        .collect();
    Ok(trace(next, &positions))
}

/// Follows the edges to closed polygons; each edge is used once.
fn trace(mut next: BTreeMap<usize, Vec<usize>>, positions: &[[f64; 2]]) -> Vec<Ring> {
    let mut rings = Vec::new();
    while let Some((&start, _)) = next.first_key_value() {
        let mut ring = Vec::new();
        let mut at = start;
        while let Some(ends) = next.get_mut(&at) {
            ring.push(positions[at]);
            let to = ends.pop();
            if ends.is_empty() {
                next.remove(&at);
            }
            let Some(to) = to else { break };
            at = to;
        }
        rings.push(ring);
    }
    rings
}

#[cfg(test)]
mod tests;
