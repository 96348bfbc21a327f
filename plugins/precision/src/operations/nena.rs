//! The operation `puncta.precision.nena/1`.

use crate::distances::{next_frame, sorted};
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
    /// Column with the third coordinate, such as z; in the plane if left out.
    z: Option<Column>,
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
                 of neighbours, and random neighbours. With z, distances are those in space, z over the \
                 ratio of both precisions, which the differences along z show.\nGive the table before repeats are merged.",
            )
            .cite("Endesfelder et al., Histochemistry and Cell Biology 141, 629 (2014)")
            .input(
                Ports::table("table")
                    .column("x", "nm")
                    .column("y", "nm")
                    .column("$z", "nm")
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
        let z = self.z.as_ref().map(|z| table.f64(z)).transpose()?;
        job.progress(0.0, "sorting by frame")?;
        let deep = |row: usize| z.as_ref().is_none_or(|z| z[row].is_finite());
        let frames = Frames::new(&t, |row| {
            x[row].is_finite() && y[row].is_finite() && deep(row)
        });
        job.progress(0.2, "finding neighbours in the next frame")?;
        let differences = next_frame(job, &frames, [&x, &y])?;
        let (counts, start, found) =
            self.fitted(2, &sorted(&differences, [1.0; 2]), self.longest)?;
        let crowding = crowding(&frames, &[&x, &y]);
        let mut result = Outcome {
            counts,
            start,
            found,
            depth: None,
            crowding,
            left_out: frames.left_out,
            pairs: differences.len(),
        };
        if let Some(z) = &z {
            self.deepen(job, &frames, [&x, &y, z], &mut result)?;
        }
        let interval = self.interval(job, &result.counts, result.start, &result.found)?;
        table_of(job, &result.counts, &result.found)?;
        figure(job, &result, interval)?;
        report(job, &result, interval)
    }
}

/// What was found along z.
struct Depth {
    /// Precision along z, nm, and its interval.
    s: f64,
    interval: [f64; 2],
    /// Over the lateral one, as the distances have it.
    ratio: f64,
}

/// Rounds in which the ratio of the precisions and the pairs settle.
const ROUNDS: usize = 3;

impl Nena {
    /// The histogram of distances, the start of the fit, and the fit.
    fn fitted(
        &self,
        axes: u8,
        distances: &[f64],
        longest: Option<f64>,
    ) -> Result<(Histogram, f64, Fit), Failure> {
        let first = guess(axes, distances).ok_or_else(|| too_few(distances.len()))?;
        let counts = histogram(axes, distances, first, longest);
        let inside: f64 = counts.counts.iter().sum();
        if inside < FEWEST {
            return Err(too_few(inside as usize));
        }
        let start = first.min(counts.width * counts.counts.len() as f64 / 3.0);
        let found = fit(&counts, start);
        Ok((counts, start, found))
    }

    /// From the plane to space: the precision along z from the differences in z of pairs that are
    /// near each other in the plane, then distances in space, z over the ratio of the precisions.
    fn deepen(
        &self,
        job: &Job,
        frames: &Frames,
        [x, y, z]: [&[f64]; 3],
        result: &mut Outcome,
    ) -> Result<(), Failure> {
        let depth = |row: &u32| z[*row as usize];
        if frames
            .rows
            .iter()
            .all(|row| depth(row) == depth(&frames.rows[0]))
        {
            let message = "z is the same in all rows, so there is no precision along it";
            return Err(Failure::bad_input(message).remedy("leave out z"));
        }
        let mut pairs = next_frame(job, frames, [x, y, z])?;
        let mut along = (Histogram::default(), 0.0, result.found);
        let mut ratio = 1.0;
        for round in 0..=ROUNDS {
            job.progress(0.3 + 0.1 * round as f64, "fitting")?;
            let near = 3.0 * 2f64.sqrt() * result.found.s;
            let deep: Vec<[f64; 1]> = pairs
                .iter()
                .filter(|d| d[0].hypot(d[1]) <= near)
                .map(|d| [d[2]])
                .collect();
            along = self.fitted(1, &sorted(&deep, [1.0]), None)?;
            ratio = along.2.s / result.found.s;
            if round == ROUNDS {
                break;
            }
            let scaled: Vec<f64> = z.iter().map(|z| z / ratio).collect();
            pairs = next_frame(job, frames, [x, y, &scaled])?;
            let distances = sorted(&pairs, [1.0; 3]);
            (result.counts, result.start, result.found) =
                self.fitted(3, &distances, self.longest)?;
            pairs.iter_mut().for_each(|d| d[2] *= ratio);
            result.crowding = crowding(frames, &[x, y, &scaled]);
        }
        let interval = self.interval(job, &along.0, along.1, &along.2)?;
        result.depth = Some(Depth {
            s: along.2.s,
            interval,
            ratio,
        });
        Ok(())
    }
}

/// What was found.
struct Outcome {
    counts: Histogram,
    start: f64,
    found: Fit,
    depth: Option<Depth>,
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
                axes: counts.axes,
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

/// The precision that molecules at random places would seem to have, for the localisations of a frame in
/// their rectangle or box: near it no repeats can be told. In the plane 1 / (2 sqrt(pi density)); in
/// space the one with the same mean distance, Gamma(4/3) (3 / (4 pi density))^(1/3) = 4 s / sqrt(pi).
fn crowding(frames: &Frames, axes: &[&[f64]]) -> f64 {
    use std::f64::consts::PI;
    let side = |values: &&[f64]| {
        let each = frames.rows.iter().map(|row| values[*row as usize]);
        let (low, high) = each.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| {
            (l.min(v), h.max(v))
        });
        high - low
    };
    let of_frame = frames.rows.len() as f64 / frames.numbers.len() as f64;
    let density = of_frame / axes.iter().map(side).product::<f64>();
    if axes.len() == 3 {
        return 0.892_979_511_6 * (0.75 / (PI * density)).cbrt() * PI.sqrt() / 4.0;
    }
    0.5 / (PI * density).sqrt()
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

fn figure(job: &Job, result: &Outcome, [low, high]: [f64; 2]) -> Result<(), Failure> {
    let counts = &result.counts;
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
    figure.caption = format!(
        "{} distances in bins of {:.4} nm. Precision {:.4} nm, 95 % interval {low:.4} to {high:.4} \
         nm (resampled counts).",
        counts.counts.iter().sum::<f64>(),
        counts.width,
        result.found.s
    );
    if let Some(depth) = &result.depth {
        let [low, high] = depth.interval;
        figure.caption.push_str(&format!(
            " Distances in space, z over {:.4}; precision along z {:.4} nm, {low:.4} to {high:.4} nm.",
            depth.ratio, depth.s
        ));
    }
    job.figure(&figure)
}

fn report(job: &Job, result: &Outcome, interval: [f64; 2]) -> Result<(), Failure> {
    let mut report = Report::new("report");
    let (counts, found) = (&result.counts, &result.found);
    let value = report.number("precision", found.s, "nm");
    value.interval = Some(interval.map(number::to_value));
    value.description = Some("Standard deviation of a position along x or y".into());
    if let Some(depth) = &result.depth {
        let value = report.number("precision_z", depth.s, "nm");
        value.interval = Some(depth.interval.map(number::to_value));
        value.description = Some("Standard deviation of a position along z".into());
        report.number("ratio", depth.ratio, "1").description =
            Some("Precision along z over the lateral one, by which z is divided".into());
    }
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
