//! Signed distance from a closed mesh.

use crate::Mesh;
use crate::bvh::{Bvh, Nearest};
use crate::mesh::NONE;
use crate::nearest::Feature;
use crate::vector::{Point, add, angle, area_vector, dot, scale, sub, unit};
use puncta_sdk::run::{Run, map};
use puncta_sdk::{Cancelled, Failure};

/// Distances from a mesh, negative inside where it is closed. The side is that of the
/// angle-weighted pseudonormal of the face, edge or corner that is nearest (Baerentzen and Aanaes,
/// IEEE TVCG 11, 2005), which is exact for closed, oriented meshes that do not cut themselves.
#[derive(Clone, Debug)]
pub struct Distance {
    bvh: Bvh,
    mesh: Mesh,
    corner_normals: Vec<Point>,
    closed: bool,
}

impl Distance {
    /// Prepares distances from a mesh.
    ///
    /// # Errors
    /// When cancelled.
    pub fn new(mesh: &Mesh, run: &dyn Run) -> Result<Distance, Failure> {
        let mut mesh = mesh.clone();
        mesh.compact();
        let bvh = Bvh::new(mesh.positions(), mesh.stored_triangles(), run)?;
        let corner_normals = crate::blocks::by_item(run, mesh.positions().len(), |v| {
            corner_normal(&mesh, v as u32)
        })?;
        let closed = !mesh.is_empty() && mesh.twin.iter().all(|twin| *twin != NONE);
        Ok(Distance {
            bvh,
            mesh,
            corner_normals,
            closed,
        })
    }

    /// Whether the mesh is closed, so that there is an inside.
    #[must_use]
    pub fn is_closed(&self) -> bool {
        self.closed
    }

    /// The boxes; triangles are numbered as in the compacted mesh.
    #[must_use]
    pub fn bvh(&self) -> &Bvh {
        &self.bvh
    }

    /// Distance from `p` to the mesh, without sign. NaN if there is no triangle, or `p` is no
    /// finite place.
    #[must_use]
    pub fn unsigned(&self, p: Point) -> f64 {
        let nearest = self.bvh.nearest(p);
        nearest.map_or(f64::NAN, |nearest| nearest.squared.sqrt())
    }

    /// Distance from `p`, negative where `p` lies behind the triangles. NaN as for
    /// [`Distance::unsigned`].
    #[must_use]
    pub fn signed(&self, p: Point) -> f64 {
        self.bvh
            .nearest(p)
            .map_or(f64::NAN, |nearest| self.sign(p, &nearest))
    }

    fn sign(&self, p: Point, nearest: &Nearest) -> f64 {
        let distance = nearest.squared.sqrt();
        if dot(sub(p, nearest.place), self.pseudonormal(nearest)) < 0.0 {
            -distance
        } else {
            distance
        }
    }

    /// The pseudonormal at a nearest place; its length means nothing.
    #[must_use]
    pub fn pseudonormal(&self, nearest: &Nearest) -> Point {
        let triangle = nearest.triangle;
        let face = |triangle: u32| {
            let corners = self.mesh.corners(triangle);
            corners.map_or([0.0; 3], |corners| unit(area_vector(corners)))
        };
        match nearest.feature {
            Feature::Face => face(triangle),
            Feature::Edge(side) => {
                let twin = self.mesh.twin(3 * triangle + u32::from(side));
                let other = if twin == NONE {
                    [0.0; 3]
                } else {
                    face(twin / 3)
                };
                add(face(triangle), other)
            }
            Feature::Corner(corner) => {
                let vertex = self.mesh.from(3 * triangle + u32::from(corner));
                let normal = self.corner_normals.get(vertex as usize);
                normal.copied().unwrap_or_default()
            }
        }
    }

