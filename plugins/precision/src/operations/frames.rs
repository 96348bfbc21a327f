//! The operation `puncta.precision.frames/1`.

use crate::frames::Frames;
use crate::histogram::{Estimate, Z95, deviation};
use puncta_sdk::documents::number;
use puncta_sdk::prelude::*;
use puncta_sdk::serde_json::json;
use puncta_sdk::{Figure, Series};

/// Most rows of the output for blocks without localisations too.
const MOST: i64 = 1_000_000;

/// Counts of localisations over time.
#[derive(Params)]
pub struct Counts {
    /// Frames that are counted together.
    #[param(default = 100, min = 1, max = 1000000000, unit = "frame")]
    block: u64,
}

/// Localisations of a block of frames.
type Blocks = Vec<(i64, f64)>;

impl Operation for Counts {
    const ID: &'static str = "puncta.precision.frames/1";

    fn info() -> Info {
        Info::operation("Localisations over time")
            .description(
                "Counts the localisations of each block of frames, and gives the mean number of a \
                 frame with its interval. Blocks between the first and the last one that hold none \
                 are rows too, unless there are more than a million blocks.",
            )
            .input(Ports::table("table").column("t", "frame"))
            .output(Ports::table("counts").description(
                "A row for each block: its first frame, localisations, and their number a frame",
            ))
            .output(Ports::figure("figure").description("Localisations a frame over time"))
            .output(Ports::report("report").description("Values with intervals"))
            .example(json!({}))
            .example_input("table", "puncta.synthetic.membrane/1", json!({}))
    }

    fn run(&self, job: &Job) -> Result<(), Failure> {
        let table = job.input("table")?;
        let t = table.f64("t")?;
        job.progress(0.0, "sorting by frame")?;
        let frames = Frames::new(&t, |_| true);
        job.progress(0.7, "counting")?;
        let (Some(first), Some(last)) = (frames.numbers.first(), frames.numbers.last()) else {
            let message = format!("{} has no row with a frame", table.header().name);
            return Err(Failure::bad_input(message).remedy("give a table with localisations"));
        };
        let size = i64::try_from(self.block).unwrap_or(i64::MAX);
        let (blocks, all) = blocks(&frames, size);
        self.table(job, &blocks)?;
        self.figure(job, frames.rows.len(), all)?;
        let length = last.saturating_sub(*first).saturating_add(1) as f64;
        job.report(&report(&frames, &blocks, length, all, size))
    }
}

/// The blocks with their counts, and whether those without localisations are among them.
fn blocks(frames: &Frames, size: i64) -> (Blocks, bool) {
    let block = |number: &i64| number.div_euclid(size);
    let ends = frames
        .numbers
        .first()
        .map(block)
        .zip(frames.numbers.last().map(block));
    let (first, last) = ends.unwrap_or((0, 0));
    let span = last.saturating_sub(first).saturating_add(1);
    let all = span <= MOST;
    let mut blocks: Blocks = Vec::new();
    if all {
        blocks = (first..=last).map(|number| (number, 0.0)).collect();
    }
    for (i, number) in frames.numbers.iter().enumerate() {
        let count = frames.of(i).len() as f64;
        let number = block(number);
        if all {
            if let Some(slot) = blocks.get_mut((number - first) as usize) {
                slot.1 += count;
            }
        } else {
            match blocks.last_mut().filter(|last| last.0 == number) {
                Some(last) => last.1 += count,
                None => blocks.push((number, count)),
            }
        }
    }
    (blocks, all)
}

impl Counts {
    fn table(&self, job: &Job, blocks: &Blocks) -> Result<(), Failure> {
        let columns = vec![
            ColumnInfo::new("t", Element::F64, "frame")
                .role("time")
                .description("First frame of the block"),
            ColumnInfo::new("count", Element::F64, "1").description("Localisations"),
            ColumnInfo::new("rate", Element::F64, "1/frame").description("Localisations a frame"),
        ];
        let header = Header::table("counts", blocks.len() as u64, columns);
        let mut out = job.begin("counts", header)?;
        out.commit(0, blocks.len() as u64)?;
        let [t, count, rate] = out.f64s_mut(["t", "count", "rate"])?;
        let size = self.block as f64;
        for (i, (number, found)) in blocks.iter().enumerate() {
            t[i] = *number as f64 * size;
            count[i] = *found;
            rate[i] = found / size;
        }
        out.finish()
    }

