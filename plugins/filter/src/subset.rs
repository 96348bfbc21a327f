//! A uniformly random subset of exactly `count` rows, without replacement.
//!
//! How many rows each block gives follows the multivariate hypergeometric law, drawn block by block;
//! which rows of a block are then drawn inside the block from a stream of its own. So every subset
//! has the same probability, and the result does not depend on the number of threads.

use std::ops::Range;

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

use crate::mask::{BLOCK, Mask, WORD};
use puncta_sdk::{Failure, Run};

/// How many rows to take.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Size {
    /// This many rows.
    Count(u64),
    /// This share of the rows, 0 to 1; the number is rounded to the nearest, halves up.
    Fraction(f64),
}

impl Size {
    /// The number of rows out of `rows`.
    ///
    /// # Errors
    /// A sentence when a count exceeds `rows` or a fraction lies outside 0 to 1.
    pub fn of(self, rows: usize) -> Result<usize, Failure> {
        match self {
            Self::Count(count) => usize::try_from(count)
                .ok()
                .filter(|count| *count <= rows)
                .ok_or_else(|| {
                    let message = format!("the table has {rows} rows, fewer than {count}");
                    Failure::bad_input(message).remedy("lower count, or clear strict")
                }),
            Self::Fraction(fraction) if (0.0..=1.0).contains(&fraction) => {
                Ok(((rows as f64 * fraction).round() as usize).min(rows))
            }
            Self::Fraction(fraction) => Err(Failure::bad_parameter(
                "fraction",
                format!("fraction is {fraction}, outside 0 to 1"),
            )),
        }
    }
}

/// A random subset of a table of `rows` rows; the same seed gives the same subset.
///
/// # Errors
/// As [`Size::of`]; or cancelled.
pub fn subset_mask(rows: usize, size: Size, seed: u64, run: &dyn Run) -> Result<Mask, Failure> {
    let counts = block_counts(rows, size.of(rows)?, seed, run)?;
    Mask::build(rows, run, &|block: Range<usize>, words| {
        let index = block.start / BLOCK;
        let count = counts.get(index).copied().unwrap_or_default();
        let mut random = stream(seed, index as u64 + 1);
        // Drawing the smaller of subset and rest keeps the rejection of repeats short.
        let rest = block.len() - count;
        draw_bits(words, block.len(), count.min(rest), &mut random);
        if rest < count {
            words.iter_mut().for_each(|word| *word = !*word);
            let tail = block.len() % WORD;
            if let (1.., Some(last)) = (tail, words.last_mut()) {
                *last &= (1 << tail) - 1;
            }
        }
    })
}

/// As [`subset_mask`], as strictly increasing row numbers.
///
/// # Errors
/// As [`subset_mask`].
pub fn random_subset(
    rows: usize,
    size: Size,
    seed: u64,
    run: &dyn Run,
) -> Result<Vec<u32>, Failure> {
    subset_mask(rows, size, seed, run)?.rows(run)
}

fn stream(seed: u64, number: u64) -> ChaCha8Rng {
    let mut key = [0; 32];
    key[..8].copy_from_slice(&seed.to_le_bytes());
    let mut random = ChaCha8Rng::from_seed(key);
    random.set_stream(number);
    random
}

/// How many of `count` rows fall into each block of `rows` rows.
fn block_counts(
    rows: usize,
    count: usize,
    seed: u64,
    run: &dyn Run,
) -> Result<Vec<usize>, Failure> {
    let mut random = stream(seed, 0);
    let (mut rows, mut left) = (rows, count);
    let mut counts = Vec::with_capacity(rows.div_ceil(BLOCK));
    while rows > 0 {
        if counts.len() % 1024 == 0 && run.cancelled() {
            return Err(Failure::cancelled());
        }
        let block = rows.min(BLOCK);
        let here = hypergeometric(rows, left, block, &mut random);
        counts.push(here);
        rows -= block;
        left -= here;
    }
    Ok(counts)
}

