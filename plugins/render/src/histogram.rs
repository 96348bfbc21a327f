//! The operation `puncta.render.histogram/1`.

use crate::channels::{self, Want};
use crate::histogram2d::{Counted, histogram2d};
use crate::output::{Entry, check, header, render, view, warn_invalid};
use crate::parameters::{Channels, Window};
use puncta_sdk::prelude::*;
use puncta_sdk::serde_json::json;

/// Counts the localisations in each pixel.
#[derive(Params)]
pub struct Histogram {
    /// Side of a pixel.
    #[param(default = 10, min = 1e-6, max = 1e9, unit = "nm")]
    pixel_size: f64,
    /// The field of view.
    #[param(flatten)]
    window: Window,
    /// The channels.
    #[param(flatten)]
    channels: Channels,
}

/// The columns of a table.
fn wants(_: &Header) -> Result<Vec<Want>, Failure> {
    Ok(["x", "y"].map(Want::position).into())
}

/// What the report tells of a channel.
pub(crate) fn entries(counted: &Counted) -> Vec<Entry> {
    vec![
        ("inside", counted.inside as f64, "Rows counted in a pixel"),
        (
            "outside",
            counted.outside as f64,
            "Rows outside the field of view",
        ),
        (
            "invalid",
            counted.invalid as f64,
            "Rows without a finite position, left out",
        ),
    ]
}

impl Operation for Histogram {
    const ID: &'static str = "puncta.render.histogram/1";

    fn info() -> Info {
        Info::operation("Histogram image")
            .description(
                "Counts the localisations in each pixel. Without bounds the image covers all \
                 localisations, and its pixels lie on a grid that starts at 0 nm, so that images \
                 of different tables fit onto each other. A pixel holds its low edges. Rows \
                 without a finite position are left out and counted in the report.",
            )
            .input(
                Ports::table("table")
                    .column("x", "nm")
                    .column("y", "nm")
                    .many(),
            )
            .output(Ports::image("image").description("Localisations per pixel, 32-bit float"))
            .output(Ports::report("report").description("Rows inside, outside and left out"))
            .example(json!({"pixel_size": 20}))
            .example_input("table", "puncta.synthetic.membrane/1", json!({}))
    }

    fn prepare(&self, request: &Request) -> Result<Plan, Failure> {
        let count = channels::count(request, &self.channels);
        check(request, &self.window.bounds(), self.pixel_size, count)?;
        let rows = request.rows();
        Ok(Plan {
            read: channels::reads(request, &self.channels, wants)?,
            // Sorted pixel numbers of a round, and a tile for each thread.
            memory: rows.min(1 << 24) * 8 + (8 << 20),
            interruptible: true,
            ..Plan::default()
        })
    }

    fn run(&self, job: &Job) -> Result<(), Failure> {
        let channels = channels::load(job, &self.channels, wants)?;
        let field = view(job, &self.window.bounds(), self.pixel_size, &channels, 0)?;
        let header = header(&field, "histogram", "1", &channels);
        render(job, header, &channels, |channel, out, run| {
            let (x, y) = (&channel.columns[0], &channel.columns[1]);
            let counted = histogram2d(x, y, &field, out, run)?;
            warn_invalid(job, counted.invalid, x.len(), "finite position");
            Ok(entries(&counted))
        })
    }
}

puncta_sdk::register!(Histogram);

#[cfg(test)]
mod tests {
    use super::*;
    use puncta_testkit::{Call, Table};

    fn table(x: &[f64], y: &[f64]) -> Table {
        Table::new("localisations")
            .f64("x", "nm", x)
            .f64("y", "nm", y)
    }

