//! The operation `puncta.ripley.nearest/1`.

use crate::bins::Bins;
use crate::nearest::{alive, border, clark_evans, kaplan_meier, lattice, nearest, shares};
use crate::place::{Place, Study, region, tables};
use crate::ripley::ball;
use crate::study::{Members, Region, bins, say, table};
use crate::window::Window;
use puncta_sdk::documents::{Figure, Series};
use puncta_sdk::prelude::*;
use puncta_sdk::serde_json::json;

/// Distances to nearest neighbours and empty space.
#[derive(Params)]
pub struct NearestNeighbours {
    /// Width of a bin, and step of the radius.
    #[param(default = 2, min = 1e-6, max = 1e9, unit = "nm")]
    step: f64,
    /// Largest distance, rounded up to a whole step.
    #[param(default = 200, min = 1e-6, max = 1e9, unit = "nm")]
    r_max: f64,
    /// Where.
    #[param(flatten)]
    place: Place,
    /// Places of the lattice from which the empty space is measured.
    #[param(default = 20000, min = 1, max = 10000000, advanced)]
    places: usize,
}

/// Distribution functions at the upper end of each bin.
struct Functions {
    counts: Vec<f64>,
    raw: Vec<f64>,
    g: Vec<f64>,
    f: Vec<f64>,
    j: Vec<f64>,
    random: Vec<f64>,
}

impl NearestNeighbours {
    fn functions<const D: usize>(
        &self,
        job: &Job,
        window: &dyn Window<D>,
        one: &Members<D>,
        of: &Members<D>,
        distances: &[f64],
        bins: &Bins,
    ) -> Result<Functions, Failure> {
        let radii = bins.upper();
        let last = bins.radius();
        let mut counts = vec![0.0; bins.len()];
        for distance in distances {
            if let Some(count) = counts.get_mut(bins.bin(distance * distance)) {
                *count += 1.0;
            }
        }
        let g = kaplan_meier(
            distances,
            &border(one.axes(), window, last, job)?,
            &radii,
            job,
        )?;
        alive(job)?;
        let places = lattice(window, self.places);
        let places = places.each_ref().map(Vec::as_slice);
        let empty = nearest(places, Some(of.axes()), job)?;
        let f = kaplan_meier(&empty, &border(places, window, last, job)?, &radii, job)?;
        let density = of.len() as f64 / window.volume();
        let power = i32::try_from(D).unwrap_or(2);
        let random = radii
            .iter()
            .map(|r| 1.0 - (-density * ball(D) * r.powi(power)).exp());
        Ok(Functions {
            counts,
            raw: shares(distances, &radii),
            j: g.iter()
                .zip(&f)
                .map(|(g, f)| {
                    if *f < 1.0 {
                        (1.0 - g) / (1.0 - f)
                    } else {
                        f64::NAN
                    }
                })
                .collect(),
            g,
            f,
            random: random.collect(),
        })
    }
}

fn write_table(job: &Job, bins: &Bins, functions: &Functions) -> Result<(), Failure> {
    let high = bins.upper();
    let low: Vec<f64> = (0..bins.len()).map(|k| k as f64 * bins.step()).collect();
    table(
        job,
        "histogram",
        &[
            ("r_low", "nm", "Low end of the bin, part of it", &low),
            ("r_high", "nm", "High end of the bin", &high),
            (
                "count",
                "1",
                "Localisations whose nearest neighbour is in the bin",
                &functions.counts,
            ),
            (
                "g_raw",
                "1",
                "Share with a neighbour up to r_high",
                &functions.raw,
            ),
            (
                "g",
                "1",
                "G at r_high, corrected for the boundary",
                &functions.g,
            ),
            (
                "f",
                "1",
                "F at r_high: share of space with a localisation so near",
                &functions.f,
            ),
            ("j", "1", "J = (1 - G) / (1 - F)", &functions.j),
            (
                "random",
                "1",
                "G and F of complete spatial randomness",
                &functions.random,
            ),
        ],
    )
}

