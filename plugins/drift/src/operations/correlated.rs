//! What the operations that correlate segments of time share.

use puncta_sdk::prelude::*;
use puncta_sdk::serde_json::json;

use super::Between;
use crate::coarse::Pattern;
use crate::correction::{Axes, Drift, Localisations, Reference, finish, report, trust};
use crate::correlation::{Settings, estimate};
use crate::steps::Steps;

/// Their parameters.
#[derive(Params)]
pub struct Correlated {
    /// Which axes are corrected.
    #[param(default = Axes::Auto)]
    pub axes: Axes,
    /// When the drift is zero.
    #[param(default = Reference::First)]
    reference: Reference,
    /// Duration of a segment, in the unit of t; 4 to 20 equal ones if left out, the more the more localisations there are.
    #[param(min = 1e-9, max = 1e12)]
    segment: Option<f64>,
    /// Between the middles of the segments.
    #[param(default = Between::Spline)]
    interpolation: Between,
    /// Largest displacement between two segments that is looked for.
    #[param(default = 500, min = 20, max = 1e5, unit = "nm")]
    reach: f64,
    /// Localisation precision where the table has no error_x; cells of the correlation are twice it.
    #[param(default = 10, min = 0.1, max = 1000, unit = "nm")]
    precision: f64,
    #[param(flatten)]
    steps: Steps,
    /// Largest error from split halves that is accepted.
    #[param(default = 20, min = 0, max = 1e6, unit = "nm", advanced)]
    max_error: f64,
    /// Seed of the halves and subsets.
    #[param(default = 1)]
    seed: Seed,
}

impl Correlated {
    /// Corrects the table by the correlation of the segments that the pattern pairs. `method`
    /// begins the caption, before the number of segments.
    ///
    /// # Errors
    /// When the table does not show its drift, or when cancelled.
    pub fn correct(&self, job: &Job, pattern: Pattern, method: &str) -> Result<(), Failure> {
        let locs = Localisations::read(&job.input("table")?, self.axes)?;
        let (frames, cloud) = locs.cloud(self.precision, job)?;
        let settings = Settings {
            segment: self.segment,
            reach: self.reach,
            pattern,
            interpolation: self.interpolation.into(),
            seed: self.seed.0,
        };
        let estimate = estimate(&cloud, &settings, &self.steps, job)?;
        trust(&estimate, self.max_error)?;
        let drift = Drift::of(&estimate, &frames, self.reference);
        let report = report(&estimate, &drift, &frames, locs.axes());
        let caption = format!(
            "{method} {} segments, displacements up to {} nm; the band is the standard error \
             from two halves of the field (seed {}).",
            estimate.curve.times.len(),
            self.reach,
            self.seed.0
        );
        finish(job, &locs, &frames, &drift, &report, &caption)
    }
}

/// An example with structure enough for every segment.
pub fn example(info: Info, parameters: puncta_sdk::serde_json::Value) -> Info {
    info.example(parameters).example_input(
        "table",
        "puncta.synthetic.membrane/1",
        json!({ "acceptance": 0.02, "copies": 8, "fwhm_x": 60, "fwhm_y": 60, "fwhm_z": 60 }),
    )
}
