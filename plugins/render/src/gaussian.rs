//! The operation `puncta.render.gaussian/1`.

use crate::channels::{self, Want};
use crate::gaussian2d::{ROUND_ROWS, Rendered, gaussian2d};
use crate::output::{Entry, check, header, render, view, warn_invalid};
use crate::parameters::{Channels, Window};
use crate::spots::{Gaussians, Sigma};
use puncta_sdk::prelude::*;
use puncta_sdk::serde_json::json;

/// Renders each localisation as a Gaussian of its precision.
#[derive(Params)]
pub struct Gaussian {
    /// Side of a pixel.
    #[param(default = 5, min = 1e-6, max = 1e9, unit = "nm")]
    pixel_size: f64,
    /// Column with the standard deviation in x.
    #[param(default = "error_x")]
    sigma_x: Column,
    /// Column with the standard deviation in y.
    #[param(default = "error_y")]
    sigma_y: Column,
    /// One standard deviation for all localisations, instead of the columns.
    #[param(min = 0, max = 1e9, unit = "nm")]
    sigma: Option<f64>,
    /// Column with the sum of each localisation, such as its photons; 1 for all if left out.
    weight: Option<Column>,
    /// Factor on the standard deviations of the columns.
    #[param(default = 1, min = 0, max = 1e6, advanced)]
    scale: f64,
    /// Smallest standard deviation: smaller ones are raised to it.
    #[param(default = 0, min = 0, max = 1e9, unit = "nm", advanced)]
    sigma_min: f64,
    /// The field of view.
    #[param(flatten)]
    window: Window,
    /// The channels.
    #[param(flatten)]
    channels: Channels,
}

impl Gaussian {
    /// Positions, then widths unless one is given for all, then the weight.
    fn wants(&self, header: &Header) -> Result<Vec<Want>, Failure> {
        let mut all: Vec<Want> = ["x", "y"].map(Want::position).into();
        if self.sigma.is_none() {
            all.extend(widths(header, &self.sigma_x, &self.sigma_y));
        }
        let weight = self.weight.as_ref();
        all.extend(weight.map(|name| Want::named(name, "weight", None)));
        Ok(all)
    }
}

/// The columns of widths in x and y. A table with an error in x only uses that in y too.
pub(crate) fn widths(header: &Header, x: &str, y: &str) -> [Want; 2] {
    let only_x = header.column(y).is_none() && y == "error_y";
    [
        Want::named(x, "sigma_x", Some("nm")),
        Want::named(if only_x { x } else { y }, "sigma_y", Some("nm")),
    ]
}

/// What the report tells of a channel.
pub(crate) fn entries(rendered: &Rendered) -> Vec<Entry> {
    vec![
        (
            "rendered",
            rendered.rendered as f64,
            "Rows that give something to the image",
        ),
        (
            "outside",
            rendered.outside as f64,
            "Rows of which nothing falls in the field of view",
        ),
        (
            "invalid",
            rendered.invalid as f64,
            "Rows without a finite position, width and weight, left out",
        ),
        ("sum", rendered.sum, "Sum of the image"),
    ]
}

impl Operation for Gaussian {
    const ID: &'static str = "puncta.render.gaussian/1";

    fn info() -> Info {
        Info::operation("Gaussian image")
            .description(
                "Renders each localisation as a Gaussian of its precision, integrated over each \
                 pixel, cut off at four standard deviations and renormalised, so that each \
                 localisation adds up to 1 (or its weight) whatever its width. What falls outside \
                 the image is lost: give a margin to keep it. Without bounds the image covers all \
                 localisations, and its pixels lie on a grid that starts at 0 nm. Rows without a \
                 finite position, width and weight, and rows with a negative width, are left out \
                 and counted in the report.",
            )
            .input(
                Ports::table("table")
                    .column("x", "nm")
                    .column("y", "nm")
                    .many(),
            )
            .output(Ports::image("image").description("Sum per pixel, 32-bit float"))
            .output(Ports::report("report").description("Rows rendered, outside and left out"))
            .cite("Smith et al., Nature Methods 7, 373 (2010), equation 1")
            .example(json!({"pixel_size": 10, "sigma": 15}))
            .example_input("table", "puncta.synthetic.membrane/1", json!({}))
    }

    fn prepare(&self, request: &Request) -> Result<Plan, Failure> {
        let count = channels::count(request, &self.channels);
        check(request, &self.window.bounds(), self.pixel_size, count)?;
        let rows = request.rows();
        Ok(Plan {
            read: channels::reads(request, &self.channels, |header| self.wants(header))?,
            // Sorted localisations of a round, and a tile for each thread.
            memory: rows.min(ROUND_ROWS as u64) * 96 + (64 << 20),
            interruptible: true,
            ..Plan::default()
        })
    }

