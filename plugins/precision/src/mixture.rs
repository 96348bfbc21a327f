//! The distribution of distances to the nearest localisation of the next frame, and its fit.
//!
//! Endesfelder et al., Histochemistry and Cell Biology 141, 629 (2014):
//!
//! p(d) = A1 d / (2 s^2) exp(-d^2 / 4 s^2) + A2 N(d; c, w) + A3 d
//!
//! in the plane; along one axis the first and the last term are exp(-d^2 / 4 s^2) / (s sqrt(pi)) and 1,
//! in space d^2 exp(-d^2 / 4 s^2) / (2 sqrt(pi) s^3) and d^2.
//!
//! The first term are two localisations of one molecule with precision s along each axis, the second
//! neighbouring molecules at a preferred distance, the third molecules at random places.

use crate::simplex::minimise;

/// Bins in units of the first guess of s.
const BIN: f64 = 0.1;
/// Reach of the histogram in units of the first guess of s.
const REACH: f64 = 15.0;
/// Calls of one search.
const CALLS: usize = 1500;

/// Counts of distances in bins of equal width from 0.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Histogram {
    /// Number of axes in which they are distances: 1, 2 or 3.
    pub axes: u8,
    /// Width of a bin, nm.
    pub width: f64,
    /// Counts.
    pub counts: Vec<f64>,
}

impl Histogram {
    /// Counts sorted distances up to `reach` in bins of `width`.
    #[must_use]
    pub fn new(axes: u8, sorted: &[f64], width: f64, reach: f64) -> Histogram {
        let bins = (reach / width).round().max(1.0) as usize;
        let mut counts = vec![0.0; bins];
        for distance in sorted {
            match counts.get_mut((distance / width) as usize) {
                Some(count) => *count += 1.0,
                None => break,
            }
        }
        Histogram {
            axes,
            width,
            counts,
        }
    }

    /// Middle of each bin.
    #[must_use]
    pub fn middles(&self) -> Vec<f64> {
        (0..self.counts.len())
            .map(|i| (i as f64 + 0.5) * self.width)
            .collect()
    }
}

/// The fitted distribution.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fit {
    /// Number of axes.
    pub axes: u8,
    /// Precision along an axis, nm.
    pub s: f64,
    /// Preferred distance of neighbouring molecules, nm.
    pub centre: f64,
    /// Its standard deviation, nm.
    pub spread: f64,
    /// Amplitudes of the three terms, counts a bin.
    pub amplitudes: [f64; 3],
    /// Sum of the squared residuals.
    pub cost: f64,
}

impl Fit {
    /// The three terms at a distance, counts a bin.
    #[must_use]
    pub fn terms(&self, distance: f64) -> [f64; 3] {
        let shapes = shapes(self.axes, distance, self.s, self.centre, self.spread);
        std::array::from_fn(|i| self.amplitudes[i] * shapes[i])
    }

    /// Share of the three terms in all counts of the histogram.
    #[must_use]
    pub fn shares(&self, histogram: &Histogram) -> [f64; 3] {
        let mut sums = [0.0; 3];
        for distance in histogram.middles() {
            for (sum, term) in sums.iter_mut().zip(self.terms(distance)) {
                *sum += term;
            }
        }
        let all: f64 = sums.iter().sum();
        sums.map(|sum| if all > 0.0 { sum / all } else { f64::NAN })
    }
}

fn shapes(axes: u8, d: f64, s: f64, centre: f64, spread: f64) -> [f64; 3] {
    let root = std::f64::consts::PI.sqrt();
    let (random, norm) = match axes {
        1 => (1.0, s * root),
        3 => (d * d, 2.0 * root * s * s * s),
        _ => (d, 2.0 * s * s),
    };
    let same = random / norm * (-d * d / (4.0 * s * s)).exp();
    let near =
        (-0.5 * ((d - centre) / spread).powi(2)).exp() / (spread * std::f64::consts::TAU.sqrt());
    [same, near, random]
}

