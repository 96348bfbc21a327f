//! Steps: which nodes show one, when it happened, and drifts with a step as good as without.

use super::*;
use crate::testing::{Sample, normal, step_errors};
use puncta_testkit::{Call, Stopped};

fn nodes(seed: u64, drift: impl Fn(f64) -> f64) -> (Vec<f64>, Vec<[f64; 3]>) {
    let times: Vec<f64> = (0..50).map(|i| f64::from(i) * 20.0).collect();
    let noise = |i: usize, axis: u64| normal(i as u64, 10 * seed + axis);
    let value = |(i, t): (usize, &f64)| [drift(*t) + noise(i, 0), noise(i, 1), 0.0];
    let values = times.iter().enumerate().map(value).collect();
    (times, values)
}

#[test]
fn a_step_stands_out_from_noise_and_from_a_smooth_drift() {
    let smooth = |t: f64| 0.15 * t + 30.0 * (t / 110.0).sin();
    for seed in 0..40 {
        let (times, values) = nodes(seed, smooth);
        assert_eq!(candidates(&times, &values, &[], 5, 3.0, true), Vec::new());
        assert!(sudden(&times, &values, 5, 3.0).is_empty());
        let step = |t: f64| smooth(t) + if t < 500.0 { 0.0 } else { 40.0 };
        let (times, mut values) = nodes(seed, step);
        assert_eq!(sudden(&times, &values, 5, 3.0), [500.0]);
        // In the middle of the bin about 500.
        values[25][0] -= 20.0;
        let found = candidates(&times, &values, &[], 5, 3.0, true);
        assert_eq!((found.len(), found[0].node), (1, 25));
        assert!((found[0].model.step()[0] - 40.0).abs() < 10.0);
        assert_eq!(
            candidates(&times, &values, &[500.0], 5, 3.0, true),
            Vec::new()
        );
    }
}

#[test]
fn known_steps_are_sorted_and_must_be_numbers() {
    let steps = |breaks: &[f64]| Steps {
        breaks: breaks.to_vec(),
        find_breaks: false,
    };
    assert_eq!(steps(&[7.0, 3.0, 7.0]).known().unwrap(), [3.0, 7.0]);
    let refused = steps(&[1.0, f64::NAN]).known().unwrap_err().to_string();
    assert!(refused.contains("time of a step"), "{refused}");
}

/// The drift of the tests, with a step at frame 437 along the axes of `step`.
fn with_step(seed: u64, step: [f64; 3]) -> Sample {
    let mut sample = Sample::with(seed, |t| {
        let u = t / 1000.0;
        let smooth = [150.0 * u + 30.0 * (9.0 * u).sin(), -90.0 * u * u, 80.0 * u];
        let jump = if t < 437.0 { 0.0 } else { 1.0 };
        std::array::from_fn(|axis| smooth[axis] + jump * step[axis])
    });
    sample.three = step[2] != 0.0;
    sample
}

/// Root mean square errors of a method, for each axis, over five seeds; a step must not add more
/// than a tenth and `margin` nm.
fn as_good_as_without<O: Operation + Sync>(step: [f64; 3], margin: f64) {
    let run = |sample: &Sample| {
        let call = Call::of::<O>().input("table", sample.table());
        step_errors(&call.threads(2).run().unwrap(), sample)
    };
    for seed in 0..5 {
        let mut without = with_step(30 + seed, [0.0; 3]);
        without.three = step[2] != 0.0;
        let (smooth, none) = run(&without);
        let (stepped, found) = run(&with_step(30 + seed, step));
        assert_eq!(none, "");
        let at: f64 = found.parse().unwrap();
        assert!((at - 437.0).abs() <= 1.0, "{found}");
        for (smooth, stepped) in smooth.iter().zip(&stepped) {
            assert!(*stepped < 1.1 * smooth + margin, "{smooth} {stepped}");
        }
    }
}

#[test]
fn least_entropy_with_a_step_in_x_and_y_is_as_good() {
    as_good_as_without::<crate::operations::entropy::Entropy>([60.0, -45.0, 0.0], 0.3);
}

#[test]
fn least_entropy_with_a_step_in_z_is_as_good() {
    as_good_as_without::<crate::operations::entropy::Entropy>([40.0, -30.0, 90.0], 0.3);
}

#[test]
fn redundant_correlation_with_a_step_is_as_good() {
    as_good_as_without::<crate::operations::rcc::Rcc>([60.0, -45.0, 0.0], 0.6);
}

#[test]
fn adaptive_intersection_with_a_step_is_as_good() {
    as_good_as_without::<crate::operations::aim::Aim>([40.0, -30.0, 0.0], 0.6);
}

#[test]
fn a_step_that_is_given_is_not_looked_for() {
    let sample = with_step(40, [300.0, -120.0, 0.0]);
    let call = Call::of::<crate::operations::aim::Aim>().input("table", sample.table());
    let call = call.set("find_breaks", false).set("breaks", vec![437.0]);
    let (errors, steps) = step_errors(&call.run().unwrap(), &sample);
    assert_eq!(steps, "437");
    assert!(errors.iter().all(|error| *error < 6.0), "{errors:?}");
}

#[test]
fn a_search_that_is_cancelled_ends() {
    let cloud = Cloud {
        times: vec![0.0],
        ..Cloud::default()
    };
    let stopped = Steps::default().estimate(&cloud, &Stopped, |_| Err(Failure::cancelled()));
    assert!(stopped.unwrap_err().is_cancelled());
}