    fn run(&self, job: &Job) -> Result<(), Failure> {
        let channels = channels::load(job, &self.channels, |header| self.wants(header))?;
        let field = view(job, &self.window.bounds(), self.pixel_size, &channels, 0)?;
        let header = header(&field, "gaussian", "1", &channels);
        let fixed = Sigma::Fixed(self.sigma.unwrap_or(0.0));
        render(job, header, &channels, |channel, out, run| {
            let columns = &channel.columns;
            let (sigma_x, sigma_y) = match self.sigma {
                None => (Sigma::Column(&columns[2]), Sigma::Column(&columns[3])),
                Some(_) => (fixed, fixed),
            };
            let weight = self.weight.as_ref().and_then(|_| columns.last());
            let spots = Gaussians {
                x: &columns[0],
                y: &columns[1],
                sigma_x,
                sigma_y,
                weight: weight.map(|column| &**column),
                sigma_min: self.sigma_min,
                scale: if self.sigma.is_none() {
                    self.scale
                } else {
                    1.0
                },
            };
            let rendered = gaussian2d(&spots, &field, out, run)?;
            warn_invalid(
                job,
                rendered.invalid,
                columns[0].len(),
                "finite position and width",
            );
            Ok(entries(&rendered))
        })
    }
}

puncta_sdk::register!(Gaussian);

#[cfg(test)]
mod tests {
    use super::*;
    use puncta_testkit::{Call, Done, Table};

    fn table() -> Table {
        let table = Table::new("localisations").f64("x", "nm", &[50.0, 80.0]);
        table.f64("y", "nm", &[40.0, 70.0])
    }

    fn sum(done: &Done) -> f64 {
        let image = done.output("image").unwrap();
        image
            .f32("value")
            .unwrap()
            .iter()
            .map(|v| f64::from(*v))
            .sum()
    }

    fn call(table: Table) -> Call {
        Call::of::<Gaussian>()
            .set("margin", 100)
            .input("table", table)
    }

    #[test]
    fn widths_come_from_columns_in_their_unit_or_from_the_parameter() {
        let both = table()
            .f32("error_x", "nm", &[8.0, 16.0])
            .f64("error_y", "um", &[0.008, 0.016]);
        let both = call(both).run().unwrap();
        assert!((sum(&both) - 2.0).abs() < 1e-6);
        let only_x = call(table().f64("error_x", "nm", &[8.0, 16.0]))
            .run()
            .unwrap();
        let values = |done: &Done| done.output("image").unwrap().f32("value").unwrap();
        let near = |a: &[f32], b: &[f32]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-7);
        assert!(near(&values(&both), &values(&only_x)));
        let same = call(table().f64("s", "nm", &[9.0, 9.0]))
            .set("sigma_x", "s")
            .set("sigma_y", "s");
        let fixed = call(table()).set("sigma", "9 nm").run().unwrap();
        assert!(values(&same.run().unwrap()) == values(&fixed));
        let weighted = call(table().f64("nPhotons", "photon", &[100.0, 50.0])).set("sigma", 9);
        let weighted = weighted.set("weight", "nPhotons").run().unwrap();
        assert!((sum(&weighted) - 150.0).abs() < 1e-4);
        assert!(weighted.documents[0].to_string().contains("\"sum\""));
    }

    #[test]
    fn what_cannot_be_rendered_is_one_sentence() {
        let missing = call(table()).run().unwrap_err();
        assert!(
            missing.to_string().contains("there is no column error_x"),
            "{missing}"
        );
        assert!(missing.remedy.is_some_and(|r| r.contains("sigma")));
        let unit = call(table().f64("error_x", "px", &[1.0, 1.0]))
            .prepare()
            .unwrap_err();
        assert!(unit.to_string().contains("px"), "{unit}");
        let text = call(table().texts("error_x", &["a", "b"]))
            .run()
            .unwrap_err();
        assert!(
            text.to_string().contains("error_x cannot be a width"),
            "{text}"
        );
        let weight = call(table())
            .set("sigma", 5)
            .set("weight", "A")
            .prepare()
            .unwrap_err();
        assert_eq!(weight.parameter.as_deref(), Some("weight"));
        assert!(call(table()).set("sigma", -1).run().is_err());
        assert!(
            call(table())
                .set("sigma", 5)
                .cancel_after(2)
                .run()
                .unwrap_err()
                .is_cancelled()
        );
    }
}
