//! Voronoi cells, each cut out of a box by the planes halfway to its neighbours (Rycroft, Chaos 19,
//! 041111, 2009). No cell depends on another, so rounding can spoil none but itself.

use crate::tree::{Found, Tree, square};
use puncta_sdk::{Cancelled, Run};
use puncta_shared_vector::{cross, dot};

/// Neighbours asked for at first.
const FIRST: usize = 24;

/// Area (or volume) of a cell, and the places of its neighbours in the tree.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Cell {
    /// nm^2 or nm^3.
    pub size: f64,
    /// Neighbours, rising.
    pub near: Vec<u32>,
}

/// A convex region around the origin.
trait Region<const D: usize>: Sized {
    /// The box between two corners.
    fn between(low: [f64; D], high: [f64; D]) -> Self;
    /// Cuts off what is nearer to `at` than to the origin.
    fn cut(&mut self, at: [f64; D], from: u32);
    /// Square of the distance of the farthest corner.
    fn reach(&self) -> f64;
    /// Size, and what it was cut from.
    fn finish(self) -> Cell;
}

/// The cells of the points of a tree within a box; no two points may coincide.
///
/// # Errors
/// When cancelled.
pub fn plane(
    tree: &Tree<2>,
    low: [f64; 2],
    high: [f64; 2],
    run: &dyn Run,
) -> Result<Vec<Cell>, Cancelled> {
    cells::<2, Polygon>(tree, low, high, run)
}

/// As [`plane`], in space.
///
/// # Errors
/// When cancelled.
pub fn space(
    tree: &Tree<3>,
    low: [f64; 3],
    high: [f64; 3],
    run: &dyn Run,
) -> Result<Vec<Cell>, Cancelled> {
    cells::<3, Solid>(tree, low, high, run)
}

fn cells<const D: usize, R: Region<D>>(
    tree: &Tree<D>,
    low: [f64; D],
    high: [f64; D],
    run: &dyn Run,
) -> Result<Vec<Cell>, Cancelled> {
    run.progress(0.1, "cutting cells")?;
    let mut all = tree.each(run, &|point, found| {
        let at = tree.at[point];
        let from =
            |corner: [f64; D]| -> [f64; D] { std::array::from_fn(|axis| corner[axis] - at[axis]) };
        let mut region = R::between(from(low), from(high));
        cut_by_neighbours(tree, point, &mut region, found, run);
        region.finish()
    })?;
    // Where four points lie on a circle, rounding decides who are neighbours: both or none.
    let mut back = vec![Vec::new(); all.len()];
    for (point, cell) in all.iter().enumerate() {
        for other in &cell.near {
            #[allow(clippy::cast_possible_truncation)]
            back[*other as usize].push(point as u32);
        }
    }
    for (cell, back) in all.iter_mut().zip(back) {
        cell.near.extend(back);
        cell.near.sort_unstable();
        cell.near.dedup();
    }
    Ok(all)
}

fn cut_by_neighbours<const D: usize, R: Region<D>>(
    tree: &Tree<D>,
    point: usize,
    region: &mut R,
    found: &mut Found,
    run: &dyn Run,
) {
    let at = tree.at[point];
    let (mut done, mut k) = (0, FIRST);
    loop {
        tree.nearest(&at, k, found);
        for &(distance, other) in &found[done..] {
            // The plane halfway to a point beyond twice the farthest corner cuts nothing.
            if distance > 4.0 * region.reach() {
                return;
            }
            if other as usize != point {
                let to = tree.at[other as usize];
                region.cut(std::array::from_fn(|axis| to[axis] - at[axis]), other);
            }
        }
        if found.len() < k || run.cancelled() {
            return;
        }
        (done, k) = (found.len(), 2 * k);
    }
}

/// A wall of the box.
const WALL: u32 = u32::MAX;

/// A convex polygon: corners to the left, each with what the edge after it was cut by.
struct Polygon {
    corners: Vec<([f64; 2], u32)>,
    spare: Vec<([f64; 2], u32)>,
}

impl Region<2> for Polygon {
    fn between(low: [f64; 2], high: [f64; 2]) -> Polygon {
        let corners = [low, [high[0], low[1]], high, [low[0], high[1]]];
        Polygon {
            corners: corners.map(|corner| (corner, WALL)).into(),
            spare: Vec::new(),
        }
    }

    fn cut(&mut self, at: [f64; 2], from: u32) {
        let half = 0.5 * square(&at, &[0.0; 2]);
        let beyond = |corner: [f64; 2]| corner[0] * at[0] + corner[1] * at[1] - half;
        if !self.corners.iter().any(|(corner, _)| beyond(*corner) > 0.0) {
            return;
        }
        self.spare.clear();
        let next = self.corners.iter().skip(1).chain(self.corners.first());
        for ((a, edge), (b, _)) in self.corners.iter().zip(next) {
            let (p, q) = (beyond(*a), beyond(*b));
            let meet = || {
                let share = p / (p - q);
                [a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1])]
            };
            match (p > 0.0, q > 0.0) {
                (false, false) => self.spare.push((*a, *edge)),
                (false, true) => {
                    self.spare.push((*a, *edge));
                    self.spare.push((meet(), from));
                }
                (true, false) => self.spare.push((meet(), *edge)),
                (true, true) => {}
            }
        }
        std::mem::swap(&mut self.corners, &mut self.spare);
    }

    fn reach(&self) -> f64 {
        let squares = self
            .corners
            .iter()
            .map(|(corner, _)| square(corner, &[0.0; 2]));
        squares.fold(0.0, f64::max)
    }

    fn finish(self) -> Cell {
        let ring: Vec<[f64; 2]> = self.corners.iter().map(|(corner, _)| *corner).collect();
        Cell {
            size: crate::plane::area(&ring).max(0.0),
            near: self
                .corners
                .iter()
                .map(|corner| corner.1)
                .filter(|n| *n != WALL)
                .collect(),
        }
    }
}

