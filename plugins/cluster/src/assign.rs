//! `puncta.cluster.assign/1`

use crate::polygons::Polygons;
use puncta_sdk::documents::manifest::Step;
use puncta_sdk::prelude::*;
use puncta_sdk::run::chunks_mut;
use puncta_sdk::serde_json::json;
use puncta_sdk::{ColumnMut, Map};

/// Rows of a task.
const CHUNK: usize = 1 << 13;

/// Finds the outline that each localisation lies in.
#[derive(Params)]
pub struct Assign {}

impl Operation for Assign {
    const ID: &'static str = "puncta.cluster.assign/1";

    fn info() -> Info {
        let map = |value| match value {
            puncta_sdk::serde_json::Value::Object(map) => map,
            _ => Map::new(),
        };
        let membrane = Step {
            op: "puncta.synthetic.membrane/1".into(),
            parameters: map(json!({ "copies": 4 })),
            ..Step::default()
        };
        let outlines = Step {
            op: "puncta.cluster.boundaries/1".into(),
            parameters: map(json!({ "group": "copy" })),
            inputs: [("table".to_owned(), membrane)].into(),
            output: Some("outlines".into()),
        };
        Info::operation("Localisations within boundaries")
            .description(
                "Applies the outlines of one channel to another: outline_id is the number of the \
                 outline that a localisation lies in, the lowest of several, 0 outside. Holes are \
                 outside; a polygon that crosses itself is inside where it winds an odd number of \
                 times.",
            )
            .input(
                Ports::table("table")
                    .column("x", "nm")
                    .column("y", "nm")
                    .description("Localisations"),
            )
            .input(
                Ports::table("outlines")
                    .any_column("outline")
                    .any_column("ring")
                    .column("x", "nm")
                    .column("y", "nm")
                    .description("Vertices of closed polygons, by outline and ring"),
            )
            .output(Ports::columns("table", "table").description("With outline_id"))
            .output(Ports::report("report").description("Localisations inside and outside"))
            .example(json!({}))
            .example_input(
                "table",
                "puncta.synthetic.membrane/1",
                json!({ "copies": 4, "seed": "1" }),
            )
            .example_step("outlines", outlines)
    }

    fn run(&self, job: &Job) -> Result<(), Failure> {
        let (table, outlines) = (job.input("table")?, job.input("outlines")?);
        let polygons = Polygons::new(
            &outlines.f64("outline")?,
            &outlines.f64("ring")?,
            &outlines.f64("x")?,
            &outlines.f64("y")?,
        )?;
        let (x, y) = (table.f64("x")?, table.f64("y")?);
        let id = ColumnInfo::new("outline_id", Element::I32, "1").role("group");
        let id = id.description("Number of the outline that it lies in; 0 outside");
        let mut out = job.add_columns("table", [id])?;
        let ColumnMut::I32(ids) = out.column_mut(0, "outline_id")? else {
            return Err(Failure::internal("the host gave another column"));
        };
        job.progress(0.2, "looking up outlines")?;
        chunks_mut(job, ids, CHUNK, &|chunk, part| {
            if job.cancelled() {
                return;
            }
            for (i, id) in part.iter_mut().enumerate() {
                let row = chunk * CHUNK + i;
                *id = polygons.find(x[row], y[row]);
            }
        });
        if job.cancelled() {
            return Err(Failure::cancelled());
        }
        let inside = ids.iter().filter(|id| **id > 0).count();
        out.finish()?;
        let mut report = Report::new("report");
        report.number("inside", inside as f64, "1");
        report.number("outside", (table.rows() - inside) as f64, "1");
        job.report(&report)
    }
}

puncta_sdk::register!(Assign);

#[cfg(test)]
mod tests {
    use super::*;
    use crate::boundaries::Boundaries;
    use puncta_testkit::{Call, Table};

    #[test]
    fn the_boundaries_of_one_channel_hold_for_another() {
        let x = [
            0.0,
            10.0,
            10.0,
            0.0,
            5.0,
            100.0,
            110.0,
            105.0,
            f64::NAN,
            500.0,
        ];
        let y = [0.0, 0.0, 10.0, 10.0, 5.0, 0.0, 0.0, 10.0, 0.0, 500.0];
        let cluster = [1, 1, 1, 1, 1, 4, 4, 4, 4, 6];
        let red = Table::new("red").f64("x", "nm", &x).f64("y", "nm", &y).i32(
            "dbscanClumpID",
            "1",
            &cluster,
        );
        let done = Call::of::<Boundaries>().input("table", red).run().unwrap();
        let outlines = done.output("outlines").unwrap().clone();
        assert_eq!(outlines.header.shape.as_deref(), Some("outline"));
        assert_eq!(outlines.i32("outline").unwrap(), [1, 1, 1, 1, 4, 4, 4]);
        let values = &done.documents[0]["values"];
        assert_eq!(values[0]["value"], 2.0);
        assert_eq!(values[1]["value"], 1.0);
        assert_eq!(values[2]["value"], 150.0);
        let green = Table::new("green")
            .f64("x", "nm", &[5.0, 105.0, 101.0, 50.0, f64::NAN])
            .f64("y", "nm", &[1.0, 5.0, 9.0, 5.0, 5.0]);
        for threads in 1..=3 {
            let call = Call::of::<Assign>().threads(threads);
            let call = call
                .input("table", green.clone())
                .input("outlines", outlines.clone());
            let done = call.run().unwrap();
            assert_eq!(
                done.output("table").unwrap().i32("outline_id").unwrap(),
                [1, 4, 0, 0, 0]
            );
        }
        let call = Call::of::<Assign>().cancel_after(1);
        let call = call.input("table", green).input("outlines", outlines);
        assert!(call.run().unwrap_err().is_cancelled());
    }

    #[test]
    fn an_alpha_shape_has_a_hole_and_empty_tables_give_nothing() {
        let (mut x, mut y) = (vec![], vec![]);
        for k in 0..200 {
            let (sin, cos) = (f64::from(k) * 0.1).sin_cos();
            let radius = if k % 2 == 0 { 100.0 } else { 90.0 };
            x.push(radius * cos);
            y.push(radius * sin);
        }
        let ring = Table::new("ring")
            .f64("x", "nm", &x)
            .f64("y", "nm", &y)
            .u32("clumpIndex", "1", &[3; 200]);
        let call = Call::of::<Boundaries>()
            .set("group", "clumpIndex")
            .set("alpha", 20);
        let done = call
            .set("outline", "alpha")
            .input("table", ring)
            .run()
            .unwrap();
        let outlines = done.output("outlines").unwrap().clone();
        let points = Table::new("points").f64("x", "nm", &[0.0, 95.0, 0.0]).f64(
            "y",
            "nm",
            &[0.0, 0.0, -95.0],
        );
        let done = Call::of::<Assign>()
            .input("table", points)
            .input("outlines", outlines);
        let ids = done
            .run()
            .unwrap()
            .output("table")
            .unwrap()
            .i32("outline_id")
            .unwrap();
        assert_eq!(ids, [0, 3, 3]);
        let none = Table::new("none")
            .f64("x", "nm", &[])
            .f64("y", "nm", &[])
            .i32("dbscanClumpID", "1", &[]);
        let done = Call::of::<Boundaries>().input("table", none).run().unwrap();
        assert_eq!(done.output("outlines").unwrap().header.rows(), 0);
    }
}
