//! Making a half-edge mesh of indexed triangles.

use crate::mesh::{Mesh, NONE, next};
use crate::vector::Point;
use puncta_sdk::Failure;

/// Half-edges sorted by the vertex at which they start.
pub(crate) struct Starts {
    first: Vec<u32>,
    edges: Vec<u32>,
}

impl Starts {
    /// Of triangles whose indices are below `vertices`.
    pub(crate) fn new(vertices: usize, triangles: &[[u32; 3]]) -> Starts {
        let mut first = vec![0_u32; vertices + 1];
        for &vertex in triangles.as_flattened() {
            first[vertex as usize + 1] += 1;
        }
        let mut sum = 0;
        for count in &mut first {
            sum += *count;
            *count = sum;
        }
        let mut place = first.clone();
        let mut edges = vec![0; triangles.len() * 3];
        for (h, &vertex) in (0..).zip(triangles.as_flattened()) {
            let place = &mut place[vertex as usize];
            edges[*place as usize] = h;
            *place += 1;
        }
        Starts { first, edges }
    }

    /// Half-edges from a vertex, in order.
    pub(crate) fn of(&self, vertex: u32) -> &[u32] {
        let vertex = vertex as usize;
        &self.edges[self.first[vertex] as usize..self.first[vertex + 1] as usize]
    }
}

/// Checks that vertices and half-edges can be numbered with 32 bits.
///
/// # Errors
/// When they cannot.
pub(crate) fn check_size(vertices: usize, triangles: usize) -> Result<(), Failure> {
    if vertices >= NONE as usize / 2 || triangles >= NONE as usize / 6 {
        let message =
            format!("a mesh of {vertices} vertices and {triangles} triangles is too large");
        let most = "meshes may have up to 2000 million vertices and 700 million triangles";
        return Err(Failure::bad_input(message).remedy(most));
    }
    Ok(())
}

/// Checks that all vertices that triangles name exist.
///
/// # Errors
/// The first one that does not; or too many triangles.
pub(crate) fn check_indices(vertices: usize, triangles: &[[u32; 3]]) -> Result<(), Failure> {
    check_size(vertices, triangles.len())?;
    for (row, triangle) in triangles.iter().enumerate() {
        if let Some(corner) = triangle.iter().find(|corner| **corner as usize >= vertices) {
            let message =
                format!("triangle {row} names vertex {corner}, but there are {vertices} vertices");
            return Err(repairable(message).row(row as u64));
        }
    }
    Ok(())
}

impl Mesh {
    /// Makes a mesh of triangles whose corners are vertex numbers, anticlockwise seen from outside.
    /// Vertices that no triangle names are dead.
    ///
    /// # Errors
    /// When an index does not exist, a triangle names a vertex twice, an edge has more than two
    /// triangles or two of the same direction, or triangles meet at a vertex without an edge:
    /// [`crate::repair`] mends all of these.
    pub fn new(positions: Vec<Point>, triangles: &[[u32; 3]]) -> Result<Mesh, Failure> {
        check_indices(positions.len(), triangles)?;
        for (row, &[a, b, c]) in triangles.iter().enumerate() {
            if a == b || b == c || c == a {
                let message = format!("triangle {row} names a vertex twice");
                return Err(repairable(message).row(row as u64));
            }
        }
        let starts = Starts::new(positions.len(), triangles);
        let mut twin = vec![NONE; triangles.len() * 3];
        let corner: Vec<u32> = triangles.as_flattened().to_vec();
        for (h, slot) in (0_u32..).zip(&mut twin) {
            let (a, b) = (corner[h as usize], corner[next(h) as usize]);
            let same = |g: &&u32| corner[next(**g) as usize] == b;
            if starts.of(a).iter().filter(same).count() > 1 {
                return Err(repairable(format!(
                    "two triangles have an edge from vertex {a} to vertex {b}"
                )));
            }
            let back = |g: &&u32| corner[next(**g) as usize] == a;
            *slot = starts.of(b).iter().find(back).copied().unwrap_or(NONE);
        }
        let mut mesh = Mesh {
            out: vec![NONE; positions.len()],
            positions,
            corner,
            twin,
            triangles: triangles.len(),
            vertices: 0,
        };
        mesh.find_outs(&starts)?;
        Ok(mesh)
    }

