//! Distances to the nearest localisation of the next frame.

use crate::frames::Frames;
use puncta_sdk::run::{Cancelled, Run, map};

/// Frames that one task takes.
const BLOCK: usize = 64;

/// For each localisation of a frame whose next frame has localisations too: how far the nearest of
/// those lies along each axis, in no order that means anything. Rows without a finite position must
/// not be in `frames`.
///
/// The next frame is sorted along its longest side, and searched outwards from the localisation
/// until nothing nearer can follow.
///
/// # Errors
/// When cancelled.
pub fn next_frame<const D: usize>(
    run: &dyn Run,
    frames: &Frames,
    at: [&[f64]; D],
) -> Result<Vec<[f64; D]>, Cancelled> {
    let pairs: Vec<usize> = (1..frames.numbers.len())
        .filter(|i| frames.numbers[*i] == frames.numbers[i - 1].saturating_add(1))
        .collect();
    let tasks: Vec<&[usize]> = pairs.chunks(BLOCK).collect();
    let found = map(run, tasks.len(), &|task| {
        let mut found = Vec::new();
        let mut next = Line::default();
        for i in tasks[task] {
            if run.cancelled() {
                break;
            }
            next.fill(frames.of(*i), at);
            for row in frames.of(i - 1) {
                found.push(next.nearest(at.map(|values| values[*row as usize])));
            }
        }
        found
    });
    if run.cancelled() {
        return Err(Cancelled);
    }
    Ok(found.concat())
}

/// Distances in the first axes of the differences, sorted.
#[must_use]
pub fn sorted<const D: usize>(differences: &[[f64; D]], scale: [f64; D]) -> Vec<f64> {
    let length = |difference: &[f64; D]| {
        let each = difference.iter().zip(scale);
        each.map(|(d, s)| d * s * d * s).sum::<f64>().sqrt()
    };
    let mut all: Vec<f64> = differences.iter().map(length).collect();
    all.sort_unstable_by(f64::total_cmp);
    all
}

/// Points sorted along one side, which comes first.
struct Line<const D: usize> {
    points: Vec<[f64; D]>,
    first: usize,
}

impl<const D: usize> Default for Line<D> {
    fn default() -> Self {
        Self {
            points: Vec::new(),
            first: 0,
        }
    }
}

impl<const D: usize> Line<D> {
    fn turned(&self, mut point: [f64; D]) -> [f64; D] {
        point.swap(0, self.first);
        point
    }

    fn fill(&mut self, rows: &[u32], at: [&[f64]; D]) {
        let side = |values: &[f64]| {
            let each = rows.iter().map(|row| values[*row as usize]);
            let (low, high) = each.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| {
                (l.min(v), h.max(v))
            });
            high - low
        };
        self.first = 0;
        if rows.len() > 2 {
            for axis in 1..D {
                if side(at[axis]) > side(at[self.first]) {
                    self.first = axis;
                }
            }
        }
        let point = |row: &u32| self.turned(at.map(|values| values[*row as usize]));
        let points: Vec<[f64; D]> = rows.iter().map(point).collect();
        self.points = points;
        self.points.sort_unstable_by(|a, b| a[0].total_cmp(&b[0]));
    }

    /// How far the nearest point is along each axis; of equally near ones the least along the first.
    fn nearest(&self, from: [f64; D]) -> [f64; D] {
        let from = self.turned(from);
        let middle = self.points.partition_point(|point| point[0] < from[0]);
        let mut best = (f64::INFINITY, [f64::INFINITY; D]);
        let mut visit = |point: &[f64; D]| {
            let side = (point[0] - from[0]).powi(2);
            if side > best.0 {
                return false;
            }
            let difference = std::array::from_fn(|axis| (point[axis] - from[axis]).abs());
            let square = difference.iter().map(|d: &f64| d * d).sum();
            let difference = self.turned(difference);
            if square < best.0 || (square == best.0 && difference < best.1) {
                best = (square, difference);
            }
            true
        };
        for point in &self.points[middle..] {
            if !visit(point) {
                break;
            }
        }
        for point in self.points[..middle].iter().rev() {
            if !visit(point) {
                break;
            }
        }
        best.1
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use puncta_testkit::{Stopped, Threads};

    fn scattered(count: u64) -> Vec<f64> {
        (0..count)
            .map(|i| {
                ((i + 1).wrapping_mul(0x9E37_79B9_7F4A_7C15) >> 11) as f64 / (1_u64 << 53) as f64
            })
            .collect()
    }

    #[test]
    fn as_by_all_pairs() {
        let all = scattered(900);
        let (x, y) = (&all[..400], &all[400..800]);
        let tall: Vec<f64> = y.iter().map(|y| 7.0 * y).collect();
        // Frames 0 to 9, without 4.
        let t: Vec<f64> = (0..400)
            .map(|i| f64::from(i * 7 % 10))
            .map(|t| if t == 4.0 { 40.0 } else { t })
            .collect();
        let deep: Vec<f64> = all[450..850].iter().map(|z| 9.0 * z).collect();
        let frames = Frames::new(&t, |_| true);
        for y in [y, &tall[..]] {
            for z in [&vec![3.0; 400], &deep] {
                let find = |threads| next_frame(&Threads(threads), &frames, [x, y, z]).unwrap();
                let found = sorted(&find(2), [1.0; 3]);
                let mut expected = Vec::new();
                for i in 0..400 {
                    let others = (0..400).filter(|j| t[*j] == t[i] + 1.0);
                    let square = |j: usize| {
                        (x[i] - x[j]).powi(2) + (y[i] - y[j]).powi(2) + (z[i] - z[j]).powi(2)
                    };
                    expected.extend(others.map(|j| square(j).sqrt()).reduce(f64::min));
                }
                expected.sort_unstable_by(f64::total_cmp);
                let near = |(a, b): (&f64, &f64)| (a - b).abs() < 1e-12;
                assert!(found.iter().zip(&expected).all(near));
                assert_eq!((found.len(), expected.len()), (280, 280));
                assert_eq!(find(2), find(3));
                if z[0] == 3.0 {
                    let plane = next_frame(&Threads(2), &frames, [x, y]).unwrap();
                    assert_eq!(sorted(&plane, [1.0; 2]), found);
                }
                assert!(next_frame(&Stopped, &frames, [x, y]).is_err());
            }
        }
    }

    #[test]
    fn no_next_frame_gives_nothing() {
        let frames = Frames::new(&[0.0, 0.0, 5.0, 1e6], |_| true);
        assert!(
            next_frame(&Threads(1), &frames, [&[0.0; 4], &[0.0; 4]])
                .unwrap()
                .is_empty()
        );
        let frames = Frames::new(&[0.0, 1.0], |_| true);
        let same = next_frame(&Threads(1), &frames, [&[3.0; 2], &[3.0; 2]]).unwrap();
        assert_eq!(same, [[0.0; 2]]);
    }
}