    /// Distances of many points, with sign or without, in parallel.
    ///
    /// # Errors
    /// When cancelled.
    pub fn all(
        &self,
        points: [&[f64]; 3],
        signed: bool,
        run: &dyn Run,
    ) -> Result<Vec<f64>, Cancelled> {
        let count = points.iter().map(|axis| axis.len()).min().unwrap_or(0);
        let order = coherent(points, count, run)?;
        let blocks = map(run, count.div_ceil(BLOCK), &|block| {
            let places = &order[block * BLOCK..count.min((block + 1) * BLOCK)];
            (!run.cancelled()).then(|| self.block(points, places, signed))
        });
        let mut distances = vec![f64::NAN; count];
        for (places, block) in order.chunks(BLOCK).zip(blocks) {
            let block = block.ok_or(Cancelled)?;
            for (&place, distance) in places.iter().zip(block) {
                distances[place as usize] = distance;
            }
        }
        if run.cancelled() {
            return Err(Cancelled);
        }
        Ok(distances)
    }

    /// Distances of points that follow one another in space: how far the next can be from the mesh
    /// is known from the one before it.
    fn block(&self, points: [&[f64]; 3], places: &[u32], signed: bool) -> Vec<f64> {
        let mut last = u32::MAX;
        let distance = |&place: &u32| {
            let p = points.map(|axis| axis[place as usize]);
            let Some(nearest) = self.bvh.nearest_by(p, &mut last) else {
                return f64::NAN;
            };
            if signed {
                self.sign(p, &nearest)
            } else {
                nearest.squared.sqrt()
            }
        };
        places.iter().map(distance).collect()
    }
}

/// Points of a block.
const BLOCK: usize = 2048;

/// The points in the order of a space-filling (Morton) curve.
fn coherent(points: [&[f64]; 3], count: usize, run: &dyn Run) -> Result<Vec<u32>, Cancelled> {
    let mut low = [f64::INFINITY; 3];
    let mut high = [f64::NEG_INFINITY; 3];
    for axis in 0..3 {
        for &x in points[axis].iter().filter(|x| x.is_finite()) {
            low[axis] = low[axis].min(x);
            high[axis] = high[axis].max(x);
        }
    }
    let extent = (0..3)
        .map(|axis| high[axis] - low[axis])
        .fold(0.0, f64::max);
    let scale = if extent > 0.0 { 1023.0 / extent } else { 0.0 };
    let keys = crate::blocks::by_item(run, count, |i| {
        let cell = |axis: usize| spread(((points[axis][i] - low[axis]) * scale) as u32 & 1023);
        u64::from(cell(0) | cell(1) << 1 | cell(2) << 2) << 32 | i as u64
    })?;
    Ok(sorted(keys))
}

/// Puts two zero bits after each of ten.
fn spread(mut x: u32) -> u32 {
    x = (x | x << 16) & 0x0300_00ff;
    x = (x | x << 8) & 0x0300_f00f;
    x = (x | x << 4) & 0x030c_30c3;
    (x | x << 2) & 0x0924_9249
}

/// Lower halves of the keys, ordered by the upper halves: three passes of ten bits.
fn sorted(mut keys: Vec<u64>) -> Vec<u32> {
    let mut other = vec![0; keys.len()];
    for pass in 0..3 {
        let digit = |key: u64| (key >> (32 + 10 * pass)) as usize & 1023;
        let mut places = [0_usize; 1024];
        keys.iter().for_each(|key| places[digit(*key)] += 1);
        let mut sum = 0;
        for place in &mut places {
            sum += std::mem::replace(place, sum);
        }
        for &key in &keys {
            let place = &mut places[digit(key)];
            other[*place] = key;
            *place += 1;
        }
        std::mem::swap(&mut keys, &mut other);
    }
    keys.iter().map(|key| *key as u32).collect()
}

