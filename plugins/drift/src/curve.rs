//! A drift as a curve: values at nodes in time, a cubic spline between them, and breaks.

use std::ops::Range;

/// Interpolation between the nodes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Interpolation {
    /// A natural cubic spline.
    #[default]
    Spline,
    /// Straight lines.
    Linear,
}

/// Values at increasing times. Between the nodes a natural cubic spline or straight lines, beyond
/// them the end values. At a break the curve jumps, and each side is a curve of its own.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Curve {
    /// Times of the nodes, strictly increasing.
    pub times: Vec<f64>,
    /// Drift in x, y, z at the nodes.
    pub values: Vec<[f64; 3]>,
    /// Times of jumps, increasing: a time at or after a break belongs to its right side.
    pub breaks: Vec<f64>,
}

impl Curve {
    /// The curve at increasing times.
    pub fn at(&self, times: &[f64], interpolation: Interpolation) -> Vec<[f64; 3]> {
        let mut out = Vec::with_capacity(times.len());
        let (mut node, mut next) = (0, 0);
        for end in self.breaks.iter().copied().chain([f64::INFINITY]) {
            let nodes = node + self.times[node..].partition_point(|t| *t < end);
            let until = next + times[next..].partition_point(|t| *t < end);
            let piece = Piece::new(
                &self.times[node..nodes],
                &self.values[node..nodes],
                interpolation,
            );
            let fallback = self.values.get(node.saturating_sub(1)).copied();
            let at = |t: &f64| piece.at(*t).or(fallback).unwrap_or_default();
            out.extend(times[next..until].iter().map(at));
            (node, next) = (nodes, until);
        }
        out
    }

    /// Pieces of the nodes between breaks.
    pub fn pieces(&self) -> Vec<Range<usize>> {
        pieces(&self.times, &self.breaks)
    }
}

/// Pieces of increasing times between breaks.
pub fn pieces(times: &[f64], breaks: &[f64]) -> Vec<Range<usize>> {
    let mut pieces = Vec::new();
    let mut begin = 0;
    for end in breaks.iter().copied().chain([f64::INFINITY]) {
        let stop = begin + times[begin..].partition_point(|t| *t < end);
        if stop > begin {
            pieces.push(begin..stop);
        }
        begin = stop;
    }
    pieces
}

/// The nodes between two breaks.
struct Piece<'a> {
    times: &'a [f64],
    values: &'a [[f64; 3]],
    /// Second derivatives at the nodes.
    bend: Vec<[f64; 3]>,
}

impl<'a> Piece<'a> {
    fn new(times: &'a [f64], values: &'a [[f64; 3]], interpolation: Interpolation) -> Self {
        let bend = match interpolation {
            Interpolation::Spline => bends(times, values),
            Interpolation::Linear => vec![[0.0; 3]; times.len()],
        };
        Self {
            times,
            values,
            bend,
        }
    }

    fn at(&self, t: f64) -> Option<[f64; 3]> {
        let after = self.times.partition_point(|node| *node <= t);
        if after == 0 || after == self.times.len() {
            let end = if after == 0 {
                self.values.first()
            } else {
                self.values.last()
            };
            return end.copied();
        }
        let width = self.times[after] - self.times[after - 1];
        let b = (t - self.times[after - 1]) / width;
        let a = 1.0 - b;
        let cubic = |s: f64| (s * s * s - s) * width * width / 6.0;
        Some(std::array::from_fn(|axis| {
            let [low, high] =
                [after - 1, after].map(|i| (self.values[i][axis], self.bend[i][axis]));
            a * low.0 + b * high.0 + cubic(a) * low.1 + cubic(b) * high.1
        }))
    }
}

/// Second derivatives of the natural cubic spline (tridiagonal system, Thomas's algorithm).
fn bends(times: &[f64], values: &[[f64; 3]]) -> Vec<[f64; 3]> {
    let n = times.len();
    let mut bend = vec![[0.0; 3]; n];
    if n < 3 {
        return bend;
    }
    let gap = |i: usize| times[i + 1] - times[i];
    let mut upper = vec![0.0; n];
    for i in 1..n - 1 {
        let (left, right) = (gap(i - 1), gap(i));
        let diagonal = 2.0 * (left + right) - left * upper[i - 1];
        upper[i] = right / diagonal;
        for axis in 0..3 {
            let slope = |i: usize| (values[i + 1][axis] - values[i][axis]) / gap(i);
            let rest = 6.0 * (slope(i) - slope(i - 1)) - left * bend[i - 1][axis];
            bend[i][axis] = rest / diagonal;
        }
    }
    for i in (1..n - 1).rev() {
        let next = bend[i + 1];
        for (bend, next) in bend[i].iter_mut().zip(next) {
            *bend -= upper[i] * next;
        }
    }
    bend
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_spline_goes_through_its_nodes_and_follows_a_sine() {
        let times: Vec<f64> = (0..41).map(|i| f64::from(i) * 0.1).collect();
        let values = times.iter().map(|t| [t.sin() * t, 2.0 * t, 0.0]).collect();
        let curve = Curve {
            times: times.clone(),
            values,
            breaks: vec![],
        };
        let fine: Vec<f64> = (0..200).map(|i| 1.0 + f64::from(i) * 0.01).collect();
        for (t, at) in fine.iter().zip(curve.at(&fine, Interpolation::Spline)) {
            assert!((at[0] - t.sin() * t).abs() < 1e-5);
            assert!((at[1] - 2.0 * t).abs() < 1e-12);
        }
        assert_eq!(curve.at(&times, Interpolation::Spline), curve.values);
        assert_eq!(
            curve.at(&[-5.0, 9.0], Interpolation::Spline)[1],
            curve.values[40]
        );
        let linear = curve.at(&[0.25], Interpolation::Linear)[0][0];
        assert!((linear - f64::midpoint(0.2 * 0.2f64.sin(), 0.3 * 0.3f64.sin())).abs() < 1e-12);
    }

    #[test]
    fn a_break_keeps_both_sides_apart() {
        let curve = Curve {
            times: vec![0.0, 1.0, 2.0, 3.0],
            values: vec![[0.0; 3], [0.0; 3], [9.0; 3], [9.0; 3]],
            breaks: vec![1.25],
        };
        let at = curve.at(&[1.0, 1.2, 1.25, 1.9], Interpolation::Spline);
        assert_eq!(at, [[0.0; 3], [0.0; 3], [9.0; 3], [9.0; 3]]);
        assert_eq!(curve.pieces(), [0..2, 2..4]);
        let one = Curve {
            times: vec![5.0],
            values: vec![[1.0; 3]],
            breaks: vec![],
        };
        assert_eq!(
            one.at(&[0.0, 5.0, 7.0], Interpolation::Spline),
            [[1.0; 3]; 3]
        );
    }
}
