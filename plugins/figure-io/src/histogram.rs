//! The operation `puncta.figure.histogram/1`: how the values of a column are distributed.

use puncta_sdk::prelude::*;
use puncta_sdk::serde_json::json;
use puncta_sdk::{ColumnMut, Figure, Series};

/// Rows between two looks at cancel.
const BATCH: usize = 1 << 16;
/// Bins when nothing is said, at most.
const MOST_BINS: f64 = 512.0;

/// Counts the values of a column in bins of one width.
#[derive(Params)]
pub struct Histogram {
    /// Column.
    column: Column,
    /// Number of bins; by the rule of Freedman and Diaconis if nothing is said.
    #[param(min = 1, max = 100000)]
    bins: Option<u32>,
    /// Low end of the first bin; the smallest value if nothing is said.
    low: Option<f64>,
    /// High end of the last bin; the largest value if nothing is said.
    high: Option<f64>,
}

impl Operation for Histogram {
    const ID: &'static str = "puncta.figure.histogram/1";

    fn info() -> Info {
        Info::operation("Histogram of a column")
            .description(
                "Counts the values of a column in bins of one width and shows them. A value on the edge \
                 of two bins is in the upper one; the last bin takes in its high end.",
            )
            .input(Ports::table("table").any_column("$column"))
            .output(Ports::table("histogram").description("Middle of each bin, and its count."))
            .output(Ports::figure("figure"))
            .example(json!({"column": "x", "bins": 40}))
            .example_input("table", "puncta.synthetic.membrane/1", json!({}))
    }

    fn run(&self, job: &Job) -> Result<(), Failure> {
        let input = job.input("table")?;
        let values = input.f64(&self.column)?;
        let unit = input
            .header()
            .column(&self.column)
            .map_or("1", |column| column.unit.as_str());
        let (edges, counts, left_out) = self.count(&values, job)?;
        if left_out > 0 {
            job.warn(&format!(
                "{left_out} of {} values are missing or lie outside",
                values.len()
            ));
        }
        let columns = vec![
            ColumnInfo::new("value", Element::F64, unit).description("middle of the bin"),
            ColumnInfo::new("count", Element::U64, "1"),
        ];
        let mut out = job.begin(
            "histogram",
            Header::table("histogram", counts.len() as u64, columns),
        )?;
        let width = (edges[1] - edges[0]) / counts.len() as f64;
        for (i, value) in out.f64_mut("value")?.iter_mut().enumerate() {
            *value = edges[0] + (i as f64 + 0.5) * width;
        }
        for column in out.columns_mut(0)? {
            if let ColumnMut::U64(values) = column {
                values.copy_from_slice(&counts);
            }
        }
        out.finish()?;
        let name = &*self.column;
        let title = format!("Distribution of {name}");
        let counted: u64 = counts.iter().sum();
        let mut figure = Figure::new("figure", &title, [name, unit], ["count", "1"])
            .with(Series::columns(name, "bars", "histogram", "value", "count"));
        let shown = if unit == "1" {
            String::new()
        } else {
            format!(" {unit}")
        };
        figure.caption = format!(
            "{counted} values in {} bins of {width:.4}{shown}.",
            counts.len()
        );
        job.figure(&figure)
    }
}

puncta_sdk::register!(Histogram);

impl Histogram {
    /// Ends of the range, counts, and the number of values that are in no bin.
    fn count(&self, values: &[f64], run: &dyn Run) -> Result<([f64; 2], Vec<u64>, u64), Failure> {
        let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
        for batch in values.chunks(BATCH) {
            if run.cancelled() {
                return Err(Failure::cancelled());
            }
            for value in batch.iter().filter(|value| value.is_finite()) {
                (low, high) = (low.min(*value), high.max(*value));
            }
        }
        if low > high {
            (low, high) = (0.0, 1.0);
        }
        let given = (self.low, self.high);
        (low, high) = (self.low.unwrap_or(low), self.high.unwrap_or(high));
        if low > high
            || !(high - low).is_finite()
            || (low == high && given.0.is_some() && given.1.is_some())
        {
            let message = format!("the histogram cannot reach from {low} to {high}");
            return Err(Failure::bad_parameter("low", message).remedy("choose low below high"));
        }
        if low == high {
            let by = if low == 0.0 { 0.5 } else { 0.05 * low.abs() };
            (low, high) = (low - by, high + by);
        }
        let bins = self
            .bins
            .map_or_else(|| automatic(values, low, high), |bins| bins as usize);
        let mut counts = vec![0_u64; bins.max(1)];
        let (scale, mut left_out) = (counts.len() as f64 / (high - low), 0);
        for batch in values.chunks(BATCH) {
            if run.cancelled() {
                return Err(Failure::cancelled());
            }
            for value in batch {
                if !(*value >= low && *value <= high) {
                    left_out += 1;
                    continue;
                }
                let bin = (((value - low) * scale) as usize).min(counts.len() - 1);
                counts[bin] += 1;
            }
        }
        Ok(([low, high], counts, left_out))
    }
}

/// The number of bins by the rule of Freedman and Diaconis (1981): bins of twice the interquartile
/// range over the cube root of the number, from at most 100,000 values spread over the column.
fn automatic(values: &[f64], low: f64, high: f64) -> usize {
    let step = values.len().div_ceil(100_000).max(1);
    let inside = |value: &f64| *value >= low && *value <= high;
    let mut some: Vec<f64> = values
        .iter()
        .step_by(step)
        .copied()
        .filter(inside)
        .collect();
    if some.len() < 2 {
        return 1;
    }
    some.sort_unstable_by(f64::total_cmp);
    let quartile = |q: usize| some[(some.len() - 1) * q / 4];
    let width = 2.0 * (quartile(3) - quartile(1)) / (some.len() as f64 * step as f64).cbrt();
    let bins = (high - low) / width;
    // Without a spread of the middle half, the square root of the number.
    let bins = if bins.is_finite() {
        bins
    } else {
        (some.len() as f64).sqrt()
    };
    bins.ceil().clamp(1.0, MOST_BINS) as usize
}
