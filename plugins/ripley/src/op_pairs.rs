//! The operation `puncta.ripley.pairs/1`.

use crate::bins::Bins;
use crate::pairs::{count_pairs, grid};
use crate::place::tables;
use crate::ripley::ball;
use crate::study::{bins, others, points, say, table, tell};
use puncta_sdk::documents::{Figure, Series};
use puncta_sdk::prelude::*;
use puncta_sdk::serde_json::json;
use puncta_shared_neighbours::Grid;

/// Counts pairs of localisations by distance.
#[derive(Params)]
pub struct Pairs {
    /// Width of a bin.
    #[param(default = 10, min = 1e-6, max = 1e9, unit = "nm")]
    step: f64,
    /// Distances counted are below this, rounded up to a whole bin.
    #[param(default = 1000, min = 1e-6, max = 1e9, unit = "nm")]
    r_max: f64,
    /// Column with the third coordinate, such as z; distances are in the plane if left out.
    z: Option<Column>,
}

impl Pairs {
    fn go<const D: usize>(&self, job: &Job) -> Result<(), Failure> {
        let bins = bins(self.step, self.r_max, Bins::from)?;
        let one = points::<D>(job, "table", self.z.as_ref())?;
        let two = others::<D>(job, self.z.as_ref())?;
        job.progress(0.0, "sorting")?;
        let source = grid(one.each_ref().map(|axis| &**axis), bins.radius(), job)?;
        tell(job, "table", source.left_out(), 0);
        let target = match &two {
            Some(two) => {
                let grid = Grid::new(two.each_ref().map(|axis| &**axis), source.edge(), job)?;
                tell(job, "other", grid.left_out(), 0);
                Some(grid)
            }
            None => None,
        };
        let ordered = match &target {
            Some(target) => source.len() as f64 * target.len() as f64,
            None => source.len() as f64 * (source.len() as f64 - 1.0) / 2.0,
        };
        if ordered <= 0.0 {
            let message = "there is no pair of localisations with finite positions";
            return Err(Failure::bad_input(message).remedy("give two localisations or more"));
        }
        job.progress(0.2, "counting pairs")?;
        let counts = count_pairs(&source, target.as_ref(), &bins, job)?;
        self.write::<D>(
            job,
            &bins,
            &counts,
            [source.len(), target.map_or(0, |grid| grid.len())],
        )
    }

    fn write<const D: usize>(
        &self,
        job: &Job,
        bins: &Bins,
        counts: &[u64],
        [one, two]: [usize; 2],
    ) -> Result<(), Failure> {
        let high = bins.upper();
        let low: Vec<f64> = (0..bins.len()).map(|k| k as f64 * bins.step()).collect();
        let pairs: Vec<f64> = counts.iter().map(|count| *count as f64).collect();
        let seen = if two > 0 { 1.0 } else { 2.0 };
        let shell = |k: usize| ball(D) * (high[k].powi(D as i32) - low[k].powi(D as i32));
        let density: Vec<f64> = (0..bins.len())
            .map(|k| seen * pairs[k] / one as f64 / shell(k))
            .collect();
        let per = if D == 2 { "nm^-2" } else { "nm^-3" };
        table(
            job,
            "histogram",
            &[
                ("r_low", "nm", "Low end of the bin, part of it", &low),
                ("r_high", "nm", "High end of the bin", &high),
                ("pairs", "1", "Pairs, each once", &pairs),
                (
                    "density",
                    per,
                    "Mean density of neighbours at this distance",
                    &density,
                ),
            ],
        )?;
        let within = if two > 0 {
            format!("between {one} and {two} localisations")
        } else {
            format!("of {one} localisations")
        };
        let mut figure = Figure::new(
            "figure",
            "Pair distances",
            ["distance", "nm"],
            ["pairs", "1"],
        );
        let bars = Series::columns("pairs", "bars", "histogram", "r_low", "pairs");
        figure.caption = format!(
            "Pairs {within} in {D} dimensions, bins of {} nm",
            bins.step()
        );
        job.figure(&figure.with(bars))?;
        let mut report = Report::new("report");
        say(
            &mut report,
            "localisations",
            one as f64,
            "1",
            "Localisations of the table",
        );
        if two > 0 {
            say(
                &mut report,
                "others",
                two as f64,
                "1",
                "Localisations of the other table",
            );
        }
        say(
            &mut report,
            "pairs",
            pairs.iter().sum(),
            "1",
            "Pairs in all bins",
        );
        job.report(&report)
    }
}

impl Operation for Pairs {
    const ID: &'static str = "puncta.ripley.pairs/1";

    fn info() -> Info {
        let info = Info::operation("Pair-distance histogram")
            .description(
                "Counts pairs of localisations by distance: of one table, each pair once and none \
                 with itself, or between two tables. A bin holds its low end. No region and no edge \
                 correction; see Ripley's K for both.",
            );
        tables(info, "Second set, such as another channel")
            .output(Ports::table("histogram").description("Pairs in each bin"))
            .output(Ports::figure("figure").description("Pairs by distance"))
            .output(Ports::report("report").description("Localisations and pairs"))
            .example(json!({"r_max": 500}))
            .example_input("table", "puncta.synthetic.membrane/1", json!({}))
            .cite("thesis, appendix B, Pairwise distances")
    }

    fn prepare(&self, request: &Request) -> Result<Plan, Failure> {
        bins(self.step, self.r_max, Bins::from)?;
        let mut plan = puncta_sdk::operation::default_plan::<Self>(request);
        plan.memory = request.rows() * 60 + (64 << 20);
        Ok(plan)
    }

    fn run(&self, job: &Job) -> Result<(), Failure> {
        if self.z.is_some() {
            self.go::<3>(job)
        } else {
            self.go::<2>(job)
        }
    }
}

puncta_sdk::register!(Pairs);

#[cfg(test)]
mod tests;
