//! Remeshing to edges of one length.

use crate::blocks::by_item;
use crate::curved::{Curved, edge_middle};
use crate::measure::{area, length, normal, vertex_normals};
use crate::mesh::{Mesh, NONE, next, prev};
use crate::vector::{Point, add, along, area_vector, dot, norm, scale, squared, sub, unit};
use puncta_sdk::{Cancelled, Failure, Run};

/// How a mesh is remeshed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Remeshing {
    /// Length that edges shall have, nm.
    pub edge: f64,
    /// Rounds of splitting, collapsing, flipping and relaxing.
    pub rounds: u32,
    /// Relaxation steps in a round.
    pub relaxations: u32,
    /// Whether vertices stay on the smooth surface through the vertices of the input. Otherwise
    /// they move along the mesh as it is, which also lets noise go slowly.
    pub project: bool,
}

impl Remeshing {
    /// Five rounds on the surface of the input.
    #[must_use]
    pub fn to(edge: f64) -> Remeshing {
        Remeshing {
            edge,
            rounds: 5,
            relaxations: 3,
            project: true,
        }
    }
}

/// Most triangles that remeshing may aim at.
const MOST: f64 = 2e8;

/// Remeshes to edges of about one length (Botsch and Kobbelt, SGP 2004): in each round edges
/// longer than 4/3 of it are split, those shorter than 4/5 collapsed, edges flipped towards six
/// neighbours (four at the boundary), and vertices relaxed along the surface. Split and merged
/// vertices lie on the curved surface (thesis D.1.4), so that neither area nor curvature shrinks.
/// The boundary keeps its shape. Gives the mesh without dead parts.
///
/// # Errors
/// When the edge length is no length or would give too many triangles; or cancelled.
pub fn remesh(mesh: &mut Mesh, how: Remeshing, run: &dyn Run) -> Result<(), Failure> {
    if !(how.edge > 0.0 && how.edge.is_finite()) {
        return Err(Failure::bad_input("the edge length must be above 0"));
    }
    let area = area(mesh, run)?;
    let triangles = area / (0.433 * how.edge * how.edge);
    if !(triangles < MOST) {
        let least = (area / (0.433 * MOST)).sqrt();
        let message = format!(
            "edges of {} nm would give {triangles:.3e} triangles",
            how.edge
        );
        return Err(Failure::bad_input(message).remedy(format!("choose at least {least:.3} nm")));
    }
    mesh.compact();
    let surface = if how.project {
        Some(Curved::new(mesh, run)?)
    } else {
        None
    };
    let normals = vertex_normals(mesh, run)?;
    let mut work = Work {
        hints: vec![NONE; normals.len()],
        normals,
        mesh,
        long: how.edge * 4.0 / 3.0,
        short: how.edge * 4.0 / 5.0,
        run,
    };
    for round in 0..how.rounds {
        let step = |part: f64| (f64::from(round) + part) / f64::from(how.rounds);
        run.progress(step(0.0), "splitting long edges")?;
        work.split()?;
        run.progress(step(0.3), "collapsing short edges")?;
        work.collapse()?;
        run.progress(step(0.5), "flipping edges")?;
        work.flip()?;
        run.progress(step(0.7), "relaxing")?;
        for _ in 0..how.relaxations {
            work.relax(surface.as_ref())?;
        }
    }
    Ok(())
}

struct Work<'a> {
    mesh: &'a mut Mesh,
    normals: Vec<Point>,
    /// Where on the surface each vertex was found last.
    hints: Vec<u32>,
    long: f64,
    short: f64,
    run: &'a dyn Run,
}

/// Steps of a serial pass between two polls of cancel.
const POLL: usize = 4096;

