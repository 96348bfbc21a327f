//! `puncta.drift.auto/1`

use puncta_sdk::documents::findings::ReportValue;
use puncta_sdk::prelude::*;
use puncta_sdk::serde_json::json;

use super::CONVENTION;
use crate::cloud::Cloud;
use crate::coarse::Pattern;
use crate::correction::{
    Axes, Drift, Localisations, Reference, finish, input, outputs, plan, report, trust,
};
use crate::curve::Interpolation;
use crate::estimate::Estimate;
use crate::steps::Steps;
use crate::{correlation, least_entropy};

/// Corrects the drift by the method with the smallest error from split halves.
#[derive(Params)]
pub struct Auto {
    /// Which axes are corrected.
    #[param(default = Axes::Auto)]
    axes: Axes,
    /// When the drift is zero.
    #[param(default = Reference::First)]
    reference: Reference,
    /// Localisation precision where the table has no error_x.
    #[param(default = 10, min = 0.1, max = 1000, unit = "nm")]
    precision: f64,
    #[param(flatten)]
    steps: Steps,
    /// Largest error from split halves that is accepted.
    #[param(default = 20, min = 0, max = 1e6, unit = "nm", advanced)]
    max_error: f64,
    /// Seed of the halves and subsets.
    #[param(default = 1)]
    seed: Seed,
}

