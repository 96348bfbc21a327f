//! The operation `puncta.precision.nena/1`.

use crate::distances::next_frame;
use crate::frames::Frames;
use crate::mixture::{Fit, Histogram, fit, guess, histogram, refit};
use puncta_sdk::documents::number;
use puncta_sdk::prelude::*;
use puncta_sdk::run::map;
use puncta_sdk::serde_json::json;
use puncta_sdk::{Figure, Series};

/// Fewest distances in the histogram.
const FEWEST: f64 = 50.0;

/// Localisation precision from the distances between consecutive frames.
#[derive(Params)]
pub struct Nena {
    /// Longest distance of the histogram; 15 times a first estimate of the precision if left out.
    #[param(min = 1e-6, max = 1e9, unit = "nm")]
    longest: Option<f64>,
    /// Resampled histograms for the interval.
    #[param(default = 100, min = 20, max = 10000, advanced)]
    resamples: u64,
    /// Seed of the resampling.
    #[param(default = 1, advanced)]
    seed: Seed,
}

impl Operation for Nena {
    const ID: &'static str = "puncta.precision.nena/1";

    fn info() -> Info {
        Info::operation("Precision from neighbours in consecutive frames")
            .description(
                "NeNA: molecules that shine in two frames are found twice, and how far apart shows \
                 the precision. The distances from each localisation to the nearest one of the \
                 next frame are fitted by the distribution for one molecule, a preferred distance \
                 of neighbours, and random neighbours.\nGive the table before repeats are merged.",
            )
            .cite("Endesfelder et al., Histochemistry and Cell Biology 141, 629 (2014)")
            .input(
                Ports::table("table")
                    .column("x", "nm")
                    .column("y", "nm")
                    .column("t", "frame"),
            )
            .output(
                Ports::table("histogram").description(
                    "A row for each bin: distance, count, the fit and its three terms",
                ),
            )
            .output(Ports::figure("figure").description("The histogram and its fit"))
            .output(Ports::report("report").description("Precision along an axis, with interval"))
            .example(json!({"resamples": 20}))
            .example_input(
                "table",
                "puncta.synthetic.membrane/1",
                json!({"copies": 4, "frames": 500}),
            )
    }

    fn run(&self, job: &Job) -> Result<(), Failure> {
        let table = job.input("table")?;
        let (x, y, t) = (table.f64("x")?, table.f64("y")?, table.f64("t")?);
        job.progress(0.0, "sorting by frame")?;
        let frames = Frames::new(&t, |row| x[row].is_finite() && y[row].is_finite());
        job.progress(0.2, "finding neighbours in the next frame")?;
        let distances = next_frame(job, &frames, &x, &y)?;
        let first = guess(&distances).ok_or_else(|| too_few(distances.len()))?;
        let counts = histogram(&distances, first, self.longest);
        let inside: f64 = counts.counts.iter().sum();
        if inside < FEWEST {
            return Err(too_few(inside as usize));
        }
        job.progress(0.6, "fitting")?;
        let start = first.min(counts.width * counts.counts.len() as f64 / 3.0);
        let found = fit(&counts, start);
        let interval = self.interval(job, &counts, start, &found)?;
        let crowding = crowding(&frames, &x, &y);
        let result = Outcome {
            found,
            interval,
            crowding,
            left_out: frames.left_out,
            pairs: distances.len(),
        };
        table_of(job, &counts, &found)?;
        figure(job, &counts, &result)?;
        report(job, &counts, &result)
    }
}

/// What was found.
struct Outcome {
    found: Fit,
    interval: [f64; 2],
    crowding: f64,
    left_out: usize,
    pairs: usize,
}

impl Nena {
    /// Percentiles 2.5 and 97.5 of the precision of histograms whose counts are drawn anew, each
    /// from the Poisson distribution of its count.
    fn interval(
        &self,
        job: &Job,
        counts: &Histogram,
        start: f64,
        found: &Fit,
    ) -> Result<[f64; 2], Failure> {
        let mut values = map(job, self.resamples as usize, &|i| {
            if job.cancelled() {
                return f64::NAN;
            }
            let mut random = Stream::new(self.seed.0, i as u64);
            let drawn = Histogram {
                width: counts.width,
                counts: counts.counts.iter().map(|n| random.poisson(*n)).collect(),
            };
            refit(&drawn, start, found).s
        });
        job.progress(0.95, "fitting")?;
        values.sort_unstable_by(f64::total_cmp);
        let last = values.len().saturating_sub(1) as f64;
        let at = |share: f64| {
            let place = (share * last).round() as usize;
            values.get(place).copied().unwrap_or(f64::NAN)
        };
        Ok([at(0.025), at(0.975)])
    }
}

/// Random numbers of one resampling (SplitMix64).
struct Stream(u64);

impl Stream {
    fn new(seed: u64, number: u64) -> Stream {
        let mut stream = Stream(seed ^ number.wrapping_mul(0xD1B5_4A32_D192_ED03));
        stream.next();
        stream.next();
        stream
    }

    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    /// Uniform in (0, 1].
    fn unit(&mut self) -> f64 {
        ((self.next() >> 11) + 1) as f64 / (1_u64 << 53) as f64
    }

