//! The half-edge mesh: storage and walks.

use crate::vector::Point;

/// No half-edge, no vertex.
pub const NONE: u32 = u32::MAX;

/// An oriented 2-manifold of triangles, with or without boundary, as directed edges in flat arrays
/// (Campagna, Kobbelt and Seidel, J. Graph. Tools 3, 1998).
///
/// Half-edge `h` is side `h % 3` of triangle `h / 3` and runs from [`Mesh::from`] to [`Mesh::to`];
/// its twin runs back along the neighbouring triangle, or is [`NONE`] at the boundary. Seen from
/// outside, triangles are anticlockwise. Edits leave dead triangles and vertices behind, which
/// every walk skips and [`Mesh::compact`] removes. An index that does not exist gives [`NONE`] or
/// an empty walk, never a panic.
#[derive(Clone, Debug, Default)]
pub struct Mesh {
    pub(crate) positions: Vec<Point>,
    /// Vertex from which each half-edge starts; `NONE` in dead triangles.
    pub(crate) corner: Vec<u32>,
    pub(crate) twin: Vec<u32>,
    /// A half-edge from each vertex: at the boundary the one that has no twin. `NONE` if dead.
    pub(crate) out: Vec<u32>,
    pub(crate) triangles: usize,
    pub(crate) vertices: usize,
}

/// The half-edge after `h` in its triangle.
#[must_use]
#[inline]
pub fn next(h: u32) -> u32 {
    if h == NONE {
        NONE
    } else if h % 3 == 2 {
        h - 2
    } else {
        h + 1
    }
}

/// The half-edge before `h` in its triangle.
#[must_use]
#[inline]
pub fn prev(h: u32) -> u32 {
    if h == NONE {
        NONE
    } else if h.is_multiple_of(3) {
        h + 2
    } else {
        h - 1
    }
}

#[inline]
pub(crate) fn at(items: &[u32], i: u32) -> u32 {
    items.get(i as usize).copied().unwrap_or(NONE)
}

impl Mesh {
    /// Number of live vertices.
    #[must_use]
    pub fn vertex_count(&self) -> usize {
        self.vertices
    }

    /// Number of live triangles.
    #[must_use]
    pub fn triangle_count(&self) -> usize {
        self.triangles
    }

