//! Localisations in canonical order: by time, then by position.
//!
//! The order does not depend on that of the rows, so neither do the sums, the halves and the
//! subsets that the estimators take. Times are the distinct values of `t`; nothing is ever
//! allocated between them.

use std::cmp::Ordering;

use puncta_sdk::run::chunks_mut;
use puncta_sdk::{Failure, Run};

/// Frame number of a row that takes no part.
pub const NO_FRAME: u32 = u32::MAX;
/// Side of the squares that go to one half, in standard deviations of a localisation.
pub const BLOCK: f32 = 40.0;
/// Rows in a chunk of parallel work.
const CHUNK: usize = 1 << 15;

/// Columns of a table of localisations. All have the same length; an error is a standard deviation.
#[derive(Clone, Copy, Debug, Default)]
pub struct Columns<'a> {
    /// x, nm.
    pub x: &'a [f64],
    /// y, nm.
    pub y: &'a [f64],
    /// z, nm; 2D without it.
    pub z: Option<&'a [f64]>,
    /// Time, in frames or any other unit.
    pub t: &'a [f64],
    /// Errors of x, y, z, nm.
    pub errors: [Option<&'a [f64]>; 3],
}

/// The distinct times of a table, and which of them each row has.
#[derive(Clone, Debug, Default)]
pub struct Frames {
    /// Distinct times, increasing.
    pub times: Vec<f64>,
    /// For each row its place in `times`, or [`NO_FRAME`] where a position or the time is not
    /// finite.
    pub of_row: Vec<u32>,
    /// Rows that take part, sorted by time.
    pub rows: Vec<u32>,
}

impl Frames {
    /// Finds the distinct times of the rows whose time and positions are finite.
    ///
    /// # Errors
    /// When the columns differ in length, are longer than 2^32 - 2 rows, or cancelled.
    pub fn new(columns: &Columns<'_>, run: &dyn Run) -> Result<Self, Failure> {
        let count = columns.t.len();
        let z = columns.z.map_or(count, <[f64]>::len);
        if [columns.x.len(), columns.y.len(), z]
            .iter()
            .any(|n| *n != count)
        {
            return Err(Failure::bad_input(
                "the columns x, y, z, t differ in length",
            ));
        }
        if count >= NO_FRAME as usize {
            let message = format!("the table has {count} rows, more than 4294967294");
            return Err(Failure::bad_input(message).remedy("split it first"));
        }
        let mut of_row = vec![NO_FRAME; count];
        chunks_mut(run, &mut of_row, CHUNK, &|chunk, out| {
            for (row, slot) in (chunk * CHUNK..).zip(out) {
                let finite = columns.t[row].is_finite()
                    && columns.x[row].is_finite()
                    && columns.y[row].is_finite()
                    && columns.z.is_none_or(|z| z[row].is_finite());
                if finite {
                    *slot = 0;
                }
            }
        });
        let mut rows: Vec<u32> = (0..count as u32)
            .filter(|row| of_row[*row as usize] == 0)
            .collect();
        let time = |row: &u32| columns.t[*row as usize];
        if !rows.is_sorted_by(|a, b| time(a) <= time(b)) {
            crate::sort::by_value(&mut rows, columns.t, run);
        }
        if run.cancelled() {
            return Err(Failure::cancelled());
        }
        let mut times: Vec<f64> = Vec::new();
        for row in &rows {
            let t = time(row);
            if times.last().is_none_or(|last| *last < t) {
                times.push(t);
            }
            of_row[*row as usize] = times.len() as u32 - 1;
        }
        Ok(Self {
            times,
            of_row,
            rows,
        })
    }
}

/// Localisations in canonical order, in a frame in which the kernel of all axes is equally wide.
#[derive(Clone, Debug, Default)]
pub struct Cloud {
    /// Distinct times, increasing.
    pub times: Vec<f64>,
    /// Place of each localisation's time in `times`, increasing.
    pub frame: Vec<u32>,
    /// Positions relative to the middle of the field, nm; z divided by `z_scale`, 0 in 2D.
    pub at: Vec<[f32; 3]>,
    /// Lateral variance of each localisation, nm^2.
    pub variance: Vec<f32>,
    /// 2 or 3.
    pub axes: usize,
    /// By how much z is less precise than x and y.
    pub z_scale: f64,
    /// Median lateral standard deviation, nm.
    pub sigma: f64,
}

/// What is assumed where a table has no errors.
#[derive(Clone, Copy, Debug)]
pub struct Assumed {
    /// Lateral standard deviation of a localisation, nm.
    pub sigma: f64,
    /// Axial divided by lateral standard deviation.
    pub axial_ratio: f64,
}

