//! Masks in space: regions of voxels.

use crate::overlap::{Overlap, Rows, voxels};
use crate::window::{Random, Rim, Window};
use puncta_sdk::run::Run;
use puncta_sdk::{Failure, ImageInfo};

/// The region of the voxels above 0.5 of an image.
#[derive(Clone, Debug)]
pub struct Solid {
    shape: [usize; 3],
    side: [f64; 3],
    low: [f64; 3],
    voxels: Vec<bool>,
    set: Vec<u32>,
    /// Voxels outside the region across a face of one inside, as places in the image with a rim of
    /// one voxel, sorted by z, y, x; and where each row along x begins.
    rim: Vec<[u32; 3]>,
    rows: Vec<usize>,
}

impl Solid {
    /// From an image, x fastest.
    ///
    /// # Errors
    /// When the image has channels or times, voxels without a depth, or no voxel above 0.5.
    pub fn new(info: &ImageInfo, values: &[f64]) -> Result<Self, Failure> {
        let [t, c, z, y, x] = info.size.map(|n| n as usize);
        let count = x * y * z;
        let padded = (x as f64 + 2.0) * (y as f64 + 2.0) * (z as f64 + 2.0);
        if t * c != 1 || count != values.len() || padded >= f64::from(u32::MAX) {
            let message = "the mask is not a volume of one channel and one time";
            return Err(Failure::bad_input(message).remedy("take one channel and time of it"));
        }
        let turned = |[z, y, x]: [f64; 3]| [x, y, z];
        let side = turned(info.voxel);
        if side.iter().any(|side| *side <= 0.0 || !side.is_finite()) {
            let message = "the voxels of the mask have no depth";
            return Err(Failure::bad_input(message).remedy("set its voxel size, or leave out z"));
        }
        let voxels: Vec<bool> = values.iter().map(|value| *value > 0.5).collect();
        let set: Vec<u32> = (0..)
            .zip(&voxels)
            .filter(|(_, set)| **set)
            .map(|(i, _)| i)
            .collect();
        if set.is_empty() {
            let message = "the mask has no voxel above 0.5";
            return Err(Failure::bad_input(message).remedy("check its values"));
        }
        let mut solid = Self {
            shape: [x, y, z],
            side,
            low: turned(info.origin),
            voxels,
            set,
            rim: Vec::new(),
            rows: Vec::new(),
        };
        solid.find_rim();
        Ok(solid)
    }

    /// Whether a voxel of the padded image belongs to the region.
    fn is(&self, [x, y, z]: [usize; 3]) -> bool {
        let place = [x, y, z].map(|k| k.wrapping_sub(1));
        (0..3).all(|a| place[a] < self.shape[a])
            && self.voxels[(place[2] * self.shape[1] + place[1]) * self.shape[0] + place[0]]
    }

    fn find_rim(&mut self) {
        let [width, height, depth] = self.shape.map(|n| n + 2);
        for z in 0..depth {
            for y in 0..height {
                self.rows.push(self.rim.len());
                for x in 0..width {
                    let at = [x, y, z];
                    let beside = |a: usize, up: bool| {
                        let mut other = at;
                        other[a] = if up { at[a] + 1 } else { at[a].wrapping_sub(1) };
                        self.is(other)
                    };
                    if !self.is(at) && (0..3).any(|a| beside(a, false) || beside(a, true)) {
                        self.rim.push(at.map(|k| k as u32));
                    }
                }
            }
        }
        self.rows.push(self.rim.len());
    }

    /// First and last place in the padded image of what lies between two positions along an axis.
    fn places(&self, a: usize, low: f64, high: f64) -> [usize; 2] {
        let last = self.shape[a] as f64 + 1.0;
        [low, high].map(|at| {
            let place = (at - self.low[a]) / self.side[a] + 1.0;
            place.floor().clamp(0.0, last) as usize
        })
    }
}

impl Window<3> for Solid {
    fn volume(&self) -> f64 {
        self.set.len() as f64 * self.side.iter().product::<f64>()
    }

    fn bounds(&self) -> [[f64; 3]; 2] {
        let high = |a: usize| self.low[a] + self.shape[a] as f64 * self.side[a];
        [self.low, std::array::from_fn(high)]
    }

    fn holds(&self, point: &[f64; 3]) -> bool {
        let place = |a: usize| ((point[a] - self.low[a]) / self.side[a]).floor();
        (0..3).all(|a| place(a) >= 0.0 && place(a) < self.shape[a] as f64)
            && self.is(std::array::from_fn(|a| place(a) as usize + 1))
    }