/// Name of a method and what it gave.
type Trial = (&'static str, Result<Estimate, Failure>);

/// An error from split halves that needs no second opinion, in standard deviations of a
/// localisation.
const GOOD: f64 = 0.1;
/// Displacements that are looked for, nm.
const REACH: f64 = 500.0;

impl Auto {
    /// The names of the methods and what they gave.
    fn trials(&self, cloud: &Cloud, run: &dyn Run) -> Result<Vec<Trial>, Failure> {
        let seed = self.seed.0;
        let settings = least_entropy::Settings {
            reach: REACH,
            segments: 20,
            bin: None,
            seed,
        };
        let first = least_entropy::estimate(cloud, &settings, &self.steps, run);
        let good = first
            .as_ref()
            .is_ok_and(|found| found.worst() <= GOOD * cloud.sigma);
        let mut trials = vec![("least entropy", first)];
        if !good && !run.cancelled() {
            let settings = correlation::Settings {
                segment: None,
                reach: REACH,
                pattern: Pattern::All,
                interpolation: Interpolation::Spline,
                seed,
            };
            let second = correlation::estimate(cloud, &settings, &self.steps, run);
            trials.push(("redundant cross-correlation", second));
        }
        if run.cancelled() {
            return Err(Failure::cancelled());
        }
        Ok(trials)
    }
}

/// The trial with the smallest error, and why; the first failure if none succeeded.
fn choose(trials: Vec<Trial>) -> Result<(Estimate, String), Failure> {
    let mut reasons = Vec::new();
    let mut best: Option<(&str, Estimate)> = None;
    let mut failure = None;
    let only = trials.len() == 1;
    for (name, trial) in trials {
        match trial {
            Ok(found) => {
                reasons.push(format!("{name} {:.2} nm", found.worst()));
                if best
                    .as_ref()
                    .is_none_or(|(_, best)| found.worst() < best.worst())
                {
                    best = Some((name, found));
                }
            }
            Err(why) => {
                reasons.push(format!("{name} failed"));
                failure.get_or_insert(why);
            }
        }
    }
    let Some((name, estimate)) = best else {
        return Err(failure.unwrap_or_else(|| Failure::internal("no method was tried")));
    };
    let rest = if only {
        "; good enough to need no other method"
    } else {
        ""
    };
    let errors = reasons.join(", ");
    Ok((
        estimate,
        format!("{name}, by the error from split halves: {errors}{rest}"),
    ))
}

impl Operation for Auto {
    const ID: &'static str = "puncta.drift.auto/1";

    fn info() -> Info {
        let info = Info::operation("Correct drift")
            .description(&format!(
                "Finds the drift by the method whose error from split halves is smallest, and says \
                 why.\nThe least entropy is tried first; where its error is above a tenth of the \
                 localisation precision, redundant cross-correlation is tried too. {CONVENTION}"
            ))
            .input(input());
        outputs(info)
            .cite("J. Cnossen et al., Optics Express 29, 27961 (2021)")
            .cite("Y. Wang et al., Optics Express 22, 15982 (2014)")
            .example(json!({ "precision": 5 }))
            .example_input(
                "table",
                "puncta.synthetic.membrane/1",
                super::example().into(),
            )
    }

    fn prepare(&self, request: &Request) -> Result<Plan, Failure> {
        plan::<Self>(request, self.axes)
    }

    fn run(&self, job: &Job) -> Result<(), Failure> {
        let locs = Localisations::read(&job.input("table")?, self.axes)?;
        let (frames, cloud) = locs.cloud(self.precision, job)?;
        let (estimate, why) = choose(self.trials(&cloud, job)?)?;
        trust(&estimate, self.max_error)?;
        let drift = Drift::of(&estimate, &frames, self.reference);
        let mut report = report(&estimate, &drift, &frames, locs.axes());
        report.values.insert(
            0,
            ReportValue {
                name: "method".into(),
                value: why.as_str().into(),
                unit: "1".into(),
                interval: None,
                description: Some("The method that was taken, and why".into()),
            },
        );
        let caption = format!("Method: {why} (seed {}).", self.seed.0);
        finish(job, &locs, &frames, &drift, &report, &caption)
    }
}

puncta_sdk::register!(Auto);

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{Sample, drift_error};
    use puncta_testkit::{Call, Done, Table};

    fn run(sample: &Sample) -> Done {
        Call::of::<Auto>()
            .input("table", sample.table())
            .run()
            .unwrap()
    }

    #[test]
    fn a_drift_in_three_dimensions_is_found_on_five_seeds() {
        for seed in 0..5 {
            let mut sample = Sample::new(seed + 10);
            sample.three = true;
            let done = run(&sample);
            let error = drift_error(&done, &sample);
            assert!(error < 4.0, "{error}");
            let report = done
                .documents
                .iter()
                .find(|d| d["output"] == "report")
                .unwrap();
            let why = report["values"][0]["value"].as_str().unwrap();
            assert!(why.contains("split halves"), "{why}");
        }
    }

    #[test]
    fn shifted_turned_and_permuted_tables_have_the_same_drift() {
        let sample = Sample::new(20);
        let drift = |sample: &Sample| {
            let done = run(sample);
            let table = done.output("drift").unwrap();
            (table.f64("x").unwrap(), table.f64("y").unwrap())
        };
        let (x, y) = drift(&sample);
        let mut permuted = sample.clone();
        for values in [&mut permuted.x, &mut permuted.y, &mut permuted.t] {
            values.reverse();
        }
        assert_eq!(drift(&permuted), (x.clone(), y.clone()));
        let near =
            |a: &[f64], b: &[f64], most: f64| a.iter().zip(b).all(|(a, b)| (a - b).abs() < most);
        let mut shifted = sample.clone();
        shifted.x.iter_mut().for_each(|x| *x += 1e7);
        let (sx, sy) = drift(&shifted);
        assert!(near(&sx, &x, 0.1) && near(&sy, &y, 0.1));
        let mut turned = sample.clone();
        turned.x = sample.y.iter().map(|y| -y).collect();
        turned.y = sample.x.clone();
        // Squares of the halves differ, so that smoothing may, but the drift turns with the field.
        let (tx, ty) = drift(&turned);
        let minus: Vec<f64> = y.iter().map(|y| -y).collect();
        assert!(near(&tx, &minus, 3.0) && near(&ty, &x, 3.0));
    }

    #[test]
    fn tripled_and_doubled_tables_have_the_drift_that_follows() {
        let sample = Sample::new(22);
        let drift = |done: &Done| {
            let table = done.output("drift").unwrap();
            ["x", "y"].map(|name| table.f64(name).unwrap())
        };
        let one = drift(&run(&sample));
        let near = |found: &[Vec<f64>; 2], factor: f64, most: f64| {
            let miss = |(a, b): (&f64, &f64)| (a - factor * b).abs();
            let pairs = found.iter().zip(&one);
            let worst = pairs.flat_map(|(a, b)| a.iter().zip(b).map(miss));
            assert!(worst.fold(0.0, f64::max) < most);
        };
        let mut tripled = sample.clone();
        for values in [&mut tripled.x, &mut tripled.y] {
            values.iter_mut().for_each(|v| *v *= 3.0);
        }
        let call = Call::of::<Auto>().input("table", tripled.table());
        let three = drift(&call.set("precision", 30).run().unwrap());
        near(&three, 3.0, 3.0);
        // The same again a millimetre away: the halves differ, and with them the smoothing.
        let mut doubled = sample.clone();
        for (values, shift) in [
            (&mut doubled.x, 1e6),
            (&mut doubled.y, 0.0),
            (&mut doubled.t, 0.0),
        ] {
            let copy: Vec<f64> = values.iter().map(|v| v + shift).collect();
            values.extend(copy);
        }
        near(&drift(&run(&doubled)), 1.0, 1.5);
    }

    #[test]
    fn equal_rows_and_a_single_place_have_a_defined_result() {
        let table = |t: &[f64]| {
            let place = vec![5.0; t.len()];
            Table::new("locs")
                .f64("x", "nm", &place)
                .f64("y", "nm", &place)
                .f64("t", "frame", t)
        };
        let call = |t: &[f64]| Call::of::<Auto>().input("table", table(t)).run();
        let refused = call(&[3.0; 500]).unwrap_err().to_string();
        assert!(refused.contains("too few"), "{refused}");
        let times: Vec<f64> = (0..1000).map(f64::from).collect();
        let done = call(&times).unwrap();
        let moved = done.output("table").unwrap().f64("x").unwrap();
        assert!(moved.iter().all(|x| (x - 5.0).abs() < 1e-6));
        let no_time = Table::new("locs")
            .f64("x", "nm", &[1.0])
            .f64("y", "nm", &[1.0]);
        let missing = Call::of::<Auto>()
            .input("table", no_time)
            .run()
            .unwrap_err();
        assert!(missing.to_string().contains('t'), "{missing}");
    }

    #[test]
    fn rows_without_a_position_pass_and_far_times_cost_nothing() {
        let mut sample = Sample::new(21);
        sample.x[5] = f64::NAN;
        sample.t[6] = f64::INFINITY;
        for t in &mut sample.t {
            *t = if *t >= 500.0 { *t + 1e9 } else { *t };
        }
        let done = run(&sample);
        let x = done.output("table").unwrap().f64("x").unwrap();
        assert!(x[5].is_nan());
        assert_eq!(x[6], sample.x[6]);
        assert_eq!(done.output("drift").unwrap().header.rows(), 1000);
    }
}
