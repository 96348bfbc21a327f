//! Split, collapse and flip of an edge.

use crate::mesh::{Mesh, NONE, next, prev};
use crate::vector::Point;

impl Mesh {
    /// Puts a vertex on the edge of half-edge `h`, with two triangles for each that it had. Gives
    /// the new vertex; `None` if there is no such half-edge or no room for more.
    pub fn split(&mut self, h: u32, position: Point) -> Option<u32> {
        if !self.is_live(h) || self.corner.len() + 6 >= NONE as usize {
            return None;
        }
        let new = self.positions.len() as u32;
        self.positions.push(position);
        self.out.push(NONE);
        self.vertices += 1;
        let twin = self.twin(h);
        let ahead = self.halve(h, new);
        if twin == NONE {
            self.set_twin(ahead, NONE);
        } else {
            let behind = self.halve(twin, new);
            // `h` and `twin` are now the first halves from either end.
            self.set_twins(h, behind);
            self.set_twins(twin, ahead);
        }
        self.out[new as usize] = ahead;
        Some(new)
    }

    /// Cuts the triangle of `h` from `new`, on `h`, to the opposite corner. `h` becomes its first
    /// half; gives the half-edge of the second.
    fn halve(&mut self, h: u32, new: u32) -> u32 {
        let (right, top) = (next(h), prev(h));
        let (b, c) = (self.from(right), self.from(top));
        let outer = self.twin(right);
        let ahead = self.corner.len() as u32;
        self.corner.extend([new, b, c]);
        self.twin.extend([NONE; 3]);
        self.triangles += 1;
        self.set_corner(right, new);
        self.set_twins(right, ahead + 2);
        self.set_twin(ahead + 1, outer);
        self.set_twin(outer, ahead + 1);
        if self.out(b) == right {
            self.out[b as usize] = ahead + 1;
        }
        ahead
    }

    /// Turns the edge of `h` to join the two opposite corners. Says whether it could: not at the
    /// boundary, and not if the corners are joined already. The half-edge of the turned edge is
    /// `next(h)`.
    pub fn flip(&mut self, h: u32) -> bool {
        let t = self.twin(h);
        if !self.is_live(h) || t == NONE {
            return false;
        }
        let (h1, h2, t1, t2) = (next(h), prev(h), next(t), prev(t));
        let (a, b, c, d) = (self.from(h), self.from(t), self.from(h2), self.from(t2));
        if c == d || self.joined(c, d) {
            return false;
        }
        let (right, left) = (self.twin(h1), self.twin(t1));
        self.set_corner(h1, d);
        self.set_corner(t1, c);
        self.set_twin(h, left);
        self.set_twin(left, h);
        self.set_twin(t, right);
        self.set_twin(right, t);
        self.set_twins(h1, t1);
        for (vertex, gone, kept) in [(a, t1, h), (b, h1, t)] {
            if self.out(vertex) == gone {
                self.out[vertex as usize] = kept;
            }
        }
        true
    }

    /// Whether the edge of `h` can be collapsed and the surface keeps its topology: the link
    /// condition (Dey et al., Publ. Inst. Math. 66, 1999), with the boundary as one more vertex.
    #[must_use]
    pub fn can_collapse(&self, h: u32) -> bool {
        if !self.is_live(h) {
            return false;
        }
        let (a, b, t) = (self.from(h), self.to(h), self.twin(h));
        let c = self.from(prev(h));
        let d = if t == NONE { NONE } else { self.from(prev(t)) };
        if t != NONE && self.at_boundary(a) && self.at_boundary(b) {
            return false;
        }
        // A triangle that hangs on by this edge or a corner only.
        let hangs = |h: u32| self.twin(next(h)) == NONE && self.twin(prev(h)) == NONE;
        if hangs(h) || (t != NONE && hangs(t)) {
            return false;
        }
        if self
            .ring(a)
            .any(|v| v != c && v != d && self.ring(b).any(|w| w == v))
        {
            return false;
        }
        let three = |v: u32| !self.at_boundary(v) && self.valence(v) == 3;
        !(three(a) && three(b))
    }

