//! The operations of this plugin.

use crate::applied::Samples;
use crate::curve::Interpolation;
use puncta_sdk::documents::units;
use puncta_sdk::{Choice, Failure, Input, Map, Plan, Request};

pub mod aim;
pub mod apply;
pub mod auto;
pub mod autocorrelation;
pub mod correlated;
pub mod entropy;
pub mod fiducials;
pub mod rcc;
pub mod transmitted;

/// Sentences that the descriptions share.
pub const CONVENTION: &str = "The drift is how far the sample has moved; it is subtracted from the positions. Rows without \
     a finite position and time are passed through. The times need not be sorted and may have gaps.";

/// Parameters of a simulated table with enough structure for an example.
fn example() -> Map {
    let values = [
        ("copies", 4),
        ("fwhm_x", 60),
        ("fwhm_y", 60),
        ("fwhm_z", 60),
    ];
    values
        .map(|(name, value)| (name.to_owned(), value.into()))
        .into_iter()
        .collect()
}

/// How the drift runs between the times at which it is known.
#[derive(Choice, Clone, Copy, Debug)]
pub enum Between {
    /// A natural cubic spline
    Spline,
    /// Straight lines
    Linear,
}

impl From<Between> for Interpolation {
    fn from(between: Between) -> Self {
        match between {
            Between::Spline => Self::Spline,
            Between::Linear => Self::Linear,
        }
    }
}

/// Adds the column `z` to the plan's columns of the port, where the table has it.
fn samples_plan(plan: &mut Plan, request: &Request, port: &str, z: &str) {
    for read in &mut plan.read {
        let input = request.inputs.get(read.input);
        if let Some(input) = input.filter(|input| input.port == port)
            && input.header.column(z).is_some()
            && !read.columns.iter().any(|name| name == z)
        {
            read.columns.push(z.to_owned());
        }
    }
}

/// Samples of a drift from the columns time, x, y, z of a table. Lengths are brought to nm; other
/// units are taken as numbers. Without z there is no drift along it.
fn samples(table: &Input<'_>, columns: [&str; 4], factor: f64) -> Result<Samples, Failure> {
    let [time, x, y, z] = columns;
    let read = |name: &str| -> Result<Vec<f64>, Failure> {
        let unit = table.header().column(name).map_or("1", |info| &info.unit);
        let scale = factor * units::conversion(unit, "nm").unwrap_or(1.0);
        Ok(table.f64(name)?.iter().map(|value| value * scale).collect())
    };
    let times = table.f64(time)?.into_owned();
    let (x, y) = (read(x)?, read(y)?);
    let z = match table.names(0).iter().any(|name| name == z) {
        true => read(z)?,
        false => vec![0.0; times.len()],
    };
    let values = x
        .into_iter()
        .zip(y)
        .zip(z)
        .map(|((x, y), z)| [x, y, z])
        .collect();
    Ok(Samples { times, values })
}
