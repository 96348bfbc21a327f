//! `puncta.chaining.estimate/1`

use crate::chain::chain;
use crate::columns::{check_length, length};
use crate::pairs::{BINS, Distances, dark_frames, distances, gap};
use crate::spots::{Radius, Rows, spots};
use puncta_sdk::documents::Read;
use puncta_sdk::operation::default_plan;
use puncta_sdk::prelude::*;
use puncta_sdk::serde_json::json;
use puncta_sdk::{Figure, Series};

/// Estimates the radius and the gap with which repeats are found.
#[derive(Params)]
pub struct Estimate {
    /// Column with the standard deviation in x and y, in units of whose combination the radius is estimated; in nm if left out.
    #[param(default = "error_x")]
    sigma: Option<Column>,
    /// Largest radius that is considered, in units of the combined standard deviation.
    #[param(default = 10, min = 0.1, max = 1e6, advanced)]
    largest_scale: f64,
    /// Largest radius that is considered, without a column.
    #[param(default = 200, min = 1e-3, max = 1e9, unit = "nm", advanced)]
    largest_radius: f64,
    /// Most dark frames that are considered.
    #[param(default = 20, min = 4, max = 1000, unit = "frame")]
    longest: u64,
}

impl Estimate {
    /// The largest radius in the unit of the estimate, and that unit.
    fn largest(&self) -> (f64, &'static str) {
        match self.sigma {
            Some(_) => (self.largest_scale, "1"),
            None => (self.largest_radius, "nm"),
        }
    }

    fn write(
        &self,
        job: &Job,
        found: &Distances,
        links: &[f64],
        level: f64,
    ) -> Result<(), Failure> {
        let (largest, unit) = self.largest();
        let columns = vec![
            ColumnInfo::new("distance", Element::F64, unit).description("Middle of the bin"),
            ColumnInfo::new("successive", Element::F64, "1")
                .description("Pairs in successive frames"),
            ColumnInfo::new("background", Element::F64, "1")
                .description("Pairs far apart in time, for one lag"),
        ];
        let mut out = job.begin(
            "distances",
            Header::table("distances", BINS as u64, columns),
        )?;
        let [distance, successive, background] =
            out.f64s_mut(["distance", "successive", "background"])?;
        for (bin, slot) in distance.iter_mut().enumerate() {
            *slot = (bin as f64 + 0.5) / BINS as f64 * largest;
        }
        successive.copy_from_slice(&found.successive);
        background.copy_from_slice(&found.background);
        out.finish()?;
        let columns = vec![
            ColumnInfo::new("dark_frames", Element::F64, "frame"),
            ColumnInfo::new("links", Element::F64, "1"),
            ColumnInfo::new("level", Element::F64, "1").description("Links after long dark times"),
        ];
        let header = Header::table("gaps", links.len() as u64, columns);
        let mut out = job.begin("gaps", header)?;
        let [dark, counts, levels] = out.f64s_mut(["dark_frames", "links", "level"])?;
        dark.iter_mut()
            .enumerate()
            .for_each(|(frame, slot)| *slot = frame as f64);
        counts.copy_from_slice(links);
        levels.fill(level);
        out.finish()
    }

    fn figures(&self, job: &Job, radius: f64, gap: usize) -> Result<(), Failure> {
        let (_, unit) = self.largest();
        let axis = match &self.sigma {
            Some(sigma) => format!("distance over combined {}", sigma.0),
            None => "distance".to_owned(),
        };
        let mut figure = Figure::new(
            "radius_figure",
            "Distances in successive frames",
            [&axis, unit],
            ["pairs", "1"],
        )
        .with(Series::columns(
            "successive",
            "line",
            "distances",
            "distance",
            "successive",
        ))
        .with(Series::columns(
            "far apart in time",
            "line",
            "distances",
            "distance",
            "background",
        ));
        figure.caption = format!(
            "Fewest errors at {radius:.4} {}.",
            if unit == "1" { "" } else { unit }
        );
        job.figure(&figure)?;
        let mut figure = Figure::new(
            "gap_figure",
            "Dark frames within chains",
            ["dark frames", "frame"],
            ["links", "1"],
        )
        .with(Series::columns(
            "links",
            "bars",
            "gaps",
            "dark_frames",
            "links",
        ))
        .with(Series::columns(
            "level of long ones",
            "line",
            "gaps",
            "dark_frames",
            "level",
        ));
        figure.caption = format!(
            "Links up to {} dark frames with this radius; more than twice the level of the longer \
             half up to {gap}.",
            self.longest
        );
        figure.logarithmic = "y".into();
        job.figure(&figure)
    }
}

