//! Distances to the nearest localisation of the next frame.

use crate::frames::Frames;
use puncta_sdk::run::{Cancelled, Run, map};

/// Frames that one task takes.
const BLOCK: usize = 64;

/// For each localisation of a frame whose next frame has localisations too: the distance to the
/// nearest of those, sorted. Rows without a finite position must not be in `frames`.
///
/// The next frame is sorted along its longer side, and searched outwards from the localisation
/// until nothing nearer can follow.
///
/// # Errors
/// When cancelled.
pub fn next_frame(
    run: &dyn Run,
    frames: &Frames,
    x: &[f64],
    y: &[f64],
) -> Result<Vec<f64>, Cancelled> {
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
            next.fill(frames.of(*i), x, y);
            for row in frames.of(i - 1) {
                let row = *row as usize;
                found.push(next.nearest(x[row], y[row]).sqrt());
            }
        }
        found
    });
    if run.cancelled() {
        return Err(Cancelled);
    }
    let mut all = found.concat();
    all.sort_unstable_by(f64::total_cmp);
    Ok(all)
}

/// Points sorted along one side.
#[derive(Default)]
struct Line {
    points: Vec<[f64; 2]>,
    turned: bool,
}

impl Line {
    fn fill(&mut self, rows: &[u32], x: &[f64], y: &[f64]) {
        let side = |values: &[f64]| {
            let each = rows.iter().map(|row| values[*row as usize]);
            let (low, high) = each.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| {
                (l.min(v), h.max(v))
            });
            high - low
        };
        self.turned = rows.len() > 2 && side(y) > side(x);
        self.points.clear();
        self.points.extend(rows.iter().map(|row| {
            let (x, y) = (x[*row as usize], y[*row as usize]);
            if self.turned { [y, x] } else { [x, y] }
        }));
        self.points.sort_unstable_by(|a, b| a[0].total_cmp(&b[0]));
    }

    /// Square of the distance to the nearest point.
    fn nearest(&self, x: f64, y: f64) -> f64 {
        let [along, across] = if self.turned { [y, x] } else { [x, y] };
        let middle = self.points.partition_point(|point| point[0] < along);
        let mut best = f64::INFINITY;
        let mut visit = |point: &[f64; 2]| {
            let side = (point[0] - along).powi(2);
            if side >= best {
                return false;
            }
            best = best.min(side + (point[1] - across).powi(2));
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
        best
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
        for y in [y, &tall[..]] {
            let frames = Frames::new(&t, |_| true);
            let found = next_frame(&Threads(2), &frames, x, y).unwrap();
            let mut expected = Vec::new();
            for i in 0..400 {
                let others = (0..400).filter(|j| t[*j] == t[i] + 1.0);
                let distances =
                    others.map(|j| ((x[i] - x[j]).powi(2) + (y[i] - y[j]).powi(2)).sqrt());
                expected.extend(distances.reduce(f64::min));
            }
            expected.sort_unstable_by(f64::total_cmp);
            assert_eq!(found, expected);
            assert_eq!(found.len(), 280);
            assert_eq!(found, next_frame(&Threads(3), &frames, x, y).unwrap());
            assert!(next_frame(&Stopped, &frames, x, y).is_err());
        }
    }

    #[test]
    fn no_next_frame_gives_nothing() {
        let frames = Frames::new(&[0.0, 0.0, 5.0, 1e6], |_| true);
        assert!(
            next_frame(&Threads(1), &frames, &[0.0; 4], &[0.0; 4])
                .unwrap()
                .is_empty()
        );
        let frames = Frames::new(&[0.0, 1.0], |_| true);
        let same = next_frame(&Threads(1), &frames, &[3.0; 2], &[3.0; 2]).unwrap();
        assert_eq!(same, [0.0]);
    }
}
