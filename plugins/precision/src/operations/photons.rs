//! The operation `puncta.precision.photons/1`.

use crate::histogram::{Bins, Estimate, deviation, mean, median};
use puncta_sdk::documents::number;
use puncta_sdk::prelude::*;
use puncta_sdk::serde_json::json;
use puncta_sdk::{Figure, Series};

/// Statistics of the photon numbers.
#[derive(Params)]
pub struct Photons {
    /// Column of photon numbers, or another positive number of each localisation.
    #[param(default = "nPhotons", input = "table")]
    column: Column,
    /// Bins of the histogram.
    #[param(default = 100, min = 5, max = 10000)]
    bins: u64,
    /// Least number that the exponential is fitted to; the fullest bin if left out.
    #[param(min = 0)]
    threshold: Option<f64>,
}

/// The fits.
struct Fits {
    threshold: f64,
    above: f64,
    /// Mean excess above the threshold.
    exponential: Estimate,
    /// Mean and standard deviation of the logarithm.
    logarithm: Estimate,
    spread: f64,
    positive: f64,
}

impl Fits {
    /// Both maximum-likelihood fits of sorted values.
    fn new(sorted: &[f64], threshold: f64) -> Fits {
        let above = &sorted[sorted.partition_point(|v| *v < threshold)..];
        let n = above.len() as f64;
        let excess = above.iter().map(|v| v - threshold).sum::<f64>() / n;
        let positive = &sorted[sorted.partition_point(|v| *v <= 0.0)..];
        let logarithms: Vec<f64> = positive.iter().map(|v| v.ln()).collect();
        Fits {
            threshold,
            above: n,
            exponential: Estimate::normal(excess, excess / n.sqrt()),
            logarithm: mean(&logarithms),
            spread: deviation(&logarithms),
            positive: positive.len() as f64,
        }
    }

    /// Expected counts of a bin.
    fn counts(&self, at: f64, width: f64) -> [f64; 2] {
        let scale = self.exponential.value;
        let falling = self.above * width / scale * (-(at - self.threshold) / scale).exp();
        let z = (at.ln() - self.logarithm.value) / self.spread;
        let normal = (-0.5 * z * z).exp() / (at * self.spread * std::f64::consts::TAU.sqrt());
        let falling = if at >= self.threshold { falling } else { 0.0 };
        let bell = if at > 0.0 {
            self.positive * width * normal
        } else {
            0.0
        };
        [falling, bell]
    }
}

impl Operation for Photons {
    const ID: &'static str = "puncta.precision.photons/1";

    fn info() -> Info {
        Info::operation("Photon statistics")
            .description(
                "Mean, median and spread of the photon numbers with intervals of 95 %, an \
                 exponential above a threshold, and a log-normal distribution, both fitted by \
                 maximum likelihood. Below the threshold the detection loses localisations.",
            )
            .input(Ports::table("table").any_column("$column"))
            .output(
                Ports::table("histogram").description("A row for each bin: count and both fits"),
            )
            .output(Ports::figure("figure").description("The histogram and both fits"))
            .output(Ports::report("report").description("Values with intervals"))
            .example(json!({}))
            .example_input("table", "puncta.synthetic.membrane/1", json!({}))
    }