    /// Merges the start of `h` into its end, which moves to `position`; the triangles of the edge
    /// go. Gives the vertex that is left; `None` if [`Mesh::can_collapse`] says no.
    pub fn collapse(&mut self, h: u32, position: Point) -> Option<u32> {
        if !self.can_collapse(h) {
            return None;
        }
        let (a, b, t) = (self.from(h), self.to(h), self.twin(h));
        let around: Vec<u32> = self.outgoing(a).collect();
        for out in around {
            self.set_corner(out, b);
        }
        // Of each side that goes: its opposite corner and the half-edges outside it.
        let sides: Vec<(u32, u32, [u32; 2])> = [h, t]
            .into_iter()
            .filter(|side| *side != NONE)
            .map(|side| {
                let outer = [self.twin(next(side)), self.twin(prev(side))];
                (side, self.from(prev(side)), outer)
            })
            .collect();
        for &(side, _, [x, y]) in &sides {
            self.set_twin(x, y);
            self.set_twin(y, x);
            self.remove(side);
        }
        self.out[a as usize] = NONE;
        self.vertices -= 1;
        self.positions[b as usize] = position;
        for (_, apex, outer) in sides {
            for h in outer.into_iter().filter(|outer| *outer != NONE) {
                for (vertex, start) in [(self.from(h), h), (self.to(h), next(h))] {
                    if vertex == apex || vertex == b {
                        self.settle_out(vertex, start);
                    }
                }
            }
        }
        Some(b)
    }

    /// Takes the triangle of `side` out of the surface.
    fn remove(&mut self, side: u32) {
        for h in [side, next(side), prev(side)] {
            self.set_corner(h, NONE);
            self.set_twin(h, NONE);
        }
        self.triangles -= 1;
    }

    #[inline]
    fn set_corner(&mut self, h: u32, vertex: u32) {
        if let Some(slot) = self.corner.get_mut(h as usize) {
            *slot = vertex;
        }
    }

    #[inline]
    fn set_twin(&mut self, h: u32, twin: u32) {
        if let Some(slot) = self.twin.get_mut(h as usize) {
            *slot = twin;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shapes;
    use crate::topology::euler;
    use rand_chacha::ChaCha8Rng;
    use rand_chacha::rand_core::{Rng, SeedableRng};

    fn torture(mut mesh: Mesh, steps: usize) {
        let chi = euler(&mesh);
        let closed = mesh.live_vertices().all(|v| !mesh.at_boundary(v));
        let mut random = ChaCha8Rng::seed_from_u64(7);
        for step in 0..steps {
            let h = random.next_u32() % mesh.half_edges();
            match random.next_u32() % 3 {
                0 => drop(mesh.split(h, [1.0, 2.0, 3.0])),
                1 => drop(mesh.collapse(h, [0.0; 3])),
                _ => drop(mesh.flip(h)),
            }
            if step % 50 == 0 {
                mesh.verify().unwrap();
                assert_eq!(euler(&mesh), chi);
            }
        }
        mesh.compact();
        mesh.verify().unwrap();
        assert_eq!(euler(&mesh), chi);
        assert_eq!(mesh.live_vertices().all(|v| !mesh.at_boundary(v)), closed);
        let (positions, triangles) = mesh.to_triangles();
        Mesh::new(positions, &triangles).unwrap();
    }

    #[test]
    fn random_edits_keep_the_topology() {
        let build = |shape: (Vec<Point>, Vec<[u32; 3]>)| Mesh::new(shape.0, &shape.1).unwrap();
        torture(build(shapes::sphere(1.0, 1)), 20_000);
        torture(build(shapes::torus(3.0, 1.0, 12, 7)), 20_000);
        torture(build(shapes::grid(5, 4, 1.0)), 20_000);
        torture(build(shapes::moebius(3.0, 1.0, 12, 3).cut()), 5_000);
    }

    trait Cut {
        fn cut(self) -> (Vec<Point>, Vec<[u32; 3]>);
    }
    impl Cut for (Vec<Point>, Vec<[u32; 3]>) {
        /// Without the last quad around, so that the strip has two sides.
        fn cut(mut self) -> (Vec<Point>, Vec<[u32; 3]>) {
            let keep = self.1.len() - 6;
            self.1.truncate(keep);
            self
        }
    }

    #[test]
    fn collapse_stops_at_the_smallest_closed_mesh() {
        let (positions, triangles) = shapes::sphere(1.0, 2);
        let mut mesh = Mesh::new(positions, &triangles).unwrap();
        loop {
            let h = mesh.edges().find(|&h| mesh.can_collapse(h));
            let Some(h) = h else { break };
            mesh.collapse(h, [0.0; 3]);
        }
        assert_eq!((mesh.vertex_count(), mesh.triangle_count()), (4, 4));
        mesh.verify().unwrap();
    }

    #[test]
    fn edits_of_nothing_are_refused() {
        let mut mesh = Mesh::new(vec![[0.0; 3]; 3], &[[0, 1, 2]]).unwrap();
        assert!(mesh.split(NONE, [0.0; 3]).is_none() && mesh.split(9, [0.0; 3]).is_none());
        assert!(!mesh.flip(0) && !mesh.flip(77));
        assert!(mesh.collapse(0, [0.0; 3]).is_none() && mesh.collapse(40, [0.0; 3]).is_none());
        assert_eq!(mesh.split(1, [0.0; 3]), Some(3));
        mesh.verify().unwrap();
    }
}