impl Operation for Estimate {
    const ID: &'static str = "puncta.chaining.estimate/1";

    fn info() -> Info {
        Info::operation("Estimate radius and gap of repeats")
            .description(
                "The distances of localisations in successive frames, compared with those of \
                 localisations far apart in time, show how far repeats scatter. The radius is \
                 that with the fewest missed repeats and false links together; the gap the \
                 longest dark time, with this radius, after which more than twice as many chains \
                 go on as after long ones. Refused if there are no more near localisations in \
                 successive frames than by chance.",
            )
            .input(
                Ports::table("table")
                    .column("x", "nm")
                    .column("y", "nm")
                    .column("t", "frame")
                    .description("Localisations, in any order"),
            )
            .output(Ports::table("distances").description("Histogram of distances"))
            .output(Ports::table("gaps").description("Links by dark frames"))
            .output(Ports::report("report").description("Radius, gap, scatter of repeats"))
            .output(Ports::figure("radius_figure").description("Distances of pairs"))
            .output(Ports::figure("gap_figure").description("Dark frames within chains"))
            .example(json!({}))
            .example_input(
                "table",
                "puncta.synthetic.membrane/1",
                json!({ "fwhm_x": 100, "fwhm_y": 100, "frames": 2000 }),
            )
    }

    fn prepare(&self, request: &Request) -> Result<Plan, Failure> {
        let mut plan = default_plan::<Self>(request);
        let Some(input) = request.inputs.first() else {
            return Ok(plan);
        };
        let mut columns: Vec<String> = ["x", "y", "t"].map(Into::into).into();
        if let Some(sigma) = &self.sigma {
            check_length(&input.header, sigma, "sigma")?;
            if !columns.contains(&sigma.0) {
                columns.push(sigma.0.clone());
            }
        }
        plan.read = vec![Read {
            input: 0,
            part: 0,
            columns,
        }];
        plan.memory = input.header.rows() * 80 + (64 << 20);
        Ok(plan)
    }

    fn run(&self, job: &Job) -> Result<(), Failure> {
        let table = job.input("table")?;
        let (x, y, t) = (table.f64("x")?, table.f64("y")?, table.f64("t")?);
        let sigma = match &self.sigma {
            Some(name) => Some(length(&table, name, "sigma")?),
            None => None,
        };
        let rows = |scale: f64| Rows {
            x: &x,
            y: &y,
            t: &t,
            radius: match &sigma {
                Some(sigma) => Radius::Combined { sigma, scale },
                None => Radius::Constant(scale),
            },
            axial: None,
        };
        let (largest, unit) = self.largest();
        let found = distances(&spots(&rows(largest), job)?, self.longest, job)?;
        let bins = found.best().ok_or_else(|| {
            Failure::bad_input(
                "localisations in successive frames are no nearer to each other than by chance",
            )
            .remedy("choose radius and gap by hand, or skip this step: there may be no repeats")
        })?;
        let radius = bins as f64 / BINS as f64 * largest;
        job.progress(0.6, "finding gaps")?;
        let near = spots(&rows(radius), job)?;
        let chains = chain(&near, self.longest, job)?;
        let links = dark_frames(&near, &chains, self.longest);
        let (level, gap) = gap(&links);
        self.write(job, &found, &links, level)?;
        let mut report = Report::new("report");
        let name = if self.sigma.is_some() {
            "scale"
        } else {
            "radius"
        };
        report.number(name, radius, unit).description =
            Some("Radius with the fewest missed and false links together".into());
        report.number("gap", gap as f64, "frame").description = Some(
            "Longest dark time after which chains go on often, and more often than by chance"
                .into(),
        );
        let spread = found.spread(bins) * largest;
        // Of a pair in nm, each localisation has half of the variance.
        let spread = if self.sigma.is_some() {
            spread
        } else {
            spread / 2.0_f64.sqrt()
        };
        report.number("scatter", spread, unit).description = Some(
            match self.sigma {
                Some(_) => "Scatter of repeats over the stated errors; 1 if these are right",
                None => "Standard deviation of a localisation along one axis",
            }
            .into(),
        );
        job.report(&report)?;
        self.figures(job, radius, gap)
    }
}