impl Work<'_> {
    fn poll(&self, i: usize) -> Result<(), Cancelled> {
        if i.is_multiple_of(POLL) && self.run.cancelled() {
            return Err(Cancelled);
        }
        Ok(())
    }

    /// Edges whose length passes a test, with their length squared.
    fn measured(&self, keep: impl Fn(f64) -> bool) -> Vec<(f64, u32)> {
        let mesh = &self.mesh;
        let measured = mesh.edges().map(|h| {
            let edge = sub(mesh.position(mesh.to(h)), mesh.position(mesh.from(h)));
            (squared(edge), h)
        });
        measured.filter(|(length, _)| keep(*length)).collect()
    }

    /// Splits edges, the longest first, until all are short enough.
    fn split(&mut self) -> Result<(), Cancelled> {
        let limit = self.long * self.long;
        // Each pass halves the longest edge: 64 passes are enough for any lengths of doubles.
        for _ in 0..64 {
            let mut edges = self.measured(|length| length > limit);
            if edges.is_empty() {
                break;
            }
            edges.sort_unstable_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
            for (i, (_, h)) in edges.into_iter().enumerate() {
                self.poll(i)?;
                let (a, b) = (self.mesh.from(h), self.mesh.to(h));
                let ends = [self.mesh.position(a), self.mesh.position(b)];
                let normals = [self.normals[a as usize], self.normals[b as usize]];
                let place = if self.mesh.twin(h) == NONE {
                    crate::vector::middle(ends[0], ends[1])
                } else {
                    edge_middle(ends, normals)
                };
                if self.mesh.split(h, place).is_some() {
                    self.normals.push(unit(add(normals[0], normals[1])));
                    self.hints.push(self.hints[a as usize]);
                }
            }
        }
        Ok(())
    }

    /// Collapses edges, the shortest first, unless that makes a long one or folds the surface.
    fn collapse(&mut self) -> Result<(), Cancelled> {
        let limit = self.short * self.short;
        let mut edges = self.measured(|length| length < limit);
        edges.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        for (i, (_, h)) in edges.into_iter().enumerate() {
            self.poll(i)?;
            // Earlier collapses move ends and remove edges.
            if self.mesh.is_live(h) && length(self.mesh, h) < self.short {
                self.collapse_one(h);
            }
        }
        let kept = self.mesh.compact();
        self.normals = kept.iter().map(|&v| self.normals[v as usize]).collect();
        self.hints = kept.iter().map(|&v| self.hints[v as usize]).collect();
        Ok(())
    }

    fn collapse_one(&mut self, h: u32) {
        let mesh = &*self.mesh;
        let (a, b) = (mesh.from(h), mesh.to(h));
        let ends = [mesh.position(a), mesh.position(b)];
        let normals = [self.normals[a as usize], self.normals[b as usize]];
        // The rim keeps its corners: an end at the boundary stays where it is.
        let place = match (mesh.at_boundary(a), mesh.at_boundary(b)) {
            (false, false) => edge_middle(ends, normals),
            (true, false) => ends[0],
            (false, true) => ends[1],
            (true, true) if is_straight(mesh, a) => ends[1],
            (true, true) if is_straight(mesh, b) => ends[0],
            (true, true) => return,
        };
        let limit = self.long * self.long;
        let far = |v: u32| squared(sub(mesh.position(v), place)) > limit;
        if mesh.ring(a).any(far) || mesh.ring(b).any(far) || !mesh.can_collapse(h) {
            return;
        }
        if folds(mesh, a, b, place) || folds(mesh, b, a, place) {
            return;
        }
        let normal = unit(add(normals[0], normals[1]));
        if self.mesh.collapse(h, place).is_some() {
            self.normals[b as usize] = normal;
        }
    }

    /// Flips edges towards six neighbours a vertex, four at the boundary.
    fn flip(&mut self) -> Result<(), Cancelled> {
        let mesh = &*self.mesh;
        // Neighbours of each vertex beyond the ideal.
        let mut excess = by_item(self.run, mesh.positions().len(), |v| {
            let ideal = if mesh.at_boundary(v as u32) { 4 } else { 6 };
            mesh.valence(v as u32) as i64 - ideal
        })?;
        for _ in 0..5 {
            let mut flips = 0;
            for h in 0..self.mesh.half_edges() {
                self.poll(h as usize)?;
                if h < self.mesh.twin(h) && self.mesh.is_live(h) && self.flip_one(h, &mut excess) {
                    flips += 1;
                }
            }
            if flips == 0 {
                break;
            }
        }
        Ok(())
    }

    fn flip_one(&mut self, h: u32, excess: &mut [i64]) -> bool {
        let mesh = &*self.mesh;
        let twin = mesh.twin(h);
        if twin == NONE {
            return false;
        }
        let corners = [h, twin, prev(h), prev(twin)].map(|h| mesh.from(h));
        let now = corners.map(|v| excess[v as usize]);
        let then = [now[0] - 1, now[1] - 1, now[2] + 1, now[3] + 1];
        let cost = |excess: [i64; 4]| excess.iter().map(|e| e * e).sum::<i64>();
        if cost(then) >= cost(now) {
            return false;
        }
        let [a, b, c, d] = corners.map(|v| mesh.position(v));
        let up = add(unit(area_vector([a, b, c])), unit(area_vector([b, a, d])));
        let (one, two) = (area_vector([a, d, c]), area_vector([d, b, c]));
        // Both new triangles face the side of the old ones.
        if dot(unit(one), up) < 1.0 || dot(unit(two), up) < 1.0 {
            return false;
        }
        let flipped = self.mesh.flip(h);
        if flipped {
            for (v, then) in corners.into_iter().zip(then) {
                excess[v as usize] = then;
            }
        }
        flipped
    }

    /// Moves vertices along the surface to the middle of their triangles.
    fn relax(&mut self, surface: Option<&Curved>) -> Result<(), Cancelled> {
        let mesh = &*self.mesh;
        let moved = by_item(self.run, mesh.positions().len(), |v| {
            let (vertex, at) = (v as u32, mesh.positions()[v]);
            let (n, mut hint) = (self.normals[v], self.hints[v]);
            if mesh.at_boundary(vertex) {
                return (at, n, hint);
            }
            let to = sub(middle_of_triangles(mesh, vertex, at), at);
            let place = along(add(at, to), n, -dot(to, n));
            match surface.and_then(|surface| surface.project(place, &mut hint)) {
                Some((place, normal)) if squared(normal) > 0.0 => (place, normal, hint),
                _ => (place, n, hint),
            }
        })?;
        let mut normals = Vec::with_capacity(moved.len());
        for (v, (place, normal, hint)) in moved.into_iter().enumerate() {
            self.mesh.positions[v] = place;
            self.hints[v] = hint;
            normals.push(normal);
        }
        self.normals = match surface {
            Some(_) => normals,
            None => by_item(self.run, self.mesh.positions().len(), |v| {
                normal(self.mesh, v as u32)
            })?,
        };
        Ok(())
    }
}

