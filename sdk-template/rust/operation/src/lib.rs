//! My plugin: the distance of each localisation from a point.

use puncta_sdk::prelude::*;
use puncta_sdk::serde_json::json;

plugin! { id: "lab.my-plugin", title: "My plugin", description: "Distances.", reentrant: true }

/// Adds the distance of each localisation from a point.
#[derive(Params)]
pub struct Distance {
    /// Position of the point along x.
    #[param(default = 0.0, unit = "nm")]
    x: f64,
    /// Position of the point along y.
    #[param(default = 0.0, unit = "nm")]
    y: f64,
}

impl Operation for Distance {
    const ID: &'static str = "lab.my-plugin.distance/1";

    fn info() -> Info {
        Info::operation("Distance from a point")
            .description("Adds a column with the distance of each localisation from a point.")
            .input(Ports::table("table").column("x", "nm").column("y", "nm"))
            .output(Ports::columns("table", "table"))
            .example(json!({"x": 100}))
    }

    fn run(&self, job: &Job) -> Result<(), Failure> {
        let table = job.input("table")?;
        let (x, y) = (table.f64("x")?, table.f64("y")?);
        let mut out =
            job.add_columns("table", [ColumnInfo::new("distance", Element::F64, "nm")])?;
        for (row, distance) in out.f64_mut("distance")?.iter_mut().enumerate() {
            if row % 65_536 == 0 {
                job.progress(row as f64 / x.len() as f64, "distances")?;
            }
            *distance = (x[row] - self.x).hypot(y[row] - self.y);
        }
        out.finish()
    }
}

register!(Distance);
