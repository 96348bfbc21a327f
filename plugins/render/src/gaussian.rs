//! The operation `puncta.render.gaussian/1`.

use crate::field::Bounds;
use crate::gaussian2d::{ROUND_ROWS, gaussian2d};
use crate::output::{check, header, view, warn_invalid};
use crate::spots::{Gaussians, Sigma};
use puncta_sdk::documents::{Read, units};
use puncta_sdk::prelude::*;
use puncta_sdk::serde_json::json;
use puncta_sdk::{Input, operation::default_plan};
use std::borrow::Cow;

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
    /// Low edge of the image in x; from the data if left out.
    #[param(unit = "nm")]
    x_min: Option<f64>,
    /// High edge of the image in x; from the data if left out.
    #[param(unit = "nm")]
    x_max: Option<f64>,
    /// Low edge of the image in y; from the data if left out.
    #[param(unit = "nm")]
    y_min: Option<f64>,
    /// High edge of the image in y; from the data if left out.
    #[param(unit = "nm")]
    y_max: Option<f64>,
    /// Added on each side whose edge comes from the data.
    #[param(default = 0, min = 0, max = 1e9, unit = "nm", advanced)]
    margin: f64,
}

/// A column of standard deviations, and the factor that brings it to nm.
struct SigmaColumn<'a> {
    name: &'a str,
    factor: f64,
}

impl Gaussian {
    fn bounds(&self) -> Bounds {
        let &Gaussian {
            x_min,
            x_max,
            y_min,
            y_max,
            margin,
            ..
        } = self;
        Bounds {
            x_min,
            x_max,
            y_min,
            y_max,
            margin,
        }
    }

    /// The columns of standard deviations; None with one for all. A table with an error in x only
    /// uses that in y too.
    fn sigma_columns<'a>(
        &'a self,
        header: &Header,
    ) -> Result<Option<[SigmaColumn<'a>; 2]>, Failure> {
        if self.sigma.is_some() {
            return Ok(None);
        }
        let find = |parameter: &str, name: &'a str| {
            let info = header.column(name).ok_or_else(|| {
                let message = format!("there is no column {name} in {}", header.name);
                Failure::bad_input(message)
                    .parameter(parameter)
                    .remedy(format!(
                        "name a column in {parameter}, or give one width for all in sigma"
                    ))
            })?;
            let factor = units::conversion(&info.unit, "nm").map_err(|why| {
                Failure::bad_input(format!("column {name} cannot be a width: {why}"))
                    .parameter(parameter)
            })?;
            Ok::<_, Failure>(SigmaColumn { name, factor })
        };
        let x = find("sigma_x", &self.sigma_x)?;
        let only_x = header.column(&self.sigma_y).is_none() && *self.sigma_y == *"error_y";
        let y = find(
            "sigma_y",
            if only_x { &self.sigma_x } else { &self.sigma_y },
        )?;
        Ok(Some([x, y]))
    }
}

/// Standard deviations of a column in nm.
fn in_nm<'a>(table: &Input<'a>, column: &SigmaColumn<'_>) -> Result<Cow<'a, [f64]>, Failure> {
    let mut values = table.f64(column.name)?;
    if column.factor != 1.0 {
        values.to_mut().iter_mut().for_each(|v| *v *= column.factor);
    }
    Ok(values)
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
            .input(Ports::table("table").column("x", "nm").column("y", "nm"))
            .output(Ports::image("image").description("Sum per pixel, 32-bit float"))
            .output(Ports::report("report").description("Rows rendered, outside and left out"))
            .cite("Smith et al., Nature Methods 7, 373 (2010), equation 1")
            .example(json!({"pixel_size": 10, "sigma": 15}))
            .example_input("table", "puncta.synthetic.membrane/1", json!({}))
    }

    fn prepare(&self, request: &Request) -> Result<Plan, Failure> {
        check(request, &self.bounds(), self.pixel_size)?;
        let mut plan = default_plan::<Self>(request);
        let Some(input) = request.inputs.first() else {
            return Ok(plan);
        };
        let mut names = vec!["x".to_owned(), "y".to_owned()];
        if let Some(columns) = self.sigma_columns(&input.header)? {
            names.extend(columns.iter().map(|c| c.name.to_owned()));
        }
        if let Some(weight) = &self.weight {
            if input.header.column(weight).is_none() {
                let message = format!("there is no column {} in {}", weight.0, input.header.name);
                return Err(Failure::bad_input(message)
                    .parameter("weight")
                    .remedy("name another, or leave it out"));
            }
            names.push(weight.0.clone());
        }
        let mut seen = std::collections::BTreeSet::new();
        names.retain(|name| seen.insert(name.clone()));
        plan.read = vec![Read {
            input: 0,
            part: 0,
            columns: names,
        }];
        // Sorted localisations of a round, and a tile for each thread.
        plan.memory = input.header.rows().min(ROUND_ROWS as u64) * 96 + (64 << 20);
        Ok(plan)
    }

    fn run(&self, job: &Job) -> Result<(), Failure> {
        let table = job.input("table")?;
        let (x, y) = (table.f64("x")?, table.f64("y")?);
        let field = view(job, &self.bounds(), self.pixel_size, &x, &y)?;
        let columns = self.sigma_columns(table.header())?;
        let columns = columns
            .map(|[x, y]| Ok::<_, Failure>((in_nm(&table, &x)?, in_nm(&table, &y)?)))
            .transpose()?;
        let fixed = Sigma::Fixed(self.sigma.unwrap_or(0.0));
        let (sigma_x, sigma_y) = match &columns {
            Some((x, y)) => (Sigma::Column(x), Sigma::Column(y)),
            None => (fixed, fixed),
        };
        let weight = self
            .weight
            .as_ref()
            .map(|name| table.f64(name))
            .transpose()?;
        let spots = Gaussians {
            x: &x,
            y: &y,
            sigma_x,
            sigma_y,
            weight: weight.as_deref(),
            sigma_min: self.sigma_min,
            scale: if columns.is_some() { self.scale } else { 1.0 },
        };
        let mut image = job.begin("image", header(&field, "gaussian", "1"))?;
        image.commit(0, field.pixels() as u64)?;
        let rendered = gaussian2d(&spots, &field, image.f32_mut("value")?, job)?;
        image.finish()?;
        warn_invalid(job, rendered.invalid, x.len(), "finite position and width");
        let mut report = Report::new("report");
        let mut add = |name: &str, value: f64, text: &str| {
            report.number(name, value, "1").description = Some(text.into());
        };
        add(
            "rendered",
            rendered.rendered as f64,
            "Rows that give something to the image",
        );
        add(
            "outside",
            rendered.outside as f64,
            "Rows of which nothing falls in the field of view",
        );
        add(
            "invalid",
            rendered.invalid as f64,
            "Rows without a finite position, width and weight, left out",
        );
        add("sum", rendered.sum, "Sum of the image");
        job.report(&report)
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
