//! `puncta.drift.fiducials/1`

use puncta_sdk::Input;
use puncta_sdk::documents::Read;
use puncta_sdk::documents::manifest::Step;
use puncta_sdk::prelude::*;
use puncta_sdk::serde_json::json;

use super::{Between, CONVENTION};
use crate::beads::{Following, Shared, Trace, shared, smooth, traces};
use crate::cloud::Frames;
use crate::correction::{
    Axes, Drift, Localisations, Reference, finish, input, known, outputs, plan,
};
use crate::curve::{Curve, pieces};
use crate::estimate::Estimate;
use crate::steps::{Steps, sudden};

/// Corrects the drift by fiducial markers.
#[derive(Params)]
pub struct Fiducials {
    /// Which axes are corrected.
    #[param(default = Axes::Auto)]
    axes: Axes,
    /// When the drift is zero.
    #[param(default = Reference::First)]
    reference: Reference,
    /// Farthest that a marker may lie from where it was last seen.
    #[param(default = 150, min = 1, max = 1e5, unit = "nm")]
    radius: f64,
    /// Longest time without a marker, in the unit of t.
    #[param(default = 25, min = 0, max = 1e12)]
    gap: f64,
    /// Least share of the times at which a marker is seen.
    #[param(default = 0.3, min = 0, max = 1)]
    share: f64,
    /// Standard deviation of the smoothing in time, in the unit of t; 0 for none.
    #[param(default = 10, min = 0, max = 1e12)]
    smoothing: f64,
    /// Localisation precision where the table has no errors.
    #[param(default = 5, min = 0.01, max = 1000, unit = "nm")]
    precision: f64,
    /// Between the times at which a marker was seen.
    #[param(default = Between::Linear)]
    interpolation: Between,
    #[param(flatten)]
    steps: Steps,
}

/// Times on each side that are looked at for a step.
const STEP: usize = 10;

impl Fiducials {
    fn traces(
        &self,
        table: &Localisations<'_>,
        run: &dyn Run,
    ) -> Result<(Frames, Vec<Trace>), Failure> {
        let columns = table.columns();
        let frames = Frames::new(&columns, run)?;
        let following = Following {
            radius: self.radius,
            gap: self.gap,
            share: self.share,
        };
        let traces = traces(&columns, &frames, &following, self.precision, run)?;
        Ok((frames, traces))
    }

    /// The drift, smoothed between steps.
    fn estimate(&self, frames: &Frames, found: &Shared) -> Result<Estimate, Failure> {
        let times: Vec<f64> = found
            .frames
            .iter()
            .map(|f| frames.times[*f as usize])
            .collect();
        let mut breaks = self.steps.known()?;
        if self.steps.find_breaks {
            breaks.extend(sudden(&times, &found.drift, STEP, 0.0));
            breaks.sort_unstable_by(f64::total_cmp);
            breaks.dedup();
        }
        let (mut values, mut error) = (Vec::new(), Vec::new());
        for piece in pieces(&times, &breaks) {
            let (drift, variance) = (&found.drift[piece.clone()], &found.variance[piece.clone()]);
            let (smoothed, variance) = smooth(&times[piece], drift, variance, self.smoothing);
            values.extend(smoothed);
            error.extend(variance.iter().map(|v| v.map(f64::sqrt)));
        }
        Ok(Estimate {
            curve: Curve {
                times,
                values,
                breaks,
            },
            error,
            interpolation: self.interpolation.into(),
            ..Estimate::default()
        })
    }
}