/// Sum of the normals of the triangles of a vertex, each times its angle there.
fn corner_normal(mesh: &Mesh, vertex: u32) -> Point {
    let centre = mesh.position(vertex);
    let mut total = [0.0; 3];
    for h in mesh.outgoing(vertex) {
        let ahead = sub(mesh.position(mesh.to(h)), centre);
        let back = sub(mesh.position(mesh.from(crate::prev(h))), centre);
        let normal = unit(crate::vector::cross(ahead, back));
        total = add(total, scale(normal, angle(ahead, back)));
    }
    total
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::nearest::on_triangle;
    use crate::shapes;
    use crate::vector::squared;
    use puncta_sdk::run::Serial;
    use puncta_testkit::{Stopped, Threads};
    use rand_chacha::ChaCha8Rng;
    use rand_chacha::rand_core::{Rng, SeedableRng};

    fn random_points(count: usize, half: f64) -> [Vec<f64>; 3] {
        let mut random = ChaCha8Rng::seed_from_u64(3);
        let mut one = || (f64::from(random.next_u32()) / f64::from(u32::MAX) * 2.0 - 1.0) * half;
        let mut axis = || (0..count).map(|_| one()).collect();
        [axis(), axis(), axis()]
    }

    fn mesh(shape: shapes::Shape) -> Mesh {
        Mesh::new(shape.0, &shape.1).unwrap()
    }

    #[test]
    fn distances_equal_those_of_all_triangles() {
        for shape in [
            shapes::torus(10.0, 4.0, 61, 23),
            shapes::cube(12.0, 9),
            shapes::grid(9, 5, 2.0),
        ] {
            let (positions, triangles) = shape.clone();
            let mesh = mesh(shape);
            let distance = Distance::new(&mesh, &Serial).unwrap();
            let points = random_points(3000, 20.0);
            let points = points.each_ref().map(Vec::as_slice);
            let found = distance.all(points, false, &Serial).unwrap();
            for (i, found) in found.iter().enumerate() {
                let p = points.map(|axis| axis[i]);
                let squares = triangles.iter().map(|t| {
                    let corners = t.map(|v| positions[v as usize]);
                    squared(sub(p, on_triangle(p, corners).0))
                });
                let best = squares.fold(f64::INFINITY, f64::min);
                assert_eq!(found.to_bits(), best.sqrt().to_bits(), "point {i}");
            }
        }
    }

    #[test]
    fn the_sign_is_that_of_the_side() {
        let cube = Distance::new(&mesh(shapes::cube(10.0, 1)), &Serial).unwrap();
        assert!(cube.is_closed());
        let points = random_points(20_000, 9.0);
        let points = points.each_ref().map(Vec::as_slice);
        let found = cube.all(points, true, &Serial).unwrap();
        for (i, found) in found.iter().enumerate() {
            let q = points.map(|axis| axis[i].abs() - 5.0);
            let outside = q.map(|x| x.max(0.0));
            let inside = q.iter().copied().fold(f64::NEG_INFINITY, f64::max).min(0.0);
            let truth = crate::vector::norm(outside) + inside;
            assert!((found - truth).abs() < 1e-12, "{found} {truth}");
        }
        let torus = Distance::new(&mesh(shapes::torus(10.0, 4.0, 400, 160)), &Serial).unwrap();
        for (p, truth) in [
            ([10.0, 0.0, 0.0], -4.0),
            ([0.0; 3], 6.0),
            ([0.0, 0.0, 9.0], 181f64.sqrt() - 4.0),
        ] {
            assert!((torus.signed(p) - truth).abs() < 0.01, "{p:?}");
        }
    }

    #[test]
    fn odd_points_and_meshes() {
        let sheet = Distance::new(&mesh(shapes::grid(2, 2, 1.0)), &Serial).unwrap();
        assert!(!sheet.is_closed());
        assert_eq!(sheet.signed([1.0, 1.0, 20.0]), 20.0);
        assert_eq!(sheet.signed([1.0, 1.0, -20.0]), -20.0);
        assert!(sheet.signed([f64::NAN, 0.0, 0.0]).is_nan());
        let none = Distance::new(&Mesh::default(), &Serial).unwrap();
        assert!(none.unsigned([0.0; 3]).is_nan() && !none.is_closed());
        let axis = [0.0, f64::INFINITY, 3.0];
        let found = sheet.all([&axis, &axis, &axis], true, &Serial).unwrap();
        assert!(found[1].is_nan() && found[0] == 0.0);
    }

    #[test]
    fn threads_change_no_bit_and_cancel_is_heard() {
        let mesh = mesh(shapes::sphere(8.0, 5));
        let points = random_points(30_000, 10.0);
        let points = points.each_ref().map(Vec::as_slice);
        let bits = |run: &dyn Run| {
            let all = Distance::new(&mesh, run)
                .unwrap()
                .all(points, true, run)
                .unwrap();
            all.iter().map(|x| x.to_bits()).collect::<Vec<_>>()
        };
        assert_eq!(bits(&Serial), bits(&Threads(3)));
        assert!(Distance::new(&mesh, &Stopped).is_err());
    }
}
