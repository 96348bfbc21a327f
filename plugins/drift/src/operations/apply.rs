//! `puncta.drift.apply/1`

use puncta_sdk::documents::manifest::Step;
use puncta_sdk::prelude::*;
use puncta_sdk::serde_json::json;

use super::{Between, samples, samples_plan};
use crate::correction::{Axes, Drift, Localisations, finish, input, known, outputs, plan};

/// Apply a drift.
#[derive(Params)]
pub struct Apply {
    /// Which axes are corrected; z where both tables have it.
    #[param(default = Axes::Auto)]
    axes: Axes,
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
    /// Factor on the drift; -1 takes a correction back.
    #[param(default = 1, min = -1e9, max = 1e9)]
    factor: f64,
    /// Between the samples.
    #[param(default = Between::Linear)]
    interpolation: Between,
}

impl Operation for Apply {
    const ID: &'static str = "puncta.drift.apply/1";

    fn info() -> Info {
        let drift = Ports::table("drift_table").any_column("$time");
        let info = Info::operation("Apply a drift")
            .description(
                "Subtracts a drift from the positions: the table that another step has found, or one from a file.\nIt is interpolated at the times of the table; before its first and after its last time the end values hold. Rows without a finite position and time are passed through.",
            )
            .input(input())
            .input(drift.any_column("$x").any_column("$y").description("Times and drift"));
        let synthetic = Step {
            op: "puncta.synthetic.membrane/1".into(),
            parameters: super::example(),
            ..Step::default()
        };
        let estimated = Step {
            op: "puncta.drift.entropy/1".into(),
            output: Some("drift".into()),
            inputs: [("table".to_owned(), synthetic)].into(),
            ..Step::default()
        };
        outputs(info)
            .example(json!({ "interpolation": "spline" }))
            .example_input(
                "table",
                "puncta.synthetic.membrane/1",
                super::example().into(),
            )
            .example_step("drift_table", estimated)
    }

    fn prepare(&self, request: &Request) -> Result<Plan, Failure> {
        let mut plan = plan::<Self>(request, self.axes)?;
        samples_plan(&mut plan, request, "drift_table", &self.z);
        Ok(plan)
    }

    fn run(&self, job: &Job) -> Result<(), Failure> {
        let locs = Localisations::read(&job.input("table")?, self.axes)?;
        let frames = locs.frames(job)?;
        let columns = [&self.time, &self.x, &self.y, &self.z].map(|column| &**column);
        let samples = samples(&job.input("drift_table")?, columns, self.factor)?;
        let curve = samples.curve(1)?;
        let count = curve.times.len();
        let drift = Drift {
            error: vec![[0.0; 3]; frames.times.len()],
            at: curve.at(&frames.times, self.interpolation.into()),
        };
        let report = known(&drift, &frames, locs.axes(), &curve);
        let caption = format!("Applied drift, {count} samples.");
        finish(job, &locs, &frames, &drift, &report, &caption)
    }
}

puncta_sdk::register!(Apply);

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
            .f64("x", "nm", &[8.0, 0.0])
            .f64("y", "nm", &[-4.0, 0.0]);
        let call = Call::of::<Apply>()
            .input("table", table)
            .input("drift_table", drift);
        let done = call.run().unwrap();
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
