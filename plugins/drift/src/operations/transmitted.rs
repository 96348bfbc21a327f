//! `puncta.drift.transmitted/1`

use puncta_sdk::documents::manifest::Step;
use puncta_sdk::prelude::*;
use puncta_sdk::serde_json::json;

use super::{Between, samples, samples_plan};
use crate::correction::{
    Axes, Drift, Localisations, Reference, finish, input, known, outputs, plan,
};
use crate::estimate::Estimate;

/// Correct by recorded drift.
#[derive(Params)]
pub struct Transmitted {
    /// Which axes are corrected; z where both tables have it.
    #[param(default = Axes::Auto)]
    axes: Axes,
    /// When the drift is zero.
    #[param(default = Reference::First)]
    reference: Reference,
    /// Column of the drift along x.
    #[param(default = "x")]
    x: Column,
    /// Column of the drift along y.
    #[param(default = "y")]
    y: Column,
    /// Column of the drift along z, where the table has z.
    #[param(default = "z")]
    z: Column,
    /// Column of the times of the drift, in the unit of t.
    #[param(default = "t")]
    time: Column,
    /// Length of one unit of the recorded drift, such as a pixel; minus for the other direction.
    #[param(default = 1, min = -1e9, max = 1e9, unit = "nm")]
    unit_length: f64,
    /// Samples of a running median, against single false ones.
    #[param(default = 5, min = 1, max = 1001)]
    median: usize,
    /// Between the samples.
    #[param(default = Between::Linear)]
    interpolation: Between,
}

impl Operation for Transmitted {
    const ID: &'static str = "puncta.drift.transmitted/1";

    fn info() -> Info {
        let drift = Ports::table("events").any_column("$time");
        let info = Info::operation("Correct by recorded drift")
            .description(
                "Subtracts a drift that was recorded during the acquisition, such as from a transmitted-light channel.\nThe samples are cleaned by a running median, interpolated at the times of the table, and set to zero at the first of them unless told otherwise; before the first and after the last sample the end values hold. Rows without a finite position and time are passed through.",
            )
            .input(input())
            .input(drift.any_column("$x").any_column("$y").description("Times and drift"));
        let synthetic = |parameters: puncta_sdk::serde_json::Value| Step {
            op: "puncta.synthetic.membrane/1".into(),
            parameters: parameters.as_object().cloned().unwrap_or_default(),
            ..Step::default()
        };
        outputs(info)
            .example(json!({ "x": "true_x", "y": "true_y", "axes": "lateral" }))
            .example_input("table", "puncta.synthetic.membrane/1", json!({}))
            .example_step("events", synthetic(json!({ "background": 0.0 })))
    }

    fn prepare(&self, request: &Request) -> Result<Plan, Failure> {
        let mut plan = plan::<Self>(request, self.axes)?;
        samples_plan(&mut plan, request, "events", &self.z);
        Ok(plan)
    }

    fn run(&self, job: &Job) -> Result<(), Failure> {
        let locs = Localisations::read(&job.input("table")?, self.axes)?;
        let frames = locs.frames(job)?;
        let columns = [&self.time, &self.x, &self.y, &self.z].map(|column| &**column);
        let samples = samples(&job.input("events")?, columns, self.unit_length)?;
        let curve = samples.curve(self.median)?;
        let count = curve.times.len();
        let estimate = Estimate {
            error: vec![[0.0; 3]; curve.times.len()],
            curve,
            interpolation: self.interpolation.into(),
            ..Estimate::default()
        };
        let drift = Drift::of(&estimate, &frames, self.reference);
        let report = known(&drift, &frames, locs.axes(), &estimate.curve);
        let caption = format!("Recorded drift, {count} samples.");
        finish(job, &locs, &frames, &drift, &report, &caption)
    }
}

puncta_sdk::register!(Transmitted);

#[cfg(test)]
mod tests {
    use super::*;
    use puncta_testkit::{Call, Table};

    #[test]
    fn the_drift_is_subtracted_at_each_time() {
        let table = Table::new("locs")
            .f64("x", "nm", &[10.0, 20.0, 30.0, f64::NAN])
            .f64("y", "nm", &[1.0, 2.0, 3.0, 4.0])
            .f64("t", "frame", &[50.0, 0.0, 1e6, 0.0]);
        let drift = Table::new("drift")
            .f64("t", "frame", &[100.0, 0.0])
            .f64("x", "1", &[8.0, 0.0])
            .f64("y", "1", &[-4.0, 0.0]);
        let call = Call::of::<Transmitted>()
            .input("table", table)
            .input("events", drift);
        let done = call.set("median", 1).run().unwrap();
        let column = |name: &str| done.output("table").unwrap().f64(name).unwrap();
        assert_eq!(column("x")[..3], [6.0, 20.0, 22.0]);
        assert!(column("x")[3].is_nan());
        assert_eq!(column("y"), [3.0, 2.0, 7.0, 4.0]);
        assert_eq!(
            done.output("drift").unwrap().f64("t").unwrap(),
            [0.0, 50.0, 1e6]
        );
    }
}