puncta_sdk::register!(Estimate);

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{Random, Set};
    use puncta_testkit::{Call, Done, Table};

    /// Bursts of consecutive frames, some of which are missing, of precision 10 nm.
    fn set(molecules: usize, missing: f64) -> Set {
        let mut random = Random(77);
        let mut set = Set::default();
        for _ in 0..molecules {
            let at = [random.unit() * 20_000.0, random.unit() * 20_000.0];
            let mut t = (random.unit() * 2000.0).floor();
            loop {
                if random.unit() >= missing {
                    set.x.push(at[0] + 10.0 * random.normal());
                    set.y.push(at[1] + 10.0 * random.normal());
                    set.t.push(t);
                }
                t += 1.0;
                if random.unit() < 0.3 {
                    break;
                }
            }
        }
        set.sigma = vec![10.0; set.x.len()];
        set
    }

    fn call(set: &Set) -> Call {
        let table = Table::new("locs")
            .f64("x", "nm", &set.x)
            .f64("y", "nm", &set.y)
            .f64("t", "frame", &set.t)
            .f64("error_x", "nm", &set.sigma);
        Call::of::<Estimate>().input("table", table)
    }

    fn value(done: &Done, name: &str) -> f64 {
        done.value(name).unwrap()
    }

    #[test]
    fn radius_gap_and_scatter_of_bursts_are_found() {
        let done = call(&set(20_000, 0.05)).run().unwrap();
        let scale = value(&done, "scale");
        assert!((2.8..5.5).contains(&scale), "{scale}");
        assert!((value(&done, "scatter") - 1.0).abs() < 0.03);
        assert_eq!(value(&done, "gap"), 1.0);
        let steady = call(&set(20_000, 0.0)).run().unwrap();
        assert_eq!(value(&steady, "gap"), 0.0);
        let in_nm = call(&set(20_000, 0.05))
            .set("sigma", json!(null))
            .run()
            .unwrap();
        assert!((value(&in_nm, "scatter") - 10.0).abs() < 0.3);
        let radius = value(&in_nm, "radius");
        assert!((40.0..80.0).contains(&radius), "{radius}");
        let counts = done.output("distances").unwrap().f64("successive").unwrap();
        assert_eq!(counts.len(), BINS);
        assert_eq!(done.documents.len(), 3);
    }

    #[test]
    fn tables_without_repeats_are_refused() {
        let mut random = Random(5);
        let mut lone = Set::default();
        for _ in 0..20_000 {
            lone.x.push(random.unit() * 20_000.0);
            lone.y.push(random.unit() * 20_000.0);
            lone.t.push((random.unit() * 500.0).floor());
        }
        lone.sigma = vec![10.0; 20_000];
        let failure = call(&lone).run().unwrap_err();
        assert!(failure.message.contains("by chance"), "{failure}");
        assert!(call(&Set::default()).run().is_err());
        assert!(
            call(&lone)
                .cancel_after(2)
                .run()
                .unwrap_err()
                .is_cancelled()
        );
    }
}
