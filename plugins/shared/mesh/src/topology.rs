//! Components, boundary loops, Euler characteristic and genus.

use crate::mesh::{Mesh, NONE, next, prev};

/// Vertices minus edges plus triangles.
#[must_use]
pub fn euler(mesh: &Mesh) -> i64 {
    let edges = mesh.edges().count() as i64;
    mesh.vertex_count() as i64 - edges + mesh.triangle_count() as i64
}

/// The boundary as closed loops of half-edges without twin, each in its direction, beginning with
/// its lowest half-edge; sorted by that.
#[must_use]
pub fn boundary_loops(mesh: &Mesh) -> Vec<Vec<u32>> {
    let mut seen = vec![false; mesh.half_edges() as usize];
    let mut loops = Vec::new();
    for start in 0..mesh.half_edges() {
        if !mesh.is_live(start) || mesh.twin(start) != NONE || seen[start as usize] {
            continue;
        }
        let mut ring = Vec::new();
        let mut h = start;
        while h != NONE && !seen[h as usize] {
            seen[h as usize] = true;
            ring.push(h);
            // The boundary goes on with the one outgoing half-edge that has no twin.
            h = mesh.out(mesh.to(h));
        }
        loops.push(ring);
    }
    loops
}

/// Component of each triangle, from 0 in the order of the lowest triangle, and their number. Dead
/// triangles have [`NONE`].
#[must_use]
pub fn components(mesh: &Mesh) -> (Vec<u32>, usize) {
    let mut component = vec![NONE; (mesh.half_edges() / 3) as usize];
    let mut count = 0;
    let mut stack = Vec::new();
    for (first, _) in mesh.triangles() {
        if component[first as usize] != NONE {
            continue;
        }
        component[first as usize] = count;
        stack.push(first);
        while let Some(triangle) = stack.pop() {
            for h in 3 * triangle..3 * triangle + 3 {
                let twin = mesh.twin(h);
                if twin != NONE && component[(twin / 3) as usize] == NONE {
                    component[(twin / 3) as usize] = count;
                    stack.push(twin / 3);
                }
            }
        }
        count += 1;
    }
    (component, count as usize)
}

/// What a component is like.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Component {
    /// Number of vertices.
    pub vertices: usize,
    /// Number of triangles.
    pub triangles: usize,
    /// Number of boundary loops; 0 if it is closed.
    pub loops: usize,
    /// Vertices minus edges plus triangles.
    pub euler: i64,
    /// Handles: (2 - euler - loops) / 2.
    pub genus: i64,
    /// Area, in the square of the unit of the positions.
    pub area: f64,
    /// Volume inside, negative if its triangles face inwards; meaningful if it is closed.
    pub volume: f64,
    /// Lowest corner of its bounding box.
    pub low: [f64; 3],
    /// Highest corner of its bounding box.
    pub high: [f64; 3],
}

/// The components of a mesh, in the order of their numbers, and the component of each triangle.
#[must_use]
pub fn describe(mesh: &Mesh) -> (Vec<Component>, Vec<u32>) {
    let (of, count) = components(mesh);
    let empty = Component {
        low: [f64::INFINITY; 3],
        high: [f64::NEG_INFINITY; 3],
        ..Component::default()
    };
    let mut all = vec![empty; count];
    let mut anchors: Vec<Option<[f64; 3]>> = vec![None; count];
    for (i, corners) in mesh.triangles() {
        let number = of[i as usize] as usize;
        let places = corners.map(|v| mesh.position(v));
        let one = &mut all[number];
        let normal = crate::vector::area_vector(places);
        // Volumes about a point of the component, so that its distance from the origin costs no
        // digits.
        let anchor = *anchors[number].get_or_insert(places[0]);
        one.triangles += 1;
        one.area += 0.5 * crate::vector::norm(normal);
        one.volume += crate::vector::dot(normal, crate::vector::sub(places[0], anchor)) / 6.0;
        for axis in 0..3 {
            for place in places {
                one.low[axis] = one.low[axis].min(place[axis]);
                one.high[axis] = one.high[axis].max(place[axis]);
            }
        }
    }
    for vertex in mesh.live_vertices() {
        all[of[(mesh.out(vertex) / 3) as usize] as usize].vertices += 1;
    }
    let mut edges = vec![0_i64; count];
    for h in mesh.edges() {
        edges[of[(h / 3) as usize] as usize] += 1;
    }
    for ring in boundary_loops(mesh) {
        all[of[(ring[0] / 3) as usize] as usize].loops += 1;
    }
    for (one, edges) in all.iter_mut().zip(edges) {
        one.euler = one.vertices as i64 - edges + one.triangles as i64;
        one.genus = (2 - one.euler - one.loops as i64) / 2;
    }
    (all, of)
}

