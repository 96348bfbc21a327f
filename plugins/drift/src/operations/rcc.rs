//! `puncta.drift.rcc/1`

use puncta_sdk::prelude::*;
use puncta_sdk::serde_json::json;

use super::{Between, CONVENTION};
use crate::coarse::Pattern;
use crate::correction::{
    Axes, Drift, Localisations, Reference, finish, input, outputs, plan, report, trust,
};
use crate::correlation::{Settings, estimate};

/// Correct drift by redundant cross-correlation.
#[derive(Params)]
pub struct Rcc {
    /// Which axes are corrected.
    #[param(default = Axes::Auto)]
    axes: Axes,
    /// When the drift is zero.
    #[param(default = Reference::First)]
    reference: Reference,
    /// Duration of a segment, in the unit of t; 20 equal ones if left out.
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
    /// Largest error from split halves that is accepted.
    #[param(default = 20, min = 0, max = 1e6, unit = "nm", advanced)]
    max_error: f64,
    /// Seed of the halves and subsets.
    #[param(default = 1)]
    seed: Seed,
}

impl Operation for Rcc {
    const ID: &'static str = "puncta.drift.rcc/1";

    fn info() -> Info {
        let info = Info::operation("Correct drift by redundant cross-correlation")
            .description(&format!(
                "Correlates all pairs of time segments, and finds the drift that agrees best with all of them; pairs that do not agree are left out.\nThe correlation is counted from the displacements between the localisations themselves, without images. The same on two halves of the field gives the error. {CONVENTION}"
            ))
            .input(input());
        outputs(info)
            .cite("Y. Wang et al., Optics Express 22, 15982 (2014)")
            .example(json!({ "precision": 5 }))
            .example_input(
                "table",
                "puncta.synthetic.membrane/1",
                json!({
                    "acceptance": 0.02, "copies": 8, "fwhm_x": 60, "fwhm_y": 60, "fwhm_z": 60
                }),
            )
    }

    fn prepare(&self, request: &Request) -> Result<Plan, Failure> {
        plan::<Self>(request, self.axes)
    }

    fn run(&self, job: &Job) -> Result<(), Failure> {
        let locs = Localisations::read(&job.input("table")?, self.axes)?;
        let (frames, cloud) = locs.cloud(self.precision, job)?;
        let settings = Settings {
            segment: self.segment,
            reach: self.reach,
            pattern: Pattern::All,
            interpolation: self.interpolation.into(),
            seed: self.seed.0,
        };
        let estimate = estimate(&cloud, &settings, job)?;
        trust(&estimate, self.max_error)?;
        let drift = Drift::of(&estimate, &frames, self.reference);
        let report = report(&estimate, &drift, &frames, locs.axes());
        let caption = format!(
            "Redundant cross-correlation of {} segments, displacements up to {} nm; the band is the standard error \
             from two halves of the field (seed {}).",
            estimate.curve.times.len(),
            self.reach,
            self.seed.0
        );
        finish(job, &locs, &frames, &drift, &report, &caption)
    }
}

puncta_sdk::register!(Rcc);

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{Sample, drift_error};
    use puncta_testkit::Call;

    #[test]
    fn a_smooth_drift_is_found() {
        for three in [false, true] {
            let mut sample = Sample::new(3);
            sample.three = three;
            let run = |threads| {
                let call = Call::of::<Rcc>().input("table", sample.table());
                call.threads(threads).run().unwrap()
            };
            let one = run(1);
            let error = drift_error(&one, &sample);
            assert!(error < 8.0, "{error}");
            assert_eq!(one.documents, run(3).documents);
        }
    }
}
