//! `puncta.drift.aim/1`

use puncta_sdk::prelude::*;
use puncta_sdk::serde_json::json;

use super::CONVENTION;
use crate::aim::{Settings, estimate};
use crate::correction::{
    Axes, Drift, Localisations, Reference, finish, input, outputs, plan, report, trust,
};
use crate::steps::Steps;

/// Correct drift by adaptive intersection.
#[derive(Params)]
pub struct Aim {
    /// Which axes are corrected.
    #[param(default = Axes::Auto)]
    axes: Axes,
    /// When the drift is zero.
    #[param(default = Reference::First)]
    reference: Reference,
    /// Duration of a segment, in the unit of t; 100 equal ones if left out.
    #[param(min = 1e-9, max = 1e12)]
    segment: Option<f64>,
    /// Side of a cell.
    #[param(default = 20, min = 1, max = 1e4, unit = "nm")]
    cell: f64,
    /// Largest shift between a segment and the one before.
    #[param(default = 60, min = 1, max = 1e4, unit = "nm")]
    reach: f64,
    /// Localisation precision where the table has no error_x.
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

impl Operation for Aim {
    const ID: &'static str = "puncta.drift.aim/1";

    fn info() -> Info {
        let info = Info::operation("Correct drift by adaptive intersection")
            .description(&format!(
                "Finds for each time segment the shift at which it has most cells in common with \
                 the localisations before it, then with all others.\nA sudden shift by more than \
                 the reach is not found. The same on two halves of the field gives the error. \
                 {CONVENTION}"
            ))
            .input(input());
        outputs(info)
            .cite("H. Ma et al., Science Advances 10, eadm7765 (2024)")
            .example(json!({ "precision": 5 }))
            .example_input(
                "table",
                "puncta.synthetic.membrane/1",
                super::example().into(),
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
            cell: self.cell,
            reach: self.reach,
            seed: self.seed.0,
        };
        let estimate = estimate(&cloud, &settings, &self.steps, job)?;
        trust(&estimate, self.max_error)?;
        let drift = Drift::of(&estimate, &frames, self.reference);
        let report = report(&estimate, &drift, &frames, locs.axes());
        let caption = format!(
            "Adaptive intersection of {} segments, cells of {} nm; the band is the standard error \
             from two halves of the field (seed {}).",
            estimate.curve.times.len(),
            self.cell,
            self.seed.0
        );
        finish(job, &locs, &frames, &drift, &report, &caption)
    }
}

puncta_sdk::register!(Aim);

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
                let call = Call::of::<Aim>().input("table", sample.table());
                call.threads(threads).run().unwrap()
            };
            let one = run(1);
            let error = drift_error(&one, &sample);
            // A segment has 300 localisations, which place it to 10 / sqrt(300) = 0.58 nm at best.
            assert!(error < 0.9, "{error}");
            assert_eq!(one.documents, run(3).documents);
        }
    }
}
