//! The mapping as parameters of a reader: in recipes, on the command line, in forms.

use crate::mapping::Mapping;
use puncta_sdk::prelude::*;

/// The explicit mapping of a file; what it says always wins over the file.
#[derive(Debug, Params)]
pub struct MappingParams {
    /// Names of all columns in order, such as x,y,t (- leaves one out), or pairs such as Frame=t.
    #[param(default = "")]
    columns: String,
    /// Units of columns, such as x=um, y=um, or one unit for all lengths that have none, such as nm.
    #[param(default = "")]
    units: String,
    /// Camera pixel, for columns in px.
    #[param(min = 0.001, max = 1e6, unit = "nm")]
    pixel_size: Option<f64>,
    /// Number of the first frame in the file.
    #[param(default = FrameBase::Auto)]
    frame_base: FrameBase,
    /// Exchanges x and y, with their errors and widths.
    #[param(default = false)]
    swap_xy: bool,
    /// Multiplies z and its error, for the mismatch of refractive indices.
    #[param(default = 1.0, min = -1000.0, max = 1000.0, unit = "1")]
    z_factor: f64,
}

/// Where frames start.
#[derive(Choice, Clone, Copy, Debug, PartialEq, Eq)]
pub enum FrameBase {
    /// As the format says: 1 for ThunderSTORM, otherwise mostly 0.
    Auto,
    /// The first frame is 0.
    Zero,
    /// The first frame is 1.
    One,
}

impl MappingParams {
    /// The mapping that the parameters say.
    ///
    /// # Errors
    /// Columns or units that cannot be understood.
    pub fn mapping(&self) -> Result<Mapping, Failure> {
        let mut mapping = Mapping {
            pixel_size: self.pixel_size,
            frame_base: match self.frame_base {
                FrameBase::Auto => None,
                FrameBase::Zero => Some(0),
                FrameBase::One => Some(1),
            },
            swap_xy: self.swap_xy,
            z_factor: self.z_factor,
            ..Mapping::default()
        };
        mapping.set_columns(&self.columns)?;
        mapping.set_units(&self.units)?;
        mapping.check()?;
        Ok(mapping)
    }
}