    fn run(&self, job: &Job) -> Result<(), Failure> {
        let table = job.input("table")?;
        let name = &self.column.0;
        let unit = table
            .header()
            .column(name)
            .map_or("1", |info| info.unit.as_str());
        job.progress(0.0, "sorting")?;
        let all = table.f64(name)?;
        let mut sorted: Vec<f64> = all.iter().copied().filter(|v| v.is_finite()).collect();
        sorted.sort_unstable_by(f64::total_cmp);
        job.progress(0.7, "fitting")?;
        let (Some(low), Some(last)) = (sorted.first(), sorted.last()) else {
            let message = format!(
                "column {name} of {} has no finite number",
                table.header().name
            );
            return Err(Failure::bad_input(message).remedy("name another column"));
        };
        // The few largest would make all the others one bin.
        let high = sorted[(sorted.len() - 1) * 995 / 1000];
        let low = low.min(0.0);
        let high = if high > low {
            high * 1.000_001
        } else {
            low + last.abs().max(1.0)
        };
        let bins = Bins::new(&sorted, low, high, self.bins as usize);
        let fits = Fits::new(&sorted, self.threshold.unwrap_or_else(|| bins.mode()));
        histogram(job, &bins, &fits, unit)?;
        let mut figure = Figure::new("figure", "Photon numbers", [name, unit], ["Count", "1"]);
        for (label, style, y) in [
            ("localisations", "bars", "count"),
            ("exponential", "line", "exponential"),
            ("log-normal", "line", "log_normal"),
        ] {
            figure = figure.with(Series::columns(label, style, "histogram", "value", y));
        }
        figure.caption = format!(
            "{} localisations in {} bins up to the 99.5th percentile. Exponential above {:.6}: \
             {:.6}; log-normal: median {:.6}.",
            sorted.len(),
            bins.counts.len(),
            fits.threshold,
            fits.exponential.value,
            fits.logarithm.value.exp()
        );
        job.figure(&figure)?;
        job.report(&report(&sorted, &fits, unit, all.len() - sorted.len()))
    }
}

fn histogram(job: &Job, bins: &Bins, fits: &Fits, unit: &str) -> Result<(), Failure> {
    let info = |name: &str, unit: &str, text: &str| {
        ColumnInfo::new(name, Element::F64, unit).description(text)
    };
    let columns = vec![
        info("value", unit, "Middle of the bin"),
        info("count", "1", "Localisations in the bin"),
        info("exponential", "1", "Expected by the exponential"),
        info("log_normal", "1", "Expected by the log-normal distribution"),
    ];
    let rows = bins.counts.len() as u64;
    let mut out = job.begin("histogram", Header::table("histogram", rows, columns))?;
    let [value, count, falling, bell] =
        out.f64s_mut(["value", "count", "exponential", "log_normal"])?;
    value.copy_from_slice(&bins.middles());
    count.copy_from_slice(&bins.counts);
    for (i, at) in value.iter().enumerate() {
        [falling[i], bell[i]] = fits.counts(*at, bins.width);
    }
    out.finish()
}

fn report(sorted: &[f64], fits: &Fits, unit: &str, left_out: usize) -> Report {
    let mut report = Report::new("report");
    let mut add = |name: &str, value: Estimate, unit: &str, text: &str| {
        let entry = report.number(name, value.value, unit);
        entry.interval = Some(value.interval.map(number::to_value));
        entry.description = Some(text.into());
    };
    add(
        "mean",
        mean(sorted),
        unit,
        "Mean; interval from the standard error",
    );
    add(
        "median",
        median(sorted),
        unit,
        "Median; interval between order statistics",
    );
    let text = "Mean excess above the threshold, of an exponential; interval from its likelihood";
    add("exponential", fits.exponential, unit, text);
    let logarithm = fits.logarithm;
    let median = Estimate {
        value: logarithm.value.exp(),
        interval: logarithm.interval.map(f64::exp),
    };
    add(
        "log_normal_median",
        median,
        unit,
        "Median of the log-normal distribution",
    );
    let spread = Estimate::normal(fits.spread, fits.spread / (2.0 * fits.positive).sqrt());
    let text = "Standard deviation of the logarithm; interval from its likelihood";
    add("log_normal_sigma", spread, "1", text);
    let mut plain = |name: &str, value: f64, unit: &str, text: &str| {
        report.number(name, value, unit).description = Some(text.into());
    };
    plain("sd", deviation(sorted), unit, "Standard deviation");
    plain(
        "threshold",
        fits.threshold,
        unit,
        "Least number that the exponential is fitted to",
    );
    plain(
        "rows",
        sorted.len() as f64,
        "1",
        "Rows with a finite number",
    );
    plain("left_out", left_out as f64, "1", "Rows without");
    report
}

