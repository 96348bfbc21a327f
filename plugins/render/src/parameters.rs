//! Parameters that the operations of this plugin share.

use crate::field::Bounds;
use puncta_sdk::prelude::*;

/// The field of view in x and y.
#[derive(Params)]
pub struct Window {
    /// Low edge of the image in x; from the data if left out.
    #[param(unit = "nm")]
    x_min: Option<f64>,
    /// High edge of the image in x; from the data if left out.
    #[param(unit = "nm")]
    x_max: Option<f64>,
    /// Low edge of the image in y; from the data if left out.
    #[param(unit = "nm")]
    y_min: Option<f64>,
    /// High edge of the image in y; from the data if left out.
    #[param(unit = "nm")]
    y_max: Option<f64>,
    /// Added on each side whose edge comes from the data.
    #[param(default = 0, min = 0, max = 1e9, unit = "nm", advanced)]
    margin: f64,
}

impl Window {
    /// The bounds of a plane.
    pub(crate) fn bounds(&self) -> Bounds {
        Bounds {
            x: [self.x_min, self.x_max],
            y: [self.y_min, self.y_max],
            z: [None, None],
            margin: self.margin,
        }
    }
}

/// The field of view of a volume.
#[derive(Params)]
pub struct Box3 {
    /// The plane.
    #[param(flatten)]
    window: Window,
    /// Low edge of the volume in z; from the data if left out.
    #[param(unit = "nm")]
    z_min: Option<f64>,
    /// High edge of the volume in z; from the data if left out.
    #[param(unit = "nm")]
    z_max: Option<f64>,
}

impl Box3 {
    /// The bounds of a volume.
    pub(crate) fn bounds(&self) -> Bounds {
        Bounds {
            z: [self.z_min, self.z_max],
            ..self.window.bounds()
        }
    }
}

/// What a channel of the image is.
#[derive(Choice, Clone, Copy, Debug, PartialEq, Eq)]
pub enum ChannelRule {
    /// One channel per input table
    Inputs,
    /// One channel per column p_<channel>
    Probability,
}

/// The channels of an image.
#[derive(Params)]
pub struct Channels {
    /// What a channel of the image is.
    #[param(default = ChannelRule::Inputs)]
    pub(crate) channels: ChannelRule,
    /// Smallest probability of its channel that a localisation needs.
    #[param(default = 0.1, min = 0, max = 1, advanced)]
    pub(crate) p_dye: f64,
    /// Probability of another channel from which on a localisation is left out.
    #[param(default = 0.1, min = 0, max = 1.000001, advanced)]
    pub(crate) p_other: f64,
}

/// Unit of a density.
#[derive(Choice, Clone, Copy, Debug, PartialEq, Eq)]
pub enum Density {
    /// Localisations per pixel or voxel
    Pixel,
    /// Localisations per nm^2, or nm^3 in a volume
    Nm,
}

impl Density {
    /// Unit of an image.
    pub(crate) fn unit(self, volume: bool) -> &'static str {
        match (self, volume) {
            (Density::Pixel, _) => "1",
            (Density::Nm, false) => "1/nm^2",
            (Density::Nm, true) => "1/nm^3",
        }
    }

    /// What a count per pixel (of this area or volume) is multiplied by.
    pub(crate) fn factor(self, size: f64) -> f64 {
        match self {
            Density::Pixel => 1.0,
            Density::Nm => 1.0 / size,
        }
    }
}
