//! Least value, greatest value and sum of a column, as `info` and the viewer show them.

use crate::store::ColumnData;
use crate::store::region::{Number, Region};
use puncta_documents::Element;
use rayon::prelude::*;

/// Values that one task takes. The blocks and the order in which their sums are added do not
/// depend on the threads, so that the result does not either.
const BLOCK: usize = 64 * 1024;
const LANES: usize = 8;

/// Summary of a column of numbers; lists count each of their numbers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Summary {
    /// Least and greatest value; `None` when there is none but NaN.
    pub range: Option<(f64, f64)>,
    /// Sum of the values that are not NaN: exact for integers, compensated for floating point (the
    /// error does not grow with their number).
    pub sum: f64,
    /// How many values are NaN.
    pub missing: u64,
}

/// Summarises a column, on the threads of the current pool. `None` for a column of texts.
#[must_use]
pub fn summary(column: &ColumnData) -> Option<Summary> {
    let empty = Summary {
        range: None,
        sum: 0.0,
        missing: 0,
    };
    if column.type_.element.is_text() {
        return None;
    }
    let Some(region) = &column.data else {
        return Some(empty);
    };
    Some(match column.type_.element {
        Element::U8 | Element::Bool => integers::<u8>(region),
        Element::I8 => integers::<i8>(region),
        Element::U16 => integers::<u16>(region),
        Element::I16 => integers::<i16>(region),
        Element::U32 => integers::<u32>(region),
        Element::I32 => integers::<i32>(region),
        Element::U64 => integers::<u64>(region),
        Element::I64 => integers::<i64>(region),
        Element::F32 => floats(region.slice::<f32>()),
        Element::F64 => floats(region.slice::<f64>()),
        Element::Utf8 | Element::Dictionary => return None,
    })
}

fn integers<T: Number + Ord + Into<i128>>(region: &Region) -> Summary {
    let values = region.slice::<T>();
    let blocks = values.par_chunks(BLOCK).map(|block| {
        let sum: i128 = block.iter().map(|value| (*value).into()).sum();
        (
            block.iter().min().copied(),
            block.iter().max().copied(),
            sum,
        )
    });
    let all = blocks.reduce(
        || (None, None, 0),
        |a, b| {
            let least = a.0.into_iter().chain(b.0).min();
            (least, a.1.max(b.1), a.2 + b.2)
        },
    );
    #[allow(clippy::cast_precision_loss)]
    let float = |value: i128| value as f64;
    let range = all
        .0
        .zip(all.1)
        .map(|(least, most)| (float(least.into()), float(most.into())));
    Summary {
        range,
        sum: float(all.2),
        missing: 0,
    }
}

/// A sum as a number and what is missing from it (Knuth, The Art of Computer Programming 2,
/// 4.2.2, theorem B).
#[derive(Clone, Copy, Default)]
struct Sum {
    high: f64,
    low: f64,
}

impl Sum {
    #[inline(always)]
    fn add(&mut self, value: f64) {
        let sum = self.high + value;
        let part = sum - self.high;
        self.low += (self.high - (sum - part)) + (value - part);
        self.high = sum;
    }

    /// Once the sum is infinite or NaN, what is missing from it means nothing.
    fn value(self) -> f64 {
        if self.high.is_finite() {
            self.high + self.low
        } else {
            self.high
        }
    }
}

struct Part {
    least: f64,
    most: f64,
    sum: Sum,
    missing: u64,
}

fn floats<T: Number + Into<f64>>(values: &[T]) -> Summary {
    let parts: Vec<Part> = values.par_chunks(BLOCK).map(block).collect();
    let start = Part {
        least: f64::INFINITY,
        most: f64::NEG_INFINITY,
        sum: Sum::default(),
        missing: 0,
    };
    let all = parts.iter().fold(start, join);
    let found = all.missing < values.len() as u64;
    let range = found.then_some((all.least, all.most));
    Summary {
        range,
        sum: all.sum.value(),
        missing: all.missing,
    }
}