puncta_sdk::register!(Photons);

#[cfg(test)]
mod tests {
    use super::super::testing::{Random, value};
    use super::*;
    use puncta_testkit::{Call, Table};

    fn call(values: &[f64]) -> Call {
        let table = Table::new("locs").f64("nPhotons", "photon", values);
        Call::of::<Photons>().input("table", table)
    }

    #[test]
    fn planted_distributions_are_found() {
        let mut random = Random(1);
        let falling: Vec<f64> = (0..50_000)
            .map(|_| 100.0 - 700.0 * (1.0 - random.unit()).ln())
            .collect();
        let done = call(&falling).set("threshold", 300).run().unwrap();
        let (found, [low, high]) = value(&done, "exponential");
        assert!(
            (found / 700.0 - 1.0).abs() < 0.02 && low < 700.0 && 700.0 < high,
            "{found}"
        );
        let (mean, _) = value(&done, "mean");
        assert!((mean / 800.0 - 1.0).abs() < 0.02);
        let bell: Vec<f64> = (0..50_000)
            .map(|_| (6.0 + 0.5 * random.normal()).exp())
            .collect();
        let done = call(&bell).run().unwrap();
        let (found, [low, high]) = value(&done, "log_normal_median");
        let truth = 6.0_f64.exp();
        assert!((found / truth - 1.0).abs() < 0.01 && low < truth && truth < high);
        assert!((value(&done, "log_normal_sigma").0 - 0.5).abs() < 0.01);
        let table = done.output("histogram").unwrap();
        let pairs = table.f64("count").unwrap().into_iter();
        let worst = pairs
            .zip(table.f64("log_normal").unwrap())
            .map(|(n, f)| (n - f).abs() / n.max(10.0).sqrt())
            .fold(0.0, f64::max);
        assert!(worst < 6.0, "{worst}");
    }

    /// Intervals of 95 % hold the truth in about 95 % of samples.
    #[test]
    fn intervals_hold_what_they_promise() {
        let mut inside = [0; 3];
        for seed in 0..200 {
            let mut random = Random(seed);
            let values: Vec<f64> = (0..300)
                .map(|_| -500.0 * (1.0 - random.unit()).ln())
                .collect();
            let done = call(&values).set("threshold", 0).run().unwrap();
            let truths = [
                ("mean", 500.0),
                ("median", 500.0 * 2.0_f64.ln()),
                ("exponential", 500.0),
            ];
            for (count, (name, truth)) in inside.iter_mut().zip(truths) {
                let (_, [low, high]) = value(&done, name);
                *count += usize::from(low <= truth && truth <= high);
            }
        }
        assert!(inside.iter().all(|n| (180..=199).contains(n)), "{inside:?}");
    }

    #[test]
    fn odd_columns() {
        for values in [&[][..], &[f64::NAN; 4]] {
            let error = call(values).run().unwrap_err().to_string();
            assert!(error.contains("no finite number"), "{error}");
        }
        let one = call(&[500.0]).run().unwrap();
        assert_eq!(value(&one, "mean").0, 500.0);
        let same = call(&[500.0; 100]).run().unwrap();
        assert_eq!(value(&same, "median"), (500.0, [500.0; 2]));
        let negative = call(&[-5.0, 0.0, 3.0, f64::INFINITY]).run().unwrap();
        assert_eq!(value(&negative, "left_out").0, 1.0);
        assert!(call(&[1.0]).set("column", "photons").run().is_err());
        let texts = [1, 3].map(|n| call(&[3.0, 4.0, 9.0]).threads(n).run().unwrap().text());
        assert_eq!(texts[0], texts[1]);
        assert!(
            call(&[1.0])
                .cancel_after(1)
                .run()
                .unwrap_err()
                .is_cancelled()
        );
    }
}
