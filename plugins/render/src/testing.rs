//! Random numbers and fields of view for the tests of the cores.

use crate::field::{Bounds, Field, IMAGE_BYTES, Room, Volume, extent, field, volume};
use crate::grid::Axis;
use puncta_testkit::Threads;

/// The room that images have by default.
pub(crate) const ROOM: Room = Room {
    budget: IMAGE_BYTES,
    pixel_bytes: 4,
};

/// The field that starts at a corner.
pub(crate) fn plane(x: f64, y: f64, size: f64, width: usize, height: usize) -> Field {
    Field {
        x: Axis::at(x, size, width).unwrap(),
        y: Axis::at(y, size, height).unwrap(),
    }
}

/// The field that covers positions on the absolute grid.
pub(crate) fn covering(x: &[f64], y: &[f64], size: f64, margin: f64) -> Field {
    let bounds = Bounds {
        margin,
        ..Bounds::default()
    };
    let extents = [x, y].map(|v| extent(v, &Threads(2)).unwrap());
    field(&bounds, size, extents, &ROOM).unwrap()
}

/// The volume that covers positions on the absolute grid.
pub(crate) fn around(points: [&[f64]; 3], size: f64, voxel_z: f64, margin: f64) -> Volume {
    let bounds = Bounds {
        margin,
        ..Bounds::default()
    };
    let extents = points.map(|v| extent(v, &Threads(2)).unwrap());
    volume(&bounds, size, voxel_z, extents, &ROOM).unwrap()
}

/// Sum of an image.
pub(crate) fn sum(image: &[f32]) -> f64 {
    image.iter().map(|v| f64::from(*v)).sum()
}

/// Repeatable numbers in 0..1 (xorshift64*, Vigna 2016).
pub(crate) struct Random(u64);

impl Random {
    pub(crate) fn new(seed: u64) -> Self {
        Self(seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1)
    }

    pub(crate) fn next(&mut self) -> f64 {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        (self.0.wrapping_mul(0x2545_f491_4f6c_dd1d) >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// `count` numbers of `low..high`.
    pub(crate) fn many(&mut self, count: usize, low: f64, high: f64) -> Vec<f64> {
        (0..count)
            .map(|_| low + (high - low) * self.next())
            .collect()
    }
}
