//! `puncta.drift.entropy/1`

use puncta_sdk::prelude::*;
use puncta_sdk::serde_json::json;

use super::CONVENTION;
use crate::correction::{
    Axes, Drift, Localisations, Reference, finish, input, outputs, plan, report, trust,
};
use crate::least_entropy::{Settings, estimate};
use crate::steps::Steps;

/// Corrects the drift by the least entropy of the localisations.
#[derive(Params)]
pub struct Entropy {
    /// Which axes are corrected.
    #[param(default = Axes::Auto)]
    axes: Axes,
    /// When the drift is zero.
    #[param(default = Reference::First)]
    reference: Reference,
    /// Duration of a bin of time, in the unit of t; chosen from the data if left out.
    #[param(min = 1e-9, max = 1e12)]
    bin: Option<f64>,
    /// Largest displacement between two segments of the coarse start that is looked for.
    #[param(default = 500, min = 20, max = 1e5, unit = "nm", advanced)]
    reach: f64,
    /// Segments of the coarse start.
    #[param(default = 20, min = 3, max = 200, advanced)]
    segments: usize,
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

impl Operation for Entropy {
    const ID: &'static str = "puncta.drift.entropy/1";

    fn info() -> Info {
        let info = Info::operation("Correct drift by entropy")
            .description(&format!(
                "Finds the drift under which the localisations lie most densely.\nA coarse start \
                 comes from the correlation of all pairs of segments; then each bin of time is \
                 moved to where the entropy is least. The same on two random halves gives the \
                 error, and how much the drift may be smoothed. {CONVENTION}"
            ))
            .input(input());
        outputs(info)
            .cite("J. Cnossen et al., Optics Express 29, 27961 (2021)")
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
            reach: self.reach,
            segments: self.segments,
            bin: self.bin,
            seed: self.seed.0,
        };
        let estimate = estimate(&cloud, &settings, &self.steps, job)?;
        trust(&estimate, self.max_error)?;
        let drift = Drift::of(&estimate, &frames, self.reference);
        let report = report(&estimate, &drift, &frames, locs.axes());
        let caption = format!(
            "Least entropy, {} bins, kernel up to {:.0} nm; the band is the standard error from two \
             halves of the field (seed {}).",
            estimate.curve.times.len(),
            cloud.sigma * crate::entropy::RADIUS,
            self.seed.0
        );
        finish(job, &locs, &frames, &drift, &report, &caption)
    }
}

puncta_sdk::register!(Entropy);

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{Sample, drift_error};
    use puncta_testkit::{Call, Done, Table};

    fn run(sample: &Sample, threads: usize) -> Done {
        let call = Call::of::<Entropy>().input("table", sample.table());
        call.threads(threads).run().unwrap()
    }

    #[test]
    fn a_smooth_drift_is_found_for_every_number_of_threads() {
        let sample = Sample::new(1);
        let one = run(&sample, 1);
        assert!(
            drift_error(&one, &sample) < 2.0,
            "{}",
            drift_error(&one, &sample)
        );
        for threads in [2, 3] {
            let other = run(&sample, threads);
            for name in ["x", "y", "error_x", "low_y"] {
                let column = |done: &Done| done.output("drift").unwrap().f64(name).unwrap();
                assert_eq!(column(&one), column(&other));
            }
            assert_eq!(one.documents, other.documents);
        }
        let x = one.output("table").unwrap().f64("x").unwrap();
        let drift = one.output("drift").unwrap().f64("x").unwrap();
        assert_eq!(drift[0], 0.0);
        let row = sample.t.iter().position(|t| *t == 700.0).unwrap();
        assert_eq!(x[row], sample.x[row] - drift[700]);
    }

    #[test]
    fn what_cannot_be_used_is_refused_with_a_remedy() {
        let call = |table: Table| Call::of::<Entropy>().input("table", table);
        let table = |x: &[f64], t: &[f64]| {
            Table::new("locs")
                .f64("x", "nm", x)
                .f64("y", "nm", x)
                .f64("t", "frame", t)
        };
        let refused = |table: Table| call(table).run().unwrap_err().to_string();
        assert!(refused(table(&[], &[])).contains("too few"));
        assert!(refused(table(&[1.0], &[0.0])).contains("fiducials"));
        let count = 1000;
        let t: Vec<f64> = (0..count).map(f64::from).collect();
        let random: Vec<f64> = (0..2000)
            .map(|i| crate::cloud::hash(i, 9) as f64 / u64::MAX as f64 * 1e5)
            .collect();
        let scattered = Table::new("locs")
            .f64("x", "nm", &random[..1000])
            .f64("y", "nm", &random[1000..])
            .f64("t", "frame", &t);
        assert!(refused(scattered).contains("no structure"));
        let flat = table(&random[..1000], &t).f64("z", "nm", &[3.0; 1000]);
        let flat = call(flat).set("axes", "all").run().unwrap_err().to_string();
        assert!(flat.contains("same in all rows"), "{flat}");
        let missing = call(table(&[1.0], &[0.0])).set("axes", "all").prepare();
        assert!(missing.unwrap_err().to_string().contains("no column z"));
        let sample = Sample::new(2);
        let stopped = call(sample.table()).cancel_after(20).run().unwrap_err();
        assert!(stopped.is_cancelled());
    }
}