    fn figure(&self, job: &Job, rows: usize, all: bool) -> Result<(), Failure> {
        let mut figure = Figure::new(
            "figure",
            "Localisations over time",
            ["Frame", "frame"],
            ["Localisations a frame", "1/frame"],
        )
        .with(Series::columns(
            "localisations",
            "line",
            "counts",
            "t",
            "rate",
        ));
        let note = if all {
            ""
        } else {
            " Blocks without localisations are left out."
        };
        figure.caption = format!(
            "{rows} localisations in blocks of {} frames.{note}",
            self.block
        );
        job.figure(&figure)
    }
}

fn report(frames: &Frames, blocks: &Blocks, length: f64, all: bool, size: i64) -> Report {
    let rows = frames.rows.len() as f64;
    let counts: Vec<f64> = blocks.iter().map(|block| block.1).collect();
    let rate = rows / length;
    // Blinking molecules stay on for several frames and bleach, so that the counts of blocks tell
    // the spread; the Poisson distribution alone would be too sure.
    let spread = deviation(&counts) / (counts.len() as f64).sqrt() / size as f64;
    let estimate = if all {
        Estimate::normal(rate, spread)
    } else {
        Estimate {
            value: rate,
            interval: [f64::NAN; 2],
        }
    };
    let mut report = Report::new("report");
    let value = report.number("rate", estimate.value, "1/frame");
    value.interval = Some(estimate.interval.map(number::to_value));
    value.description = Some(format!(
        "Localisations a frame from the first to the last; interval {Z95:.2} standard errors of \
         the blocks"
    ));
    let most = (0..frames.numbers.len())
        .map(|i| frames.of(i).len())
        .max()
        .unwrap_or(0);
    let fraction = frames.numbers.len() as f64 / length;
    let first = frames.numbers.first().map_or(f64::NAN, |n| *n as f64);
    for (name, value, unit, text) in [
        ("rows", rows, "1", "Localisations"),
        ("first", first, "frame", "First frame with a localisation"),
        (
            "frames",
            length,
            "frame",
            "Frames from the first to the last localisation",
        ),
        (
            "occupied",
            fraction,
            "1",
            "Share of them that hold a localisation",
        ),
        ("most", most as f64, "1", "Most localisations of one frame"),
        (
            "left_out",
            frames.left_out as f64,
            "1",
            "Rows without a finite frame",
        ),
    ] {
        report.number(name, value, unit).description = Some(text.into());
    }
    report
}

puncta_sdk::register!(Counts);

#[cfg(test)]
mod tests {
    use super::super::testing::{Random, value};
    use super::*;
    use puncta_testkit::{Call, Table};

    fn call(t: &[f64]) -> Call {
        Call::of::<Counts>().input("table", Table::new("locs").f64("t", "frame", t))
    }

    #[test]
    fn blocks_are_counted() {
        let done = call(&[12.0, 3.0, 35.0, 3.0, f64::NAN])
            .set("block", 10)
            .run()
            .unwrap();
        let table = done.output("counts").unwrap();
        assert_eq!(table.f64("t").unwrap(), [0.0, 10.0, 20.0, 30.0]);
        assert_eq!(table.f64("count").unwrap(), [2.0, 1.0, 0.0, 1.0]);
        assert_eq!(table.f64("rate").unwrap()[0], 0.2);
        assert_eq!(value(&done, "rate").0, 4.0 / 33.0);
        assert_eq!(
            (value(&done, "most").0, value(&done, "left_out").0),
            (2.0, 1.0)
        );
        // Gaps of a million frames make no rows.
        let done = call(&[0.0, 1e12, 5e12]).set("block", 1).run().unwrap();
        assert_eq!(
            done.output("counts").unwrap().f64("t").unwrap(),
            [0.0, 1e12, 5e12]
        );
        assert!(done.text().contains("are left out"));
    }

    #[test]
    fn the_interval_holds_the_rate() {
        let mut random = Random(7);
        let t: Vec<f64> = (0..20_000)
            .map(|_| (random.unit() * 10_000.0).floor())
            .collect();
        let (rate, [low, high]) = value(&call(&t).run().unwrap(), "rate");
        assert!((rate - 2.0).abs() < 0.01 && low < 2.0 && 2.0 < high && high - low < 0.08);
    }

    #[test]
    fn odd_tables() {
        for t in [&[][..], &[f64::NAN; 3]] {
            let error = call(t).run().unwrap_err().to_string();
            assert!(error.contains("no row with a frame"), "{error}");
        }
        let one = call(&[7.0]).run().unwrap();
        assert_eq!(value(&one, "rate").0, 1.0);
        let extreme = call(&[-1e300, 1e300]).set("block", 1).run().unwrap();
        assert_eq!(extreme.output("counts").unwrap().f64("t").unwrap().len(), 2);
        assert!(
            call(&[7.0])
                .cancel_after(1)
                .run()
                .unwrap_err()
                .is_cancelled()
        );
    }
}
