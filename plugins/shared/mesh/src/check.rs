//! What is wrong with indexed triangles, without changing them.

use crate::groups::Groups;
use crate::mesh::next;
use crate::vector::{Point, area_vector, finite, norm, squared, sub};

/// Defects of indexed triangles. All zero for a closed, oriented 2-manifold.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Defects {
    /// Vertices with a coordinate that is no finite number.
    pub not_finite: usize,
    /// Vertices that no triangle names.
    pub unused: usize,
    /// Triangles that name a vertex that does not exist.
    pub bad_index: usize,
    /// Triangles that name a vertex twice, or whose corners lie on a line.
    pub degenerate: usize,
    /// Triangles that have the same corners as an earlier one.
    pub duplicate: usize,
    /// Edges of one triangle only.
    pub boundary_edges: usize,
    /// Edges of more than two triangles.
    pub non_manifold_edges: usize,
    /// Edges along which two triangles face opposite sides.
    pub flipped_edges: usize,
    /// Vertices at which triangles meet without sharing an edge.
    pub non_manifold_vertices: usize,
}

impl Defects {
    /// Whether it is a 2-manifold, with or without boundary, all triangles facing one side.
    #[must_use]
    pub fn is_manifold(&self) -> bool {
        *self
            == Defects {
                boundary_edges: self.boundary_edges,
                unused: self.unused,
                ..Defects::default()
            }
    }

    /// Whether it is a closed, oriented 2-manifold.
    #[must_use]
    pub fn is_closed(&self) -> bool {
        self.is_manifold() && self.boundary_edges == 0
    }
}

/// Half-edges sorted by edge: `(lower vertex, higher vertex, half-edge)`.
pub(crate) fn sorted_edges(triangles: &[[u32; 3]]) -> Vec<(u64, u32)> {
    let corners = triangles.as_flattened();
    let key = |h: u32| {
        let (a, b) = (corners[h as usize], corners[next(h) as usize]);
        u64::from(a.min(b)) << 32 | u64::from(a.max(b))
    };
    let mut edges: Vec<(u64, u32)> = (0..corners.len() as u32).map(|h| (key(h), h)).collect();
    edges.sort_unstable();
    edges
}

/// Whether the corners lie on a line, as far as their digits tell.
pub(crate) fn is_sliver([a, b, c]: [Point; 3]) -> bool {
    let longest = squared(sub(b, a))
        .max(squared(sub(c, b)))
        .max(squared(sub(a, c)));
    !(norm(area_vector([a, b, c])) > 1e-12 * longest)
}

/// Counts the defects.
#[must_use]
pub fn check(positions: &[Point], triangles: &[[u32; 3]]) -> Defects {
    let mut defects = Defects {
        not_finite: positions.iter().filter(|p| !finite(**p)).count(),
        ..Defects::default()
    };
    let mut used = vec![false; positions.len()];
    let mut sound = Vec::with_capacity(triangles.len());
    for &triangle in triangles {
        if triangle.iter().any(|&v| v as usize >= positions.len()) {
            defects.bad_index += 1;
            continue;
        }
        triangle.iter().for_each(|&v| used[v as usize] = true);
        let [a, b, c] = triangle;
        if is_sliver(triangle.map(|v| positions[v as usize])) {
            defects.degenerate += 1;
        }
        if a != b && b != c && c != a {
            sound.push(triangle);
        }
    }
    defects.unused = used.iter().filter(|used| !**used).count();
    let mut sorted: Vec<[u32; 3]> = sound.iter().copied().map(in_order).collect();
    sorted.sort_unstable();
    defects.duplicate = sorted.windows(2).filter(|pair| pair[0] == pair[1]).count();
    count_edges(&sound, positions.len(), &mut defects);
    defects
}

pub(crate) fn in_order(mut triangle: [u32; 3]) -> [u32; 3] {
    triangle.sort_unstable();
    triangle
}

fn count_edges(triangles: &[[u32; 3]], vertices: usize, defects: &mut Defects) {
    let corners = triangles.as_flattened();
    let mut fans = Groups::new(corners.len());
    for edge in sorted_edges(triangles).chunk_by(|a, b| a.0 == b.0) {
        let first = edge[0].1;
        for &(_, h) in &edge[1..] {
            // Corners at the same end of the edge.
            let same = corners[h as usize] == corners[first as usize];
            let (start, end) = if same { (h, next(h)) } else { (next(h), h) };
            fans.join(first, start);
            fans.join(next(first), end);
            defects.flipped_edges += usize::from(same && edge.len() == 2);
        }
        match edge.len() {
            1 => defects.boundary_edges += 1,
            2 => {}
            _ => defects.non_manifold_edges += 1,
        }
    }
    let mut count = vec![0_u32; vertices];
    for h in 0..corners.len() as u32 {
        if fans.find(h) == h {
            count[corners[h as usize] as usize] += 1;
        }
    }
    defects.non_manifold_vertices = count.iter().filter(|fans| **fans > 1).count();
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shapes;

    #[test]
    fn sound_shapes_have_no_defects() {
        for (positions, triangles) in [
            shapes::sphere(2.0, 2),
            shapes::torus(5.0, 1.0, 9, 6),
            shapes::cube(1.0, 3),
        ] {
            assert!(check(&positions, &triangles).is_closed());
        }
        let (positions, triangles) = shapes::grid(3, 2, 1.0);
        let defects = check(&positions, &triangles);
        assert!(defects.is_manifold() && !defects.is_closed());
        assert_eq!(defects.boundary_edges, 10);
    }

    #[test]
    fn each_defect_is_counted() {
        let (mut positions, mut triangles) = shapes::cube(1.0, 1);
        triangles[0].swap(0, 1);
        assert_eq!(check(&positions, &triangles).flipped_edges, 3);
        triangles.push(triangles[5]);
        triangles.push([0, 0, 1]);
        triangles.push([0, 1, 99]);
        positions.push([f64::NAN; 3]);
        let defects = check(&positions, &triangles);
        assert_eq!(
            (defects.duplicate, defects.degenerate, defects.bad_index),
            (1, 1, 1)
        );
        assert_eq!(
            (
                defects.not_finite,
                defects.unused,
                defects.non_manifold_edges
            ),
            (1, 1, 3)
        );
        let (positions, _) = shapes::grid(2, 2, 1.0);
        let bow = check(&positions, &[[0, 1, 4], [4, 7, 6]]);
        assert_eq!((bow.non_manifold_vertices, bow.boundary_edges), (1, 6));
        // One side only: somewhere two triangles face opposite sides.
        let (positions, triangles) = shapes::moebius(5.0, 1.0, 12, 2);
        assert_eq!(check(&positions, &triangles).flipped_edges, 2);
    }
}
