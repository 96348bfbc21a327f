//! Percentiles of the pixels of an image, exactly and without a copy.
//!
//! A value as f32 becomes a u32 of the same order; its upper and then its lower 16 bits are
//! counted. Passes over the image find the value of any rank.

use crate::pixels::{Pixel, Pixels, each_type};
use puncta_sdk::Failure;
use puncta_sdk::run::{Run, map};

/// Pixels counted by one task: much more than there are counts.
const CHUNK: usize = 1 << 22;
/// Values of 16 bits.
const BINS: usize = 1 << 16;

/// The values below which the given percentages (0 to 100) of the finite pixels other than 0 lie
/// (nearest rank); None when there is no such pixel.
pub(crate) fn percentiles(
    pixels: &Pixels<'_>,
    percent: [f64; 2],
    run: &dyn Run,
) -> Result<Option<[f64; 2]>, Failure> {
    let upper = count(pixels, 1, &|key| Some(key >> 16), run)?;
    let total: u64 = upper.iter().sum();
    if total == 0 {
        return Ok(None);
    }
    let rank = |percent: f64| ((percent / 100.0 * total as f64).ceil() as u64).clamp(1, total);
    let [(a, rest_a), (b, rest_b)] = percent.map(|percent| find(&upper, rank(percent)));
    // The lower halves of the values in both bins, one after the other.
    let lower = |key: u32| match key >> 16 {
        high if high == a => Some(key & 0xffff),
        high if high == b => Some(BINS as u32 + (key & 0xffff)),
        _ => None,
    };
    let lower = count(pixels, 2, &lower, run)?;
    let (low, high) = lower.split_at(BINS);
    let high = if a == b { low } else { high };
    let value = |upper: u32, lower: &[u64], rank| from_key(upper << 16 | find(lower, rank).0);
    Ok(Some(
        [value(a, low, rest_a), value(b, high, rest_b)].map(f64::from),
    ))
}

/// The values that are shown as the ends of a colour map: those given, otherwise the percentiles of
/// the pixels other than 0. Percentage 0 means the smallest value, or 0 where no value is negative.
///
/// # Errors
/// When the low one is not below the high one and both are given.
pub(crate) fn display(
    pixels: &Pixels<'_>,
    given: [Option<f64>; 2],
    percent: [f64; 2],
    run: &dyn Run,
) -> Result<[f64; 2], Failure> {
    if let [Some(low), Some(high)] = given {
        let sound = low.is_finite() && high.is_finite() && low < high;
        let message = format!("the limits {low} and {high} enclose nothing");
        let failure = Failure::bad_parameter("low", message);
        return if sound {
            Ok([low, high])
        } else {
            Err(failure.remedy("give low below high"))
        };
    }
    let found = percentiles(pixels, percent, run)?.unwrap_or([0.0, 1.0]);
    let low = if percent[0] <= 0.0 {
        found[0].min(0.0)
    } else {
        found[0]
    };
    let (low, high) = (given[0].unwrap_or(low), given[1].unwrap_or(found[1]));
    // An image of one value, or a limit beyond all of them.
    Ok(match given {
        [None, Some(_)] if low >= high => [high - 1.0, high],
        _ if low >= high => [low, low + 1.0],
        _ => [low, high],
    })
}

/// Bin that holds the value of this rank (from 1), and the rank within the bin.
fn find(counts: &[u64], rank: u64) -> (u32, u64) {
    let mut rest = rank;
    for (bin, count) in (0_u32..).zip(counts) {
        if rest <= *count {
            return (bin, rest);
        }
        rest -= count;
    }
    (BINS as u32 - 1, 1)
}

