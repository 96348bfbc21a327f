//! Where a curve falls below a threshold.

/// Standard deviations by which the mean correlation up to a crossing must exceed that of noise.
const SIGNIFICANT: f64 = 5.0;

/// Where a curve falls below a threshold.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Crossing {
    /// At this ring, interpolated.
    At(f64),
    /// No part of the curve above the threshold differs from noise.
    Never,
    /// The curve stays above up to the last ring.
    Beyond,
}

impl Crossing {
    /// The ring; NaN if there is none.
    #[must_use]
    pub fn ring(self) -> f64 {
        match self {
            Crossing::At(ring) => ring,
            Crossing::Never | Crossing::Beyond => f64::NAN,
        }
    }
}

/// The first crossing, from low frequencies, of the smoothed curve through the threshold.
///
/// A crossing counts only if the correlation of the rings up to it is no chance: with n independent
/// numbers a ring, sum(n c) / sqrt(sum(n)) is normal with standard deviation 1 for noise, and must
/// exceed 5. So the first rings, which hold few frequencies, neither start nor end a curve.
#[must_use]
pub fn crossing(smooth: &[f64], threshold: &[f64], raw: &[f64], numbers: &[f64]) -> Crossing {
    let (mut sum, mut all) = (0.0, 0.0);
    let mut above: Option<usize> = None;
    let mut significant = false;
    for i in 1..smooth.len() {
        let excess = smooth[i] - threshold[i];
        if !excess.is_finite() {
            continue;
        }
        if excess < 0.0
            && significant
            && let Some(last) = above
        {
            let before = smooth[last] - threshold[last];
            let share = before / (before - excess);
            return Crossing::At(last as f64 + share * (i - last) as f64);
        }
        above = (excess >= 0.0).then_some(i);
        if raw[i].is_finite() {
            sum += numbers[i] * raw[i];
            all += numbers[i];
        }
        significant = sum > SIGNIFICANT * all.sqrt();
    }
    match above {
        Some(_) if significant => Crossing::Beyond,
        _ => Crossing::Never,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(curve: &[f64], number: f64) -> Crossing {
        let n = curve.len();
        crossing(curve, &vec![0.25; n], curve, &vec![number; n])
    }

    #[test]
    fn the_first_significant_crossing_counts() {
        let curve = [1.0, 0.75, 0.5, 0.125, 0.5, 0.5];
        assert_eq!(of(&curve, 100.0), Crossing::At(2.0 + 2.0 / 3.0));
        // With few frequencies the first dip could be chance, and so could all the rest.
        assert_eq!(of(&curve, 1.0), Crossing::Never);
        assert_eq!(of(&[1.0; 50], 10.0), Crossing::Beyond);
        assert_eq!(of(&[0.0; 50], 10.0), Crossing::Never);
        assert_eq!(of(&[], 1.0), Crossing::Never);
        assert_eq!(of(&[f64::NAN; 5], 1.0), Crossing::Never);
        assert!(Crossing::Never.ring().is_nan());
    }

    #[test]
    fn a_low_start_is_passed_over() {
        let mut curve = vec![0.0, 0.1, 0.9, 0.9, 0.9, 0.05, 0.05];
        assert_eq!(of(&curve, 50.0), Crossing::At(4.0 + 0.65 / 0.85));
        curve.truncate(5);
        assert_eq!(of(&curve, 50.0), Crossing::Beyond);
    }
}
