//! The writer `puncta.figure.csv.write/1`.

use crate::data::{self, Curve};
use crate::example;
use crate::picture::plan;
use puncta_sdk::prelude::*;
use puncta_sdk::serde_json::json;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;

/// Rows between two looks at cancel.
const BATCH: usize = 1 << 14;

/// Writes the numbers of a figure as text.
#[derive(Params)]
pub struct CsvWrite {}

impl Operation for CsvWrite {
    const ID: &'static str = "puncta.figure.csv.write/1";

    fn info() -> Info {
        Info::writer("Numbers of a figure", &[".csv"])
            .description(
                "Writes the points of all series below each other: series, x, y and the upper end of \
                 bands. Numbers have the fewest digits that give the same number again; missing values \
                 are nan.",
            )
            .input(Ports::figure("figure"))
            .example(json!({}))
            .example_step("figure", example::figure())
    }

    fn prepare(&self, request: &Request) -> Result<Plan, Failure> {
        plan(request)
    }

    fn run(&self, job: &Job) -> Result<(), Failure> {
        let input = job.input("figure")?;
        let figure = data::figure(input.header())?;
        let curves = data::curves(&figure, &input)?;
        let path = Path::new(&job.file()?.path);
        let io = |error| Failure::io("write", path, &error);
        let mut out = BufWriter::new(File::create(path).map_err(io)?);
        let name = |[label, unit]: &[String; 2]| match unit.trim() {
            "" | "1" | "unknown" => quoted(label),
            unit => quoted(&format!("{label} [{unit}]")),
        };
        writeln!(out, "series,{},{},upper", name(&figure.x), name(&figure.y)).map_err(io)?;
        let all: usize = curves.iter().map(|curve| curve.x.len()).sum();
        let mut done = 0;
        for curve in &curves {
            for from in (0..curve.x.len()).step_by(BATCH) {
                job.progress((done + from) as f64 / all as f64, "writing")?;
                let to = (from + BATCH).min(curve.x.len());
                rows(curve, from..to, &mut out).map_err(io)?;
            }
            done += curve.x.len();
        }
        out.flush().map_err(io)
    }
}

puncta_sdk::register!(CsvWrite);

fn rows(
    curve: &Curve<'_>,
    range: std::ops::Range<usize>,
    out: &mut impl Write,
) -> std::io::Result<()> {
    let label = quoted(&curve.label);
    for i in range {
        write!(
            out,
            "{label},{},{},",
            number(curve.x[i]),
            number(curve.y[i])
        )?;
        match &curve.upper {
            Some(upper) => writeln!(out, "{}", number(upper[i]))?,
            None => writeln!(out)?,
        }
    }
    Ok(())
}

fn number(value: f64) -> String {
    if value.is_nan() {
        "nan".into()
    } else {
        value.to_string()
    }
}

/// A text as a field: in quotes where it must be.
fn quoted(text: &str) -> String {
    if text.contains([',', '"', '\n', '\r']) {
        format!("\"{}\"", text.replace('"', "\"\""))
    } else {
        text.into()
    }
}