impl Cloud {
    /// Puts the rows of `frames` in order.
    ///
    /// # Errors
    /// When cancelled.
    pub fn new(
        columns: &Columns<'_>,
        frames: &Frames,
        assumed: &Assumed,
        run: &dyn Run,
    ) -> Result<Self, Failure> {
        let mut rows = frames.rows.clone();
        let order = |a: &u32, b: &u32| compare(columns, *a, *b);
        let starts = crate::sort::runs(&rows, |row| frames.of_row[*row as usize]);
        crate::sort::each_run(&mut rows, &starts, run, &|part| {
            part.sort_unstable_by(order)
        });
        if run.cancelled() {
            return Err(Failure::cancelled());
        }
        let median = |values: &[f64]| sampled_median(&rows, |row| values[row]);
        let axes = if columns.z.is_some() { 3 } else { 2 };
        let lateral = lateral_errors(columns);
        let sigma = lateral
            .as_ref()
            .and_then(|error| sampled_median(&rows, error))
            .unwrap_or(assumed.sigma);
        let z_scale = match columns.errors[2].and_then(median) {
            Some(error) if error > 0.0 && lateral.is_some() && axes == 3 => error / sigma,
            _ => assumed.axial_ratio,
        };
        let middle = [
            median(columns.x).unwrap_or(0.0),
            median(columns.y).unwrap_or(0.0),
            columns.z.and_then(median).unwrap_or(0.0),
        ];
        let mut cloud = Self {
            times: frames.times.clone(),
            frame: vec![0; rows.len()],
            at: vec![[0.0; 3]; rows.len()],
            variance: vec![(sigma * sigma) as f32; rows.len()],
            axes,
            z_scale,
            sigma,
        };
        chunks_mut(run, &mut cloud.frame, CHUNK, &|chunk, out| {
            for (slot, row) in out.iter_mut().zip(&rows[chunk * CHUNK..]) {
                *slot = frames.of_row[*row as usize];
            }
        });
        chunks_mut(run, &mut cloud.at, CHUNK, &|chunk, out| {
            for (at, row) in out.iter_mut().zip(&rows[chunk * CHUNK..]) {
                let row = *row as usize;
                let z = columns.z.map_or(0.0, |z| (z[row] - middle[2]) / z_scale);
                let (x, y) = (columns.x[row] - middle[0], columns.y[row] - middle[1]);
                *at = [x as f32, y as f32, z as f32];
            }
        });
        if let Some(error) = lateral {
            // Neither a lucky nor a broken error may rule: both are held near the median.
            let (low, high) = (0.25 * sigma, 4.0 * sigma);
            chunks_mut(run, &mut cloud.variance, CHUNK, &|chunk, out| {
                for (slot, row) in out.iter_mut().zip(&rows[chunk * CHUNK..]) {
                    let error = error(*row as usize);
                    if error.is_finite() {
                        *slot = error.clamp(low, high).powi(2) as f32;
                    }
                }
            });
        }
        Ok(cloud)
    }

    /// Number of localisations.
    pub fn len(&self) -> usize {
        self.frame.len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.frame.is_empty()
    }

    /// The localisations whose number passes; times stay.
    pub fn subset(&self, keep: impl Fn(usize) -> bool) -> Self {
        let chosen: Vec<usize> = (0..self.len()).filter(|i| keep(*i)).collect();
        Self {
            times: self.times.clone(),
            frame: chosen.iter().map(|i| self.frame[*i]).collect(),
            at: chosen.iter().map(|i| self.at[*i]).collect(),
            variance: chosen.iter().map(|i| self.variance[*i]).collect(),
            ..*self
        }
    }

    /// One of two random halves: the field is cut into squares of [`BLOCK`] standard deviations, and
    /// each square goes to one half. So all localisations of a molecule are in the same half, and
    /// the halves err independently.
    pub fn half(&self, seed: u64, which: bool) -> Self {
        let side = BLOCK * self.sigma as f32;
        let block = |axis: usize, i: usize| (self.at[i][axis] / side).floor() as i64 as u64;
        self.subset(|i| {
            let square = hash(block(0, i), hash(block(1, i), seed));
            (square >> 63 == 1) == which
        })
    }

    /// About `count` localisations at random, or all if there are fewer.
    pub fn thinned(&self, count: usize, seed: u64) -> Self {
        if count >= self.len() {
            return self.clone();
        }
        let limit = (count as f64 / self.len() as f64 * u64::MAX as f64) as u64;
        self.subset(|i| hash(i as u64, seed) < limit)
    }
}

