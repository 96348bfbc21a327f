//! The curve of one or several splits, its thresholds and the resolution.

use crate::crossing::{Crossing, crossing};
use crate::smooth::{Smooth, default_span, smooth};
use puncta_shared_fourier::Rings;

/// Normal quantile of an interval of 95 %.
const Z95: f64 = 1.959_963_984_540_054;

/// The three thresholds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Threshold {
    /// 1/7 (Nieuwenhuizen et al., Nature Methods 10, 557, 2013).
    OneSeventh,
    /// Half a bit of information a frequency (van Heel and Schatz, J. Struct. Biol. 151, 250, 2005).
    HalfBit,
    /// Three standard deviations of the correlation of noise.
    ThreeSigma,
}

impl Threshold {
    /// All of them.
    pub const ALL: [Threshold; 3] = [
        Threshold::OneSeventh,
        Threshold::HalfBit,
        Threshold::ThreeSigma,
    ];

    /// Value for a ring of `n` independent frequencies, each with its conjugate twin.
    #[must_use]
    pub fn value(self, n: f64) -> f64 {
        let root = n.sqrt();
        match self {
            Threshold::OneSeventh => 1.0 / 7.0,
            Threshold::HalfBit => (0.2071 + 1.9102 / root) / (1.2071 + 0.9102 / root),
            Threshold::ThreeSigma => 3.0 / root,
        }
    }

    /// Name of its column and value.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Threshold::OneSeventh => "one_seventh",
            Threshold::HalfBit => "half_bit",
            Threshold::ThreeSigma => "three_sigma",
        }
    }
}

/// Ring sums of one split: Re F1 F2*, |F1|^2, |F2|^2.
pub type Sums = Vec<[f64; 3]>;

/// A resolution, in nm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Resolution {
    /// Where the curve falls below the threshold.
    pub crossing: Crossing,
    /// 1 / frequency; NaN if the threshold is not reached.
    pub value: f64,
    /// Where the curve plus and minus 1.96 standard deviations does; NaN where that does not.
    pub interval: [f64; 2],
}

/// The curve of one or several splits.
#[derive(Clone, Debug)]
pub struct Curve {
    /// Distance of two rings, 1/nm.
    pub step: f64,
    /// Frequencies of each ring that the grid has.
    pub frequencies: Vec<f64>,
    /// How many of them are independent of each other.
    pub numbers: Vec<f64>,
    /// The correlation, mean of the splits.
    pub mean: Vec<f64>,
    /// Standard deviation between the splits; NaN for one split.
    pub deviation: Vec<f64>,
    /// Mean power of the halves.
    pub power: [Vec<f64>; 2],
    /// The smoothed mean.
    pub smooth: Smooth,
    /// Rings that it averages.
    pub span: usize,
    /// 1/7 resolution of each split; NaN where not reached.
    pub splits: Vec<f64>,
}

/// Correlation of each ring; NaN where a half has no power.
#[must_use]
pub fn correlation(sums: &[[f64; 3]]) -> Vec<f64> {
    let one = |[cross, a, b]: &[f64; 3]| {
        let power = (a * b).sqrt();
        if power > 0.0 { cross / power } else { f64::NAN }
    };
    sums.iter().map(one).collect()
}

/// Standard deviation of the correlation c of n independent numbers, (1 - c^2) / sqrt(n).
fn error(correlation: &[f64], numbers: &[f64]) -> Vec<f64> {
    let pairs = correlation.iter().zip(numbers);
    pairs
        .map(|(c, n)| (1.0 - c * c).max(0.0) / n.sqrt())
        .collect()
}

impl Curve {
    /// The curve of `splits`; `independent` of the frequencies of a ring are independent. `span`
    /// rings are averaged, or a twentieth of them.
    #[must_use]
    pub fn new(
        rings: &Rings,
        frequencies: Vec<f64>,
        independent: f64,
        splits: &[Sums],
        span: Option<usize>,
    ) -> Curve {
        let count = frequencies.len();
        let span = span.unwrap_or_else(|| default_span(count));
        let numbers: Vec<f64> = frequencies.iter().map(|n| n * independent).collect();
        let curves: Vec<Vec<f64>> = splits.iter().map(|sums| correlation(sums)).collect();
        let (mean, deviation) = moments(&curves, count);
        let power = [1, 2].map(|half| {
            let sum = |ring: usize| splits.iter().map(|sums| sums[ring][half]).sum::<f64>();
            let parts = splits.len().max(1) as f64;
            (0..count)
                .map(|ring| sum(ring) / (parts * frequencies[ring]))
                .collect()
        });
        let smoothed = smooth(&mean, &numbers, &error(&mean, &numbers), span);
        let mut curve = Curve {
            step: rings.step(),
            frequencies,
            numbers,
            mean,
            deviation,
            power,
            smooth: smoothed,
            span,
            splits: Vec::new(),
        };
        let threshold = curve.threshold(Threshold::OneSeventh);
        curve.splits = curves
            .iter()
            .map(|one| {
                let line = smooth(one, &curve.numbers, &vec![0.0; count], span);
                let at = crossing(&line.values, &threshold, one, &curve.numbers);
                1.0 / (at.ring() * curve.step)
            })
            .collect();
        curve
    }

