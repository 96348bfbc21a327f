//! One bit a row, built in parallel blocks, and its expansion to strictly increasing row numbers.
//!
//! A filter reads every column once, to set the bits; the second pass reads one bit a row only.

use std::ops::Range;
use std::sync::Mutex;

use puncta_sdk::{Failure, Run};

/// Rows in a block: the unit of parallel work. 8 KiB of bits, so a block's bits stay in cache.
pub const BLOCK: usize = 1 << 16;
/// Rows in a word of the mask.
pub const WORD: usize = 64;
/// Row numbers are 32 bits wide.
pub const MAX_ROWS: u64 = 1 << 32;

/// Which rows of a table are selected.
pub struct Mask {
    words: Vec<u64>,
    counts: Vec<usize>,
}

impl Mask {
    /// Builds the mask of `rows` rows. `fill` is called once a block, in parallel, with the block's
    /// rows and its words, all zero; bit `i` of word `w` is row `start + 64 w + i`.
    ///
    /// # Errors
    /// When cancelled, or when there are more than [`MAX_ROWS`] rows.
    pub fn build(
        rows: usize,
        run: &dyn Run,
        fill: &(dyn Fn(Range<usize>, &mut [u64]) + Sync),
    ) -> Result<Self, Failure> {
        if rows as u64 > MAX_ROWS {
            let message = format!("the table has {rows} rows, more than {MAX_ROWS}");
            return Err(Failure::bad_input(message).remedy("split it first"));
        }
        let mut words = vec![0u64; rows.div_ceil(WORD)];
        let mut counts = vec![0usize; rows.div_ceil(BLOCK)];
        let parts: Vec<Mutex<(&mut [u64], &mut usize)>> = words
            .chunks_mut(BLOCK / WORD)
            .zip(&mut counts)
            .map(Mutex::new)
            .collect();
        run.parallel(parts.len(), &|block| {
            if run.cancelled() {
                return;
            }
            let Some(Ok(mut part)) = parts.get(block).map(Mutex::lock) else {
                return;
            };
            let (words, count) = &mut *part;
            let start = block * BLOCK;
            fill(start..rows.min(start + BLOCK), words);
            **count = words.iter().map(|w| w.count_ones() as usize).sum();
        });
        drop(parts);
        if run.cancelled() {
            return Err(Failure::cancelled());
        }
        Ok(Self { words, counts })
    }

    /// Drops the rows outside `rows`.
    pub fn keep(&mut self, rows: Range<usize>) {
        let blocks = self.words.chunks_mut(BLOCK / WORD).zip(&mut self.counts);
        for (block, (words, count)) in blocks.enumerate() {
            let start = block * BLOCK;
            if rows.start <= start && rows.end >= start + BLOCK {
                continue;
            }
            for (word, first) in words.iter_mut().zip((start..).step_by(WORD)) {
                let below = |row: usize| match row.saturating_sub(first) {
                    bits @ 0..WORD => (1u64 << bits) - 1,
                    _ => u64::MAX,
                };
                *word &= below(rows.end) & !below(rows.start);
            }
            *count = words.iter().map(|w| w.count_ones() as usize).sum();
        }
    }

    /// Number of selected rows.
    pub fn count(&self) -> usize {
        self.counts.iter().sum()
    }

    /// Writes the selected row numbers, strictly increasing, to `out`, which has [`Mask::count`]
    /// places.
    ///
    /// # Errors
    /// When cancelled, or when `out` has another length.
    pub fn write(&self, out: &mut [u32], run: &dyn Run) -> Result<(), Failure> {
        if out.len() != self.count() {
            let (rows, places) = (self.count(), out.len());
            return Err(Failure::internal(format!(
                "{rows} rows are selected, {places} have room"
            )));
        }
        let mut rest = out;
        let mut parts = Vec::with_capacity(self.counts.len());
        for &count in &self.counts {
            let (head, tail) = rest.split_at_mut(count);
            parts.push(Mutex::new(head));
            rest = tail;
        }
        run.parallel(parts.len(), &|block| {
            if run.cancelled() {
                return;
            }
            let Some(Ok(mut part)) = parts.get(block).map(Mutex::lock) else {
                return;
            };
            let first = block * (BLOCK / WORD);
            let last = self.words.len().min(first + BLOCK / WORD);
            let words = self.words.get(first..last).unwrap_or_default();
            expand(words, (block * BLOCK) as u32, &mut part);
        });
        if run.cancelled() {
            Err(Failure::cancelled())
        } else {
            Ok(())
        }
    }

