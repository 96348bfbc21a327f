//! Hulls and alpha shapes of points in space. The convex hull is found by quickhull (Barber, Dobkin and Huhdanpaa, ACM TOMS 22, 469,
//! 1996).

use puncta_sdk::{Cancelled, Run};
use puncta_shared_delaunay::tetrahedra;
use puncta_shared_vector::{cross, dot, sub};

/// A triangle of the hull, seen from outside to the left, with the neighbours across its edges.
struct Face {
    corners: [usize; 3],
    near: [usize; 3],
    normal: [f64; 3],
    offset: f64,
    outside: Vec<usize>,
    alive: bool,
}

/// Volume and surface of a solid.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Solid {
    /// Volume, nm^3.
    pub volume: f64,
    /// Surface, nm^2.
    pub surface: f64,
}

/// The convex hull. Zero volume and surface if the points lie in a plane to within rounding.
#[must_use]
pub fn hull(points: &[[f64; 3]]) -> Solid {
    let Some(first) = points.first() else {
        return Solid::default();
    };
    let points: Vec<[f64; 3]> = points.iter().map(|point| sub(*point, *first)).collect();
    let size = points
        .iter()
        .flatten()
        .fold(0.0_f64, |most, value| most.max(value.abs()));
    let Some(start) = tetrahedron(&points, size) else {
        return Solid::default();
    };
    let mut quick = Quick {
        points: &points,
        faces: Vec::new(),
        thin: 1e-12 * size,
    };
    quick.begin(start);
    quick.grow();
    quick.measure()
}

/// The alpha shape: the union of the Delaunay tetrahedra whose circumscribed sphere has at most the
/// radius `alpha` (Edelsbrunner and Muecke, ACM Trans. Graphics 13, 43, 1994). Its surface is that
/// between what is in it and what is not, around holes too.
///
/// # Errors
/// When cancelled.
pub fn alpha_shape(points: &[[f64; 3]], alpha: f64, run: &dyn Run) -> Result<Solid, Cancelled> {
    let first = points.first().copied().unwrap_or_default();
    let points: Vec<[f64; 3]> = points.iter().map(|point| sub(*point, first)).collect();
    let mut solid = Solid::default();
    let mut faces: Vec<[u32; 3]> = Vec::new();
    for cell in tetrahedra(&points, run)? {
        let [a, b, c, d] = cell.map(|corner| points[corner as usize]);
        let (u, v, w) = (sub(b, a), sub(c, a), sub(d, a));
        let (vw, wu, uv) = (cross(v, w), cross(w, u), cross(u, v));
        let six = dot(u, vw);
        // The centre of the sphere, from a corner.
        let [uu, vv, ww] = [dot(u, u), dot(v, v), dot(w, w)];
        let centre: [f64; 3] =
            std::array::from_fn(|k| (uu * vw[k] + vv * wu[k] + ww * uv[k]) / (2.0 * six));
        let square = dot(centre, centre);
        // Flat to within rounding: the centre is no number or far away.
        if square.is_nan() || square > alpha * alpha * (1.0 + 1e-9) {
            continue;
        }
        solid.volume += six.abs() / 6.0;
        for slot in 0..4 {
            let mut face = [0, 1, 2].map(|k| cell[(slot + 1 + k) % 4]);
            face.sort_unstable();
            faces.push(face);
        }
    }
    faces.sort_unstable();
    for same in faces.chunk_by(|a, b| a == b).filter(|same| same.len() == 1) {
        let [a, b, c] = same[0].map(|corner| points[corner as usize]);
        let normal = cross(sub(b, a), sub(c, a));
        solid.surface += 0.5 * dot(normal, normal).sqrt();
    }
    Ok(solid)
}

/// Four points that span a volume.
fn tetrahedron(points: &[[f64; 3]], size: f64) -> Option<[usize; 4]> {
    let farthest = |measure: &dyn Fn([f64; 3]) -> f64| {
        let all = points
            .iter()
            .enumerate()
            .map(|(place, point)| (measure(*point), place));
        all.max_by(|a, b| a.0.total_cmp(&b.0).then(b.1.cmp(&a.1)))
    };
    let (_, a) = farthest(&|p| -p[0])?;
    let from = |p| sub(p, points[a]);
    let (length, b) = farthest(&|p| dot(from(p), from(p)))?;
    let along = from(points[b]);
    let off = |p| cross(from(p), along);
    let (width, c) = farthest(&|p| dot(off(p), off(p)))?;
    let normal = cross(along, from(points[c]));
    let (height, d) = farthest(&|p| dot(from(p), normal).abs())?;
    let flat = width.sqrt() <= 1e-10 * size * length.sqrt()
        || height <= 1e-10 * size * dot(normal, normal).sqrt();
    (length > 0.0 && !flat).then_some([a, b, c, d])
}