    /// Poisson: by products of uniform numbers, from a mean of 60 on by the normal distribution.
    fn poisson(&mut self, mean: f64) -> f64 {
        if mean > 60.0 {
            let radius = (-2.0 * self.unit().ln()).sqrt();
            let normal = radius * (std::f64::consts::TAU * self.unit()).cos();
            return (mean + mean.sqrt() * normal).round().max(0.0);
        }
        let (limit, mut product, mut count) = ((-mean).exp(), self.unit(), 0.0);
        while product > limit {
            product *= self.unit();
            count += 1.0;
        }
        count
    }
}

/// The precision that molecules at random places would seem to have, 1 / (2 sqrt(pi density)), for
/// the localisations of a frame in their rectangle: near it no repeats can be told.
fn crowding(frames: &Frames, x: &[f64], y: &[f64]) -> f64 {
    let side = |values: &[f64]| {
        let each = frames.rows.iter().map(|row| values[*row as usize]);
        let (low, high) = each.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| {
            (l.min(v), h.max(v))
        });
        high - low
    };
    let of_frame = frames.rows.len() as f64 / frames.numbers.len() as f64;
    let density = of_frame / (side(x) * side(y));
    0.5 / (std::f64::consts::PI * density).sqrt()
}

fn too_few(count: usize) -> Failure {
    let message = format!("{count} localisations have a neighbour in the next frame");
    Failure::bad_input(message)
        .remedy("give a table with repeats in consecutive frames, before they are merged")
}

fn table_of(job: &Job, counts: &Histogram, found: &Fit) -> Result<(), Failure> {
    let info = |name: &str, unit: &str, text: &str| {
        ColumnInfo::new(name, Element::F64, unit).description(text)
    };
    let columns = vec![
        info("distance", "nm", "Middle of the bin"),
        info("count", "1", "Distances in the bin"),
        info("fit", "1", "Sum of the three terms"),
        info("same", "1", "Localisations of one molecule"),
        info("neighbours", "1", "Neighbours at a preferred distance"),
        info("random", "1", "Random neighbours"),
    ];
    let rows = counts.counts.len() as u64;
    let mut out = job.begin("histogram", Header::table("histogram", rows, columns))?;
    let names = ["distance", "count", "fit", "same", "neighbours", "random"];
    let [distance, count, sum, same, near, random] = out.f64s_mut(names)?;
    distance.copy_from_slice(&counts.middles());
    count.copy_from_slice(&counts.counts);
    for (i, d) in distance.iter().enumerate() {
        [same[i], near[i], random[i]] = found.terms(*d);
        sum[i] = same[i] + near[i] + random[i];
    }
    out.finish()
}

fn figure(job: &Job, counts: &Histogram, result: &Outcome) -> Result<(), Failure> {
    let of = |label: &str, style: &str, y: &str| {
        Series::columns(label, style, "histogram", "distance", y)
    };
    let mut figure = Figure::new(
        "figure",
        "Nearest neighbours in the next frame",
        ["Distance", "nm"],
        ["Count", "1"],
    )
    .with(of("distances", "bars", "count"))
    .with(of("fit", "line", "fit"))
    .with(of("one molecule", "line", "same"))
    .with(of("neighbours", "line", "neighbours"))
    .with(of("random", "line", "random"));
    let [low, high] = result.interval;
    figure.caption = format!(
        "{} distances in bins of {:.4} nm. Precision {:.4} nm, 95 % interval {low:.4} to {high:.4} \
         nm (resampled counts).",
        counts.counts.iter().sum::<f64>(),
        counts.width,
        result.found.s
    );
    job.figure(&figure)
}

fn report(job: &Job, counts: &Histogram, result: &Outcome) -> Result<(), Failure> {
    let mut report = Report::new("report");
    let found = &result.found;
    let value = report.number("precision", found.s, "nm");
    value.interval = Some(result.interval.map(number::to_value));
    value.description = Some("Standard deviation of a position along an axis".into());
    let [same, near, random] = found.shares(counts);
    let reach = counts.width * counts.counts.len() as f64;
    for (name, value, unit, text) in [
        ("same", same, "1", "Share of distances within one molecule"),
        (
            "neighbours",
            near,
            "1",
            "Share of neighbours at a preferred distance",
        ),
        ("random", random, "1", "Share of random neighbours"),
        (
            "centre",
            found.centre,
            "nm",
            "Preferred distance of neighbours",
        ),
        ("spread", found.spread, "nm", "Its standard deviation"),
        ("longest", reach, "nm", "Longest distance of the histogram"),
        (
            "pairs",
            result.pairs as f64,
            "1",
            "Localisations with a next frame",
        ),
        (
            "crowding",
            result.crowding,
            "nm",
            "What molecules at random places would give",
        ),
        (
            "left_out",
            result.left_out as f64,
            "1",
            "Rows without a finite position or frame",
        ),
    ] {
        report.number(name, value, unit).description = Some(text.into());
    }
    if found.s > 0.5 * result.crowding {
        job.warn(&format!(
            "the precision of {:.4} nm is near the {:.4} nm that molecules at random places would \
             give; too many shine in one frame to tell repeats from neighbours",
            found.s, result.crowding
        ));
    }
    job.report(&report)
}

puncta_sdk::register!(Nena);

#[cfg(test)]
mod tests;
