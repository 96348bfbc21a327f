//! What a person may say about an image file; it wins over what the file says.

use puncta_sdk::prelude::*;

/// The explicit calibration of an image.
#[derive(Debug, Params)]
pub struct ImageOptions {
    /// Side of a pixel.
    #[param(min = 0.001, max = 1e9, unit = "nm")]
    pixel_size: Option<f64>,
    /// Distance of planes.
    #[param(min = 0.001, max = 1e9, unit = "nm")]
    z_step: Option<f64>,
    /// Time between frames.
    #[param(min = 0.0, max = 1e9, unit = "s")]
    frame_time: Option<f64>,
    /// What the planes of a file are that does not say it.
    #[param(default = Planes::Auto)]
    planes: Planes,
}

/// What planes are.
#[derive(Choice, Clone, Copy, Debug, PartialEq, Eq)]
pub enum Planes {
    /// As the file says; otherwise z.
    Auto,
    /// Positions along z.
    Z,
    /// Frames.
    T,
    /// Channels.
    C,
}

impl ImageOptions {
    /// The axis of planes of which nothing is known: 0 t, 1 c, 2 z.
    pub(crate) fn axis(&self) -> usize {
        match self.planes {
            Planes::T => 0,
            Planes::C => 1,
            Planes::Auto | Planes::Z => 2,
        }
    }

    /// Whether the person says what planes are.
    pub(crate) fn says_planes(&self) -> bool {
        self.planes != Planes::Auto
    }

    /// Puts what the person says into a grid, and says what is still unknown.
    pub(crate) fn apply(&self, info: &mut ImageInfo, file: &str, notes: &mut Vec<String>) {
        let old = info.voxel;
        if let Some(size) = self.pixel_size {
            info.voxel[1] = size;
            info.voxel[2] = size;
        }
        if let Some(step) = self.z_step {
            info.voxel[0] = step;
        }
        let voxels = info.origin.iter_mut().zip(old.iter().zip(info.voxel));
        for (origin, (old, new)) in voxels {
            // The origin was said in voxels.
            if *old > 0.0 && new != *old {
                *origin *= new / old;
            }
        }
        if let Some(time) = self.frame_time {
            info.frame_time = time;
        }
        if !(info.voxel[2] > 0.0 && info.voxel[1] > 0.0) {
            notes.push(format!(
                "{file} does not say the size of its pixels; give --pixel_size, such as \
                 --pixel_size 100nm."
            ));
        }
    }
}
