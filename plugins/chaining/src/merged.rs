//! Localisations of a group made into one.

use puncta_sdk::run::{chunks_mut, map};
use puncta_sdk::{Cancelled, Run};

/// Groups of a task.
const CHUNK: usize = 1 << 13;

/// The rows of each group, in the order of the rows.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Groups {
    /// Numbers of the groups, rising.
    pub numbers: Vec<i64>,
    /// Group g has the rows `rows[starts[g]..starts[g + 1]]`.
    pub starts: Vec<usize>,
    /// Rows by group.
    pub rows: Vec<u32>,
}

/// The groups that a column of numbers makes. Rows whose number is below 1 or NaN are in none.
///
/// # Errors
/// When cancelled.
pub fn groups(numbers: &[f64], run: &dyn Run) -> Result<Groups, Cancelled> {
    let number = |row: usize| -> Option<i64> {
        let value = numbers[row];
        #[allow(clippy::cast_possible_truncation)]
        (1.0..9.0e15).contains(&value).then_some(value as i64)
    };
    let pieces = map(run, numbers.len().div_ceil(CHUNK), &|piece| {
        let end = numbers.len().min((piece + 1) * CHUNK);
        (piece * CHUNK..end).filter_map(number).max().unwrap_or(0)
    });
    let most = pieces.into_iter().max().unwrap_or(0);
    if run.cancelled() {
        return Err(Cancelled);
    }
    if most.unsigned_abs() <= 4 * numbers.len() as u64 + 1024 {
        Ok(counted(
            numbers.len(),
            most.unsigned_abs() as usize,
            &number,
        ))
    } else {
        Ok(sorted(numbers.len(), &number))
    }
}

fn counted(count: usize, most: usize, number: &dyn Fn(usize) -> Option<i64>) -> Groups {
    let mut ends = vec![0_usize; most + 2];
    let at = |row| number(row).map(|number| number.unsigned_abs() as usize);
    (0..count)
        .filter_map(at)
        .for_each(|number| ends[number + 1] += 1);
    for number in 1..ends.len() {
        ends[number] += ends[number - 1];
    }
    // ends[n] is where group n starts, and becomes where it ends.
    let mut rows = vec![0_u32; ends[most + 1]];
    for row in 0..count {
        if let Some(number) = at(row) {
            #[allow(clippy::cast_possible_truncation)]
            let small = row as u32;
            rows[ends[number]] = small;
            ends[number] += 1;
        }
    }
    let mut groups = Groups {
        numbers: Vec::new(),
        starts: vec![0],
        rows,
    };
    for number in 1..=most {
        if ends[number] > ends[number - 1] {
            groups.numbers.push(number as i64);
            groups.starts.push(ends[number]);
        }
    }
    groups
}

fn sorted(count: usize, number: &dyn Fn(usize) -> Option<i64>) -> Groups {
    let mut pairs: Vec<(i64, u32)> = Vec::new();
    #[allow(clippy::cast_possible_truncation)]
    pairs.extend((0..count).filter_map(|row| Some((number(row)?, row as u32))));
    pairs.sort_unstable();
    let mut groups = Groups {
        numbers: Vec::new(),
        starts: vec![0],
        rows: pairs.iter().map(|pair| pair.1).collect(),
    };
    for (end, pair) in pairs.iter().enumerate() {
        let last = pairs.get(end + 1).is_none_or(|next| next.0 != pair.0);
        if last {
            groups.numbers.push(pair.0);
            groups.starts.push(end + 1);
        }
    }
    groups
}

impl Groups {
    /// Number of groups.
    #[must_use]
    pub fn len(&self) -> usize {
        self.numbers.len()
    }

    /// Whether there is none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.numbers.is_empty()
    }

    /// Rows of a group.
    #[must_use]
    pub fn of(&self, group: usize) -> &[u32] {
        &self.rows[self.starts[group]..self.starts[group + 1]]
    }

    /// Sets `out[g]` to `value` of the rows of group g, on all threads.
    ///
    /// # Errors
    /// When cancelled.
    pub fn each<T: Send>(
        &self,
        out: &mut [T],
        run: &dyn Run,
        value: &(dyn Fn(&[u32]) -> T + Sync),
    ) -> Result<(), Cancelled> {
        chunks_mut(run, out, CHUNK, &|chunk, part| {
            if run.cancelled() {
                return;
            }
            for (i, slot) in part.iter_mut().enumerate() {
                *slot = value(self.of(chunk * CHUNK + i));
            }
        });
        if run.cancelled() {
            Err(Cancelled)
        } else {
            Ok(())
        }
    }
}

/// Mean of the values that are not NaN; NaN if there is none.
#[must_use]
pub fn mean(values: &[f64], rows: &[u32]) -> f64 {
    let (mut sum, mut count) = (0.0, 0.0);
    for row in rows {
        let value = values[*row as usize];
        if !value.is_nan() {
            sum += value;
            count += 1.0;
        }
    }
    sum / count
}

/// Sum of the values that are not NaN; NaN if there is none.
#[must_use]
pub fn sum(values: &[f64], rows: &[u32]) -> f64 {
    let known = rows
        .iter()
        .map(|row| values[*row as usize])
        .filter(|value| !value.is_nan());
    known.fold(
        f64::NAN,
        |sum, value| if sum.is_nan() { value } else { sum + value },
    )
}

/// Root of the sum of squares: the standard deviation of a sum.
#[must_use]
pub fn root_sum_square(errors: &[f64], rows: &[u32]) -> f64 {
    let square = |row: &u32| errors[*row as usize] * errors[*row as usize];
    rows.iter().map(square).sum::<f64>().sqrt()
}

/// Mean weighted with the inverse variances, and its standard deviation 1 / sqrt(sum 1 / s^2).
/// Values with the standard deviation 0 outweigh all others. Values without a standard deviation
/// (NaN, infinite, negative) have no weight; if there is no other, it is the plain mean, and its
/// standard deviation NaN.
#[must_use]
pub fn weighted(values: &[f64], errors: &[f64], rows: &[u32]) -> (f64, f64) {
    let known = |row: &u32| {
        let (value, error) = (values[*row as usize], errors[*row as usize]);
        (value.is_finite() && error.is_finite() && error >= 0.0).then_some((value, error))
    };
    // Relative to the smallest, so that squares neither overflow nor vanish.
    let least = rows
        .iter()
        .filter_map(known)
        .map(|pair| pair.1)
        .fold(f64::INFINITY, f64::min);
    if least == f64::INFINITY {
        return (mean(values, rows), f64::NAN);
    }
    let origin = rows.iter().find_map(known).map_or(0.0, |pair| pair.0);
    let (mut weights, mut moment) = (0.0, 0.0);
    for (value, error) in rows.iter().filter_map(known) {
        let ratio = if error == least { 1.0 } else { least / error };
        weights += ratio * ratio;
        // From the first value, so that far from zero no digits are lost.
        moment += ratio * ratio * (value - origin);
    }
    (origin + moment / weights, least / weights.sqrt())
}
