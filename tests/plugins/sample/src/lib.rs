//! A plugin for tests: every kind of object, every form of output, and faults.

mod faults;
mod kinds;

use puncta_sdk::prelude::*;
use std::sync::atomic::{AtomicU64, Ordering};

puncta_sdk::plugin! {
    id: "test.sample",
    title: "Sample",
    description: "Every kind of object, every form of output, and faults.",
    isolation: "none",
    reentrant: true,
}

/// Runs of this process, so that a test sees what was computed anew.
static RUNS: AtomicU64 = AtomicU64::new(0);

/// Does nothing, to time the host.
#[derive(Params)]
struct Empty {
    /// Makes one call different from another.
    #[param(default = 0)]
    tag: u64,
}

impl Operation for Empty {
    const ID: &'static str = "test.empty/1";

    fn info() -> Info {
        Info::operation("Empty").example(puncta_sdk::serde_json::json!({}))
    }

    fn run(&self, _job: &Job) -> Result<(), Failure> {
        std::hint::black_box(self.tag);
        Ok(())
    }
}

/// Makes a table of `rows` points.
#[derive(Params)]
struct Points {
    /// Number of points.
    #[param(default = 10)]
    rows: u64,
    /// Offset of all x.
    #[param(default = 0.0, unit = "nm")]
    offset: f64,
    /// Unit that x claims to have.
    #[param(default = "nm")]
    unit: String,
}

impl Operation for Points {
    const ID: &'static str = "test.points/1";

    fn info() -> Info {
        Info::operation("Points")
            .output(Ports::table("points"))
            .example(puncta_sdk::serde_json::json!({}))
    }

    fn run(&self, job: &Job) -> Result<(), Failure> {
        RUNS.fetch_add(1, Ordering::Relaxed);
        let columns = vec![
            ColumnInfo::new("x", Element::F64, self.unit.as_str()).role("position"),
            ColumnInfo::new("y", Element::F64, "nm").role("position"),
            ColumnInfo::new("t", Element::I32, "frame").role("time"),
        ];
        let mut out = job.begin("points", Header::table("points", self.rows, columns))?;
        let [x, y] = out.f64s_mut(["x", "y"])?;
        for (i, (x, y)) in x.iter_mut().zip(y).enumerate() {
            *x = i as f64 + self.offset;
            *y = -(i as f64);
        }
        if let puncta_sdk::ColumnMut::I32(t) = out.column_mut(0, "t")? {
            t.iter_mut().enumerate().for_each(|(i, t)| *t = i as i32);
        }
        out.finish()
    }
}

/// Adds a column: x times a factor.
#[derive(Params)]
struct Scale {
    /// Factor.
    #[param(default = 2.0)]
    factor: f64,
}

impl Operation for Scale {
    const ID: &'static str = "test.scale/1";

    fn info() -> Info {
        Info::operation("Scale")
            .input(Ports::table("table").column("x", "nm"))
            .output(Ports::columns("table", "table"))
            .example(puncta_sdk::serde_json::json!({}))
            .example_input("table", "test.points/1", puncta_sdk::serde_json::json!({}))
    }

    fn run(&self, job: &Job) -> Result<(), Failure> {
        RUNS.fetch_add(1, Ordering::Relaxed);
        let table = job.input("table")?;
        let x = table.f64("x")?;
        let mut out = job.add_columns("table", [ColumnInfo::new("scaled", Element::F64, "nm")])?;
        let scaled = out.f64_mut("scaled")?;
        puncta_sdk::run::chunks_mut(job, scaled, 1000, &|i, chunk| {
            for (out, x) in chunk.iter_mut().zip(&x[i * 1000..]) {
                *out = x * self.factor;
            }
        });
        out.finish()
    }
}

/// Keeps every n-th row.
#[derive(Params)]
struct EveryNth {
    /// Distance of the kept rows.
    #[param(default = 2, min = 1)]
    n: u64,
}

impl Operation for EveryNth {
    const ID: &'static str = "test.every-nth/1";

    fn info() -> Info {
        Info::operation("Every n-th row")
            .input(Ports::table("table"))
            .output(Ports::selection("table", "table"))
            .example(puncta_sdk::serde_json::json!({"n": 3}))
            .example_input("table", "test.points/1", puncta_sdk::serde_json::json!({}))
    }

    fn run(&self, job: &Job) -> Result<(), Failure> {
        RUNS.fetch_add(1, Ordering::Relaxed);
        let rows = job.input("table")?.rows() as u64;
        let mut out = job.select("table")?;
        let mut count = 0;
        for (slot, row) in out
            .u32_mut("row")?
            .iter_mut()
            .zip((0..rows).step_by(self.n as usize))
        {
            *slot = row as u32;
            count += 1;
        }
        out.finish_rows(&[count])
    }
}

/// Reports the number of runs in this process, and the sum of x.
#[derive(Params)]
struct Count;

impl Operation for Count {
    const ID: &'static str = "test.count/1";

    fn info() -> Info {
        Info::operation("Count")
            .input(Ports::table("table").column("x", "nm").optional())
            .output(Ports::report("report"))
            .example(puncta_sdk::serde_json::json!({}))
    }

    fn run(&self, job: &Job) -> Result<(), Failure> {
        let mut report = Report::new("report");
        report.number("runs", RUNS.load(Ordering::Relaxed) as f64, "1");
        if let Ok(table) = job.input("table") {
            report.number("sum", table.f64("x")?.iter().sum(), "nm");
        }
        job.report(&report)
    }
}

/// Reports the number of its process: an operation whose result depends on where it runs.
#[derive(Params)]
struct Process;

impl Operation for Process {
    const ID: &'static str = "test.process/1";

    fn info() -> Info {
        Info::operation("Process")
            .output(Ports::report("report"))
            .example(puncta_sdk::serde_json::json!({}))
    }

    fn run(&self, job: &Job) -> Result<(), Failure> {
        let mut report = Report::new("report");
        report.number("process", f64::from(std::process::id()), "1");
        job.report(&report)
    }
}

puncta_sdk::register!(Empty, Points, Scale, EveryNth, Count, Process);
