//! The region that is studied: what an estimator needs to know of it.

use crate::overlap::Overlap;
use puncta_sdk::Failure;
use puncta_sdk::run::Run;
use rand_chacha::rand_core::Rng;

/// The region in which points could have been seen.
pub trait Window<const D: usize>: Sync {
    /// Area in nm^2, or volume in nm^3.
    fn volume(&self) -> f64;

    /// Low and high corner of its bounding box, nm.
    fn bounds(&self) -> [[f64; D]; 2];

    /// Whether a point belongs to it.
    fn holds(&self, point: &[f64; D]) -> bool;

    /// Lengths of its sides if it is a rectangle or a box.
    fn sides(&self) -> Option<[f64; D]>;

    /// How much of the region lies in its copy moved by differences of up to `reach` nm.
    ///
    /// # Errors
    /// When there would be too many differences, or when cancelled.
    fn overlap(&self, reach: f64, run: &dyn Run) -> Result<Overlap<D>, Failure>;

    /// Whether [`Window::share`] knows the share of circles (spheres).
    fn isotropic(&self) -> bool {
        true
    }

    /// Pieces of the boundary that may lie within `reach` of points of a box.
    fn pieces(&self, low: &[f64; D], high: &[f64; D], reach: f64) -> Vec<u32>;

    /// What the boundary is to a point of the region: `rim` is cleared and filled with those of
    /// `pieces` that lie within `reach`.
    fn about(&self, point: &[f64; D], pieces: &[u32], reach: f64, rim: &mut Rim);

    /// Share of the circle (sphere) of this radius about the point of `rim` that lies in the
    /// region. The radius is above the distance of the boundary and not above `reach`.
    fn share(&self, rim: &Rim, radius: f64) -> f64;

    /// A point with uniform density.
    fn draw(&self, random: &mut dyn Random) -> [f64; D];

    /// Mean number of places tried for a point with uniform density.
    fn tries(&self) -> f64 {
        1.0
    }

    /// For captions: what it is and how large.
    fn describe(&self) -> String;
}

/// Uniform numbers.
pub trait Random {
    /// In [0, 1), 53 bits.
    fn unit(&mut self) -> f64;

    /// Below `n`; 0 for `n` 0. The bias is below 2^-32 for `n` up to 2^32.
    fn below(&mut self, n: usize) -> usize;
}

impl<R: Rng> Random for R {
    fn unit(&mut self) -> f64 {
        (self.next_u64() >> 11) as f64 / (1_u64 << 53) as f64
    }

    fn below(&mut self, n: usize) -> usize {
        ((u128::from(self.next_u64()) * n as u128) >> 64) as usize
    }
}

/// The boundary near a point.
#[derive(Clone, Debug, Default)]
pub struct Rim {
    /// Distance of the boundary; infinite if it is beyond reach.
    pub distance: f64,
    /// Angle of the region as seen from the point without any circle: 2 pi inside.
    pub(crate) whole: f64,
    pub(crate) edges: Vec<NearEdge>,
    /// Distance of each face of a box, low and high along each axis.
    pub(crate) faces: [[f64; 2]; 3],
}

/// An edge of a polygon as seen from a point.
#[derive(Clone, Copy, Debug)]
pub(crate) struct NearEdge {
    /// Squared distance of its nearest place.
    pub(crate) near: f64,
    /// Distance of its line.
    pub(crate) line: f64,
    /// 1 if the point is on its left, else -1.
    pub(crate) side: f64,
    /// Places of its ends along the line, from the foot of the perpendicular.
    pub(crate) ends: [f64; 2],
    /// Angles of its ends from the perpendicular.
    pub(crate) angles: [f64; 2],
    /// The point lies on the edge's line, but not on its inner part: no angle at all.
    pub(crate) blind: bool,
}

/// A box in three dimensions.
#[derive(Clone, Copy, Debug)]
pub struct Cuboid {
    /// Low corner, nm.
    pub low: [f64; 3],
    /// High corner, nm.
    pub high: [f64; 3],
}

impl Window<3> for Cuboid {
    fn volume(&self) -> f64 {
        (0..3).map(|a| self.high[a] - self.low[a]).product()
    }

    fn bounds(&self) -> [[f64; 3]; 2] {
        [self.low, self.high]
    }

    fn holds(&self, point: &[f64; 3]) -> bool {
        (0..3).all(|a| self.low[a] <= point[a] && point[a] <= self.high[a])
    }

    fn sides(&self) -> Option<[f64; 3]> {
        Some(std::array::from_fn(|a| self.high[a] - self.low[a]))
    }

    fn overlap(&self, _reach: f64, _run: &dyn Run) -> Result<Overlap<3>, Failure> {
        let side = |a: usize| 1.0 / (self.high[a] - self.low[a]);
        Ok(Overlap::Sides(std::array::from_fn(side)))
    }

    fn pieces(&self, low: &[f64; 3], high: &[f64; 3], reach: f64) -> Vec<u32> {
        let near = |a: usize| low[a] - self.low[a] < reach || self.high[a] - high[a] < reach;
        if (0..3).any(near) { vec![0] } else { vec![] }
    }

