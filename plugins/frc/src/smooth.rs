//! The smoothed curve, and its error.

/// A smoothed curve.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Smooth {
    /// Its values; NaN where no neighbour has a value.
    pub values: Vec<f64>,
    /// Their standard deviations, from those of the values that were averaged.
    pub errors: Vec<f64>,
}

/// Rings that are averaged when nothing else is said: a twentieth of them, at least 5.
#[must_use]
pub fn default_span(rings: usize) -> usize {
    (rings / 20).max(5)
}

/// LOESS of degree 1: at each ring a straight line is fitted to the `span` rings around it, with
/// tricube weights (Cleveland, J. Am. Stat. Assoc. 74, 829, 1979) times their numbers of independent
/// frequencies. Ring 0 and rings with NaN take no part. A span of 1 or less changes nothing.
#[must_use]
pub fn smooth(values: &[f64], numbers: &[f64], errors: &[f64], span: usize) -> Smooth {
    let reach = span / 2;
    let mut out = Smooth::default();
    for i in 0..values.len() {
        let from = i.saturating_sub(reach).max(1).min(i);
        let to = (i + reach + 1).min(values.len());
        let (value, error) = line(i, from..to, reach, values, numbers, errors);
        out.values.push(value);
        out.errors.push(error);
    }
    out
}

fn line(
    at: usize,
    range: std::ops::Range<usize>,
    reach: usize,
    values: &[f64],
    numbers: &[f64],
    errors: &[f64],
) -> (f64, f64) {
    let weight = |j: usize| {
        let distance = j.abs_diff(at) as f64 / (reach + 1) as f64;
        (1.0 - distance.powi(3)).powi(3) * numbers[j]
    };
    let used = || {
        range
            .clone()
            .filter(|j| values[*j].is_finite() && numbers[*j] > 0.0)
    };
    let [mut s0, mut s1, mut s2] = [0.0; 3];
    for j in used() {
        let (w, d) = (weight(j), j as f64 - at as f64);
        s0 += w;
        s1 += w * d;
        s2 += w * d * d;
    }
    if s0 <= 0.0 {
        return (f64::NAN, f64::NAN);
    }
    let determinant = s0 * s2 - s1 * s1;
    let level = determinant <= 1e-9 * s0 * s2;
    let (mut value, mut variance) = (0.0, 0.0);
    for j in used() {
        let (w, d) = (weight(j), j as f64 - at as f64);
        let share = if level {
            w / s0
        } else {
            w * (s2 - s1 * d) / determinant
        };
        value += share * values[j];
        variance += (share * errors[j]).powi(2);
    }
    (value, variance.sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn straight_lines_stay() {
        let values: Vec<f64> = (0..40).map(|i| 1.0 - 0.02 * f64::from(i)).collect();
        let numbers: Vec<f64> = (0..40).map(|i| 1.0 + 6.0 * f64::from(i)).collect();
        let smooth = smooth(&values, &numbers, &[0.1; 40], 9);
        for (i, (a, b)) in values.iter().zip(&smooth.values).enumerate() {
            assert!((a - b).abs() < 1e-12, "{i}");
        }
        // Nine rings with tricube weights average about six.
        assert!(
            (0.035..0.055).contains(&smooth.errors[20]),
            "{}",
            smooth.errors[20]
        );
    }

    #[test]
    fn a_span_of_one_changes_nothing_and_gaps_are_bridged() {
        let values = [1.0, 0.9, f64::NAN, 0.7, 0.6];
        let one = smooth(&values, &[1.0; 5], &[0.1; 5], 1);
        assert_eq!(one.values[3], 0.7);
        assert!(one.values[2].is_nan());
        let three = smooth(&values, &[1.0; 5], &[0.1; 5], 3);
        assert!((three.values[2] - 0.8).abs() < 1e-12);
        assert_eq!(default_span(30), 5);
        assert_eq!(default_span(500), 25);
    }
}
