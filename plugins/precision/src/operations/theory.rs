//! The operation `puncta.precision.theory/1`.

use crate::histogram::{Estimate, median};
use crate::theory::{self, precision};
use puncta_sdk::documents::number;
use puncta_sdk::operation::default_plan;
use puncta_sdk::prelude::*;
use puncta_sdk::run::chunks_mut;
use puncta_sdk::serde_json::json;

/// Rows that one task takes.
const CHUNK: usize = 1 << 15;

/// How positions were fitted.
#[derive(Choice, Clone, Copy, Debug, PartialEq, Eq)]
enum Estimator {
    /// Least squares of a Gaussian.
    LeastSquares,
    /// Maximum likelihood.
    MaximumLikelihood,
}

/// Precision that photon counting allows.
#[derive(Params)]
pub struct Theory {
    /// How the positions were fitted.
    #[param(default = Estimator::MaximumLikelihood)]
    estimator: Estimator,
    /// Side of a camera pixel.
    #[param(default = 100, min = 1e-3, max = 1e6, unit = "nm")]
    camera_pixel: f64,
    /// Standard deviation of a spot where the table has no column sig.
    #[param(min = 1e-3, max = 1e6, unit = "nm")]
    spot: Option<f64>,
    /// Background photons of a pixel where the table has no column background; 0 if left out.
    #[param(min = 0, max = 1e9, unit = "photon")]
    background: Option<f64>,
    /// Whether the camera multiplied its electrons, which doubles the variance.
    #[param(default = false)]
    multiplied: bool,
}

impl Theory {
    /// Whether the column is read; refused in another unit.
    fn has(header: &Header, name: &str, unit: &str) -> Result<bool, Failure> {
        match header.column(name) {
            None => Ok(false),
            Some(info) if info.unit == unit => Ok(true),
            Some(info) => {
                let message = format!(
                    "column {name} of {} is in {}, not in {unit}",
                    header.name, info.unit
                );
                Err(Failure::bad_input(message).remedy("give the column its unit first"))
            }
        }
    }
}

impl Operation for Theory {
    const ID: &'static str = "puncta.precision.theory/1";

    fn info() -> Info {
        Info::operation("Precision that photon counting allows")
            .description(
                "Adds the column error_theory: the standard deviation that a position has for its \
                 photon number, spot width (column sig), background (column background, photons a \
                 pixel) and pixel size. Rows whose photons, width or background make no sense get \
                 nan.",
            )
            .cite("Mortensen et al., Nature Methods 7, 377 (2010)")
            .cite("Rieger and Stallinga, ChemPhysChem 15, 664 (2014)")
            .input(Ports::table("table").column("nPhotons", "photon"))
            .output(Ports::columns("table", "table").description("With error_theory, nm"))
            .output(Ports::report("report").description(
                "Median of error_theory, and of error_x over it where the table has error_x",
            ))
            .example(json!({}))
            .example_input("table", "puncta.synthetic.membrane/1", json!({}))
    }

    fn prepare(&self, request: &Request) -> Result<Plan, Failure> {
        let mut plan = default_plan::<Self>(request);
        let Some(input) = request.inputs.first() else {
            return Ok(plan);
        };
        let mut more = Vec::new();
        for (name, unit) in [("sig", "nm"), ("background", "photon"), ("error_x", "nm")] {
            if Self::has(&input.header, name, unit)? {
                more.push(name.to_owned());
            }
        }
        if self.spot.is_none() && !more.iter().any(|name| name == "sig") {
            let message = format!("{} has no column sig", input.header.name);
            return Err(Failure::bad_parameter("spot", message).remedy("give the width of a spot"));
        }
        if let Some(read) = plan.read.first_mut() {
            read.columns.extend(more);
        }
        Ok(plan)
    }

