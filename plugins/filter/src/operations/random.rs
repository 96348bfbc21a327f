//! `puncta.filter.random/1`

use puncta_sdk::operation::default_plan;
use puncta_sdk::prelude::*;
use puncta_sdk::serde_json::json;

use crate::subset::{Size, subset_mask};

/// Keeps a random subset of the rows.
#[derive(Params)]
pub struct Random {
    /// Number of rows to keep; if it is not given, the fraction decides.
    pub count: Option<u64>,
    /// Share of the rows to keep, rounded to whole rows.
    #[param(default = 0.1, min = 0.0, max = 1.0)]
    pub fraction: f64,
    /// Refuse a table with fewer rows than count, instead of keeping all of them.
    #[param(default = false)]
    pub strict: bool,
    /// Seed of the random numbers.
    #[param(default = 0)]
    pub seed: Seed,
}

impl Random {
    fn size(&self, rows: u64) -> Size {
        match self.count {
            Some(count) if self.strict => Size::Count(count),
            Some(count) => Size::Count(count.min(rows)),
            None => Size::Fraction(self.fraction),
        }
    }
}

impl Operation for Random {
    const ID: &'static str = "puncta.filter.random/1";

    fn info() -> Info {
        Info::operation("Random subset")
            .description(
                "Keeps exactly so many rows, drawn at random without replacement.\nEvery subset \
                 of that size has the same probability; the same seed keeps the same rows.",
            )
            .input(Ports::table("table").description("Any table"))
            .output(Ports::selection("table", "table").description("The rows drawn"))
            .example(json!({ "count": 100, "seed": "1" }))
            .example_input("table", "puncta.synthetic.membrane/1", json!({}))
    }

    fn prepare(&self, request: &Request) -> Result<Plan, Failure> {
        if let Some(input) = request.inputs.first() {
            let rows = input.header.rows();
            self.size(rows)
                .of(usize::try_from(rows).unwrap_or(usize::MAX))?;
        }
        Ok(Plan {
            memory: super::memory(request),
            ..default_plan::<Self>(request)
        })
    }

    fn run(&self, job: &Job) -> Result<(), Failure> {
        let rows = job.input("table")?.rows();
        super::select(
            job,
            &subset_mask(rows, self.size(rows as u64), self.seed.0, job)?,
        )
    }
}

puncta_sdk::register!(Random);

#[cfg(test)]
mod tests {
    use super::*;
    use puncta_testkit::{Call, Table};

    fn call(rows: usize) -> Call {
        let table = Table::new("locs").f64("x", "nm", &vec![1.0; rows]);
        Call::of::<Random>().input("table", table)
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
    fn a_count_or_a_fraction_of_rows_is_kept() {
        assert_eq!(rows(call(200_000)).len(), 20_000);
        assert_eq!(rows(call(200_000).set("count", 7)).len(), 7);
        assert_eq!(rows(call(5).set("count", 7)), [0, 1, 2, 3, 4]);
        assert_eq!(rows(call(0)), [0; 0]);
        let seeded = |seed, threads| rows(call(200_000).set("seed", seed).threads(threads));
        assert_eq!(seeded("1", 1), seeded("1", 2));
        assert_ne!(seeded("1", 1), seeded("18446744073709551615", 1));
    }

    #[test]
    fn bad_sizes_are_refused_before_the_run() {
        let strict = call(5)
            .set("count", 7)
            .set("strict", true)
            .prepare()
            .unwrap_err();
        assert_eq!(
            strict.to_string(),
            "the table has 5 rows, fewer than 7; lower count, or clear strict"
        );
        assert!(call(5).set("fraction", 1.5).prepare().is_err());
        assert!(call(5).cancel_after(1).run().unwrap_err().is_cancelled());
    }

    #[test]
    fn no_column_is_read() {
        assert!(call(5).prepare().unwrap().read.is_empty());
    }
}
