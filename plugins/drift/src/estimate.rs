//! A drift with its error: the whole data, two random halves, and smoothing.

use crate::bins::Bins;
use crate::curve::{Curve, Interpolation};
use crate::smooth::Nodes;

/// Share of the series over which the error band is averaged, to each side.
const BAND: f64 = 0.05;

/// Drift of each bin, from all localisations and from two random halves of them.
#[derive(Clone, Debug, Default)]
pub struct Trials {
    /// From all localisations.
    pub whole: Vec<[f64; 3]>,
    /// From each half.
    pub halves: [Vec<[f64; 3]>; 2],
}

/// A drift and its standard error.
#[derive(Clone, Debug, Default)]
pub struct Estimate {
    /// The drift.
    pub curve: Curve,
    /// Its standard error at the nodes.
    pub error: Vec<[f64; 3]>,
    /// Root mean square of half the difference between the halves, for each axis, nm.
    pub rms: [f64; 3],
    /// Between the nodes.
    pub interpolation: Interpolation,
    /// What was found and left out, for the report.
    pub notes: Vec<Note>,
}

impl Estimate {
    /// Brings z from the estimators' scale back to nm.
    pub fn scale_z(&mut self, scale: f64) {
        for values in [&mut self.curve.values, &mut self.error] {
            values.iter_mut().for_each(|v| v[2] *= scale);
        }
        self.rms[2] *= scale;
    }

    /// The largest error from split halves, nm.
    pub fn worst(&self) -> f64 {
        self.rms.iter().fold(0.0, |high: f64, v| high.max(*v))
    }
}

/// A number for the report.
#[derive(Clone, Debug, PartialEq)]
pub struct Note {
    /// Name.
    pub name: &'static str,
    /// Value.
    pub value: f64,
    /// Unit.
    pub unit: &'static str,
    /// What it is.
    pub meaning: &'static str,
}

/// Shorthand for a [`Note`].
pub fn note(name: &'static str, value: f64, unit: &'static str, meaning: &'static str) -> Note {
    Note {
        name,
        value,
        unit,
        meaning,
    }
}

/// Smooths the drift as far as the halves support it, and takes its error from them.
pub fn combine(bins: &Bins, mut trials: Trials, axes: usize, breaks: Vec<f64>) -> Estimate {
    let mut curve = Curve {
        times: bins.centre.clone(),
        values: vec![[0.0; 3]; bins.len()],
        breaks,
    };
    let pieces = curve.pieces();
    let nodes = Nodes {
        times: &bins.centre,
        weights: &bins.count,
        pieces: &pieces,
    };
    let mut error = vec![[0.0; 3]; bins.len()];
    let mut rms = [0.0; 3];
    for values in [&mut trials.whole]
        .into_iter()
        .chain(trials.halves.iter_mut())
    {
        centre(values, &bins.count);
    }
    for axis in 0..axes {
        let of = |values: &[[f64; 3]]| values.iter().map(|v| v[axis]).collect::<Vec<f64>>();
        let [a, b] = [0, 1].map(|half| of(&trials.halves[half]));
        let lambda = nodes.best(&a, &b);
        let whole = nodes.smooth(&of(&trials.whole), lambda);
        let (a, b) = (nodes.smooth(&a, lambda), nodes.smooth(&b, lambda));
        let half = |(a, b): (&f64, &f64)| (a - b) / 2.0;
        let halves: Vec<f64> = a.iter().zip(&b).map(half).collect();
        let spread = spread(&halves, &bins.count);
        let total: f64 = bins.count.iter().sum();
        let sum: f64 = halves.iter().zip(&bins.count).map(|(h, w)| w * h * h).sum();
        rms[axis] = (sum / total.max(1.0)).sqrt();
        for i in 0..bins.len() {
            curve.values[i][axis] = whole[i];
            error[i][axis] = spread[i];
        }
    }
    Estimate {
        curve,
        error,
        rms,
        ..Estimate::default()
    }
}

/// Takes the weighted mean off.
pub fn centre(values: &mut [[f64; 3]], weights: &[f64]) {
    let total: f64 = weights.iter().sum::<f64>().max(f64::MIN_POSITIVE);
    for axis in 0..3 {
        let sum: f64 = values.iter().zip(weights).map(|(v, w)| v[axis] * w).sum();
        values.iter_mut().for_each(|v| v[axis] -= sum / total);
    }
}

/// Running root mean square.
fn spread(values: &[f64], weights: &[f64]) -> Vec<f64> {
    let n = values.len();
    let reach = ((n as f64 * BAND).ceil() as usize).max(3);
    let at = |i: usize| {
        let window = i.saturating_sub(reach)..(i + reach + 1).min(n);
        let total: f64 = weights[window.clone()].iter().sum();
        let sum: f64 = window.map(|k| weights[k] * values[k] * values[k]).sum();
        (sum / total.max(f64::MIN_POSITIVE)).sqrt()
    };
    (0..n).map(at).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_error_is_half_the_difference_of_the_halves() {
        let n = 40;
        let bins = Bins {
            of_frame: Vec::new(),
            centre: (0..n).map(f64::from).collect(),
            count: vec![10.0; 40],
        };
        let line = |slope: f64| -> Vec<[f64; 3]> {
            (0..n).map(|i| [slope * f64::from(i), 0.0, 0.0]).collect()
        };
        let trials = Trials {
            whole: line(1.0),
            halves: [line(1.1), line(0.9)],
        };
        let estimate = combine(&bins, trials, 2, Vec::new());
        // Half the difference is 0.1 (i - 19.5); its mean square 0.01 (n^2 - 1) / 12.
        let expected = (0.01 * (1600.0 - 1.0) / 12.0_f64).sqrt();
        assert!((estimate.rms[0] - expected).abs() < 0.02 * expected);
        assert!(estimate.rms[1] < 1e-12);
        assert!(estimate.error[0][0] > 1.6 && estimate.error[20][0] < 0.3);
        let first = estimate.curve.values[0][0];
        assert!((estimate.curve.values[39][0] - first - 39.0).abs() < 1e-3);
    }
}