    fn sides(&self) -> Option<[f64; 3]> {
        None
    }

    fn overlap(&self, reach: f64, run: &dyn Run) -> Result<Overlap<3>, Failure> {
        let rows = Rows::new(&self.voxels, self.shape);
        voxels(&rows, self.side, reach, run)
    }

    fn isotropic(&self) -> bool {
        false
    }

    fn pieces(&self, low: &[f64; 3], high: &[f64; 3], reach: f64) -> Vec<u32> {
        let ends: [[usize; 2]; 3] =
            std::array::from_fn(|a| self.places(a, low[a] - reach, high[a] + reach));
        let [columns, rows, planes] = ends.map(|[first, last]| first..=last);
        let mut pieces = Vec::new();
        for z in planes {
            for y in rows.clone() {
                let row = z * (self.shape[1] + 2) + y;
                let line = self.rows[row]..self.rows[row + 1];
                let within = line.filter(|i| columns.contains(&(self.rim[*i][0] as usize)));
                pieces.extend(within.map(|i| i as u32));
            }
        }
        pieces
    }

    fn about(&self, point: &[f64; 3], pieces: &[u32], reach: f64, rim: &mut Rim) {
        let mut nearest = f64::INFINITY;
        for piece in pieces {
            let place = self.rim[*piece as usize];
            let gap = |a: usize| {
                let low = self.low[a] + (f64::from(place[a]) - 1.0) * self.side[a];
                (low - point[a]).max(point[a] - low - self.side[a]).max(0.0)
            };
            nearest = nearest.min((0..3).map(|a| gap(a) * gap(a)).sum::<f64>());
        }
        let nearest = nearest.sqrt();
        rim.distance = if nearest < reach {
            nearest
        } else {
            f64::INFINITY
        };
    }

    fn share(&self, _rim: &Rim, _radius: f64) -> f64 {
        1.0
    }

    fn draw(&self, random: &mut dyn Random) -> [f64; 3] {
        let voxel = self.set.get(random.below(self.set.len())).copied();
        let voxel = voxel.unwrap_or(0) as usize;
        let [width, height, _] = self.shape;
        let place = [
            voxel % width,
            voxel / width % height,
            voxel / width / height,
        ];
        std::array::from_fn(|a| self.low[a] + (place[a] as f64 + random.unit()) * self.side[a])
    }

    fn describe(&self) -> String {
        format!(
            "mask of {} voxels, {:.6e} nm^3",
            self.set.len(),
            self.volume()
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simulate::stream;

    #[test]
    fn a_mask_knows_its_places_and_the_distance_of_its_boundary() {
        // A box of 4 x 3 x 2 voxels without the voxel (1, 1, 0).
        let mut info = ImageInfo::plane(4, 3, 10.0, -20.0, 5.0);
        (info.size[2], info.voxel[0], info.origin[0]) = (2, 25.0, 100.0);
        let mut values = [1.0; 24];
        values[5] = 0.0;
        let solid = Solid::new(&info, &values).unwrap();
        assert_eq!(solid.volume(), 23.0 * 2500.0);
        assert_eq!(solid.bounds(), [[-20.0, 5.0, 100.0], [20.0, 35.0, 150.0]]);
        assert!(solid.holds(&[-5.0, 20.0, 130.0]) && !solid.holds(&[-5.0, 20.0, 110.0]));
        assert!(!solid.holds(&[-5.0, 20.0, 99.0]) && !solid.holds(&[20.0, 20.0, 130.0]));
        let mut rim = Rim::default();
        let mut distance = |point: [f64; 3]| {
            let pieces = solid.pieces(&point, &point, 60.0);
            solid.about(&point, &pieces, 60.0, &mut rim);
            rim.distance
        };
        assert_eq!(distance([-5.0, 20.0, 130.0]), 5.0);
        assert_eq!(distance([13.0, 20.0, 130.0]), 7.0);
        assert!((distance([3.0, 28.0, 120.0]) - 18f64.sqrt()).abs() < 1e-12);
        let mut random = stream(1, 0);
        assert!((0..200).all(|_| solid.holds(&solid.draw(&mut random))));
        assert!(Solid::new(&info, &[0.0; 24]).is_err());
        assert!(Solid::new(&ImageInfo::plane(2, 2, 1.0, 0.0, 0.0), &[1.0; 4]).is_err());
    }
}