/// How many of `drawn` rows, out of `rows` of which `marked` are marked, are marked.
///
/// Inversion: the weights relative to the mode follow from the ratio of neighbouring
/// probabilities, so no factorial is needed and nothing but rounding (1e-13) is lost.
fn hypergeometric(rows: usize, marked: usize, drawn: usize, random: &mut impl Rng) -> usize {
    let low = (marked + drawn).saturating_sub(rows);
    let high = marked.min(drawn);
    let (n, m, d) = (rows as f64, marked as f64, drawn as f64);
    let mode = ((m + 1.0) * (d + 1.0) / (n + 2.0)).floor();
    let mode = (mode as usize).clamp(low, high);
    // P(k + 1) / P(k)
    let ratio = |k: f64| (m - k) * (d - k) / ((k + 1.0) * (n - m - d + k + 1.0));
    let mut above = vec![1.0];
    let mut total = 1.0;
    let mut weight = 1.0;
    for k in mode..high {
        weight *= ratio(k as f64);
        if weight < NEGLIGIBLE {
            break;
        }
        above.push(weight);
        total += weight;
    }
    let mut below = vec![];
    weight = 1.0;
    for k in (low..mode).rev() {
        weight /= ratio(k as f64);
        if weight < NEGLIGIBLE {
            break;
        }
        below.push(weight);
        total += weight;
    }
    let mut left = unit(random) * total;
    let first = mode - below.len();
    let weights = below.iter().rev().chain(&above);
    for (value, weight) in (first..).zip(weights) {
        left -= weight;
        if left < 0.0 {
            return value;
        }
    }
    mode
}

/// Weights below this, relative to the mode's, add up to less than the rounding of f64.
const NEGLIGIBLE: f64 = 1e-22;

/// Uniform in [0, 1), 53 bits.
fn unit(random: &mut impl Rng) -> f64 {
    (random.next_u64() >> 11) as f64 / (1u64 << 53) as f64
}

