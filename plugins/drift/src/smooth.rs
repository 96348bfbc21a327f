//! Smoothing of the bins' drifts, as strong as two independent halves of the data allow.
//!
//! Whittaker's smoother: of all curves the one that minimises sum w (y - s)^2 + lambda sum of the
//! squared second divided differences. Lambda is the one for which the smoothed drift of one half
//! predicts that of the other half best, so that a jump or a fast drift is not smoothed away.

use std::ops::Range;

/// Values by node, their weights, and the pieces that are smoothed apart.
#[derive(Clone, Copy, Debug)]
pub struct Nodes<'a> {
    /// Times of the nodes, strictly increasing.
    pub times: &'a [f64],
    /// Weight of each node, such as its number of localisations.
    pub weights: &'a [f64],
    /// Pieces between breaks.
    pub pieces: &'a [Range<usize>],
}

/// Strengths that are tried, in mean weights; 0 is none.
const LADDER: usize = 22;

impl Nodes<'_> {
    /// The strength with which each half predicts the other best.
    pub fn best(&self, a: &[f64], b: &[f64]) -> f64 {
        let loss = |lambda: f64| {
            let (smooth_a, smooth_b) = (self.smooth(a, lambda), self.smooth(b, lambda));
            let miss = |i: usize| (smooth_a[i] - b[i]).powi(2) + (smooth_b[i] - a[i]).powi(2);
            (0..a.len()).map(|i| self.weights[i] * miss(i)).sum::<f64>()
        };
        let ladder = (0..LADDER).map(|k| 0.05 * 3f64.powi(k as i32));
        let mut best = (loss(0.0), 0.0);
        for lambda in ladder {
            let loss = loss(lambda);
            if loss < best.0 {
                best = (loss, lambda);
            }
        }
        best.1
    }

    /// Smooths values.
    pub fn smooth(&self, values: &[f64], lambda: f64) -> Vec<f64> {
        let mut out = values.to_vec();
        if lambda <= 0.0 {
            return out;
        }
        for piece in self.pieces {
            let part = self.piece(values, piece.clone(), lambda);
            out[piece.clone()].copy_from_slice(&part);
        }
        out
    }

    /// Solves (W + lambda D' D) s = W y by a banded Cholesky factorisation.
    fn piece(&self, values: &[f64], piece: Range<usize>, lambda: f64) -> Vec<f64> {
        let n = piece.len();
        let (times, weights) = (&self.times[piece.clone()], &self.weights[piece.clone()]);
        let values = &values[piece];
        if n < 3 {
            return values.to_vec();
        }
        let mean = weights.iter().sum::<f64>() / n as f64;
        let usual = (times[n - 1] - times[0]) / (n - 1) as f64;
        // Rows of the lower band: diagonal, first and second subdiagonal.
        let mut band: Vec<[f64; 3]> = weights.iter().map(|w| [w / mean, 0.0, 0.0]).collect();
        for i in 1..n - 1 {
            let (left, right) = (times[i] - times[i - 1], times[i + 1] - times[i]);
            let scale = 2.0 * usual * usual / (left + right);
            let d = [scale / left, -scale / left - scale / right, scale / right];
            let lambda = lambda * f64::midpoint(left, right) / usual;
            for (p, row) in (i - 1..).zip(0..3) {
                for k in 0..=row {
                    band[p][row - k] += lambda * d[row] * d[k];
                }
            }
        }
        let mut right: Vec<f64> = (0..n).map(|i| weights[i] / mean * values[i]).collect();
        solve_band(&mut band, &mut right);
        right
    }
}