/// The traces as a table: where each marker lay on average, and how far its residuals spread.
fn beads(job: &Job, traces: &[Trace], found: &Shared, axes: usize) -> Result<(), Failure> {
    let names = &["x", "y", "z"][..axes];
    let mut infos = vec![
        ColumnInfo::new("fiducial", Element::U32, "1"),
        ColumnInfo::new("frames", Element::U32, "1"),
        ColumnInfo::new("used", Element::Bool, "1"),
    ];
    infos.extend(
        names
            .iter()
            .map(|n| ColumnInfo::new(*n, Element::F64, "nm").role("position")),
    );
    let residual = |n: &&str| ColumnInfo::new(format!("residual_{n}"), Element::F64, "nm");
    infos.extend(names.iter().map(residual));
    let mut out = job.begin(
        "fiducials",
        Header::table("fiducials", traces.len() as u64, infos),
    )?;
    for (i, id) in out.u32_mut("fiducial")?.iter_mut().enumerate() {
        *id = i as u32 + 1;
    }
    for (frames, trace) in out.u32_mut("frames")?.iter_mut().zip(traces) {
        *frames = trace.frames.len() as u32;
    }
    if let puncta_sdk::ColumnMut::Bool(values) = out.column_mut(0, "used")? {
        values
            .iter_mut()
            .zip(&found.used)
            .for_each(|(v, used)| *v = u8::from(*used));
    }
    for (axis, name) in names.iter().enumerate() {
        for (value, origin) in out.f64_mut(name)?.iter_mut().zip(&found.origin) {
            *value = origin[axis];
        }
        let values = out.f64_mut(&format!("residual_{name}"))?;
        for (value, residual) in values.iter_mut().zip(&found.residual) {
            *value = residual[axis];
        }
    }
    out.finish()
}

impl Operation for Fiducials {
    const ID: &'static str = "puncta.drift.fiducials/1";

    fn info() -> Info {
        let second = Ports::table("markers")
            .column("x", "nm")
            .column("y", "nm")
            .any_column("t")
            .optional()
            .description("Localisations of the markers; those of the table itself if left out");
        let info = Info::operation("Correct drift by fiducials")
            .description(&format!(
                "Follows fiducial markers through the frames and subtracts the drift that they \
                 share.\nEach marker is weighted by its localisation precision, gross errors count \
                 less, and gaps are tolerated as long as the markers overlap in time. The residuals \
                 of each marker show how well it follows the others. {CONVENTION}"
            ))
            .input(input())
            .input(second);
        let marker = Step {
            op: "puncta.synthetic.membrane/1".into(),
            parameters: super::example(),
            ..Step::default()
        };
        outputs(info)
            .output(
                Ports::table("fiducials").description("Mean position and residuals of each marker"),
            )
            .cite("S. H. Lee et al., Optics Express 20, 12177 (2012)")
            .example(json!({ "radius": 1000, "gap": 10000, "share": 0.001 }))
            .example_input(
                "table",
                "puncta.synthetic.membrane/1",
                super::example().into(),
            )
            .example_step("markers", marker)
    }

    fn prepare(&self, request: &Request) -> Result<Plan, Failure> {
        let mut plan = plan::<Self>(request, self.axes)?;
        let optional = plan
            .read
            .first()
            .map(|read| read.columns.clone())
            .unwrap_or_default();
        for (place, input) in request
            .inputs
            .iter()
            .enumerate()
            .filter(|(_, i)| i.port == "markers")
        {
            let known = |name: &String| input.header.column(name).is_some();
            plan.read.retain(|read| read.input != place);
            plan.read.push(Read {
                input: place,
                part: 0,
                columns: optional
                    .iter()
                    .filter(|name| known(name))
                    .cloned()
                    .collect(),
            });
        }
        Ok(plan)
    }

