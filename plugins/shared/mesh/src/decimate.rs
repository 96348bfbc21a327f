//! Decimation by quadric errors.

use crate::mesh::{Mesh, NONE, next, prev};
use crate::vector::{Point, area_vector, cross, dot, middle, norm, scale, squared, sub, unit};
use puncta_sdk::{Cancelled, Run};
use std::cmp::{Ordering, Reverse};
use std::collections::BinaryHeap;

/// Sum of squared distances to planes: p^T A p - 2 b p + c.
#[derive(Clone, Copy, Debug, Default)]
struct Quadric {
    a: [f64; 6],
    b: Point,
    c: f64,
}

impl Quadric {
    /// The plane through `at` with the unit normal `n`, times `weight`.
    fn plane(n: Point, at: Point, weight: f64) -> Quadric {
        let d = dot(n, at);
        let a = [
            n[0] * n[0],
            n[0] * n[1],
            n[0] * n[2],
            n[1] * n[1],
            n[1] * n[2],
            n[2] * n[2],
        ];
        Quadric {
            a: a.map(|x| x * weight),
            b: scale(n, d * weight),
            c: d * d * weight,
        }
    }

    fn add(&mut self, other: &Quadric) {
        self.a.iter_mut().zip(other.a).for_each(|(a, b)| *a += b);
        self.b.iter_mut().zip(other.b).for_each(|(a, b)| *a += b);
        self.c += other.c;
    }

    fn at(&self, p: Point) -> f64 {
        dot(p, self.times(p)) - 2.0 * dot(self.b, p) + self.c
    }

    fn times(&self, [x, y, z]: Point) -> Point {
        let [xx, xy, xz, yy, yz, zz] = self.a;
        [
            xx * x + xy * y + xz * z,
            xy * x + yy * y + yz * z,
            xz * x + yz * y + zz * z,
        ]
    }

    /// The place of least error, if one stands out.
    fn least(&self) -> Option<Point> {
        let [xx, xy, xz, yy, yz, zz] = self.a;
        let rows = [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]];
        let across = cross(rows[1], rows[2]);
        let determinant = dot(rows[0], across);
        let size = xx + yy + zz;
        if !(determinant > 1e-6 * size * size * size) {
            return None;
        }
        // By Cramer's rule; the matrix is symmetric, so that its rows are its columns.
        let b = self.b;
        let place = [
            dot(b, across),
            dot(rows[0], cross(b, rows[2])),
            dot(rows[0], cross(rows[1], b)),
        ];
        Some(place.map(|x| x / determinant))
    }
}

/// A collapse that may be made: the edge with the least error first, then by number.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Candidate {
    error: f64,
    h: u32,
    place: Point,
    stamp: u32,
}

impl Eq for Candidate {}
impl PartialOrd for Candidate {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}
impl Ord for Candidate {
    fn cmp(&self, other: &Self) -> Ordering {
        let error = self.error.total_cmp(&other.error);
        error
            .then(self.h.cmp(&other.h))
            .then(self.stamp.cmp(&other.stamp))
    }
}

/// Collapses edges, that with the least quadric error first (Garland and Heckbert, SIGGRAPH 1997),
/// until at most `triangles` are left or the error of the next would exceed `most` nm (root of the
/// mean squared distance to the planes that it replaces). The topology and the boundary stay, so
/// that fewer may be impossible. Gives the mesh without dead parts.
///
/// # Errors
/// When cancelled.
pub fn decimate(
    mesh: &mut Mesh,
    triangles: usize,
    most: f64,
    run: &dyn Run,
) -> Result<(), Cancelled> {
    mesh.compact();
    let start = mesh.triangle_count();
    let mut work = Work::new(mesh);
    let mut heap = BinaryHeap::with_capacity(start * 2);
    let edges: Vec<u32> = work.mesh.edges().collect();
    for h in edges {
        heap.extend(work.candidate(h).map(Reverse));
    }
    let mut steps = 0_usize;
    while work.mesh.triangle_count() > triangles {
        let Some(Reverse(best)) = heap.pop() else {
            break;
        };
        if best.error > most * most {
            break;
        }
        steps += 1;
        if steps.is_multiple_of(4096) {
            let left = work.mesh.triangle_count().saturating_sub(triangles) as f64;
            let all = start.saturating_sub(triangles).max(1) as f64;
            run.progress(1.0 - left / all, "collapsing edges")?;
        }
        if let Some(vertex) = work.collapse(&best) {
            let around: Vec<u32> = work.mesh.outgoing(vertex).collect();
            for h in around {
                heap.extend(work.candidate(h).map(Reverse));
                let inward = prev(h);
                if work.mesh.twin(inward) == NONE {
                    heap.extend(work.candidate(inward).map(Reverse));
                }
            }
        }
    }
    mesh.compact();
    Ok(())
}

struct Work<'a> {
    mesh: &'a mut Mesh,
    quadrics: Vec<Quadric>,
    /// Area that each vertex stands for, to make the error a mean.
    weights: Vec<f64>,
    /// Counts the changes of each vertex: a candidate with older ones is out of date.
    stamps: Vec<u32>,
    /// A vertex in the middle, from which the quadrics are taken so that few digits are lost.
    origin: Point,
}

