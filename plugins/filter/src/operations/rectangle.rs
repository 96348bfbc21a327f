//! `puncta.filter.rectangle/1`

use puncta_sdk::operation::default_plan;
use puncta_sdk::prelude::*;
use puncta_sdk::serde_json::json;

use crate::rectangle::rectangle_mask;

/// Keeps the rows whose point lies in a rectangle.
#[derive(Params)]
pub struct Rectangle {
    /// Lowest x.
    #[param(default = f64::NEG_INFINITY, unit = "nm")]
    pub x_min: f64,
    /// Highest x.
    #[param(default = f64::INFINITY, unit = "nm")]
    pub x_max: f64,
    /// Lowest y.
    #[param(default = f64::NEG_INFINITY, unit = "nm")]
    pub y_min: f64,
    /// Highest y.
    #[param(default = f64::INFINITY, unit = "nm")]
    pub y_max: f64,
    /// Turn of the rectangle about its centre, positive from the x axis towards the y axis.
    #[param(default = 0.0, unit = "rad")]
    pub angle: f64,
}

impl Rectangle {
    fn shape(&self) -> crate::rectangle::Rectangle {
        crate::rectangle::Rectangle {
            x: [self.x_min, self.x_max],
            y: [self.y_min, self.y_max],
            angle: self.angle,
        }
    }
}

impl Operation for Rectangle {
    const ID: &'static str = "puncta.filter.rectangle/1";

    fn info() -> Info {
        Info::operation("Filter by a rectangle")
            .description(
                "Keeps the rows whose point lies in a rectangle of the x y plane, its boundary \
                 included.\nThe rectangle may be turned about its centre; then its limits are \
                 those before the turn, and finite. NaN lies outside.",
            )
            .input(
                Ports::table("table")
                    .column("x", "nm")
                    .column("y", "nm")
                    .description("A table of points"),
            )
            .output(Ports::selection("table", "table").description("The rows in the rectangle"))
            .example(json!({ "x_min": 0, "y_min": -20, "y_max": 20 }))
            .example_input("table", "puncta.synthetic.membrane/1", json!({}))
    }

    fn prepare(&self, request: &Request) -> Result<Plan, Failure> {
        self.shape().check()?;
        Ok(Plan {
            memory: super::memory(request),
            ..default_plan::<Self>(request)
        })
    }

    fn run(&self, job: &Job) -> Result<(), Failure> {
        let table = job.input("table")?;
        let (x, y) = (table.f64("x")?, table.f64("y")?);
        super::select(job, &rectangle_mask(&x, &y, &self.shape(), job)?)
    }
}

puncta_sdk::register!(Rectangle);

#[cfg(test)]
mod tests {
    use super::*;
    use puncta_testkit::{Call, Table};

    fn call() -> Call {
        let table = Table::new("locs")
            .f64("x", "nm", &[0.0, 3.0, 4.0, 0.0, f64::NAN])
            .f64("y", "nm", &[0.0, 3.0, 0.0, 4.1, 0.0]);
        Call::of::<Rectangle>().input("table", table)
    }

    fn rows(call: Call) -> Vec<u32> {
        call.run()
            .unwrap()
            .output("table")
            .unwrap()
            .u32("row")
            .unwrap()
    }

    #[test]
    fn points_in_the_rectangle_are_selected() {
        assert_eq!(rows(call()), [0, 1, 2, 3]);
        let square = || {
            call()
                .set("x_min", -3)
                .set("x_max", 3)
                .set("y_min", -3)
                .set("y_max", 3)
        };
        assert_eq!(rows(square()), [0, 1]);
        // Turned by 45 degrees its half diagonal, 4.24 nm, lies along the axes.
        assert_eq!(rows(square().set("angle", "45 deg")), [0, 2, 3]);
    }

    #[test]
    fn bad_rectangles_are_refused_before_the_run() {
        let inverted = call()
            .set("x_min", 5)
            .set("x_max", 3)
            .prepare()
            .unwrap_err();
        assert_eq!(
            inverted.to_string(),
            "the range of x runs from 5 down to 3; swap its limits"
        );
        let endless = call().set("angle", 1.0).prepare().unwrap_err();
        assert_eq!(endless.parameter.as_deref(), Some("angle"));
        assert!(call().cancel_after(1).run().unwrap_err().is_cancelled());
    }
}
