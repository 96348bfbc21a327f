//! What every operation of this plugin shares: reading the table, and giving the corrected
//! positions, the drift, its figure and the report.

use std::borrow::Cow;

use puncta_sdk::documents::findings::ReportValue;
use puncta_sdk::documents::{Read, units};
use puncta_sdk::operation::default_plan;
use puncta_sdk::prelude::*;
use puncta_sdk::run::chunks_mut;
use puncta_sdk::{Figure, Input, Series};

use crate::cloud::{Assumed, Cloud, Columns, Frames, NO_FRAME};
use crate::curve::{Curve, Interpolation};
use crate::estimate::Estimate;

/// Which axes are corrected.
#[derive(Choice, Clone, Copy, Debug, PartialEq, Eq)]
pub enum Axes {
    /// x and y, and z where the table has it and it is not constant
    Auto,
    /// x and y
    Lateral,
    /// x, y and z
    All,
}

/// When the drift is zero.
#[derive(Choice, Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reference {
    /// At the first time, so that the corrected positions are those of the start
    First,
    /// On average over the localisations, so that the middle of the corrected positions stays
    Mean,
}

/// Columns that are read where the table has them.
const OPTIONAL: [&str; 4] = ["z", "error_x", "error_y", "error_z"];
/// Rows in a chunk of parallel work.
const CHUNK: usize = 1 << 15;

/// The plan of an estimator: the columns it needs, and those it uses where they are.
///
/// # Errors
/// When z is asked for and missing.
pub fn plan<O: Operation>(request: &Request, axes: Axes) -> Result<Plan, Failure> {
    let mut plan = default_plan::<O>(request);
    let Some(input) = request.inputs.first() else {
        return Ok(plan);
    };
    let mut columns = vec!["x".to_owned(), "y".to_owned(), "t".to_owned()];
    for name in OPTIONAL {
        let wanted = axes != Axes::Lateral || !name.ends_with('z');
        let known = input.header.column(name);
        if wanted && known.is_some_and(|info| units::conversion(&info.unit, "nm").is_ok()) {
            columns.push(name.to_owned());
        }
    }
    if axes == Axes::All && !columns.iter().any(|name| name == "z") {
        let message = format!("{} has no column z that is a length", input.header.name);
        return Err(Failure::bad_input(message)
            .parameter("axes")
            .remedy("set axes to lateral"));
    }
    plan.read.retain(|read| read.input != 0);
    plan.read.insert(
        0,
        Read {
            input: 0,
            part: 0,
            columns,
        },
    );
    plan.memory = input.header.rows() * 160 + (64 << 20);
    Ok(plan)
}

/// A table as the estimators see it.
pub struct Localisations<'a> {
    x: Cow<'a, [f64]>,
    y: Cow<'a, [f64]>,
    z: Option<Cow<'a, [f64]>>,
    t: Cow<'a, [f64]>,
    errors: [Option<Cow<'a, [f64]>>; 3],
    time_unit: String,
}

impl<'a> Localisations<'a> {
    /// Reads the columns of the plan.
    ///
    /// # Errors
    /// When z is asked for and constant, or a column cannot be read.
    pub fn read(table: &Input<'a>, axes: Axes) -> Result<Self, Failure> {
        let planned = |name: &str| table.names(0).iter().any(|known| known == name);
        let optional = |name: &str| -> Result<Option<Cow<'a, [f64]>>, Failure> {
            if !planned(name) {
                return Ok(None);
            }
            let mut values = table.f64(name)?;
            let unit = table.header().column(name).map_or("nm", |info| &info.unit);
            let factor = units::conversion(unit, "nm").unwrap_or(1.0);
            if factor != 1.0 {
                values.to_mut().iter_mut().for_each(|v| *v *= factor);
            }
            Ok(Some(values))
        };
        let mut finite = None;
        let mut z = optional("z")?;
        let varies = z
            .iter()
            .flat_map(|z| z.iter())
            .any(|value| value.is_finite() && *finite.get_or_insert(*value) != *value);
        if !varies && z.is_some() {
            if axes == Axes::All {
                let message = "z is the same in all rows, so there is no drift to find in it";
                return Err(Failure::bad_input(message)
                    .parameter("axes")
                    .remedy("set axes to lateral"));
            }
            z = None;
        }
        let info = table.header().column("t");
        Ok(Self {
            x: table.f64("x")?,
            y: table.f64("y")?,
            z,
            t: table.f64("t")?,
            errors: [
                optional("error_x")?,
                optional("error_y")?,
                optional("error_z")?,
            ],
            time_unit: info.map_or_else(|| "frame".into(), |info| info.unit.clone()),
        })
    }

    /// The columns.
    pub fn columns(&self) -> Columns<'_> {
        Columns {
            x: &self.x,
            y: &self.y,
            z: self.z.as_deref(),
            t: &self.t,
            errors: std::array::from_fn(|axis| self.errors[axis].as_deref()),
        }
    }

    /// 2 or 3.
    pub fn axes(&self) -> usize {
        if self.z.is_some() { 3 } else { 2 }
    }

    /// The distinct times, and where each row belongs.
    ///
    /// # Errors
    /// When cancelled.
    pub fn frames(&self, run: &dyn Run) -> Result<Frames, Failure> {
        Frames::new(&self.columns(), run)
    }

    /// Frames and localisations in canonical order.
    ///
    /// # Errors
    /// When cancelled.
    pub fn cloud(&self, precision: f64, run: &dyn Run) -> Result<(Frames, Cloud), Failure> {
        let columns = self.columns();
        let assumed = Assumed {
            sigma: precision,
            axial_ratio: 2.5,
        };
        let frames = self.frames(run)?;
        let cloud = Cloud::new(&columns, &frames, &assumed, run)?;
        Ok((frames, cloud))
    }
}

