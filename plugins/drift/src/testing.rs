//! Simulated localisations with a known drift, for tests.

use crate::cloud::hash;
use puncta_testkit::{Done, Table};

/// Filaments and clusters in 6 x 6 um, 1000 frames, precision about 10 nm.
#[derive(Clone, Debug)]
pub struct Sample {
    pub x: Vec<f64>,
    pub y: Vec<f64>,
    pub z: Vec<f64>,
    pub t: Vec<f64>,
    /// True drift at each of the 1000 frames.
    pub truth: Vec<[f64; 3]>,
    pub three: bool,
}

/// Uniform in [0, 1).
pub fn uniform(number: u64, seed: u64) -> f64 {
    (hash(number, seed) >> 11) as f64 / (1u64 << 53) as f64
}

/// Standard normal.
pub fn normal(number: u64, seed: u64) -> f64 {
    let radius = (-2.0 * (1.0 - uniform(number, hash(1, seed))).ln()).sqrt();
    radius * (std::f64::consts::TAU * uniform(number, hash(2, seed))).cos()
}

impl Sample {
    /// A smooth drift.
    pub fn new(seed: u64) -> Self {
        Self::with(seed, |t| {
            let t = t / 1000.0;
            [150.0 * t + 30.0 * (9.0 * t).sin(), -90.0 * t * t, 80.0 * t]
        })
    }

    /// A drift of one's own.
    pub fn with(seed: u64, drift: impl Fn(f64) -> [f64; 3]) -> Self {
        let mut sample = Self {
            x: vec![],
            y: vec![],
            z: vec![],
            t: vec![],
            truth: (0..1000).map(|t| drift(f64::from(t))).collect(),
            three: false,
        };
        for i in 0..30_000u64 {
            let value = |k: u64| uniform(i, hash(k, seed));
            let noise = |k: u64| normal(i, hash(k, seed)) * 10.0;
            let fibre = (value(1) * 60.0) as u64;
            let of = |k: u64| uniform(fibre, hash(k, seed));
            let angle = std::f64::consts::TAU * of(20);
            let along = 3000.0 * value(2);
            let frame = (value(3) * 1000.0) as usize;
            let d = sample.truth[frame];
            sample
                .x
                .push(6000.0 * of(21) + along * angle.cos() + noise(4) + d[0]);
            sample
                .y
                .push(6000.0 * of(22) + along * angle.sin() + noise(5) + d[1]);
            sample
                .z
                .push(300.0 * (along / 500.0).sin() + 2.5 * noise(6) + d[2]);
            sample.t.push(frame as f64);
        }
        sample
    }

    /// One of `step` localisations.
    pub fn thinned(mut self, step: usize) -> Self {
        for values in [&mut self.x, &mut self.y, &mut self.z, &mut self.t] {
            *values = values.iter().copied().step_by(step).collect();
        }
        self
    }

    /// As a table, with z if `three`.
    pub fn table(&self) -> Table {
        let table = Table::new("locs")
            .f64("x", "nm", &self.x)
            .f64("y", "nm", &self.y)
            .f64("t", "frame", &self.t);
        if self.three {
            table.f64("z", "nm", &self.z)
        } else {
            table
        }
    }
}

/// Largest root mean square error of an axis of the drift table, mean removed, nm.
pub fn drift_error(done: &Done, sample: &Sample) -> f64 {
    let (errors, _) = step_errors(done, sample);
    errors.into_iter().fold(0.0, f64::max)
}

/// Root mean square error of each axis of the drift table, mean removed, nm; and the times of the
/// steps in the report.
pub fn step_errors(done: &Done, sample: &Sample) -> (Vec<f64>, String) {
    let table = done.output("drift").unwrap();
    let times = table.f64("t").unwrap();
    let error = |(axis, name): (usize, &str)| {
        let values = table.f64(name).unwrap();
        let truth = times.iter().map(|t| sample.truth[*t as usize][axis]);
        let miss: Vec<f64> = values.iter().zip(truth).map(|(v, t)| v - t).collect();
        let mean = miss.iter().sum::<f64>() / miss.len() as f64;
        (miss.iter().map(|m| (m - mean).powi(2)).sum::<f64>() / miss.len() as f64).sqrt()
    };
    let axes = if sample.three { 3 } else { 2 };
    let names = ["x", "y", "z"].into_iter().enumerate().take(axes);
    let steps = done
        .reported("step_times")
        .and_then(|entry| entry["value"].as_str());
    let steps = steps.unwrap_or_default();
    (names.map(error).collect(), steps.to_owned())
}