    fn run(&self, job: &Job) -> Result<(), Failure> {
        let locs = Localisations::read(&job.input("table")?, self.axes)?;
        let markers: Option<Input<'_>> = job.inputs("markers").next();
        let markers = markers
            .map(|table| Localisations::read(&table, self.axes))
            .transpose()?;
        let markers = markers.as_ref().unwrap_or(&locs);
        if markers.axes() < locs.axes() {
            let message = "the markers have no z, or the same z in all rows";
            return Err(Failure::bad_input(message).remedy("set axes to lateral"));
        }
        let (seen, traces) = self.traces(markers, job)?;
        let found = shared(&traces, locs.axes(), job)?;
        let estimate = self.estimate(&seen, &found)?;
        let frames = locs.frames(job)?;
        let drift = Drift::of(&estimate, &frames, self.reference);
        let mut report = known(&drift, &frames, locs.axes(), &estimate.curve);
        let used = found.used.iter().filter(|used| **used).count();
        report.number("fiducials", used as f64, "1").description =
            Some("Markers whose traces were used".into());
        for (axis, name) in ["x", "y", "z"].into_iter().enumerate().take(locs.axes()) {
            let squares = found
                .residual
                .iter()
                .zip(&found.used)
                .filter(|(_, used)| **used);
            let sum: f64 = squares.map(|(residual, _)| residual[axis].powi(2)).sum();
            report
                .number(
                    &format!("residual_{name}"),
                    (sum / used.max(1) as f64).sqrt(),
                    "nm",
                )
                .description = Some("Root mean square residual of the markers".into());
        }
        let caption = format!(
            "{used} fiducial markers, smoothed by {} (unit of t); the band is the standard error from \
             their localisation precision.",
            self.smoothing
        );
        beads(job, &traces, &found, locs.axes())?;
        finish(job, &locs, &frames, &drift, &report, &caption)
    }
}

puncta_sdk::register!(Fiducials);

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{Sample, drift_error, normal, step_errors};
    use puncta_testkit::{Call, Table};

    /// Four markers that follow the sample.
    fn markers(sample: &Sample) -> Table {
        let (mut x, mut y, mut t) = (vec![], vec![], vec![]);
        for (frame, d) in sample.truth.iter().enumerate() {
            for bead in 0..4 {
                let id = (frame * 4 + bead) as u64;
                x.push(900.0 * bead as f64 + d[0] + 4.0 * normal(id, 1));
                y.push(300.0 + d[1] + 4.0 * normal(id, 2));
                t.push(frame as f64);
            }
        }
        Table::new("markers")
            .f64("x", "nm", &x)
            .f64("y", "nm", &y)
            .f64("t", "frame", &t)
    }

    #[test]
    fn a_step_is_not_smoothed() {
        for seed in 0..5 {
            let step = |t: f64| if t < 437.0 { 0.0 } else { 40.0 };
            let smooth = |t: f64| [0.1 * t, 20.0 * (t / 150.0).sin(), 0.0];
            let stepped = |t: f64| [smooth(t)[0] + step(t), smooth(t)[1] - 0.5 * step(t), 0.0];
            let errors = |sample: &Sample| {
                let call = Call::of::<Fiducials>().input("table", sample.table());
                step_errors(
                    &call.input("markers", markers(sample)).run().unwrap(),
                    sample,
                )
            };
            let (without, none) = errors(&Sample::with(seed, smooth));
            let (with, found) = errors(&Sample::with(seed, stepped));
            assert_eq!((none.as_str(), found.as_str()), ("", "437"));
            for (without, with) in without.iter().zip(&with) {
                assert!(*with < 1.1 * without + 0.05, "{without} {with}");
            }
        }
    }

    #[test]
    fn markers_of_a_second_table_correct_the_first() {
        let sample = Sample::new(4);
        let markers = markers(&sample);
        let call = Call::of::<Fiducials>().input("table", sample.table());
        let done = call.input("markers", markers).run().unwrap();
        assert!(drift_error(&done, &sample) < 0.6);
        let beads = done.output("fiducials").unwrap();
        assert_eq!(beads.u32("frames").unwrap(), [1000; 4]);
        assert!(
            beads
                .f64("residual_x")
                .unwrap()
                .iter()
                .all(|r| *r > 2.0 && *r < 5.0)
        );
        let alone = Call::of::<Fiducials>().input("table", sample.table()).run();
        assert!(
            alone
                .unwrap_err()
                .to_string()
                .contains("no fiducial marker")
        );
    }
}