/// A first guess of s, from sorted distances: of those up to a distance r, below which most are of
/// one molecule, the median over its multiple of s (in the plane 2 sqrt(ln 2)). r is where the count grows least when r is doubled;
/// random neighbours make it grow fourfold again, farther out, which must exceed chance. None when too few differ from 0.
#[must_use]
pub fn guess(axes: u8, sorted: &[f64]) -> Option<f64> {
    let below = |r: f64| sorted.partition_point(|d| *d <= r);
    let start = sorted.len().min(20);
    let first = sorted
        .iter()
        .skip(start.saturating_sub(1))
        .find(|d| **d > 0.0)?;
    let last = *sorted.last()?;
    let (mut r, mut least, mut best, mut chance) = (*first, f64::INFINITY, *first, 1.0);
    while r < last {
        let count = below(r).max(1) as f64;
        let growth = below(2.0 * r) as f64 / count;
        if growth < least {
            (least, best, chance) = (growth, r, 1.0 + 3.0 / count.sqrt());
        } else if growth * (1.0 - 3.0 / count.sqrt()) > 1.15 * least * chance {
            break;
        }
        r *= 1.05;
    }
    let inside = &sorted[..below(best).max(1)];
    let median = inside[inside.len() / 2];
    // Medians of the length of normal numbers of standard deviation sqrt(2) along 1, 2 and 3 axes.
    let usual = match axes {
        1 => 0.953_872_552_3,
        3 => 2.175_329_549_0,
        _ => 2.0 * std::f64::consts::LN_2.sqrt(),
    };
    (median > 0.0).then(|| median / usual)
}

/// The histogram for a first guess of s, up to `reach` if it is given.
#[must_use]
pub fn histogram(axes: u8, sorted: &[f64], guess: f64, reach: Option<f64>) -> Histogram {
    let reach = reach.unwrap_or(REACH * guess);
    let width = BIN * guess.min(reach / 3.0);
    // So many bins that the fit stays quick, whatever is asked for.
    Histogram::new(axes, sorted, width.max(reach / 2000.0), reach)
}

/// Fits the distribution by least squares, from several starts. The amplitudes enter linearly and
/// are solved for, none below 0.
#[must_use]
pub fn fit(histogram: &Histogram, guess: f64) -> Fit {
    let mut best: Option<Fit> = None;
    for share in [1.3, 1.0, 2.0, 0.7] {
        let start = [guess / share, 3.0 * guess, 2.0 * guess];
        let found = search(histogram, guess, start);
        if best.is_none_or(|best| found.cost < best.cost) {
            best = Some(found);
        }
    }
    best.unwrap_or_else(|| evaluate(histogram, &histogram.middles(), [guess; 3]))
}

/// Fits from the result of another fit of nearly the same counts.
#[must_use]
pub fn refit(histogram: &Histogram, guess: f64, from: &Fit) -> Fit {
    search(histogram, guess, [from.s, from.centre, from.spread])
}

fn search(histogram: &Histogram, guess: f64, start: [f64; 3]) -> Fit {
    let middles = histogram.middles();
    let reach = histogram.width * middles.len() as f64;
    // Logarithms keep the widths positive; limits keep a term from turning into another.
    // Along one axis the first term is half a normal distribution, from which one about 0 cannot be told.
    let nearest = guess * if histogram.axes == 1 { 4.0 } else { 1e-3 };
    let place = |p: &[f64; 3]| {
        [
            p[0].exp().clamp(0.5 * histogram.width, reach),
            p[1].exp().clamp(nearest.min(reach), reach),
            p[2].exp().clamp(0.5 * guess, 10.0 * reach),
        ]
    };
    let logarithms = start.map(|v| v.max(1e-3 * guess).ln());
    let cost = |p: &[f64; 3]| evaluate(histogram, &middles, place(p)).cost;
    let (at, _) = minimise(logarithms, 0.2, CALLS, cost);
    evaluate(histogram, &middles, place(&at))
}

/// The best amplitudes for given widths.
fn evaluate(histogram: &Histogram, middles: &[f64], [s, centre, spread]: [f64; 3]) -> Fit {
    let mut normal = [[0.0; 3]; 3];
    let mut right = [0.0; 3];
    let mut square = 0.0;
    // Shapes of like size keep the equations well conditioned.
    let reach = histogram.width * middles.len() as f64;
    let scale = [s, spread, reach.powi(1 - i32::from(histogram.axes))];
    for (d, count) in middles.iter().zip(&histogram.counts) {
        let shape = shapes(histogram.axes, *d, s, centre, spread);
        let shape: [f64; 3] = std::array::from_fn(|i| shape[i] * scale[i]);
        for i in 0..3 {
            right[i] += shape[i] * count;
            for j in 0..3 {
                normal[i][j] += shape[i] * shape[j];
            }
        }
        square += count * count;
    }
    let (amplitudes, gain) = not_negative(&normal, &right);
    Fit {
        axes: histogram.axes,
        s,
        centre,
        spread,
        amplitudes: std::array::from_fn(|i| amplitudes[i] * scale[i]),
        cost: (square - gain).max(0.0),
    }
}