    /// Finds the first half-edge of each vertex, and that one walk sees all of its triangles.
    fn find_outs(&mut self, starts: &Starts) -> Result<(), Failure> {
        for vertex in 0..self.positions.len() as u32 {
            let around = starts.of(vertex);
            let Some(&some) = around.first() else {
                continue;
            };
            self.vertices += 1;
            let boundary = around.iter().find(|&&h| self.twin(h) == NONE);
            self.out[vertex as usize] = *boundary.unwrap_or(&some);
            if self.outgoing(vertex).count() != around.len() {
                return Err(repairable(format!(
                    "triangles meet at vertex {vertex} without sharing an edge"
                )));
            }
        }
        Ok(())
    }

    /// Sets the first half-edge of a vertex, of which `h` is one.
    pub(crate) fn settle_out(&mut self, vertex: u32, h: u32) {
        let mut first = h;
        let mut left = self.corner.len();
        while left > 0 {
            let twin = self.twin(first);
            if twin == NONE {
                break;
            }
            first = next(twin);
            if first == h {
                break;
            }
            left -= 1;
        }
        if let Some(slot) = self.out.get_mut(vertex as usize) {
            *slot = first;
        }
    }

    pub(crate) fn set_twins(&mut self, a: u32, b: u32) {
        if let Some(slot) = self.twin.get_mut(a as usize) {
            *slot = b;
        }
        if let Some(slot) = self.twin.get_mut(b as usize) {
            *slot = a;
        }
    }
}

fn repairable(message: String) -> Failure {
    Failure::bad_input(message).remedy("repair the mesh first (puncta.mesh.repair)")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shapes;

    #[test]
    fn closed_shapes_have_no_boundary() {
        for (positions, triangles, edges) in [
            with(shapes::sphere(10.0, 2), 480),
            with(shapes::torus(10.0, 3.0, 20, 10), 600),
        ] {
            let mesh = Mesh::new(positions, &triangles).unwrap();
            mesh.verify().unwrap();
            assert_eq!(mesh.edges().count(), edges);
            assert!(mesh.live_vertices().all(|v| !mesh.at_boundary(v)));
            assert_eq!(mesh.to_triangles().1, triangles);
        }
    }

    fn with(
        shape: (Vec<Point>, Vec<[u32; 3]>),
        edges: usize,
    ) -> (Vec<Point>, Vec<[u32; 3]>, usize) {
        (shape.0, shape.1, edges)
    }

    #[test]
    fn rings_at_the_boundary_are_whole() {
        let (positions, triangles) = shapes::grid(3, 3, 1.0);
        let mesh = Mesh::new(positions, &triangles).unwrap();
        mesh.verify().unwrap();
        let mut ring: Vec<u32> = mesh.ring(0).collect();
        ring.sort_unstable();
        assert_eq!(ring, [1, 4, 5]);
        assert_eq!(mesh.valence(5), 6);
        assert!(mesh.at_boundary(0) && !mesh.at_boundary(5));
        assert_eq!(mesh.edges().count(), 33);
    }

    #[test]
    fn what_is_no_mesh_is_refused() {
        let points = vec![[0.0; 3]; 5];
        let text = |triangles: &[[u32; 3]]| {
            Mesh::new(points.clone(), triangles)
                .unwrap_err()
                .to_string()
        };
        assert!(text(&[[0, 1, 9]]).contains("vertex 9"));
        assert!(text(&[[0, 1, 1]]).contains("twice"));
        assert!(text(&[[0, 1, 2], [0, 1, 3]]).contains("from vertex 0 to vertex 1"));
        assert!(text(&[[0, 1, 2], [0, 3, 4]]).contains("meet at vertex 0"));
        let empty = Mesh::new(Vec::new(), &[]).unwrap();
        assert!(empty.is_empty() && empty.verify().is_ok());
    }

    #[test]
    fn unknown_numbers_give_nothing() {
        let mesh = Mesh::new(vec![[0.0; 3]; 3], &[[0, 1, 2]]).unwrap();
        assert_eq!(
            (mesh.from(99), mesh.to(NONE), mesh.twin(7)),
            (NONE, NONE, NONE)
        );
        assert_eq!(mesh.ring(55).count() + mesh.outgoing(NONE).count(), 0);
        assert_eq!(mesh.triangle(u32::MAX), None);
    }
}