    #[test]
    fn an_image_a_report_and_a_warning() {
        let points = table(&[12.0, 18.0, 37.0, f64::NAN], &[-5.0, -5.0, 4.0, 0.0]);
        let done = Call::of::<Histogram>()
            .input("table", points)
            .run()
            .unwrap();
        let image = done.output("image").unwrap();
        assert_eq!(image.f32("value").unwrap(), [2.0, 0.0, 0.0, 0.0, 0.0, 1.0]);
        let info = image.header.image.as_ref().unwrap();
        assert_eq!(
            (info.size, info.voxel),
            ([1, 1, 1, 2, 3], [0.0, 10.0, 10.0])
        );
        assert_eq!(info.origin, [0.0, -10.0, 10.0]);
        let report = done.documents[0].to_string();
        assert!(
            report.contains("\"inside\"") && report.contains("3"),
            "{report}"
        );
        assert!(
            done.messages[0]
                .1
                .contains("1 of 4 row has no finite position"),
            "{:?}",
            done.messages
        );
    }

    #[test]
    fn bounds_are_kept() {
        let call = Call::of::<Histogram>().input("table", table(&[3.0, 14.0], &[0.0, 9.0]));
        let call = call
            .set("x_min", 4)
            .set("x_max", 24)
            .set("y_min", "-0.01 um")
            .set("y_max", 20);
        let done = call.run().unwrap();
        assert_eq!(
            done.output("image").unwrap().f32("value").unwrap(),
            [0.0, 0.0, 0.0, 1.0, 0.0, 0.0]
        );
    }

    #[test]
    fn what_cannot_be_rendered_is_one_sentence() {
        let empty = Call::of::<Histogram>()
            .input("table", table(&[], &[]))
            .run()
            .unwrap_err();
        assert!(
            empty.to_string().contains("no row has a finite x"),
            "{empty}"
        );
        let far = table(&[0.0, 1e9], &[0.0, 1e6]);
        let far = Call::of::<Histogram>()
            .input("table", far)
            .run()
            .unwrap_err();
        assert!(far.to_string().contains("use a pixel size of"), "{far}");
        let call = Call::of::<Histogram>().input("table", table(&[0.0], &[0.0]));
        let wrong = call
            .set("x_min", 5)
            .set("x_max", 5)
            .set("y_min", 0)
            .set("y_max", 9)
            .prepare();
        assert_eq!(wrong.unwrap_err().parameter.as_deref(), Some("x_max"));
        let call = Call::of::<Histogram>().input("table", table(&[0.0; 1000], &[0.0; 1000]));
        assert!(call.cancel_after(1).run().unwrap_err().is_cancelled());
    }

    /// Expected values: numpy.histogram2d of the same file with edges at multiples of 10 nm.
    #[test]
    fn real_localisations_as_another_program_counts_them() {
        let root = concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/data");
        let file = format!("{root}/pyme-smlm-import-tests/ThunderSTORM_TS3D.csv");
        let Ok(text) = std::fs::read_to_string(file) else {
            return;
        };
        let mut lines = text.lines();
        let names: Vec<&str> = lines
            .next()
            .unwrap()
            .split(',')
            .map(|n| n.trim_matches('"'))
            .collect();
        let place = |name: &str| names.iter().position(|n| *n == name).unwrap();
        let (px, py) = (place("x [nm]"), place("y [nm]"));
        let rows: Vec<Vec<f64>> = lines
            .map(|l| {
                l.split(',')
                    .map(|v| v.trim().parse().unwrap_or(f64::NAN))
                    .collect()
            })
            .collect();
        let x: Vec<f64> = rows.iter().map(|r| r[px]).collect();
        let y: Vec<f64> = rows.iter().map(|r| r[py]).collect();
        let done = Call::of::<Histogram>()
            .input("table", table(&x, &y))
            .run()
            .unwrap();
        let image = done.output("image").unwrap();
        assert_eq!(
            image.header.image.as_ref().unwrap().size,
            [1, 1, 1, 499, 490]
        );
        let values = image.f32("value").unwrap();
        assert_eq!(values.iter().sum::<f32>(), 11195.0);
        assert_eq!(values.iter().fold(0.0_f32, |a, b| a.max(*b)), 7.0);
        assert_eq!(values.iter().filter(|v| **v > 0.0).count(), 7381);
    }
}