fn figures(job: &Job, caption: String) -> Result<(), Failure> {
    let axes = ["distance", "nm"];
    let mut histogram = Figure::new(
        "figure",
        "Nearest-neighbour distances",
        axes,
        ["localisations", "1"],
    );
    histogram.caption.clone_from(&caption);
    let bars = Series::columns("nearest neighbour", "bars", "histogram", "r_low", "count");
    job.figure(&histogram.with(bars))?;
    let mut curves = Figure::new("functions", "G and F", axes, ["share", "1"]);
    curves.caption = caption;
    let line = |label: &str, y: &str| Series::columns(label, "line", "histogram", "r_high", y);
    let curves = curves
        .with(line("G, neighbours", "g"))
        .with(line("F, empty space", "f"));
    job.figure(&curves.with(line("complete spatial randomness", "random")))
}

fn summary(report: &mut Report, distances: &[f64]) {
    let mean = distances.iter().sum::<f64>() / distances.len() as f64;
    let mut sorted: Vec<f64> = distances.to_vec();
    let (below, middle, _) = sorted.select_nth_unstable_by(distances.len() / 2, f64::total_cmp);
    let median = if distances.len() % 2 == 1 {
        *middle
    } else {
        (below.iter().copied().fold(0.0, f64::max) + *middle) / 2.0
    };
    say(
        report,
        "mean",
        mean,
        "nm",
        "Mean distance to the nearest neighbour",
    );
    say(
        report,
        "median",
        median,
        "nm",
        "Median distance to the nearest neighbour",
    );
}

impl Study for NearestNeighbours {
    fn place(&self) -> &Place {
        &self.place
    }

    fn study<const D: usize>(
        &self,
        job: &Job,
        region: &Region<impl Window<D>>,
    ) -> Result<(), Failure> {
        let window: &dyn Window<D> = &region.window;
        let bins = bins(self.step, self.r_max, Bins::from)?;
        let (one, two) = self.place.both(job, window)?;
        let found = two
            .as_ref()
            .map_or(one.len().saturating_sub(1), Members::len);
        if one.is_empty() || found == 0 {
            let message = format!("no localisation in the {} has a neighbour", region.origin);
            return Err(Failure::bad_input(message).remedy("give two localisations or more"));
        }
        job.progress(0.1, "finding nearest neighbours")?;
        let distances = nearest(one.axes(), two.as_ref().map(Members::axes), job)?;
        job.progress(0.6, "measuring empty space")?;
        let of = two.as_ref().unwrap_or(&one);
        let density = of.len() as f64 / window.volume();
        let functions = self.functions(job, window, &one, of, &distances, &bins)?;
        write_table(job, &bins, &functions)?;
        let what = match &two {
            Some(two) => format!("From {} localisations to {}", one.len(), two.len()),
            None => format!("{} localisations", one.len()),
        };
        let caption = format!(
            "{what} in a {} ({}); Kaplan-Meier correction for its boundary",
            window.describe(),
            region.origin
        );
        figures(job, caption)?;
        let mut report = Report::new("report");
        say(
            &mut report,
            "localisations",
            one.len() as f64,
            "1",
            "Localisations in the region",
        );
        if let Some(two) = &two {
            say(
                &mut report,
                "others",
                two.len() as f64,
                "1",
                "Those of the other table in it",
            );
        }
        let unit = if D == 2 { "nm^-2" } else { "nm^-3" };
        say(
            &mut report,
            "density",
            density,
            unit,
            "Density of the neighbours in the region",
        );
        summary(&mut report, &distances);
        if two.is_none() {
            let (ratio, score) = clark_evans(&distances, density, D);
            let text = "Mean distance over that of complete spatial randomness (Clark and Evans)";
            say(&mut report, "clark_evans", ratio, "1", text);
            if D == 2 {
                let text = "Its standard score, without correction for the boundary";
                say(&mut report, "clark_evans_score", score, "1", text);
            }
        }
        job.report(&report)
    }
}