/// A drift at each of the times of a table.
#[derive(Clone, Debug, Default)]
pub struct Drift {
    /// Drift at each time.
    pub at: Vec<[f64; 3]>,
    /// Its standard error.
    pub error: Vec<[f64; 3]>,
}

impl Drift {
    /// The estimate at the times of a table.
    pub fn of(estimate: &Estimate, frames: &Frames, reference: Reference) -> Self {
        let mut at = estimate.curve.at(&frames.times, estimate.interpolation);
        let errors = Curve {
            times: estimate.curve.times.clone(),
            values: estimate.error.clone(),
            breaks: estimate.curve.breaks.clone(),
        };
        let error = errors.at(&frames.times, Interpolation::Linear);
        let zero = match reference {
            Reference::First => at.first().copied().unwrap_or_default(),
            Reference::Mean => mean(&at, frames),
        };
        for value in &mut at {
            *value = std::array::from_fn(|axis| value[axis] - zero[axis]);
        }
        Self { at, error }
    }
}

fn mean(at: &[[f64; 3]], frames: &Frames) -> [f64; 3] {
    let mut sum = [0.0; 3];
    for row in &frames.rows {
        let value = at[frames.of_row[*row as usize] as usize];
        (0..3).for_each(|axis| sum[axis] += value[axis]);
    }
    sum.map(|sum| sum / frames.rows.len().max(1) as f64)
}

/// Refuses an estimate whose halves disagree by more than `most` nm.
///
/// # Errors
/// A sentence for the person.
pub fn trust(estimate: &Estimate, most: f64) -> Result<(), Failure> {
    let rms = estimate.worst();
    if rms <= most {
        return Ok(());
    }
    let message = format!(
        "two halves of the localisations give drifts that differ by {rms:.1} nm (root mean square), \
         more than {most} nm, so the data do not determine it"
    );
    Err(Failure::bad_input(message)
        .remedy("give more localisations, correct with fiducials, or raise max_error"))
}

/// Gives the corrected table, the drift, the figure and the report.
///
/// # Errors
/// When the host has no room, or cancelled.
pub fn finish(
    job: &Job,
    locs: &Localisations<'_>,
    frames: &Frames,
    drift: &Drift,
    report: &Report,
    caption: &str,
) -> Result<(), Failure> {
    let columns = locs.columns();
    let names = ["x", "y", "z"];
    let source = [Some(columns.x), Some(columns.y), columns.z];
    let position = |name: &str| ColumnInfo::new(name, Element::F64, "nm").role("position");
    let infos: Vec<ColumnInfo> = names[..locs.axes()].iter().map(|n| position(n)).collect();
    let mut out = job.add_columns("table", infos)?;
    for (axis, name) in names.into_iter().enumerate().take(locs.axes()) {
        let source = source[axis].unwrap_or_default();
        chunks_mut(job, out.f64_mut(name)?, CHUNK, &|chunk, out| {
            for (row, value) in (chunk * CHUNK..).zip(out) {
                let frame = frames.of_row[row];
                let moved = if frame == NO_FRAME {
                    0.0
                } else {
                    drift.at[frame as usize][axis]
                };
                *value = source[row] - moved;
            }
        });
    }
    out.finish()?;
    table(job, locs, &frames.times, drift)?;
    job.figure(&figure(locs, caption))?;
    job.report(report)
}