    fn about(&self, point: &[f64; 3], _pieces: &[u32], reach: f64, rim: &mut Rim) {
        rim.faces = std::array::from_fn(|a| {
            [point[a] - self.low[a], self.high[a] - point[a]].map(|h| h.max(0.0))
        });
        let nearest = rim
            .faces
            .iter()
            .flatten()
            .fold(f64::INFINITY, |near, h| near.min(*h));
        rim.distance = if nearest < reach {
            nearest
        } else {
            f64::INFINITY
        };
    }

    fn share(&self, rim: &Rim, radius: f64) -> f64 {
        sphere_share(&rim.faces, radius)
    }

    fn draw(&self, random: &mut dyn Random) -> [f64; 3] {
        std::array::from_fn(|a| self.low[a] + random.unit() * (self.high[a] - self.low[a]))
    }

    fn describe(&self) -> String {
        let [x, y, z] = [0, 1, 2].map(|a| self.high[a] - self.low[a]);
        format!("box of {x:.6} x {y:.6} x {z:.6} nm")
    }
}

/// Share of a sphere inside a box whose faces lie at these distances from its centre.
///
/// The part beyond the faces follows from inclusion and exclusion of one, two and three half-spaces;
/// each such part is bounded by circles, so that its area is 2 pi less the turns at its corners and
/// along its arcs (Gauss and Bonnet; Baddeley et al., Appl. Stat. 42, 641, 1993).
fn sphere_share(faces: &[[f64; 2]; 3], radius: f64) -> f64 {
    use std::f64::consts::PI;
    let near = faces.map(|face| face.map(|h| h / radius));
    let mut outside = 0.0;
    for h in near.iter().flatten().filter(|h| **h < 1.0) {
        outside += 2.0 * PI * (1.0 - h);
    }
    for (i, j) in [(0, 1), (0, 2), (1, 2)] {
        for a in near[i] {
            for b in near[j] {
                outside -= two_planes(a, b);
            }
        }
    }
    for a in near[0] {
        for b in near[1] {
            for c in near[2] {
                outside += three_planes(a, b, c);
            }
        }
    }
    (1.0 - outside / (4.0 * PI)).max(0.0)
}

/// Angle between the circles x = a and y = b of the unit sphere, on the side beyond both.
fn corner(a: f64, b: f64) -> f64 {
    (a * b / ((1.0 - a * a) * (1.0 - b * b)).sqrt())
        .clamp(-1.0, 1.0)
        .acos()
}

/// Area of the part x > a, y > b of the unit sphere; a and b are not negative.
fn two_planes(a: f64, b: f64) -> f64 {
    if a * a + b * b >= 1.0 {
        return 0.0;
    }
    let arc = |a: f64, b: f64| 2.0 * (b / (1.0 - a * a).sqrt()).min(1.0).acos();
    (2.0 * corner(a, b) - a * arc(a, b) - b * arc(b, a)).max(0.0)
}

/// Area of the part x > a, y > b, z > c of the unit sphere; none is negative.
fn three_planes(a: f64, b: f64, c: f64) -> f64 {
    use std::f64::consts::PI;
    if a * a + b * b + c * c >= 1.0 {
        return 0.0;
    }
    let arc = |a: f64, b: f64, c: f64| {
        let radius = (1.0 - a * a).sqrt();
        (b / radius).min(1.0).acos() - (c / radius).min(1.0).asin()
    };
    let corners = corner(a, b) + corner(b, c) + corner(c, a);
    (corners - PI - a * arc(a, b, c) - b * arc(b, c, a) - c * arc(c, a, b)).max(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand_chacha::ChaCha8Rng;
    use rand_chacha::rand_core::SeedableRng;

    #[test]
    fn shares_of_spheres_are_those_of_many_directions() {
        let cube = Cuboid {
            low: [0.0, 0.0, 0.0],
            high: [10.0, 8.0, 3.0],
        };
        let mut random = ChaCha8Rng::seed_from_u64(1);
        let mut rim = Rim::default();
        // Directions evenly spread by the golden angle.
        let count = 40_000;
        let directions: Vec<[f64; 3]> = (0..count)
            .map(|i| {
                let z = (f64::from(i) + 0.5) / f64::from(count) * 2.0 - 1.0;
                let (sin, cos) = (f64::from(i) * 2.399_963_229_728_653).sin_cos();
                let r = (1.0 - z * z).sqrt();
                [r * cos, r * sin, z]
            })
            .collect();
        for case in 0..60 {
            let mut centre = cube.draw(&mut random);
            if case % 10 == 0 {
                centre[case / 10 % 3] = 0.0;
            }
            if case == 7 {
                centre = [0.0; 3];
            }
            let radius = 0.1 + 7.0 * random.unit();
            cube.about(&centre, &[0], 100.0, &mut rim);
            let inside = directions
                .iter()
                .filter(|u| cube.holds(&std::array::from_fn(|a| centre[a] + radius * u[a])));
            let expected = inside.count() as f64 / f64::from(count);
            let found = cube.share(&rim, radius);
            assert!(
                (found - expected).abs() < 2e-3,
                "{centre:?} {radius}: {found} {expected}"
            );
        }
    }
}