    /// The selected row numbers, strictly increasing.
    ///
    /// # Errors
    /// When cancelled.
    pub fn rows(&self, run: &dyn Run) -> Result<Vec<u32>, Failure> {
        let mut out = vec![0; self.count()];
        self.write(&mut out, run)?;
        Ok(out)
    }
}

/// Writes the numbers of the set bits of `words`, bit 0 being row `start`.
fn expand(words: &[u64], start: u32, out: &mut [u32]) {
    let mut out = out.iter_mut();
    let mut base = start;
    for &word in words {
        if word == u64::MAX {
            for (slot, row) in out.by_ref().take(WORD).zip(base..=base | 63) {
                *slot = row;
            }
        } else {
            let mut left = word;
            while left != 0 {
                if let Some(slot) = out.next() {
                    *slot = base | left.trailing_zeros();
                }
                left &= left - 1;
            }
        }
        base = base.wrapping_add(WORD as u32);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use puncta_testkit::{Stopped, Threads};

    fn every(step: usize) -> impl Fn(Range<usize>, &mut [u64]) + Sync {
        move |rows, words| {
            let start = rows.start;
            for row in rows.filter(|row| row % step == 0) {
                words[(row - start) / WORD] |= 1 << (row % WORD);
            }
        }
    }

    #[test]
    fn rows_are_those_whose_bit_is_set() {
        for rows in [0, 1, 63, 64, 65, BLOCK - 1, BLOCK, BLOCK + 1, 3 * BLOCK + 7] {
            for step in [1, 2, 7, 100_000] {
                for threads in [1, 2] {
                    let run = Threads(threads);
                    let mask = Mask::build(rows, &run, &every(step)).expect("not cancelled");
                    let expected: Vec<u32> = (0..rows as u32).step_by(step).collect();
                    assert_eq!(mask.rows(&run), Ok(expected));
                }
            }
        }
    }

    #[test]
    fn rows_outside_a_range_are_dropped() {
        let run = Threads(2);
        let end = 2 * BLOCK + 100;
        for (low, high) in [
            (0, end),
            (0, 0),
            (5, 64),
            (64, 65),
            (BLOCK - 1, end - 1),
            (7, 3 * BLOCK),
        ] {
            let mut mask = Mask::build(end, &run, &every(3)).expect("not cancelled");
            mask.keep(low..high);
            let expected = (0..end as u32)
                .step_by(3)
                .filter(|row| (low..high).contains(&(*row as usize)));
            assert_eq!(mask.rows(&run), Ok(expected.collect()));
        }
    }

    #[test]
    fn the_last_rows_of_a_full_range_are_numbered() {
        let mut out = [0u32; 65];
        expand(&[u64::MAX, 1 << 63], u32::MAX - 127, &mut out);
        assert_eq!(out[0], u32::MAX - 127);
        assert_eq!(out[63], u32::MAX - 64);
        assert_eq!(out[64], u32::MAX);
    }

    #[test]
    fn wrong_output_length_and_cancel_are_errors() {
        let run = Threads(1);
        let mask = Mask::build(10, &run, &every(2)).expect("not cancelled");
        assert!(
            mask.write(&mut [0; 4], &run)
                .is_err_and(|failure| !failure.is_cancelled())
        );
        assert_eq!(mask.write(&mut [0; 5], &Stopped), Err(Failure::cancelled()));
        assert!(Mask::build(10, &Stopped, &every(2)).is_err_and(|failure| failure.is_cancelled()));
    }
}