struct Quick<'a> {
    points: &'a [[f64; 3]],
    faces: Vec<Face>,
    /// Distance from a face below which a point lies in it.
    thin: f64,
}

impl Quick<'_> {
    fn face(&self, corners: [usize; 3], near: [usize; 3]) -> Face {
        let [a, b, c] = corners.map(|corner| self.points[corner]);
        let normal = cross(sub(b, a), sub(c, a));
        let length = dot(normal, normal).sqrt().max(f64::MIN_POSITIVE);
        let normal = normal.map(|value| value / length);
        Face {
            corners,
            near,
            normal,
            offset: dot(normal, a),
            outside: Vec::new(),
            alive: true,
        }
    }

    fn height(&self, face: &Face, point: usize) -> f64 {
        dot(face.normal, self.points[point]) - face.offset
    }

    fn begin(&mut self, [a, b, c, d]: [usize; 4]) {
        let base = self.face([a, b, c], [0; 3]);
        let [b, c] = if self.height(&base, d) > 0.0 {
            [c, b]
        } else {
            [b, c]
        };
        // Neighbour k of a face lies across the edge from corner k to the next.
        let corners = [[a, b, c], [b, a, d], [c, b, d], [a, c, d]];
        let near = [[1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1]];
        for (corners, near) in corners.into_iter().zip(near) {
            let face = self.face(corners, near);
            self.faces.push(face);
        }
        let all = (0..self.points.len()).collect();
        self.share(all, &[0, 1, 2, 3]);
    }

    /// Gives each point to the first of these faces that it lies outside of.
    fn share(&mut self, points: Vec<usize>, faces: &[usize]) {
        for point in points {
            let outside = faces
                .iter()
                .find(|face| self.height(&self.faces[**face], point) > self.thin);
            if let Some(face) = outside {
                self.faces[*face].outside.push(point);
            }
        }
    }

    fn grow(&mut self) {
        let mut at = 0;
        while at < self.faces.len() {
            if !self.faces[at].alive || self.faces[at].outside.is_empty() {
                at += 1;
                continue;
            }
            let face = &self.faces[at];
            let height = |point: &&usize| self.height(face, **point);
            let top = face
                .outside
                .iter()
                .max_by(|a, b| height(a).total_cmp(&height(b)));
            let Some(&top) = top else { continue };
            self.add(at, top);
        }
    }

    /// Makes `top`, which lies outside of the face `from`, a corner.
    fn add(&mut self, from: usize, top: usize) {
        let mut seen = vec![from];
        self.faces[from].alive = false;
        let mut horizon: Vec<(usize, usize, usize)> = Vec::new();
        let mut place = 0;
        while place < seen.len() {
            let face = seen[place];
            place += 1;
            for side in 0..3 {
                let other = self.faces[face].near[side];
                if !self.faces[other].alive {
                    continue;
                }
                if self.height(&self.faces[other], top) > self.thin {
                    self.faces[other].alive = false;
                    seen.push(other);
                }
            }
        }
        for &face in &seen {
            for side in 0..3 {
                let other = self.faces[face].near[side];
                if self.faces[other].alive {
                    let corners = self.faces[face].corners;
                    horizon.push((corners[side], corners[(side + 1) % 3], other));
                }
            }
        }
        // The edges of the horizon, one after another.
        let mut starts = std::collections::BTreeMap::new();
        let first = self.faces.len();
        for (place, (start, _, _)) in horizon.iter().enumerate() {
            starts.insert(*start, first + place);
        }
        let mut ends = std::collections::BTreeMap::new();
        for (place, (_, end, _)) in horizon.iter().enumerate() {
            ends.insert(*end, first + place);
        }
        for (place, &(start, end, other)) in horizon.iter().enumerate() {
            let next = starts.get(&end).copied().unwrap_or(first + place);
            let before = ends.get(&start).copied().unwrap_or(first + place);
            let face = self.face([start, end, top], [other, next, before]);
            self.faces.push(face);
            let back = &mut self.faces[other];
            for side in 0..3 {
                if back.corners[side] == end && back.corners[(side + 1) % 3] == start {
                    back.near[side] = first + place;
                }
            }
        }
        let mut points = Vec::new();
        for face in seen {
            points.append(&mut self.faces[face].outside);
        }
        points.retain(|point| *point != top);
        let new: Vec<usize> = (first..self.faces.len()).collect();
        self.share(points, &new);
    }

    fn measure(&self) -> Solid {
        let mut hull = Solid::default();
        for face in self.faces.iter().filter(|face| face.alive) {
            let [a, b, c] = face.corners.map(|corner| self.points[corner]);
            let normal = cross(sub(b, a), sub(c, a));
            hull.surface += 0.5 * dot(normal, normal).sqrt();
            hull.volume += dot(a, normal) / 6.0;
        }
        hull
    }
}

#[cfg(test)]
mod tests;