    fn run(&self, job: &Job) -> Result<(), Failure> {
        let table = job.input("table")?;
        let column = |name: &str| {
            let read = table.names(0).iter().any(|known| known == name);
            read.then(|| table.f64(name)).transpose()
        };
        let photons = table.f64("nPhotons")?;
        let (spots, backgrounds) = (column("sig")?, column("background")?);
        let errors = column("error_x")?;
        let info = ColumnInfo::new("error_theory", Element::F64, "nm")
            .role("error")
            .description("Precision that photon counting allows");
        let mut out = job.add_columns("table", [info])?;
        out.commit(0, photons.len() as u64)?;
        let estimator = match self.estimator {
            Estimator::LeastSquares => theory::Estimator::LeastSquares,
            Estimator::MaximumLikelihood => theory::Estimator::MaximumLikelihood,
        };
        let of = |row: usize| {
            let spot = spots
                .as_ref()
                .map_or(self.spot.unwrap_or(f64::NAN), |s| s[row]);
            let background = backgrounds
                .as_ref()
                .map_or(self.background.unwrap_or(0.0), |b| b[row]);
            let pixel = self.camera_pixel;
            precision(
                estimator,
                photons[row],
                spot,
                pixel,
                background,
                self.multiplied,
            )
        };
        let to = out.f64_mut("error_theory")?;
        chunks_mut(job, to, CHUNK, &|chunk, to| {
            if !job.cancelled() {
                for (i, to) in to.iter_mut().enumerate() {
                    *to = of(chunk * CHUNK + i);
                }
            }
        });
        job.progress(0.8, "taking the medians")?;
        let mut values: Vec<f64> = to.iter().copied().filter(|v| v.is_finite()).collect();
        values.sort_unstable_by(f64::total_cmp);
        let ratio = errors.map(|errors| {
            let pairs = errors.iter().zip(to.iter());
            let mut ratios: Vec<f64> = pairs
                .map(|(e, t)| e / t)
                .filter(|r| r.is_finite())
                .collect();
            ratios.sort_unstable_by(f64::total_cmp);
            median(&ratios)
        });
        let left_out = photons.len() - values.len();
        out.finish()?;
        job.report(&report(median(&values), ratio, left_out))
    }
}

fn report(error: Estimate, ratio: Option<Estimate>, left_out: usize) -> Report {
    let mut report = Report::new("report");
    let mut add = |name: &str, found: Estimate, unit: &str, text: &str| {
        let value = report.number(name, found.value, unit);
        value.interval = Some(found.interval.map(number::to_value));
        value.description = Some(text.into());
    };
    add(
        "median",
        error,
        "nm",
        "Median of error_theory; interval between order statistics",
    );
    if let Some(ratio) = ratio {
        let text = "Median of error_x over error_theory; interval between order statistics";
        add("ratio", ratio, "1", text);
    }
    let text = "Rows without a positive photon number and width, nan";
    report.number("left_out", left_out as f64, "1").description = Some(text.into());
    report
}

puncta_sdk::register!(Theory);

#[cfg(test)]
mod tests {
    use super::super::testing::value;
    use super::*;
    use puncta_testkit::{Call, Table};

    fn table(photons: &[f64]) -> Table {
        Table::new("locs").f64("nPhotons", "photon", photons)
    }

    #[test]
    fn columns_or_parameters_give_the_precision() {
        let photons = [1000.0, 4000.0, 0.0, f64::NAN];
        let whole = table(&photons)
            .f64("sig", "nm", &[130.0; 4])
            .f64("background", "photon", &[10.0; 4])
            .f64("error_x", "nm", &[11.0; 4]);
        let call = |table: Table| Call::of::<Theory>().input("table", table);
        let done = call(whole).set("estimator", "least_squares").run().unwrap();
        let found = done.output("table").unwrap().f64("error_theory").unwrap();
        // sqrt(39.4294) by hand.
        assert!((found[0] - 6.279_287).abs() < 1e-5 && found[2].is_nan() && found[3].is_nan());
        assert_eq!(value(&done, "left_out").0, 2.0);
        assert!(value(&done, "ratio").0 > 1.0);
        let bare = || call(table(&photons)).set("estimator", "least_squares");
        assert_eq!(
            bare().prepare().unwrap_err().parameter.as_deref(),
            Some("spot")
        );
        let done = bare().set("spot", 130).set("background", 10).run().unwrap();
        let again = done.output("table").unwrap().f64("error_theory").unwrap();
        assert_eq!(again[..2], found[..2]);
        let wrong = table(&photons).f64("sig", "um", &[0.13; 4]);
        assert!(
            call(wrong)
                .prepare()
                .unwrap_err()
                .to_string()
                .contains("not in nm")
        );
    }

    #[test]
    fn empty_tables_and_stops() {
        let call = |photons: &[f64]| {
            Call::of::<Theory>()
                .input("table", table(photons))
                .set("spot", 99)
        };
        let done = call(&[]).run().unwrap();
        assert!(value(&done, "median").0.is_nan());
        assert!(
            call(&[1.0; 10])
                .cancel_after(2)
                .run()
                .unwrap_err()
                .is_cancelled()
        );
    }
}
