//! Polygons of the surface in one cell of the dual grid.
//!
//! The topology comes from the leaves, never from positions: a vertex of the surface is a pair of
//! leaves that share a face and lie on different sides. On a face of a cell whose corners alternate,
//! the corners inside are kept apart; both cells of a face see the same corners, so their polygons
//! meet. A leaf that is as wide as several corners fills them all; edges that this makes equal are
//! one vertex, and polygons of two vertices vanish. In an octree whose neighbours differ by one
//! level at most, each edge of the surface then belongs to two polygons.

use crate::cells::Octants;

/// Corners of the six faces of a cube in circular order, seen from outside.
const FACES: [[u8; 4]; 6] = [
    [0, 4, 6, 2],
    [1, 3, 7, 5],
    [0, 1, 5, 4],
    [2, 6, 7, 3],
    [0, 2, 3, 1],
    [4, 5, 7, 6],
];

/// An edge of a cube: its low corner, and its axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Edge {
    /// The corner at its low end.
    pub low: u8,
    /// Its axis.
    pub axis: u8,
}

impl Edge {
    fn between(a: u8, b: u8) -> Edge {
        Edge {
            low: a.min(b),
            axis: (a ^ b).trailing_zeros() as u8,
        }
    }

    /// The corner at its high end.
    #[must_use]
    pub fn high(self) -> u8 {
        self.low | 1 << self.axis
    }

    fn number(self) -> usize {
        usize::from(self.low) * 3 + usize::from(self.axis)
    }
}

/// The loops of edges about the inside, for each set of corners inside.
pub struct Loops(Vec<Vec<Vec<Edge>>>);

impl Loops {
    /// Makes the table.
    #[must_use]
    pub fn new() -> Loops {
        Loops((0..=255u8).map(loops).collect())
    }

    /// The loops of a set of corners, bit c for corner c.
    #[must_use]
    pub fn of(&self, inside: u8) -> &[Vec<Edge>] {
        &self.0[usize::from(inside)]
    }
}

impl Default for Loops {
    fn default() -> Self {
        Self::new()
    }
}

fn loops(inside: u8) -> Vec<Vec<Edge>> {
    let is_in = |corner: u8| inside >> corner & 1 == 1;
    // On each face a segment goes about each run of corners inside.
    let mut next: [Option<Edge>; 24] = [None; 24];
    for face in FACES {
        for k in 0..4 {
            if is_in(face[k]) || !is_in(face[(k + 1) % 4]) {
                continue;
            }
            let begin = Edge::between(face[k], face[(k + 1) % 4]);
            let mut end = k + 1;
            while is_in(face[(end + 1) % 4]) {
                end += 1;
            }
            let end = Edge::between(face[end % 4], face[(end + 1) % 4]);
            next[begin.number()] = Some(end);
        }
    }
    let mut loops = Vec::new();
    for number in 0..24 {
        let mut one = Vec::new();
        let mut at = number;
        while let Some(edge) = next[at].take() {
            one.push(edge);
            at = edge.number();
        }
        if !one.is_empty() {
            loops.push(one);
        }
    }
    loops
}

/// A polygon of a cell: its corners as vertices, and which diagonals may be used.
#[derive(Clone, Debug, Default)]
pub struct Polygon {
    /// Vertices in order, seen from outside.
    pub vertices: Vec<u32>,
    pairs: Vec<[u32; 2]>,
}

impl Polygon {
    /// The polygon of a loop in a cell; `vertex` numbers the pair of leaves at an edge.
    pub fn set(&mut self, edges: &[Edge], cell: &Octants, vertex: &dyn Fn(Edge) -> u32) {
        self.vertices.clear();
        self.pairs.clear();
        for edge in edges {
            let number = vertex(*edge);
            if self.vertices.last() != Some(&number) {
                self.vertices.push(number);
                let ends = [edge.low, edge.high()];
                self.pairs
                    .push(ends.map(|corner| cell[usize::from(corner)]));
            }
        }
        while self.vertices.len() > 1 && self.vertices.first() == self.vertices.last() {
            self.vertices.pop();
            self.pairs.pop();
        }
    }

    /// Whether no other cell can join the same two vertices: no face of the cell has all leaves at
    /// both.
    #[must_use]
    pub fn may_join(&self, a: usize, b: usize, cell: &Octants) -> bool {
        !FACES.iter().any(|face| {
            let on_face = |leaf: u32| face.iter().any(|c| cell[usize::from(*c)] == leaf);
            self.pairs[a].into_iter().chain(self.pairs[b]).all(on_face)
        })
    }

    /// The first corner from which all diagonals may be used, the shortest longest diagonal first;
    /// none if there is no such corner.
    #[must_use]
    pub fn fan(&self, cell: &Octants, squared: &dyn Fn(u32, u32) -> f64) -> Option<usize> {
        let count = self.vertices.len();
        let mut best: Option<(f64, usize)> = None;
        for from in 0..count {
            let mut longest = 0f64;
            let all = (2..count - 1).all(|k| {
                let to = (from + k) % count;
                longest = longest.max(squared(self.vertices[from], self.vertices[to]));
                self.may_join(from, to, cell)
            });
            if all && best.is_none_or(|(shortest, _)| longest < shortest) {
                best = Some((longest, from));
            }
        }
        best.map(|(_, from)| from)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_cut_edge_lies_on_one_loop() {
        let loops = Loops::new();
        for inside in 0..=255u8 {
            let mut seen = [0; 24];
            for edge in loops.of(inside).iter().flatten() {
                seen[edge.number()] += 1;
            }
            for low in 0..8u8 {
                for axis in 0..3u8 {
                    if low >> axis & 1 == 1 {
                        continue;
                    }
                    let edge = Edge { low, axis };
                    let cut = (inside >> low ^ inside >> edge.high()) & 1;
                    assert_eq!(seen[edge.number()], cut, "{inside:08b} {edge:?}");
                }
            }
            let lengths = loops.of(inside).iter().map(Vec::len);
            assert!(lengths.into_iter().all(|length| length >= 3));
        }
        assert_eq!(loops.of(0b0000_0001)[0].len(), 3);
        // Opposite corners of a face stay apart.
        assert_eq!(loops.of(0b0000_1001).len(), 2);
        assert_eq!(loops.of(0b0110_1001).len(), 4);
        assert_eq!(loops.of(0b1001_0110).len(), 4);
    }
}