    /// Number of rings.
    #[must_use]
    pub fn rings(&self) -> usize {
        self.mean.len()
    }

    /// Spatial frequency of each ring, 1/nm.
    #[must_use]
    pub fn frequency(&self) -> Vec<f64> {
        (0..self.rings()).map(|i| i as f64 * self.step).collect()
    }

    /// Finest period that the grid can show, nm.
    #[must_use]
    pub fn finest(&self) -> f64 {
        1.0 / ((self.rings() - 1) as f64 * self.step)
    }

    /// A threshold for each ring.
    #[must_use]
    pub fn threshold(&self, threshold: Threshold) -> Vec<f64> {
        self.numbers.iter().map(|n| threshold.value(*n)).collect()
    }

    /// Lower and upper end of the smoothed curve's band of 95 %.
    #[must_use]
    pub fn band(&self) -> [Vec<f64>; 2] {
        let Smooth { values, errors } = &self.smooth;
        [-Z95, Z95].map(|z| values.iter().zip(errors).map(|(v, e)| v + z * e).collect())
    }

    /// The resolution at a threshold.
    #[must_use]
    pub fn resolution(&self, threshold: Threshold) -> Resolution {
        let limit = self.threshold(threshold);
        let at = |line: &[f64]| crossing(line, &limit, &self.mean, &self.numbers);
        let length = |crossing: Crossing| 1.0 / (crossing.ring() * self.step);
        let crossing = at(&self.smooth.values);
        let [low, high] = self.band();
        Resolution {
            crossing,
            value: length(crossing),
            interval: [length(at(&high)), length(at(&low))],
        }
    }
}

/// Mean and standard deviation of the curves at each ring, of those that are not NaN.
fn moments(curves: &[Vec<f64>], count: usize) -> (Vec<f64>, Vec<f64>) {
    (0..count)
        .map(|ring| {
            let values = curves.iter().map(|curve| curve[ring]);
            mean_and_deviation(values.filter(|v| v.is_finite()))
        })
        .unzip()
}

/// Mean, and standard deviation with n - 1; NaN of none, and of one.
#[must_use]
pub fn mean_and_deviation(values: impl Iterator<Item = f64> + Clone) -> (f64, f64) {
    let n = values.clone().count() as f64;
    let mean = values.clone().sum::<f64>() / n;
    let square = values.map(|v| (v - mean).powi(2)).sum::<f64>();
    let variance = if n > 1.0 {
        square / (n - 1.0)
    } else {
        f64::NAN
    };
    (mean, variance.sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn thresholds_have_their_published_values() {
        assert_eq!(Threshold::OneSeventh.value(4.0), 1.0 / 7.0);
        // (0.2071 + 1.9102/10) / (1.2071 + 0.9102/10) by hand.
        assert!((Threshold::HalfBit.value(100.0) - 0.306_690).abs() < 1e-6);
        assert!((Threshold::HalfBit.value(1e12) - 0.171_57).abs() < 1e-5);
        assert_eq!(Threshold::ThreeSigma.value(900.0), 0.1);
    }

    #[test]
    fn equal_halves_correlate_completely() {
        let sums: Vec<[f64; 3]> = (1..40).map(|i| [0.1 * f64::from(i); 3]).collect();
        assert!(correlation(&sums).iter().all(|c| *c == 1.0));
        assert!(correlation(&[[0.0; 3]])[0].is_nan());
        let rings = Rings::new([1, 78, 78], [1.0, 5.0, 5.0]);
        let numbers = vec![100.0; 39];
        let curve = Curve::new(&rings, numbers, 1.0, &[sums], None);
        let found = curve.resolution(Threshold::OneSeventh);
        assert_eq!(found.crossing, Crossing::Beyond);
        assert!(found.value.is_nan() && curve.splits[0].is_nan());
        assert!(curve.deviation[3].is_nan());
    }

    #[test]
    fn a_known_curve_has_its_resolution() {
        // exp(-(q/q0)^2) meets 1/7 at q0 sqrt(ln 7); q0 is ring 60 of 200.
        let rings = Rings::new([1, 400, 400], [1.0, 5.0, 5.0]);
        let curve = |phase: f64| -> Sums {
            let value = |r: f64| (-(r / 60.0).powi(2)).exp() + 0.002 * (phase * r).sin();
            (0..=200).map(|r| [value(f64::from(r)), 1.0, 1.0]).collect()
        };
        let numbers: Vec<f64> = (0..=200).map(|r| 1.0 + 6.0 * f64::from(r)).collect();
        let found = Curve::new(&rings, numbers, 0.8, &[curve(1.0), curve(2.0)], None);
        let truth = 2000.0 / (60.0 * 7.0_f64.ln().sqrt());
        let resolution = found.resolution(Threshold::OneSeventh);
        assert!(
            (resolution.value / truth - 1.0).abs() < 0.01,
            "{resolution:?} {truth}"
        );
        let [fine, coarse] = resolution.interval;
        assert!(fine < resolution.value && resolution.value < coarse);
        assert_eq!(found.splits.len(), 2);
        assert!(found.deviation[100] > 0.0);
        assert_eq!(found.finest(), 10.0);
    }
}