impl Operation for NearestNeighbours {
    const ID: &'static str = "puncta.ripley.nearest/1";

    fn info() -> Info {
        let info = Info::operation("Nearest-neighbour distances, G and F")
            .description(
                "Distances from each localisation to the nearest other one, or to the nearest of \
                 another table: their histogram, their distribution function G, that of the empty \
                 space F, and J. The region is an outline, a mask, given bounds or the bounding box \
                 of the localisations.",
            );
        region(tables(info, "Neighbours, such as another channel"))
            .output(Ports::table("histogram").description("Counts and distribution functions"))
            .output(Ports::figure("figure").description("Nearest-neighbour distances"))
            .output(Ports::figure("functions").description("G and F"))
            .output(Ports::report("report").description("Mean, median, Clark and Evans"))
            .example(json!({"r_max": 100}))
            .example_input("table", "puncta.synthetic.membrane/1", json!({}))
            .cite("Baddeley and Gill, Ann. Stat. 25, 263 (1997)")
            .cite("Clark and Evans, Ecology 35, 445 (1954)")
    }

    fn prepare(&self, request: &Request) -> Result<Plan, Failure> {
        bins(self.step, self.r_max, Bins::from)?;
        self.place.plan::<Self>(request, 120)
    }

    fn run(&self, job: &Job) -> Result<(), Failure> {
        self.run_in_region(job)
    }
}

puncta_sdk::register!(NearestNeighbours);

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
    fn distances_within_and_between() {
        let one = table(&[0.0, 3.0, 100.0, f64::NAN], &[0.0, 4.0, 100.0, 0.0]);
        let call = Call::of::<NearestNeighbours>()
            .input("table", one.clone())
            .set("step", 5);
        let done = call.run().expect("valid");
        let counts = done
            .output("histogram")
            .expect("finished")
            .f64("count")
            .expect("there");
        assert_eq!((counts[0], counts[1], counts[27]), (0.0, 2.0, 1.0));
        let call = Call::of::<NearestNeighbours>()
            .input("table", one)
            .set("step", 5);
        let two = table(&[0.0, 90.0], &[1.0, 100.0]);
        let done = call.input("other", two).run().expect("valid");
        let counts = done
            .output("histogram")
            .expect("finished")
            .f64("count")
            .expect("there");
        assert_eq!(counts[..3], [2.0, 0.0, 1.0]);
    }

    #[test]
    fn nothing_to_measure_is_said() {
        let say = |x: &[f64], y: &[f64], text: &str| {
            let call = Call::of::<NearestNeighbours>().input("table", table(x, y));
            let failure = call.run().expect_err(text).to_string();
            assert!(failure.contains(text), "{failure}");
        };
        say(&[], &[], "no row has a finite position");
        say(&[f64::NAN], &[1.0], "no row has a finite position");
        say(&[1.0], &[1.0], "no width along x");
        say(&[1.0; 9], &[1.0; 9], "no width along x");
        let call = Call::of::<NearestNeighbours>().input("table", table(&[1.0], &[1.0]));
        let call = call
            .set("x_min", 0)
            .set("x_max", 9)
            .set("y_min", 0)
            .set("y_max", 9);
        let failure = call.run().expect_err("one row").to_string();
        assert!(failure.contains("has a neighbour"), "{failure}");
    }

    #[test]
    fn coincident_rows_have_distance_0() {
        let call = Call::of::<NearestNeighbours>().input("table", table(&[1.0; 50], &[1.0; 50]));
        let call = call
            .set("x_min", 0)
            .set("x_max", 9)
            .set("y_min", 0)
            .set("y_max", 9);
        let done = call.run().expect("valid");
        let histogram = done.output("histogram").expect("finished");
        assert_eq!(histogram.f64("count").expect("there")[0], 50.0);
    }
}