fn join(mut all: Part, part: &Part) -> Part {
    all.least = all.least.min(part.least);
    all.most = all.most.max(part.most);
    all.missing += part.missing;
    let low = part.sum.low;
    all.sum.add(part.sum.high);
    all.sum.add(if low.is_finite() { low } else { 0.0 });
    all
}

fn block<T: Number + Into<f64>>(values: &[T]) -> Part {
    let mut sums = [Sum::default(); LANES];
    let mut least = [f64::INFINITY; LANES];
    let mut most = [f64::NEG_INFINITY; LANES];
    let mut missing = [0_u64; LANES];
    let mut take = |lane: usize, value: f64| {
        let there = !value.is_nan();
        missing[lane] += u64::from(!there);
        sums[lane].add(if there { value } else { 0.0 });
        least[lane] = if value < least[lane] {
            value
        } else {
            least[lane]
        };
        most[lane] = if value > most[lane] {
            value
        } else {
            most[lane]
        };
    };
    let (whole, rest) = values.as_chunks::<LANES>();
    for chunk in whole {
        for (lane, value) in chunk.iter().enumerate() {
            take(lane, (*value).into());
        }
    }
    for (lane, value) in rest.iter().enumerate() {
        take(lane, (*value).into());
    }
    let parts = (0..LANES).map(|lane| Part {
        least: least[lane],
        most: most[lane],
        sum: sums[lane],
        missing: missing[lane],
    });
    let start = Part {
        least: f64::INFINITY,
        most: f64::NEG_INFINITY,
        sum: Sum::default(),
        missing: 0,
    };
    parts.fold(start, |all, part| join(all, &part))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sums_are_compensated() {
        let values = [1e16, 1.0, -1e16, 1.0, f64::NAN, 1e-3];
        let found = floats(&values);
        assert_eq!(found.sum, 2.001);
        assert_eq!((found.range, found.missing), (Some((-1e16, 1e16)), 1));
        // Added one after another they give 999999.9998389754.
        let many = vec![0.1; 10_000_000];
        assert_eq!(floats(&many).sum, 1_000_000.0);
        let found = floats(&[f32::MAX, f32::MAX, -f32::MAX]);
        assert_eq!(found.sum, f64::from(f32::MAX));
    }

    #[test]
    fn nothing_and_infinities() {
        assert_eq!(
            floats::<f64>(&[]),
            Summary {
                range: None,
                sum: 0.0,
                missing: 0
            }
        );
        assert_eq!(
            floats(&[f64::NAN; 3]),
            Summary {
                range: None,
                sum: 0.0,
                missing: 3
            }
        );
        let found = floats(&[1.0, f64::INFINITY, 2.0]);
        assert_eq!(
            (found.sum, found.range),
            (f64::INFINITY, Some((1.0, f64::INFINITY)))
        );
        assert!(floats(&[f64::NEG_INFINITY, f64::INFINITY]).sum.is_nan());
    }

    #[test]
    fn threads_do_not_matter() {
        let values: Vec<f64> = (0..300_000_u32)
            .map(|i| f64::from(i.wrapping_mul(2_654_435_761)) * 1.1 - 2e9)
            .collect();
        let with = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new()
                .num_threads(threads)
                .build()
                .unwrap();
            pool.install(|| floats(&values))
        };
        let (one, four) = (with(1), with(4));
        assert_eq!(one.sum.to_bits(), four.sum.to_bits());
        assert_eq!(one, four);
    }

    #[test]
    fn integers_are_exact() {
        let column = crate::store::gather::row_numbers(100_001).unwrap();
        let found = summary(&column).unwrap();
        assert_eq!(found.range, Some((0.0, 100_000.0)));
        assert_eq!(found.sum, 5_000_050_000.0);
        let none = summary(&crate::store::gather::row_numbers(0).unwrap()).unwrap();
        assert_eq!((none.range, none.sum), (None, 0.0));
    }
}
