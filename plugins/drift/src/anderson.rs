//! Anderson's acceleration of a fixed point u = g(u).
//!
//! The next point is the combination of the last few for which the linearised step is smallest
//! (Walker and Ni, SIAM J. Numer. Anal. 49, 1715, 2011).

use std::collections::VecDeque;

use crate::network::{back_substitute, cholesky};

/// Points that are remembered.
const DEPTH: usize = 6;

/// The last few points and their steps.
#[derive(Debug)]
pub struct Anderson {
    weights: Vec<f64>,
    total: f64,
    last: Option<(Vec<f64>, Vec<f64>)>,
    /// Differences of points and of steps.
    history: VecDeque<(Vec<f64>, Vec<f64>)>,
    norm: f64,
}

impl Anderson {
    /// For `count` unknowns, whose steps are weighted.
    pub fn new(count: usize, weight: impl Fn(usize) -> f64) -> Self {
        let weights: Vec<f64> = (0..count).map(weight).collect();
        Self {
            total: weights.iter().sum::<f64>().max(f64::MIN_POSITIVE),
            weights,
            last: None,
            history: VecDeque::new(),
            norm: f64::INFINITY,
        }
    }

    /// Weighted root mean square of a step.
    pub fn norm(&self, step: &[f64]) -> f64 {
        (self.dot(step, step) / self.total).sqrt()
    }

    fn dot(&self, a: &[f64], b: &[f64]) -> f64 {
        let terms = self.weights.iter().zip(a.iter().zip(b));
        terms.map(|(w, (a, b))| w * a * b).sum()
    }

    /// Forgets all points.
    pub fn restart(&mut self) {
        self.last = None;
        self.history.clear();
        self.norm = f64::INFINITY;
    }

    /// Moves `point`, at which the step g(u) - u is `step`.
    pub fn advance(&mut self, point: &mut [f64], step: &[f64]) {
        let norm = self.norm(step);
        if norm > 2.0 * self.norm {
            self.restart();
        }
        self.norm = norm;
        let difference = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a - b).collect();
        if let Some((old_point, old_step)) = self.last.take() {
            let pair = (difference(point, &old_point), difference(step, &old_step));
            self.history.push_back(pair);
            if self.history.len() > DEPTH {
                self.history.pop_front();
            }
        }
        self.last = Some((point.to_vec(), step.to_vec()));
        let mix = self.mix(step);
        point.iter_mut().zip(step).for_each(|(p, s)| *p += s);
        for ((points, steps), mix) in self.history.iter().zip(mix) {
            for (p, (du, df)) in point.iter_mut().zip(points.iter().zip(steps)) {
                *p -= mix * (du + df);
            }
        }
    }

    /// Least squares of the step by the differences of steps.
    fn mix(&self, step: &[f64]) -> Vec<f64> {
        let n = self.history.len();
        let mut matrix = vec![0.0; n * n];
        let mut right = vec![0.0; n];
        for (i, (_, a)) in self.history.iter().enumerate() {
            for (j, (_, b)) in self.history.iter().enumerate().take(i + 1) {
                matrix[i * n + j] = self.dot(a, b);
                matrix[j * n + i] = matrix[i * n + j];
            }
            matrix[i * n + i] *= 1.0 + 1e-8;
            right[i] = self.dot(a, step);
        }
        if cholesky(&mut matrix, n).is_none() {
            return Vec::new();
        }
        back_substitute(&matrix, n, &mut right);
        right
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_slow_linear_fixed_point_is_reached_in_few_steps() {
        // g(u) = u - A (u - 1) with A diagonal from 0.05 to 0.9: 8 plain steps leave two thirds.
        let rate = |k: usize| 0.05 + 0.85 * (k % 5) as f64 / 4.0;
        let mut point = vec![0.0; 50];
        let mut anderson = Anderson::new(50, |_| 1.0);
        for _ in 0..8 {
            let step: Vec<f64> = (0..50).map(|k| rate(k) * (1.0 - point[k])).collect();
            anderson.advance(&mut point, &step);
        }
        assert!(point.iter().all(|p| (p - 1.0).abs() < 1e-6));
    }
}