/// Mean of the middles of the triangles of a vertex, weighted by their areas.
fn middle_of_triangles(mesh: &Mesh, vertex: u32, at: Point) -> Point {
    let (mut total, mut areas) = ([0.0; 3], 0.0);
    for h in mesh.outgoing(vertex) {
        let [b, c] = [next(h), prev(h)].map(|h| mesh.position(mesh.from(h)));
        let area = norm(area_vector([at, b, c]));
        total = along(total, add(add(at, b), c), area / 3.0);
        areas += area;
    }
    if areas > 0.0 {
        scale(total, 1.0 / areas)
    } else {
        at
    }
}

/// Whether the boundary hardly bends at a vertex.
fn is_straight(mesh: &Mesh, vertex: u32) -> bool {
    let Some(last) = mesh.outgoing(vertex).last() else {
        return false;
    };
    let at = mesh.position(vertex);
    let ahead = unit(sub(mesh.position(mesh.to(mesh.out(vertex))), at));
    let back = unit(sub(at, mesh.position(mesh.from(prev(last)))));
    dot(ahead, back) > 0.99
}

/// Whether moving `vertex` to `place` turns a triangle that does not go with `other` by more than
/// about 50 degrees, or leaves it without area.
pub(crate) fn folds(mesh: &Mesh, vertex: u32, other: u32, place: Point) -> bool {
    mesh.outgoing(vertex).any(|h| {
        let (b, c) = (mesh.to(h), mesh.from(prev(h)));
        if b == other || c == other {
            return false;
        }
        let (pb, pc) = (mesh.position(b), mesh.position(c));
        let before = unit(area_vector([mesh.position(vertex), pb, pc]));
        let after = unit(area_vector([place, pb, pc]));
        squared(before) > 0.0 && dot(before, after) < 0.6
    })
}

#[cfg(test)]
mod tests;