/// Solves a symmetric system whose rows hold the diagonal and the two entries left of it.
fn solve_band(band: &mut [[f64; 3]], right: &mut [f64]) {
    let n = band.len();
    for i in 0..n {
        let second = if i >= 2 {
            band[i][2] / band[i - 2][0]
        } else {
            0.0
        };
        let cross = if i >= 2 { second * band[i - 1][1] } else { 0.0 };
        let first = if i >= 1 {
            (band[i][1] - cross) / band[i - 1][0]
        } else {
            0.0
        };
        let diagonal = (band[i][0] - first * first - second * second).max(f64::MIN_POSITIVE);
        band[i] = [diagonal.sqrt(), first, second];
        let mut rest = right[i];
        if i >= 1 {
            rest -= first * right[i - 1];
        }
        if i >= 2 {
            rest -= second * right[i - 2];
        }
        right[i] = rest / band[i][0];
    }
    for i in (0..n).rev() {
        if i + 1 < n {
            right[i] -= band[i + 1][1] * right[i + 1];
        }
        if i + 2 < n {
            right[i] -= band[i + 2][2] * right[i + 2];
        }
        right[i] /= band[i][0];
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cloud::hash;

    fn noise(i: usize, seed: u64) -> f64 {
        let uniform = |s| (hash(i as u64, s) >> 11) as f64 / (1u64 << 53) as f64;
        (0..12).map(|k| uniform(seed * 100 + k)).sum::<f64>() - 6.0
    }

    #[test]
    fn a_line_stays_and_a_curve_is_followed() {
        let n = 300;
        let times: Vec<f64> = (0..n)
            .map(|i| f64::from(i) + 0.3 * noise(i as usize, 1))
            .collect();
        let weights: Vec<f64> = (0..n).map(|i| 1.0 + f64::from(i % 3)).collect();
        let all = 0..300;
        let pieces = std::slice::from_ref(&all);
        let nodes = Nodes {
            times: &times,
            weights: &weights,
            pieces,
        };
        let line: Vec<f64> = times.iter().map(|t| 3.0 - 0.5 * t).collect();
        for (s, v) in nodes.smooth(&line, 1e6).iter().zip(&line) {
            assert!((s - v).abs() < 1e-6);
        }
        let truth: Vec<f64> = times.iter().map(|t| 50.0 * (t / 40.0).sin()).collect();
        let noisy = |seed: u64| -> Vec<f64> {
            let value = |i: usize| truth[i] + noise(i, seed) / weights[i].sqrt();
            (0..truth.len()).map(value).collect()
        };
        let (a, b) = (noisy(5), noisy(6));
        let lambda = nodes.best(&a, &b);
        let rms = |values: &[f64]| {
            let sum: f64 = values
                .iter()
                .zip(&truth)
                .map(|(v, t)| (v - t).powi(2))
                .sum();
            (sum / values.len() as f64).sqrt()
        };
        assert!(rms(&a) > 0.6);
        assert!(rms(&nodes.smooth(&a, lambda)) < 0.3);
    }

    #[test]
    fn a_jump_is_not_smoothed_unless_it_is_a_break() {
        let times: Vec<f64> = (0..100).map(f64::from).collect();
        let weights = vec![1.0; 100];
        let half = |seed| -> Vec<f64> {
            (0..100)
                .map(|i| if i < 40 { 0.0 } else { 200.0 } + noise(i, seed))
                .collect()
        };
        let (a, b) = (half(1), half(2));
        let all = 0..100;
        let whole = std::slice::from_ref(&all);
        let nodes = Nodes {
            times: &times,
            weights: &weights,
            pieces: whole,
        };
        let kept = nodes.smooth(&a, nodes.best(&a, &b));
        assert!((kept[39] - a[39]).abs() < 5.0 && (kept[40] - a[40]).abs() < 5.0);
        let pieces = [0..40, 40..100];
        let nodes = Nodes {
            pieces: &pieces,
            ..nodes
        };
        assert!(nodes.best(&a, &b) > 1.0);
        let kept = nodes.smooth(&a, nodes.best(&a, &b));
        assert!(kept[39].abs() < 1.5 && (kept[40] - 200.0).abs() < 1.5);
    }
}