/// A face of a solid: what it was cut by, its distance from the origin, its normal, its corners in
/// order.
struct Face {
    from: u32,
    distance: f64,
    normal: [f64; 3],
    corners: Vec<[f64; 3]>,
}

/// A convex solid.
struct Solid {
    faces: Vec<Face>,
}

impl Region<3> for Solid {
    fn between(low: [f64; 3], high: [f64; 3]) -> Solid {
        let mut faces = Vec::with_capacity(24);
        for axis in 0..3 {
            for (side, end) in [(-1.0, low), (1.0, high)] {
                let mut normal = [0.0; 3];
                normal[axis] = side;
                let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
                let corner = |a: [f64; 3], b: [f64; 3]| {
                    let mut corner = [0.0; 3];
                    (corner[axis], corner[u], corner[v]) = (end[axis], a[u], b[v]);
                    corner
                };
                let corners = vec![
                    corner(low, low),
                    corner(high, low),
                    corner(high, high),
                    corner(low, high),
                ];
                faces.push(Face {
                    from: WALL,
                    distance: side * end[axis],
                    normal,
                    corners,
                });
            }
        }
        Solid { faces }
    }

    fn cut(&mut self, at: [f64; 3], from: u32) {
        let length = dot(at, at).sqrt();
        let normal = at.map(|value| value / length);
        let distance = 0.5 * length;
        let beyond = |corner: &[f64; 3]| dot(*corner, normal) - distance;
        let cuts = |face: &Face| face.corners.iter().any(|corner| beyond(corner) > 0.0);
        if !self.faces.iter().any(cuts) {
            return;
        }
        let mut rim = Vec::new();
        for face in &mut self.faces {
            if cuts(face) {
                face.corners = clip(&face.corners, &beyond, &mut rim);
            }
        }
        self.faces.retain(|face| face.corners.len() > 2);
        if let Some(corners) = around(rim, normal) {
            self.faces.push(Face {
                from,
                distance,
                normal,
                corners,
            });
        }
    }

    fn reach(&self) -> f64 {
        let corners = self.faces.iter().flat_map(|face| &face.corners);
        corners
            .map(|corner| dot(*corner, *corner))
            .fold(0.0, f64::max)
    }

    fn finish(self) -> Cell {
        let area = |face: &Face| {
            let first = face.corners[0];
            let from = |corner: [f64; 3]| [0, 1, 2].map(|axis| corner[axis] - first[axis]);
            let pairs = face.corners.windows(2);
            let twice: f64 = pairs
                .map(|p| dot(cross(from(p[0]), from(p[1])), face.normal))
                .sum();
            0.5 * twice.abs()
        };
        Cell {
            size: self
                .faces
                .iter()
                .map(|face| area(face) * face.distance / 3.0)
                .sum(),
            near: self
                .faces
                .iter()
                .map(|face| face.from)
                .filter(|from| *from != WALL)
                .collect(),
        }
    }
}

/// The part of a polygon that is not beyond a plane; adds the corners on the plane to `rim`.
fn clip(
    corners: &[[f64; 3]],
    beyond: &dyn Fn(&[f64; 3]) -> f64,
    rim: &mut Vec<[f64; 3]>,
) -> Vec<[f64; 3]> {
    let mut kept = Vec::with_capacity(corners.len() + 1);
    let next = corners.iter().skip(1).chain(corners.first());
    for (a, b) in corners.iter().zip(next) {
        let (p, q) = (beyond(a), beyond(b));
        if p <= 0.0 {
            kept.push(*a);
        }
        if (p > 0.0) != (q > 0.0) {
            let share = p / (p - q);
            let meet = [0, 1, 2].map(|axis| a[axis] + share * (b[axis] - a[axis]));
            kept.push(meet);
            rim.push(meet);
        }
    }
    kept
}

/// Corners of a convex face in order around its middle; none if there are fewer than three.
fn around(rim: Vec<[f64; 3]>, normal: [f64; 3]) -> Option<Vec<[f64; 3]>> {
    if rim.len() < 3 {
        return None;
    }
    let count = rim.len() as f64;
    let middle = [0, 1, 2].map(|axis| rim.iter().map(|corner| corner[axis]).sum::<f64>() / count);
    let thin = (0..3)
        .min_by(|a, b| normal[*a].abs().total_cmp(&normal[*b].abs()))
        .unwrap_or(0);
    let mut axis = [0.0; 3];
    axis[thin] = 1.0;
    let u = cross(normal, axis);
    let v = cross(normal, u);
    let angle = |corner: &[f64; 3]| {
        let from = [0, 1, 2].map(|axis| corner[axis] - middle[axis]);
        dot(from, v).atan2(dot(from, u))
    };
    let mut keyed: Vec<(f64, [f64; 3])> = rim.into_iter().map(|c| (angle(&c), c)).collect();
    keyed.sort_by(|a, b| a.0.total_cmp(&b.0));
    // Each corner comes from both faces that meet there; doubles do no harm.
    Some(keyed.into_iter().map(|pair| pair.1).collect())
}

#[cfg(test)]
mod tests;