/// Counts of the bins (`sets` times 65536) of all finite values other than 0.
fn count(
    pixels: &Pixels<'_>,
    sets: usize,
    bin: &(impl Fn(u32) -> Option<u32> + Sync),
    run: &dyn Run,
) -> Result<Vec<u64>, Failure> {
    let parts = map(run, pixels.len().div_ceil(CHUNK), &|i| {
        let part = pixels.part(i * CHUNK, CHUNK.min(pixels.len() - i * CHUNK));
        let mut counts = vec![0_u32; sets * BINS];
        each_type!(part, v => count_part(v, bin, run, &mut counts));
        counts
    });
    if run.cancelled() {
        return Err(Failure::cancelled());
    }
    let mut total = vec![0_u64; sets * BINS];
    for part in parts {
        total
            .iter_mut()
            .zip(part)
            .for_each(|(t, n)| *t += u64::from(n));
    }
    Ok(total)
}

fn count_part<T: Pixel>(
    values: &[T],
    bin: &impl Fn(u32) -> Option<u32>,
    run: &dyn Run,
    counts: &mut [u32],
) {
    for block in values.chunks(1 << 16) {
        if run.cancelled() {
            return;
        }
        for v in block {
            let v = v.wide() as f32;
            if v != 0.0
                && v.is_finite()
                && let Some(bin) = bin(key(v))
            {
                counts[bin as usize] += 1;
            }
        }
    }
}

/// A number of the same order as `v`.
fn key(v: f32) -> u32 {
    let bits = v.to_bits();
    if bits >> 31 == 1 {
        !bits
    } else {
        bits | 1 << 31
    }
}

fn from_key(key: u32) -> f32 {
    f32::from_bits(if key >> 31 == 1 {
        key & !(1 << 31)
    } else {
        !key
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use puncta_sdk::run::Serial;

    #[test]
    fn ranks_are_those_of_the_sorted_values() {
        let values: Vec<f32> = (0..1001)
            .map(|i| ((i * 577) % 1009 - 300) as f32 * 0.37)
            .collect();
        let mut sorted: Vec<f32> = values.iter().copied().filter(|v| *v != 0.0).collect();
        sorted.sort_by(f32::total_cmp);
        let n = sorted.len() as f64;
        for percent in [0.0, 0.1, 25.0, 50.0, 99.9, 100.0] {
            let found = percentiles(&Pixels::F32(&values), [percent, 100.0], &Serial).unwrap();
            let rank = ((percent / 100.0 * n).ceil() as usize).max(1);
            let truth = [sorted[rank - 1], sorted[sorted.len() - 1]].map(f64::from);
            assert_eq!(found, Some(truth), "{percent}");
        }
    }

    #[test]
    fn limits_to_show() {
        let show =
            |values: &[f32], given| display(&Pixels::F32(values), given, [0.0, 100.0], &Serial);
        assert_eq!(show(&[0.0, 2.0, 5.0], [None; 2]).unwrap(), [0.0, 5.0]);
        assert_eq!(show(&[-3.0, 2.0, 5.0], [None; 2]).unwrap(), [-3.0, 5.0]);
        assert_eq!(show(&[0.0; 4], [None; 2]).unwrap(), [0.0, 1.0]);
        assert_eq!(show(&[-2.0; 4], [None; 2]).unwrap(), [-2.0, -1.0]);
        assert_eq!(show(&[1.0, 2.0], [Some(7.0), None]).unwrap(), [7.0, 8.0]);
        assert_eq!(show(&[1.0, 2.0], [None, Some(-7.0)]).unwrap(), [-8.0, -7.0]);
        assert_eq!(show(&[], [Some(1.0), Some(2.0)]).unwrap(), [1.0, 2.0]);
        assert!(show(&[1.0], [Some(2.0), Some(2.0)]).is_err());
        assert!(show(&[1.0], [Some(f64::NAN), Some(2.0)]).is_err());
    }

    #[test]
    fn zero_and_what_is_not_finite_do_not_count() {
        let values = [0.0, -0.0, f64::NAN, f64::INFINITY, 3.0, 1e300];
        let found = percentiles(&Pixels::F64(&values), [0.0, 100.0], &Serial).unwrap();
        assert_eq!(found, Some([3.0, 3.0]));
        assert_eq!(
            percentiles(&Pixels::U8(&[0; 9]), [0.0, 100.0], &Serial).unwrap(),
            None
        );
    }
}