/// Sets `count` different bits out of the first `len`, every choice equally likely.
fn draw_bits(words: &mut [u64], len: usize, count: usize, random: &mut impl Rng) {
    let mask = len.next_power_of_two().wrapping_sub(1) as u32;
    let mut left = count;
    while left > 0 {
        let bit = (random.next_u32() & mask) as usize;
        if bit >= len {
            continue;
        }
        if let Some(word) = words.get_mut(bit / WORD) {
            let one = 1 << (bit % WORD);
            left -= usize::from(*word & one == 0);
            *word |= one;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use puncta_testkit::{Stopped, Threads};

    fn subset(rows: usize, size: Size, seed: u64) -> Vec<u32> {
        let one = random_subset(rows, size, seed, &Threads(1)).expect("valid");
        assert_eq!(
            random_subset(rows, size, seed, &Threads(2)),
            Ok(one.clone())
        );
        one
    }

    fn chi_squared(observed: &[u64], expected: &[f64]) -> f64 {
        observed
            .iter()
            .zip(expected)
            .map(|(&o, e)| (o as f64 - e).powi(2) / e)
            .sum()
    }

    #[test]
    fn exactly_count_increasing_rows() {
        for rows in [1, 2, 63, 64, 65, 1000, BLOCK, BLOCK + 1, 5 * BLOCK + 123] {
            for count in [0, 1, rows / 3, rows / 2, rows - 1, rows] {
                let found = subset(rows, Size::Count(count as u64), 9);
                assert_eq!(found.len(), count);
                assert!(found.windows(2).all(|pair| pair[0] < pair[1]));
                assert!(found.last().is_none_or(|&last| (last as usize) < rows));
            }
        }
        assert_eq!(subset(0, Size::Fraction(0.5), 1), [0; 0]);
    }

    #[test]
    fn fractions_are_rounded_and_seeds_differ() {
        assert_eq!(subset(7, Size::Fraction(0.5), 1).len(), 4);
        assert_eq!(subset(10, Size::Fraction(0.24), 1).len(), 2);
        assert_eq!(
            subset(10, Size::Fraction(1.0), 1),
            (0..10).collect::<Vec<_>>()
        );
        assert_ne!(
            subset(1000, Size::Count(500), 1),
            subset(1000, Size::Count(500), 2)
        );
    }

    #[test]
    fn every_pair_of_six_rows_is_equally_likely() {
        let mut observed = [0u64; 36];
        for seed in 0..30_000 {
            let pair = random_subset(6, Size::Count(2), seed, &Threads(1)).expect("valid");
            observed[(pair[0] * 6 + pair[1]) as usize] += 1;
        }
        let pairs: Vec<u64> = observed.into_iter().filter(|&n| n > 0).collect();
        assert_eq!(pairs.len(), 15);
        // 14 degrees of freedom: 0.999 quantile 36.1.
        assert!(chi_squared(&pairs, &[2000.0; 15]) < 36.1);
    }

    #[test]
    fn rows_are_equally_likely_within_and_across_blocks() {
        let rows = 2 * BLOCK + BLOCK / 2;
        let bins = 40;
        for count in [3000, rows - 3000] {
            let mut observed = vec![0u64; bins];
            let seeds = 20;
            for seed in 0..seeds {
                let picked = random_subset(rows, Size::Count(count as u64), seed, &Threads(1));
                for row in picked.expect("valid") {
                    observed[row as usize * bins / rows] += 1;
                }
            }
            let mean = (seeds as usize * count) as f64 / bins as f64;
            // Without replacement the counts vary less by the share that is not taken.
            let taken = count as f64 / rows as f64;
            let statistic = chi_squared(&observed, &vec![mean; bins]) / (1.0 - taken);
            // 39 degrees of freedom: 0.001 and 0.999 quantiles.
            assert!((16.3..72.1).contains(&statistic), "{count}: {statistic}");
        }
    }

    /// ln(n!) by summation.
    fn ln_factorial(n: usize) -> f64 {
        (2..=n).map(|i| (i as f64).ln()).sum()
    }

    #[test]
    fn hypergeometric_draws_follow_the_law() {
        let choose = |n, k| ln_factorial(n) - ln_factorial(k) - ln_factorial(n - k);
        for (rows, marked, drawn) in [
            (100usize, 50usize, 49usize),
            (20, 3, 15),
            (5000, 4000, 900),
            (10, 10, 4),
        ] {
            let mut random = stream(5, 0);
            let low = (marked + drawn).saturating_sub(rows);
            let high: usize = marked.min(drawn);
            let mut observed = vec![0u64; high - low + 1];
            let draws = 100_000;
            for _ in 0..draws {
                observed[hypergeometric(rows, marked, drawn, &mut random) - low] += 1;
            }
            let probability = |k| {
                (choose(marked, k) + choose(rows - marked, drawn - k) - choose(rows, drawn)).exp()
            };
            let (mut statistic, mut bins) = (0.0, 0);
            for (k, &seen) in (low..).zip(&observed) {
                let expected = probability(k) * draws as f64;
                if expected > 10.0 {
                    statistic += (seen as f64 - expected).powi(2) / expected;
                    bins += 1;
                } else {
                    assert!(seen < 40, "{seen} draws of {k}, {expected} expected");
                }
            }
            let freedom = f64::from(bins - 1);
            assert!(
                statistic < freedom + 4.0 * (2.0 * freedom).sqrt() + 1e-9,
                "{statistic}"
            );
        }
    }

    #[test]
    fn bad_sizes_are_refused() {
        let refused = |size| {
            random_subset(10, size, 0, &Threads(1))
                .expect_err("bad")
                .to_string()
        };
        assert_eq!(
            refused(Size::Count(11)),
            "the table has 10 rows, fewer than 11; lower count, or clear strict"
        );
        for fraction in [-0.1, 1.1, f64::NAN, f64::INFINITY] {
            assert!(refused(Size::Fraction(fraction)).starts_with("fraction is "));
        }
        let cancelled = random_subset(10, Size::Count(2), 0, &Stopped);
        assert_eq!(cancelled, Err(Failure::cancelled()));
    }
}