    /// Whether there is no triangle.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.triangles == 0
    }

    /// Positions of all vertices, dead ones too.
    #[must_use]
    pub fn positions(&self) -> &[Point] {
        &self.positions
    }

    /// Positions of all vertices, dead ones too, to be moved.
    pub fn positions_mut(&mut self) -> &mut [Point] {
        &mut self.positions
    }

    /// Position of a vertex; the origin if there is none.
    #[must_use]
    #[inline]
    pub fn position(&self, vertex: u32) -> Point {
        let position = self.positions.get(vertex as usize);
        position.copied().unwrap_or_default()
    }

    /// Number of half-edges, dead ones too.
    #[must_use]
    pub fn half_edges(&self) -> u32 {
        self.corner.len() as u32
    }

    /// Vertex at which half-edge `h` starts.
    #[must_use]
    #[inline]
    pub fn from(&self, h: u32) -> u32 {
        at(&self.corner, h)
    }

    /// Vertex at which half-edge `h` ends.
    #[must_use]
    #[inline]
    pub fn to(&self, h: u32) -> u32 {
        at(&self.corner, next(h))
    }

    /// The half-edge the other way, in the neighbouring triangle; [`NONE`] at the boundary.
    #[must_use]
    #[inline]
    pub fn twin(&self, h: u32) -> u32 {
        at(&self.twin, h)
    }

    /// A half-edge that starts at a vertex: at the boundary the one that has no twin.
    #[must_use]
    #[inline]
    pub fn out(&self, vertex: u32) -> u32 {
        at(&self.out, vertex)
    }

    /// Whether half-edge `h` is part of a live triangle.
    #[must_use]
    #[inline]
    pub fn is_live(&self, h: u32) -> bool {
        self.from(h) != NONE
    }

    /// Whether a vertex is live and lies at the boundary.
    #[must_use]
    #[inline]
    pub fn at_boundary(&self, vertex: u32) -> bool {
        let out = self.out(vertex);
        out != NONE && self.twin(out) == NONE
    }

    /// Corners of a triangle; `None` if it is dead.
    #[must_use]
    #[inline]
    pub fn triangle(&self, triangle: u32) -> Option<[u32; 3]> {
        let first = (triangle as usize).checked_mul(3)?;
        let corners = self.corner.get(first..first + 3)?;
        (corners[0] != NONE).then(|| [corners[0], corners[1], corners[2]])
    }

    /// Positions of the corners of a triangle.
    #[must_use]
    #[inline]
    pub fn corners(&self, triangle: u32) -> Option<[Point; 3]> {
        Some(self.triangle(triangle)?.map(|vertex| self.position(vertex)))
    }

    /// Live triangles with their numbers, in order.
    pub fn triangles(&self) -> impl Iterator<Item = (u32, [u32; 3])> + '_ {
        let (triples, _) = self.corner.as_chunks::<3>();
        let numbered = (0..).zip(triples);
        numbered
            .filter(|(_, corners)| corners[0] != NONE)
            .map(|(i, corners)| (i, *corners))
    }

    /// Live vertices, in order.
    pub fn live_vertices(&self) -> impl Iterator<Item = u32> + '_ {
        let numbered = (0..).zip(&self.out);
        numbered.filter(|(_, out)| **out != NONE).map(|(i, _)| i)
    }

    /// One half-edge of each edge: the one at the boundary, or the lower of two.
    pub fn edges(&self) -> impl Iterator<Item = u32> + '_ {
        (0..self.half_edges()).filter(|&h| self.is_live(h) && h < self.twin(h))
    }

    /// Half-edges that start at a vertex, anticlockwise.
    pub fn outgoing(&self, vertex: u32) -> impl Iterator<Item = u32> + '_ {
        let first = self.out(vertex);
        let mut h = first;
        let mut left = self.corner.len();
        std::iter::from_fn(move || {
            if h == NONE || left == 0 {
                return None;
            }
            let current = h;
            left -= 1;
            h = self.twin(prev(h));
            if h == first {
                h = NONE;
            }
            Some(current)
        })
    }

    /// Vertices joined to a vertex by an edge, anticlockwise.
    pub fn ring(&self, vertex: u32) -> impl Iterator<Item = u32> + '_ {
        let last = move |h: u32| {
            let inward = prev(h);
            (self.twin(inward) == NONE).then(|| self.from(inward))
        };
        self.outgoing(vertex)
            .flat_map(move |h| [Some(self.to(h)), last(h)])
            .flatten()
    }

    /// Number of edges of a vertex.
    #[must_use]
    pub fn valence(&self, vertex: u32) -> usize {
        self.ring(vertex).count()
    }

    /// The half-edge from `a` to `b`; [`NONE`] if there is none.
    #[must_use]
    pub fn half_edge(&self, a: u32, b: u32) -> u32 {
        self.outgoing(a).find(|&h| self.to(h) == b).unwrap_or(NONE)
    }

    /// Whether an edge joins two vertices.
    #[must_use]
    pub fn joined(&self, a: u32, b: u32) -> bool {
        self.half_edge(a, b) != NONE || self.half_edge(b, a) != NONE
    }

    /// Removes dead vertices and triangles. Gives the former number of each vertex.
    pub fn compact(&mut self) -> Vec<u32> {
        let kept: Vec<u32> = self.live_vertices().collect();
        let mut place = vec![NONE; self.positions.len()];
        for (new, &old) in (0..).zip(&kept) {
            place[old as usize] = new;
        }
        let live: Vec<u32> = self.triangles().map(|(i, _)| i).collect();
        let mut moved = vec![NONE; self.corner.len() / 3];
        for (new, &old) in (0..).zip(&live) {
            moved[old as usize] = new;
        }
        let edge = |h: u32| match h {
            NONE => NONE,
            h => at(&moved, h / 3) * 3 + h % 3,
        };
        let old = |i: &u32| [3 * i, 3 * i + 1, 3 * i + 2];
        let corner = live.iter().flat_map(old).map(|h| at(&place, self.from(h)));
        let corner = corner.collect();
        let twin = live.iter().flat_map(old).map(|h| edge(self.twin(h)));
        let twin = twin.collect();
        self.out = kept.iter().map(|&v| edge(self.out(v))).collect();
        self.positions = kept.iter().map(|&v| self.position(v)).collect();
        self.corner = corner;
        self.twin = twin;
        kept
    }

    /// Positions of the live vertices and the triangles between them.
    #[must_use]
    pub fn to_triangles(&self) -> (Vec<Point>, Vec<[u32; 3]>) {
        let mut copy = self.clone();
        copy.compact();
        let (triples, _) = copy.corner.as_chunks::<3>();
        let triangles = triples.to_vec();
        (copy.positions, triangles)
    }

    /// The triangles as they are stored; compact the mesh first.
    #[must_use]
    pub fn stored_triangles(&self) -> &[[u32; 3]] {
        self.corner.as_chunks::<3>().0
    }

    /// Checks that the arrays agree with one another; the sentence says where they do not.
    ///
    /// # Errors
    /// The first disagreement.
    pub fn verify(&self) -> Result<(), String> {
        for h in 0..self.half_edges() {
            if !self.is_live(h) {
                continue;
            }
            let (a, b, twin) = (self.from(h), self.to(h), self.twin(h));
            if a as usize >= self.positions.len() || a == b {
                return Err(format!("half-edge {h} runs from {a} to {b}"));
            }
            if twin != NONE && (self.twin(twin) != h || self.from(twin) != b || self.to(twin) != a)
            {
                return Err(format!("half-edge {h} has the wrong twin {twin}"));
            }
            if twin == NONE && self.out(a) != h {
                return Err(format!("vertex {a} does not begin at its boundary"));
            }
        }
        let mut starts = vec![0_u32; self.positions.len()];
        for (_, corners) in self.triangles() {
            corners.iter().for_each(|&v| starts[v as usize] += 1);
        }
        for (v, &count) in (0..).zip(&starts) {
            let walked = self.outgoing(v).take_while(|&h| self.from(h) == v).count();
            if walked != count as usize {
                return Err(format!(
                    "vertex {v} has {count} corners, of which a walk sees {walked}"
                ));
            }
        }
        let (vertices, triangles) = (self.live_vertices().count(), self.triangles().count());
        if (vertices, triangles) != (self.vertices, self.triangles) {
            return Err(format!(
                "{vertices} vertices and {triangles} triangles are live"
            ));
        }
        Ok(())
    }
}