impl Work<'_> {
    fn new(mesh: &mut Mesh) -> Work<'_> {
        let origin = mesh.positions().first().copied().unwrap_or_default();
        let mut quadrics = vec![Quadric::default(); mesh.positions().len()];
        let mut weights = vec![0.0; mesh.positions().len()];
        for (i, corners) in mesh.triangles() {
            let places = corners.map(|v| sub(mesh.position(v), origin));
            let normal = area_vector(places);
            let area = 0.5 * norm(normal);
            let plane = Quadric::plane(unit(normal), places[0], area);
            for v in corners {
                quadrics[v as usize].add(&plane);
                weights[v as usize] += area;
            }
            // Planes upright on the rim hold it in place.
            for h in 3 * i..3 * i + 3 {
                if mesh.twin(h) != NONE {
                    continue;
                }
                let [a, b] = [h, next(h)].map(|h| mesh.from(h));
                let [pa, pb] = [a, b].map(|v| sub(mesh.position(v), origin));
                let side = unit(cross(sub(pb, pa), normal));
                let rim = Quadric::plane(side, pa, 10.0 * squared(sub(pb, pa)));
                quadrics[a as usize].add(&rim);
                quadrics[b as usize].add(&rim);
            }
        }
        Work {
            stamps: vec![0; mesh.positions().len()],
            mesh,
            quadrics,
            weights,
            origin,
        }
    }

    fn candidate(&self, h: u32) -> Option<Candidate> {
        let (a, b) = (self.mesh.from(h), self.mesh.to(h));
        let mut sum = self.quadrics[a as usize];
        sum.add(&self.quadrics[b as usize]);
        let weight = self.weights[a as usize] + self.weights[b as usize];
        let ends = [a, b].map(|v| sub(self.mesh.position(v), self.origin));
        let reach = squared(sub(ends[1], ends[0]));
        let near = |p: &Point| squared(sub(*p, middle(ends[0], ends[1]))) <= 4.0 * reach;
        let mut places = vec![middle(ends[0], ends[1]), ends[0], ends[1]];
        places.extend(sum.least().filter(near));
        let error = |p: &Point| sum.at(*p).max(0.0);
        let place = places
            .into_iter()
            .min_by(|a, b| error(a).total_cmp(&error(b)))?;
        let error = error(&place) / weight.max(f64::MIN_POSITIVE);
        Some(Candidate {
            error,
            h,
            place: crate::vector::add(place, self.origin),
            stamp: self.stamps[a as usize].wrapping_add(self.stamps[b as usize]),
        })
    }

    fn collapse(&mut self, best: &Candidate) -> Option<u32> {
        let (h, place) = (best.h, best.place);
        if !self.mesh.is_live(h) {
            return None;
        }
        let (a, b) = (self.mesh.from(h), self.mesh.to(h));
        let stamp = self.stamps[a as usize].wrapping_add(self.stamps[b as usize]);
        let bad = |v: u32, w: u32| crate::remesh::folds(self.mesh, v, w, place);
        if stamp != best.stamp || !self.mesh.can_collapse(h) || bad(a, b) || bad(b, a) {
            return None;
        }
        let merged = self.mesh.collapse(h, place)?;
        let quadric = self.quadrics[a as usize];
        self.quadrics[b as usize].add(&quadric);
        self.weights[b as usize] += self.weights[a as usize];
        self.stamps[b as usize] = stamp.wrapping_add(1);
        Some(merged)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Distance;
    use crate::measure::{area, volume};
    use crate::shapes;
    use crate::topology::{describe, euler};
    use puncta_sdk::run::Serial;

    #[test]
    fn a_cube_needs_twelve_triangles() {
        let (positions, triangles) = shapes::cube(10.0, 12);
        let mut mesh = Mesh::new(positions, &triangles).unwrap();
        decimate(&mut mesh, 12, 1e-6, &Serial).unwrap();
        mesh.verify().unwrap();
        assert_eq!((mesh.triangle_count(), euler(&mesh)), (12, 2));
        assert!((volume(&mesh, &Serial).unwrap() - 1000.0).abs() < 1e-6);
    }

    #[test]
    fn a_torus_keeps_its_shape_and_hole() {
        let (positions, triangles) = shapes::torus(100.0, 30.0, 120, 60);
        let mut mesh = Mesh::new(positions.clone(), &triangles).unwrap();
        decimate(&mut mesh, 2000, f64::INFINITY, &Serial).unwrap();
        mesh.verify().unwrap();
        assert_eq!((mesh.triangle_count(), euler(&mesh)), (2000, 0));
        let distance = Distance::new(&mesh, &Serial).unwrap();
        let worst = positions.iter().map(|p| distance.unsigned(*p));
        assert!(worst.fold(0.0, f64::max) < 1.0);
    }

    #[test]
    fn sheets_keep_their_rim_and_few_triangles_are_the_end() {
        let (positions, triangles) = shapes::grid(10, 6, 1.0);
        let mut mesh = Mesh::new(positions, &triangles).unwrap();
        decimate(&mut mesh, 0, 1e-9, &Serial).unwrap();
        mesh.verify().unwrap();
        assert!((area(&mesh, &Serial).unwrap() - 60.0).abs() < 1e-9);
        assert!(mesh.triangle_count() <= 4 && describe(&mesh).0[0].loops == 1);
        let (positions, triangles) = shapes::sphere(1.0, 2);
        let mut ball = Mesh::new(positions, &triangles).unwrap();
        decimate(&mut ball, 0, f64::INFINITY, &Serial).unwrap();
        ball.verify().unwrap();
        assert_eq!(euler(&ball), 2);
    }
}