/// Least squares with no amplitude below 0: the best of all subsets. Gives the amplitudes, and by
/// how much they lower the sum of squares.
fn not_negative(normal: &[[f64; 3]; 3], right: &[f64; 3]) -> ([f64; 3], f64) {
    let (mut best, mut most) = ([0.0; 3], 0.0);
    for subset in 1..8_usize {
        let uses = |i: usize| subset >> i & 1 == 1;
        let mut matrix = [[0.0; 4]; 3];
        for i in 0..3 {
            for j in 0..3 {
                let given = uses(i) && uses(j);
                matrix[i][j] = if given {
                    normal[i][j]
                } else {
                    f64::from(u8::from(i == j))
                };
            }
            matrix[i][3] = if uses(i) { right[i] } else { 0.0 };
        }
        let Some(solution) = solve(matrix) else {
            continue;
        };
        let gain: f64 = solution.iter().zip(right).map(|(a, b)| a * b).sum();
        if solution.iter().all(|a| *a >= 0.0) && gain > most {
            (best, most) = (solution, gain);
        }
    }
    (best, most)
}

/// Gauss's elimination with pivots.
fn solve(mut m: [[f64; 4]; 3]) -> Option<[f64; 3]> {
    for column in 0..3 {
        let pivot =
            (column..3).max_by(|a, b| m[*a][column].abs().total_cmp(&m[*b][column].abs()))?;
        m.swap(column, pivot);
        if m[column][column].abs() < 1e-12 {
            return None;
        }
        let top = m[column];
        for row in m.iter_mut().skip(column + 1) {
            let share = row[column] / top[column];
            for (to, from) in row.iter_mut().zip(top) {
                *to -= share * from;
            }
        }
    }
    let mut out = [0.0; 3];
    for i in (0..3).rev() {
        let known: f64 = (i + 1..3).map(|j| m[i][j] * out[j]).sum();
        out[i] = (m[i][3] - known) / m[i][i];
    }
    Some(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_known_distribution_is_fitted() {
        let truth = Fit {
            axes: 2,
            s: 9.0,
            centre: 40.0,
            spread: 12.0,
            amplitudes: [5000.0, 800.0, 0.2],
            cost: 0.0,
        };
        let mut histogram = Histogram {
            axes: 2,
            width: 0.9,
            counts: vec![0.0; 150],
        };
        for (count, d) in histogram.middles().iter().enumerate() {
            histogram.counts[count] = truth.terms(*d).iter().sum();
        }
        let found = fit(&histogram, 11.0);
        assert!((found.s - 9.0).abs() < 0.01, "{found:?}");
        assert!((found.centre - 40.0).abs() < 0.2 && (found.spread - 12.0).abs() < 0.2);
        assert!((found.amplitudes[2] - 0.2).abs() < 1e-3);
        let shares = found.shares(&histogram);
        assert!((shares.iter().sum::<f64>() - 1.0).abs() < 1e-12 && shares[0] > 0.5);
    }

    #[test]
    fn amplitudes_do_not_become_negative() {
        let normal = [[2.0, 1.0, 0.0], [1.0, 2.0, 0.0], [0.0, 0.0, 1.0]];
        let (found, gain) = not_negative(&normal, &[1.0, -5.0, 3.0]);
        assert_eq!(found, [0.5, 0.0, 3.0]);
        assert_eq!(gain, 9.5);
        assert_eq!(solve([[0.0; 4]; 3]), None);
    }

    #[test]
    fn the_first_guess_sees_the_plateau_before_random_neighbours() {
        // Quantiles of the distances of one molecule with s = 5, then random ones from far out.
        let n = 4000;
        let share = |i: i32| (f64::from(i) + 0.5) / f64::from(n);
        let mut distances: Vec<f64> = (0..n)
            .map(|i| 10.0 * (-(1.0 - share(i)).ln()).sqrt())
            .collect();
        distances.extend((0..n).map(|i| 400.0 * share(i).sqrt()));
        distances.sort_unstable_by(f64::total_cmp);
        let found = guess(2, &distances).unwrap();
        assert!((4.0..7.0).contains(&found), "{found}");
        assert_eq!(guess(2, &[]), None);
        assert_eq!(guess(3, &[0.0; 50]), None);
    }
}
