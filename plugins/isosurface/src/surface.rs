//! The surface of a field: vertices on the edges of the dual grid, polygons from its cells.

use crate::cells::{Octants, Walk};
use crate::field::{CHUNK, Field, each_mut};
use crate::march::{Edge, Loops, Polygon};
use puncta_sdk::run::{Cancelled, Run, chunks_mut, map};
use puncta_shared_mesh::Groups;
use puncta_shared_octree::NONE;
use puncta_shared_vector::{Point, add, between, cross, dot, squared, sub};

/// A vertex that only one polygon has: its middle.
const MIDDLE: u32 = 1 << 31;
/// Nearest that a vertex comes to the centre of a leaf, as a share of the edge: no two coincide.
const NEAR: f64 = 0.02;

/// Triangles about the inside, corners anticlockwise seen from outside.
#[derive(Clone, Debug, Default)]
pub struct Surface {
    /// Positions of the vertices, nm.
    pub positions: Vec<Point>,
    /// Side of the smaller leaf at each vertex, nm.
    pub sizes: Vec<f32>,
    /// Corners of the triangles.
    pub triangles: Vec<[u32; 3]>,
}

/// What a task makes.
#[derive(Default)]
struct Piece {
    triangles: Vec<[u32; 3]>,
    middles: Vec<(Point, f32)>,
}

/// Vertices by pair of leaves: the smaller leaf (of equal ones, that on the low side) and the
/// direction of the other.
struct Vertices {
    slots: Vec<[u32; 6]>,
    positions: Vec<Point>,
    sizes: Vec<f32>,
}

impl Surface {
    /// The surface at a threshold, in localisations per nm^3, between leaves of different sides.
    ///
    /// # Errors
    /// When cancelled.
    pub fn new(
        field: &Field<'_>,
        sides: &[u8],
        threshold: f64,
        run: &dyn Run,
    ) -> Result<Surface, Cancelled> {
        let vertices = Vertices::new(field, sides, threshold, run)?;
        let walk = Walk {
            nodes: field.tree.nodes(),
            sides,
        };
        let (states, loops) = (walk.start(2048), Loops::new());
        let pieces = map(run, states.len(), &|i| {
            let mut piece = Piece::default();
            let mut polygon = Polygon::default();
            if !run.cancelled() {
                walk.cells(&states[i], &mut |cell| {
                    piece.add(cell, &loops, &mut polygon, &vertices, walk);
                });
            }
            piece
        });
        if run.cancelled() {
            return Err(Cancelled);
        }
        let mut surface = Surface {
            positions: vertices.positions,
            sizes: vertices.sizes,
            triangles: Vec::with_capacity(pieces.iter().map(|p| p.triangles.len()).sum()),
        };
        for piece in pieces {
            let first = surface.positions.len() as u32;
            let number = |v: u32| {
                if v & MIDDLE == 0 {
                    v
                } else {
                    first + (v & !MIDDLE)
                }
            };
            let triangles = piece.triangles.iter().map(|t| t.map(number));
            surface.triangles.extend(triangles);
            for (position, size) in piece.middles {
                surface.positions.push(position);
                surface.sizes.push(size);
            }
        }
        Ok(surface)
    }

    /// Corners of a triangle.
    fn corners(&self, triangle: [u32; 3]) -> [Point; 3] {
        triangle.map(|v| self.positions[v as usize])
    }

    /// Area, nm^2.
    #[must_use]
    pub fn area(&self) -> f64 {
        let corners = self.triangles.iter().map(|t| self.corners(*t));
        corners
            .map(|[a, b, c]| squared(cross(sub(b, a), sub(c, a))).sqrt() / 2.0)
            .sum()
    }

    /// Volume, nm^3.
    #[must_use]
    pub fn volume(&self) -> f64 {
        let middle = self.positions.first().copied().unwrap_or_default();
        let corners = self.triangles.iter().map(|t| self.corners(*t));
        corners
            .map(|t| t.map(|p| sub(p, middle)))
            .map(|[a, b, c]| dot(a, cross(b, c)) / 6.0)
            .sum()
    }

    /// Euler characteristic of a closed surface: vertices - edges + triangles.
    #[must_use]
    pub fn euler(&self) -> i64 {
        self.positions.len() as i64 - self.triangles.len() as i64 / 2
    }

    /// Drops components with fewer triangles, and gives the number of those kept and dropped.
    pub fn drop_small(&mut self, fewest: usize) -> [usize; 2] {
        let mut groups = Groups::new(self.positions.len());
        for [a, b, c] in &self.triangles {
            groups.join(*a, *b);
            groups.join(*b, *c);
        }
        let mut counts = vec![0usize; self.positions.len()];
        for [a, ..] in &self.triangles {
            counts[groups.find(*a) as usize] += 1;
        }
        let all = counts.iter().filter(|count| **count > 0).count();
        let kept = counts
            .iter()
            .filter(|count| **count > 0 && **count >= fewest)
            .count();
        if kept < all {
            let mut keep = |v: u32| counts[groups.find(v) as usize] >= fewest.max(1);
            let mut numbers = vec![NONE; self.positions.len()];
            let mut next = 0;
            for (v, number) in numbers.iter_mut().enumerate() {
                if keep(v as u32) {
                    *number = next;
                    self.positions[next as usize] = self.positions[v];
                    self.sizes[next as usize] = self.sizes[v];
                    next += 1;
                }
            }
            self.positions.truncate(next as usize);
            self.sizes.truncate(next as usize);
            self.triangles
                .retain(|[a, ..]| numbers[*a as usize] != NONE);
            for triangle in &mut self.triangles {
                *triangle = triangle.map(|v| numbers[v as usize]);
            }
        }
        [kept, all - kept]
    }
}