/// The drift as a table: a row for each distinct time.
fn table(job: &Job, locs: &Localisations<'_>, times: &[f64], drift: &Drift) -> Result<(), Failure> {
    let mut infos = vec![ColumnInfo::new("t", Element::F64, &locs.time_unit).role("time")];
    let names = &["x", "y", "z"][..locs.axes()];
    for kind in ["", "error_", "low_", "high_"] {
        let info = |name: &&str| ColumnInfo::new(format!("{kind}{name}"), Element::F64, "nm");
        infos.extend(names.iter().map(info));
    }
    let mut out = job.begin("drift", Header::table("drift", times.len() as u64, infos))?;
    out.f64_mut("t")?.copy_from_slice(times);
    for (axis, name) in names.iter().enumerate() {
        for (kind, factor) in [("", 0.0), ("low_", -1.0), ("high_", 1.0)] {
            let values = out.f64_mut(&format!("{kind}{name}"))?;
            for (value, (at, error)) in values.iter_mut().zip(drift.at.iter().zip(&drift.error)) {
                *value = if kind.is_empty() {
                    at[axis]
                } else {
                    at[axis] + factor * error[axis]
                };
            }
        }
        let values = out.f64_mut(&format!("error_{name}"))?;
        for (value, error) in values.iter_mut().zip(&drift.error) {
            *value = error[axis];
        }
    }
    out.finish()
}

fn figure(locs: &Localisations<'_>, caption: &str) -> Figure {
    let time = ["t", locs.time_unit.as_str()];
    let mut figure = Figure::new("figure", "Drift", time, ["Drift", "nm"]);
    for name in &["x", "y", "z"][..locs.axes()] {
        let low = format!("low_{name}");
        let band = format!("{name}, standard error");
        figure = figure
            .with(Series::columns(&band, "band", "drift", "t", &low).up_to(&format!("high_{name}")))
            .with(Series::columns(name, "line", "drift", "t", name));
    }
    figure.caption = caption.into();
    figure
}

/// The report of an estimate.
pub fn report(estimate: &Estimate, drift: &Drift, frames: &Frames, axes: usize) -> Report {
    let mut report = Report::new("report");
    for (axis, name) in ["x", "y", "z"].into_iter().enumerate().take(axes) {
        report
            .number(
                &format!("split_half_error_{name}"),
                estimate.rms[axis],
                "nm",
            )
            .description =
            Some("Root mean square of half the difference between two halves of the data".into());
        let values = || drift.at.iter().map(|at| at[axis]);
        let span = values().fold(f64::MIN, f64::max) - values().fold(f64::MAX, f64::min);
        report
            .number(&format!("range_{name}"), span.max(0.0), "nm")
            .description = Some("Largest minus smallest drift".into());
    }
    let breaks = &estimate.curve.breaks;
    report.number("steps", breaks.len() as f64, "1").description =
        Some("Sudden steps, given or found; the drift is smooth between them".into());
    if !breaks.is_empty() {
        let times: Vec<String> = breaks.iter().map(f64::to_string).collect();
        report.values.push(ReportValue {
            name: "step_times".into(),
            value: times.join(", ").into(),
            unit: "1".into(),
            interval: None,
            description: Some("The first time after each step".into()),
        });
    }
    let used = frames.rows.len() as f64;
    report.number("localisations", used, "1").description =
        Some("Rows with a finite position and time".into());
    let left = frames.of_row.len() as f64 - used;
    report.number("left_out", left, "1").description =
        Some("Rows without, which are passed through as they are".into());
    for note in &estimate.notes {
        report.number(note.name, note.value, note.unit).description = Some(note.meaning.into());
    }
    report
}

/// The report of a drift that was known already.
pub fn known(drift: &Drift, frames: &Frames, axes: usize, curve: &Curve) -> Report {
    let estimate = Estimate {
        curve: Curve {
            breaks: curve.breaks.clone(),
            ..Curve::default()
        },
        notes: vec![crate::estimate::note(
            "samples",
            curve.times.len() as f64,
            "1",
            "Times at which the drift was given",
        )],
        ..Estimate::default()
    };
    let mut report = report(&estimate, drift, frames, axes);
    report
        .values
        .retain(|value| !value.name.starts_with("split_half"));
    if curve.breaks.is_empty() {
        report.values.retain(|value| value.name != "steps");
    }
    report
}

/// The outputs of every operation that corrects a table.
pub fn outputs(info: Info) -> Info {
    info.output(Ports::columns("table", "table").description("The table with corrected positions"))
        .output(Ports::table("drift").description(
            "The drift at each time of the table, its standard error, and both ends of its band",
        ))
        .output(Ports::figure("figure").description("The drift against time"))
        .output(Ports::report("report").description("Errors, ranges, what was used and left out"))
}

/// The input of every operation that corrects a table.
pub fn input() -> Ports {
    Ports::table("table")
        .column("x", "nm")
        .column("y", "nm")
        .any_column("t")
        .description("Localisations; z and errors are used where they are")
}