/// A well mixed number from a number and a seed (splitmix64).
pub fn hash(number: u64, seed: u64) -> u64 {
    let mut z = number.wrapping_add(seed.wrapping_mul(0xD1B5_4A32_D192_ED03));
    z = z.wrapping_add(0x9E37_79B9_7F4A_7C15);
    z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    z ^ (z >> 31)
}

fn compare(columns: &Columns<'_>, a: u32, b: u32) -> Ordering {
    let (a, b) = (a as usize, b as usize);
    let by = |values: &[f64]| values[a].total_cmp(&values[b]);
    let optional = |values: Option<&[f64]>| values.map_or(Ordering::Equal, by);
    by(columns.x)
        .then_with(|| by(columns.y))
        .then_with(|| optional(columns.z))
        .then_with(|| optional(columns.errors[0]))
        .then_with(|| optional(columns.errors[1]))
}

/// The root mean square of the errors of x and y of a row; None without errors.
fn lateral_errors<'a>(columns: &Columns<'a>) -> Option<impl Fn(usize) -> f64 + Sync + use<'a>> {
    let x = columns.errors[0].or(columns.errors[1])?;
    let y = columns.errors[1].unwrap_or(x);
    Some(move |row: usize| f64::midpoint(x[row] * x[row], y[row] * y[row]).sqrt())
}

/// Median of the finite values of about 10,000 evenly spread rows; None without one.
fn sampled_median(rows: &[u32], value: impl Fn(usize) -> f64) -> Option<f64> {
    let step = (rows.len() / 10_000).max(1);
    let values = rows.iter().step_by(step).map(|row| value(*row as usize));
    let mut values: Vec<f64> = values.filter(|v| v.is_finite()).collect();
    values.sort_unstable_by(f64::total_cmp);
    values.get(values.len() / 2).copied()
}

#[cfg(test)]
mod tests {
    use super::*;
    use puncta_testkit::{Stopped, Threads};

    const ASSUMED: Assumed = Assumed {
        sigma: 10.0,
        axial_ratio: 2.5,
    };

    fn cloud(x: &[f64], y: &[f64], t: &[f64]) -> (Frames, Cloud) {
        let columns = Columns {
            x,
            y,
            t,
            ..Columns::default()
        };
        let frames = Frames::new(&columns, &Threads(2)).unwrap();
        let cloud = Cloud::new(&columns, &frames, &ASSUMED, &Threads(2)).unwrap();
        (frames, cloud)
    }

    #[test]
    fn rows_in_any_order_give_the_same_cloud() {
        let count = 5000;
        let value = |i: usize, seed| (hash(i as u64, seed) >> 40) as f64;
        let x: Vec<f64> = (0..count).map(|i| value(i, 1)).collect();
        let y: Vec<f64> = (0..count).map(|i| value(i, 2)).collect();
        let t: Vec<f64> = (0..count)
            .map(|i| (value(i, 3) / 1e5).floor() * 1e6)
            .collect();
        let (_, one) = cloud(&x, &y, &t);
        let turned = |values: &[f64]| values.iter().rev().copied().collect::<Vec<_>>();
        let (_, other) = cloud(&turned(&x), &turned(&y), &turned(&t));
        assert_eq!(one.times, other.times);
        assert_eq!(one.frame, other.frame);
        assert_eq!(one.at, other.at);
        assert!(one.frame.is_sorted() && one.times.is_sorted());
        let half = one.half(7, true);
        assert_eq!(half.len() + one.half(7, false).len(), count);
        assert!((half.len() as f64 - 2500.0).abs() < 200.0);
        assert!((one.thinned(1000, 3).len() as f64 - 1000.0).abs() < 150.0);
    }

    #[test]
    fn rows_that_are_not_finite_take_no_part() {
        let (frames, cloud) = cloud(
            &[1.0, f64::NAN, 3.0, 4.0],
            &[1.0, 2.0, f64::INFINITY, 4.0],
            &[5.0, 1.0, 2.0, -1e9],
        );
        assert_eq!(frames.of_row, [1, NO_FRAME, NO_FRAME, 0]);
        assert_eq!(frames.times, [-1e9, 5.0]);
        assert_eq!(cloud.len(), 2);
        let columns = Columns::default();
        assert!(Frames::new(&columns, &Stopped).is_err());
        let columns = Columns {
            x: &[1.0],
            ..columns
        };
        assert!(Frames::new(&columns, &Threads(1)).is_err());
    }
}
