//! Histograms and simple statistics of one column.

/// Counts in bins of equal width.
#[derive(Clone, Debug, PartialEq)]
pub struct Bins {
    /// Low edge of the first bin.
    pub low: f64,
    /// Width of a bin.
    pub width: f64,
    /// Counts; what lies beyond the last bin is not counted.
    pub counts: Vec<f64>,
}

impl Bins {
    /// Counts sorted values in `bins` bins from `low` to `high`.
    #[must_use]
    pub fn new(sorted: &[f64], low: f64, high: f64, bins: usize) -> Bins {
        let width = (high - low) / bins as f64;
        let mut counts = vec![0.0; bins];
        for value in sorted {
            let place = (value - low) / width;
            if place >= 0.0
                && let Some(count) = counts.get_mut(place as usize)
            {
                *count += 1.0;
            }
        }
        Bins { low, width, counts }
    }

    /// Middle of each bin.
    #[must_use]
    pub fn middles(&self) -> Vec<f64> {
        (0..self.counts.len())
            .map(|i| self.low + (i as f64 + 0.5) * self.width)
            .collect()
    }

    /// Middle of the fullest bin, the first of equal ones.
    #[must_use]
    pub fn mode(&self) -> f64 {
        let mut best = 0;
        for (i, count) in self.counts.iter().enumerate() {
            if *count > self.counts[best] {
                best = i;
            }
        }
        self.low + (best as f64 + 0.5) * self.width
    }
}

/// A value with its interval of 95 %.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate {
    /// The value.
    pub value: f64,
    /// Lower and upper end.
    pub interval: [f64; 2],
}

/// Normal quantile of an interval of 95 %.
pub const Z95: f64 = 1.959_963_984_540_054;

impl Estimate {
    /// A value with a standard error, as for large samples.
    #[must_use]
    pub fn normal(value: f64, error: f64) -> Estimate {
        Estimate {
            value,
            interval: [value - Z95 * error, value + Z95 * error],
        }
    }
}

/// Mean with its interval from the standard error; the interval of one value is NaN.
#[must_use]
pub fn mean(values: &[f64]) -> Estimate {
    let n = values.len() as f64;
    Estimate::normal(values.iter().sum::<f64>() / n, deviation(values) / n.sqrt())
}

/// Standard deviation with n - 1; NaN for fewer than two.
#[must_use]
pub fn deviation(values: &[f64]) -> f64 {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    let square: f64 = values.iter().map(|v| (v - mean).powi(2)).sum();
    if n > 1.0 {
        (square / (n - 1.0)).sqrt()
    } else {
        f64::NAN
    }
}

/// Median of sorted values. Its interval is that between order statistics whose ranks follow from
/// the binomial distribution (normal approximation), whatever the values' distribution.
#[must_use]
pub fn median(sorted: &[f64]) -> Estimate {
    let n = sorted.len();
    let Some(last) = n.checked_sub(1) else {
        return Estimate {
            value: f64::NAN,
            interval: [f64::NAN; 2],
        };
    };
    let half = 0.5 * Z95 * (n as f64).sqrt();
    let middle = 0.5 * n as f64;
    let low = (middle - half).floor().max(0.0) as usize;
    let high = ((middle + half).ceil() as usize).min(last);
    Estimate {
        value: 0.5 * (sorted[last / 2] + sorted[n / 2]),
        interval: [sorted[low], sorted[high]],
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn small_samples_by_hand() {
        let values = [1.0, 2.0, 3.0, 4.0];
        assert_eq!(mean(&values).value, 2.5);
        let error = (5.0_f64 / 3.0).sqrt() / 2.0;
        assert!((mean(&values).interval[0] - (2.5 - Z95 * error)).abs() < 1e-12);
        assert_eq!(median(&values).value, 2.5);
        assert_eq!(median(&[3.0]).interval, [3.0, 3.0]);
        assert!(median(&[]).value.is_nan());
        assert!(mean(&[3.0]).interval[0].is_nan());
        let bins = Bins::new(&[0.0, 1.0, 1.5, 9.0], 0.0, 4.0, 4);
        assert_eq!(
            (bins.counts.clone(), bins.mode()),
            (vec![1.0, 2.0, 0.0, 0.0], 1.5)
        );
        assert_eq!(bins.middles(), [0.5, 1.5, 2.5, 3.5]);
    }

    /// The interval of the median of 100 values: ranks 40 and 60 of 0 to 99 enclose 95 %.
    #[test]
    fn the_interval_of_the_median_has_its_ranks() {
        let values: Vec<f64> = (0..100).map(f64::from).collect();
        assert_eq!(median(&values).interval, [40.0, 60.0]);
    }
}
