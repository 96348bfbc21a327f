//! Rows whose values lie in closed ranges, `low <= value <= high` for every named column.
//!
//! NaN never passes. An infinite limit is open, so `[-inf, inf]` drops NaN only. Limits are
//! brought to the column's own type once, exactly: 64-bit integers are never rounded to f64.

use std::ops::Range;

use crate::mask::{MAX_ROWS, Mask, WORD};
use puncta_sdk::{Failure, FailureCode, Run};

/// A column of any numeric type.
#[derive(Clone, Copy, Debug)]
#[allow(missing_docs)]
pub enum Values<'a> {
    U8(&'a [u8]),
    I8(&'a [i8]),
    U16(&'a [u16]),
    I16(&'a [i16]),
    U32(&'a [u32]),
    I32(&'a [i32]),
    U64(&'a [u64]),
    I64(&'a [i64]),
    F32(&'a [f32]),
    F64(&'a [f64]),
}

/// A column and its closed range.
#[derive(Clone, Copy, Debug)]
pub struct Limits<'a> {
    /// Name of the column, for the error sentence.
    pub name: &'a str,
    /// The column.
    pub values: Values<'a>,
    /// Lowest value that passes.
    pub low: f64,
    /// Highest value that passes.
    pub high: f64,
}

/// The rows of a table of `rows` rows whose values lie in every range.
///
/// # Errors
/// A sentence naming the column when a range is inverted or has a NaN limit, or when a column has
/// not `rows` values; or cancelled.
pub fn range_mask(rows: usize, limits: &[Limits<'_>], run: &dyn Run) -> Result<Mask, Failure> {
    for limit in limits {
        check(rows, limit)?;
    }
    let tests: Vec<Test<'_>> = limits.iter().map(Test::new).collect();
    Mask::build(rows, run, &|block, words| {
        words.fill(u64::MAX);
        for test in &tests {
            test.keep(block.clone(), words);
        }
        let tail = block.len() % WORD;
        if let (1.., Some(last)) = (tail, words.last_mut()) {
            *last &= (1 << tail) - 1;
        }
    })
}

/// As [`range_mask`], as strictly increasing row numbers.
///
/// # Errors
/// As [`range_mask`].
pub fn range_rows(rows: usize, limits: &[Limits<'_>], run: &dyn Run) -> Result<Vec<u32>, Failure> {
    range_mask(rows, limits, run)?.rows(run)
}

/// Drops the rows whose number lies outside the closed range.
pub fn keep_rows(mask: &mut Mask, low: f64, high: f64) {
    // No row has the number 2^32; an empty range drops all.
    let limit = |number: f64| number.clamp(0.0, MAX_ROWS as f64) as u64;
    let first = limit(low.ceil());
    let end = if high < 0.0 {
        0
    } else {
        limit(high.floor() + 1.0)
    };
    mask.keep(first as usize..(end as usize).max(first as usize));
}

fn check(rows: usize, limit: &Limits<'_>) -> Result<(), Failure> {
    check_limits(limit.name, limit.low, limit.high)?;
    let (name, len) = (limit.name, limit.values.len());
    if len != rows {
        return Err(Failure::bad_input(format!(
            "column {name} has {len} rows, but the table has {rows}"
        )));
    }
    Ok(())
}

/// Refuses limits that are not numbers or inverted.
pub fn check_limits(name: &str, low: f64, high: f64) -> Result<(), Failure> {
    let refuse = |message| Failure::new(FailureCode::BadParameter, message);
    if low.is_nan() || high.is_nan() {
        return Err(refuse(format!("a limit of {name} is not a number")));
    }
    if low > high {
        let message = format!("the range of {name} runs from {low} down to {high}");
        return Err(refuse(message).remedy("swap its limits"));
    }
    Ok(())
}

/// Calls `$body` with the slice inside `$values` bound to `$slice`.
macro_rules! typed {
    ($values:expr, $slice:ident => $body:expr) => {
        match $values {
            Values::U8($slice) => $body,
            Values::I8($slice) => $body,
            Values::U16($slice) => $body,
            Values::I16($slice) => $body,
            Values::U32($slice) => $body,
            Values::I32($slice) => $body,
            Values::U64($slice) => $body,
            Values::I64($slice) => $body,
            Values::F32($slice) => $body,
            Values::F64($slice) => $body,
        }
    };
}

impl Values<'_> {
    /// Number of values.
    pub fn len(&self) -> usize {
        typed!(self, values => values.len())
    }

    /// Whether there is no value.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

struct Test<'a> {
    values: Values<'a>,
    low: f64,
    high: f64,
}

impl<'a> Test<'a> {
    fn new(limits: &Limits<'a>) -> Self {
        Self {
            values: limits.values,
            low: limits.low,
            high: limits.high,
        }
    }

    /// Clears the bits of the rows of the block that fail.
    fn keep(&self, rows: Range<usize>, words: &mut [u64]) {
        typed!(self.values, values => {
            keep_typed(values.get(rows).unwrap_or_default(), self.low, self.high, words);
        });
    }
}

fn keep_typed<T: Number>(values: &[T], low: f64, high: f64, words: &mut [u64]) {
    let Some((low, high)) = T::limits(low, high) else {
        words.fill(0);
        return;
    };
    let mut chunks = values.chunks_exact(WORD);
    for (chunk, word) in chunks.by_ref().zip(words.iter_mut()) {
        // A word that is already empty spares the column's memory.
        if let (1.., Ok(chunk)) = (*word, chunk.try_into()) {
            *word &= word_mask(chunk, low, high);
        }
    }
    let tail = chunks.remainder();
    if let (1.., Some(word)) = (tail.len(), words.get_mut(values.len() / WORD)) {
        let bits = tail.iter().enumerate();
        *word &= bits.fold(0, |m, (i, &v)| m | (u64::from(v >= low && v <= high) << i));
    }
}

/// The mask of 64 values: comparisons to bytes, which the compiler vectorises, then eight bytes
/// of 0 or 1 to eight bits with one multiplication.
#[inline]
fn word_mask<T: Number>(values: &[T; WORD], low: T, high: T) -> u64 {
    let mut bytes = [0u8; WORD];
    for (byte, value) in bytes.iter_mut().zip(values) {
        *byte = u8::from((*value >= low) & (*value <= high));
    }
    let mut mask = 0;
    let (eights, _) = bytes.as_chunks::<8>();
    for (i, eight) in eights.iter().enumerate() {
        let bits = u64::from_le_bytes(*eight).wrapping_mul(0x0102_0408_1020_4080) >> 56;
        mask |= bits << (8 * i);
    }
    mask
}

/// A column type, with its own limits.
trait Number: Copy + PartialOrd {
    /// The lowest and highest value of this type inside `[low, high]`, or `None` if there is none.
    fn limits(low: f64, high: f64) -> Option<(Self, Self)>;
}

impl Number for f64 {
    fn limits(low: f64, high: f64) -> Option<(Self, Self)> {
        Some((low, high))
    }
}

impl Number for f32 {
    fn limits(low: f64, high: f64) -> Option<(Self, Self)> {
        let (mut l, mut h) = (low as f32, high as f32);
        if f64::from(l) < low {
            l = l.next_up();
        }
        if f64::from(h) > high {
            h = h.next_down();
        }
        Some((l, h))
    }
}

macro_rules! integer {
    ($($t:ty)*) => {$(
        impl Number for $t {
            fn limits(low: f64, high: f64) -> Option<(Self, Self)> {
                let (low, high) = (low.ceil(), high.floor());
                // MAX + 1 is exact in f64 for every width, MAX itself is not.
                let inside = low < <$t>::MAX as f64 + 1.0 && high >= <$t>::MIN as f64;
                inside.then_some((low as $t, high as $t))
            }
        }
    )*};
}
integer!(u8 i8 u16 i16 u32 i32 u64 i64);

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mask::BLOCK;
    use puncta_testkit::Threads;

    const INF: f64 = f64::INFINITY;

    fn rows(limits: &[(Values<'_>, f64, f64)]) -> Vec<u32> {
        let limits: Vec<_> = limits
            .iter()
            .map(|&(values, low, high)| Limits {
                name: "c",
                values,
                low,
                high,
            })
            .collect();
        let one = range_rows(limits[0].values.len(), &limits, &Threads(1)).expect("valid");
        let two = range_rows(limits[0].values.len(), &limits, &Threads(2)).expect("valid");
        assert_eq!(one, two);
        one
    }

    /// A fixed, full-range sequence (Weyl sequence, scrambled).
    fn noise(n: usize) -> Vec<u64> {
        (0..n as u64)
            .map(|i| {
                let z = i.wrapping_mul(0x9E37_79B9_7F4A_7C15);
                let z = (z ^ (z >> 31)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
                z ^ (z >> 29)
            })
            .collect()
    }

    #[test]
    fn a_ramp_passes_between_its_limits_ends_included() {
        let ramp: Vec<f64> = (0..200_000).map(f64::from).collect();
        assert_eq!(
            rows(&[(Values::F64(&ramp), 10.0, 20.0)]),
            (10..=20).collect::<Vec<_>>()
        );
        assert_eq!(rows(&[(Values::F64(&ramp), 7.0, 7.0)]), [7]);
        assert_eq!(rows(&[(Values::F64(&ramp), 199_999.0, INF)]), [199_999]);
        let down: Vec<f64> = ramp.iter().rev().copied().collect();
        let both = [
            (Values::F64(&ramp), 70_000.0, INF),
            (Values::F64(&down), 129_990.0, INF),
        ];
        assert_eq!(rows(&both), (70_000..=70_009).collect::<Vec<_>>());
    }

    #[test]
    fn every_type_agrees_with_a_plain_loop() {
        let raw = noise(2 * BLOCK + 77);
        macro_rules! compare {
            ($($variant:ident $t:ty, $low:expr, $high:expr;)*) => {$({
                let column: Vec<$t> = raw.iter().map(|&r| r as $t).collect();
                let expected: Vec<u32> = (0..column.len() as u32)
                    .filter(|&i| {
                        let v = column[i as usize];
                        f64::from(v) >= $low && f64::from(v) <= $high
                    })
                    .collect();
                assert!(!expected.is_empty() && expected.len() < column.len());
                assert_eq!(rows(&[(Values::$variant(&column), $low, $high)]), expected);
            })*};
        }
        compare! {
            U8 u8, 3.5, 100.0;
            I8 i8, -3.0, 100.2;
            U16 u16, 1000.0, 3e9;
            I16 i16, -INF, 12.0;
            U32 u32, 1e9, 3e9;
            I32 i32, -1e9, INF;
            F32 f32, 1e18, 9.123_456_789e18;
        }
        let column: Vec<f64> = raw.iter().map(|&r| r as f64 / 1e19 - 0.5).collect();
        let expected: Vec<u32> = (0..raw.len() as u32)
            .filter(|&i| column[i as usize].abs() <= 0.1)
            .collect();
        assert_eq!(rows(&[(Values::F64(&column), -0.1, 0.1)]), expected);
    }

    #[test]
    fn sixty_four_bit_integers_are_compared_exactly() {
        let big = 1u64 << 53;
        let unsigned = [0, big, big + 1, big + 2, u64::MAX];
        assert_eq!(rows(&[(Values::U64(&unsigned), 0.0, big as f64)]), [0, 1]);
        assert_eq!(
            rows(&[(Values::U64(&unsigned), (big + 2) as f64, INF)]),
            [3, 4]
        );
        assert_eq!(
            rows(&[(Values::U64(&unsigned), 18_446_744_073_709_551_616.0, INF)]),
            [0; 0]
        );
        let signed = [i64::MIN, -1, 0, i64::MAX];
        assert_eq!(rows(&[(Values::I64(&signed), -INF, -0.5)]), [0, 1]);
        assert_eq!(
            rows(&[(Values::I64(&signed), 9_223_372_036_854_775_808.0, INF)]),
            [0; 0]
        );
    }

    #[test]
    fn a_limit_between_two_f32_values_is_not_rounded_outwards() {
        let values = [0.1f32, 0.1f32.next_up(), f32::MAX, f32::INFINITY];
        let between = (f64::from(values[0]) + f64::from(values[1])) / 2.0;
        assert_eq!(rows(&[(Values::F32(&values), between, 1.0)]), [1]);
        assert_eq!(rows(&[(Values::F32(&values), -1.0, between)]), [0]);
        assert_eq!(rows(&[(Values::F32(&values), 1.0, 1e300)]), [2]);
        assert_eq!(rows(&[(Values::F32(&values), 1e300, INF)]), [3]);
    }

    #[test]
    fn nan_never_passes_and_infinity_passes_an_open_end() {
        let values = [f64::NAN, -INF, -0.0, 0.0, INF];
        assert_eq!(rows(&[(Values::F64(&values), -INF, INF)]), [1, 2, 3, 4]);
        assert_eq!(rows(&[(Values::F64(&values), 0.0, 0.0)]), [2, 3]);
        assert_eq!(rows(&[(Values::F64(&values), INF, INF)]), [4]);
        let narrow = [f32::NAN, 1.0];
        assert_eq!(rows(&[(Values::F32(&narrow), -INF, INF)]), [1]);
    }

    #[test]
    fn permuted_and_duplicated_rows_permute_and_duplicate_the_selection() {
        let values: Vec<f64> = noise(1000).iter().map(|&r| (r % 997) as f64).collect();
        let kept = rows(&[(Values::F64(&values), 100.0, 400.0)]);
        let reversed: Vec<f64> = values.iter().rev().copied().collect();
        let mut back: Vec<u32> = rows(&[(Values::F64(&reversed), 100.0, 400.0)]);
        back.iter_mut().for_each(|row| *row = 999 - *row);
        back.reverse();
        assert_eq!(back, kept);
        let twice: Vec<f64> = values.iter().flat_map(|&v| [v, v]).collect();
        let doubled: Vec<u32> = kept
            .iter()
            .flat_map(|&row| [2 * row, 2 * row + 1])
            .collect();
        assert_eq!(rows(&[(Values::F64(&twice), 100.0, 400.0)]), doubled);
    }

    #[test]
    fn empty_tables_one_row_and_no_range() {
        let run = Threads(2);
        assert_eq!(rows(&[(Values::F64(&[]), 0.0, 1.0)]), [0; 0]);
        assert_eq!(rows(&[(Values::I32(&[5]), 5.0, 5.0)]), [0]);
        assert_eq!(range_rows(70, &[], &run), Ok((0..70).collect()));
    }

    #[test]
    fn bad_limits_and_lengths_are_refused_naming_the_column() {
        let values = Values::F64(&[1.0, 2.0]);
        let refused = |rows, low, high| {
            let limits = [Limits {
                name: "error_x",
                values,
                low,
                high,
            }];
            range_rows(rows, &limits, &Threads(1))
                .expect_err("bad")
                .to_string()
        };
        assert_eq!(
            refused(2, 15.0, 0.0),
            "the range of error_x runs from 15 down to 0; swap its limits"
        );
        for (low, high) in [(f64::NAN, 1.0), (0.0, f64::NAN)] {
            assert_eq!(refused(2, low, high), "a limit of error_x is not a number");
        }
        assert_eq!(
            refused(3, 0.0, 1.0),
            "column error_x has 2 rows, but the table has 3"
        );
    }
}