impl Vertices {
    fn new(
        field: &Field<'_>,
        sides: &[u8],
        threshold: f64,
        run: &dyn Run,
    ) -> Result<Vertices, Cancelled> {
        let nodes = field.tree.nodes();
        let is_vertex = |at: usize, direction: usize| {
            let other = field.beside[at][direction];
            other != NONE && nodes[at].is_leaf() && {
                let neighbour = &nodes[other as usize];
                neighbour.is_leaf()
                    && sides[at] != sides[other as usize]
                    && (neighbour.level < nodes[at].level || direction % 2 == 1)
            }
        };
        // Numbers follow the order of the nodes.
        let found = map(run, nodes.len().div_ceil(CHUNK), &|chunk| {
            let mut found: Vec<([u32; 2], usize)> = Vec::new();
            if !run.cancelled() {
                for at in chunk * CHUNK..nodes.len().min((chunk + 1) * CHUNK) {
                    let directions = (0..6).filter(|direction| is_vertex(at, *direction));
                    found.extend(directions.map(|k| ([at as u32, field.beside[at][k]], k)));
                }
            }
            found
        });
        if run.cancelled() {
            return Err(Cancelled);
        }
        let mut firsts = vec![0];
        for found in &found {
            firsts.push(firsts[firsts.len() - 1] + found.len() as u32);
        }
        let mut slots = vec![[NONE; 6]; nodes.len()];
        chunks_mut(run, &mut slots, CHUNK, &|chunk, slots| {
            for (number, (ends, direction)) in (firsts[chunk]..).zip(&found[chunk]) {
                slots[ends[0] as usize - chunk * CHUNK][*direction] = number;
            }
        });
        let ends: Vec<[u32; 2]> = found.into_iter().flatten().map(|(ends, _)| ends).collect();
        let mut placed = vec![([0.0; 3], 0f32); ends.len()];
        each_mut(run, &mut placed, &|i, placed| {
            let [a, b] = ends[i];
            let (va, vb) = (field.values[a as usize], field.values[b as usize]);
            let share = ((threshold - va) / (vb - va)).clamp(NEAR, 1.0 - NEAR);
            let position = between(field.tree.centre(a), field.tree.centre(b), share);
            *placed = (position, field.tree.size(a) as f32);
        })?;
        let (positions, sizes) = placed.into_iter().unzip();
        Ok(Vertices {
            slots,
            positions,
            sizes,
        })
    }
}

impl Piece {
    fn add(
        &mut self,
        cell: &Octants,
        loops: &Loops,
        polygon: &mut Polygon,
        vertices: &Vertices,
        walk: Walk<'_>,
    ) {
        let mut inside = 0;
        for (corner, at) in cell.iter().enumerate() {
            inside |= u8::from(walk.sides[*at as usize] == crate::field::INSIDE) << corner;
        }
        let vertex = |edge: Edge| {
            let [low, high] = [edge.low, edge.high()].map(|c| cell[usize::from(c)] as usize);
            let axis = usize::from(edge.axis);
            if walk.nodes[low].level >= walk.nodes[high].level {
                vertices.slots[low][2 * axis + 1]
            } else {
                vertices.slots[high][2 * axis]
            }
        };
        for edges in loops.of(inside) {
            polygon.set(edges, cell, &vertex);
            self.triangulate(polygon, cell, vertices);
        }
    }

    fn triangulate(&mut self, polygon: &Polygon, cell: &Octants, vertices: &Vertices) {
        let corners = &polygon.vertices;
        let place = |v: u32| vertices.positions[v as usize];
        match corners.len() {
            0..=2 => {}
            3 => self.triangles.push([corners[0], corners[1], corners[2]]),
            count => {
                let length = |a, b| squared(sub(place(a), place(b)));
                if let Some(from) = polygon.fan(cell, &length) {
                    let at = |k: usize| corners[(from + k) % count];
                    let fan = (1..count - 1).map(|k| [at(0), at(k), at(k + 1)]);
                    self.triangles.extend(fan);
                } else {
                    let mut middle = [0.0; 3];
                    let mut size = f32::INFINITY;
                    for v in corners {
                        middle = add(middle, place(*v));
                        size = size.min(vertices.sizes[*v as usize]);
                    }
                    let middle = middle.map(|x| x / count as f64);
                    let number = MIDDLE | self.middles.len() as u32;
                    self.middles.push((middle, size));
                    let fan = (0..count).map(|k| [number, corners[k], corners[(k + 1) % count]]);
                    self.triangles.extend(fan);
                }
            }
        }
    }
}