/// The triangles for which `keep` says yes to their component, with all vertices as they are.
#[must_use]
pub fn keep_components(mesh: &Mesh, keep: impl FnMut(&Component) -> bool) -> Mesh {
    let (all, of) = describe(mesh);
    let kept: Vec<bool> = all.iter().map(keep).collect();
    let mut result = mesh.clone();
    for (i, corners) in mesh.triangles() {
        if kept[of[i as usize] as usize] {
            continue;
        }
        for vertex in corners {
            if std::mem::replace(&mut result.out[vertex as usize], NONE) != NONE {
                result.vertices -= 1;
            }
        }
        for h in [3 * i, next(3 * i), prev(3 * i)] {
            result.corner[h as usize] = NONE;
            result.twin[h as usize] = NONE;
        }
        result.triangles -= 1;
    }
    result
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shapes;

    #[test]
    fn shapes_have_their_genus() {
        let (positions, triangles) = shapes::torus(10.0, 3.0, 30, 12);
        let mesh = Mesh::new(positions, &triangles).unwrap();
        assert_eq!(euler(&mesh), 0);
        let one = describe(&mesh).0[0];
        assert_eq!(
            (one.genus, one.loops, one.vertices, one.triangles),
            (1, 0, 360, 720)
        );
        let mesh = shape(shapes::sphere(5.0, 3));
        assert_eq!((euler(&mesh), describe(&mesh).0[0].genus), (2, 0));
        let mesh = shape(shapes::cube(2.0, 4));
        let one = describe(&mesh).0[0];
        assert_eq!((one.euler, one.area), (2, 24.0));
        assert!((one.volume - 8.0).abs() < 1e-12);
        assert_eq!((one.low, one.high), ([-1.0; 3], [1.0; 3]));
        let mesh = shape(shapes::grid(4, 3, 1.0));
        let one = describe(&mesh).0[0];
        assert_eq!((one.euler, one.loops, one.genus), (1, 1, 0));
        let rings = boundary_loops(&mesh);
        assert_eq!((rings.len(), rings[0].len()), (1, 14));
        assert!(
            rings[0]
                .windows(2)
                .all(|w| mesh.to(w[0]) == mesh.from(w[1]))
        );
    }

    fn shape(shape: shapes::Shape) -> Mesh {
        Mesh::new(shape.0, &shape.1).unwrap()
    }

    #[test]
    fn components_are_told_apart_and_kept() {
        let (mut positions, mut triangles) = shapes::sphere(1.0, 1);
        let (more, others) = shapes::torus(10.0, 3.0, 9, 5);
        let shift = positions.len() as u32;
        positions.extend(more);
        triangles.extend(others.iter().map(|t| t.map(|v| v + shift)));
        let mesh = Mesh::new(positions, &triangles).unwrap();
        let (all, _) = describe(&mesh);
        assert_eq!(all.iter().map(|c| c.genus).collect::<Vec<_>>(), [0, 1]);
        let mut kept = keep_components(&mesh, |c| c.genus == 1);
        kept.verify().unwrap();
        kept.compact();
        kept.verify().unwrap();
        assert_eq!((euler(&kept), kept.vertex_count()), (0, 45));
        assert!(keep_components(&mesh, |_| false).is_empty());
    }
}
