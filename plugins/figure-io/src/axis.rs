//! Axes: ranges, ticks and their labels.

/// Numbers beyond this cannot be drawn and count as missing.
const LARGEST: f64 = 1e300;
/// Smaller numbers cannot be drawn on a logarithmic axis, and are zero on a linear one.
const SMALLEST: f64 = 1e-300;

/// A tick: where, and what stands there.
#[derive(Clone, Debug, PartialEq)]
pub struct Tick {
    /// Value.
    pub value: f64,
    /// Label; empty for small ticks.
    pub label: String,
}

/// An axis from `low` to `high`, which differ.
#[derive(Clone, Debug, PartialEq)]
pub struct Axis {
    /// Value at its beginning.
    pub low: f64,
    /// Value at its end.
    pub high: f64,
    /// Logarithmic.
    pub log: bool,
    /// Labels are in units of this power of ten.
    pub exponent: i32,
    /// Ticks.
    pub ticks: Vec<Tick>,
}

/// Smallest and largest of the values that can be drawn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Range {
    /// Smallest.
    pub low: f64,
    /// Largest.
    pub high: f64,
}

impl Range {
    /// Nothing yet.
    pub const EMPTY: Range = Range {
        low: f64::INFINITY,
        high: f64::NEG_INFINITY,
    };

    /// Takes in a value, if it can be drawn.
    pub fn add(&mut self, value: f64, log: bool) {
        if drawable(value, log) {
            self.low = self.low.min(value);
            self.high = self.high.max(value);
        }
    }

    /// Whether nothing was taken in.
    pub fn is_empty(&self) -> bool {
        self.low > self.high
    }
}

/// Whether an axis can show a value.
pub fn drawable(value: f64, log: bool) -> bool {
    value.is_finite() && value.abs() <= LARGEST && (!log || value >= SMALLEST)
}

impl Axis {
    /// An axis for a range of values, which is widened by `padding` of its length on each side.
    /// `zero`: it begins at zero when the values lie above and near it, and nothing is added there.
    /// `room` is the number of labels that there is room for.
    pub fn new(range: Range, log: bool, padding: f64, zero: bool, room: usize) -> Axis {
        let room = room.max(2);
        if log {
            logarithmic(range, padding, room)
        } else {
            linear(range, padding, zero, room)
        }
    }

    /// Place of a value along the axis, 0 to 1.
    pub fn place(&self, value: f64) -> f64 {
        let to = |v: f64| if self.log { v.log10() } else { v };
        (to(value) - to(self.low)) / (to(self.high) - to(self.low))
    }
}

fn linear(range: Range, padding: f64, zero: bool, room: usize) -> Axis {
    let Range { mut low, mut high } = range;
    if range.is_empty() {
        (low, high) = (0.0, 1.0);
    }
    let from_zero = zero && low >= 0.0 && low <= 0.5 * high;
    let to_zero = zero && high <= 0.0 && high >= 0.5 * low;
    // Narrower than this the numbers have no digits left.
    let least = (1e-9 * low.abs().max(high.abs())).max(SMALLEST);
    if high - low <= least {
        let by = if low.abs() < SMALLEST {
            1.0
        } else {
            0.1 * low.abs()
        };
        (low, high) = (low - by, high + by);
    } else {
        let by = padding * (high - low);
        (low, high) = (low - by, high + by);
    }
    if from_zero && high > 0.0 {
        low = 0.0;
    }
    if to_zero && low < 0.0 {
        high = 0.0;
    }
    let step = nice_step((high - low) / room as f64);
    let largest = low.abs().max(high.abs());
    let order = largest.log10().floor() as i32;
    let exponent = if (-3..6).contains(&order) { 0 } else { order };
    let first = (low / step - 1e-9).ceil();
    let count = ((high / step + 1e-9).floor() - first).max(0.0) as usize + 1;
    let shown_step = step / 10_f64.powi(exponent);
    // The step has one digit, or two for 2.5.
    let decimals = (0..15).find(|d| {
        let scaled = shown_step * 10_f64.powi(*d);
        (scaled - scaled.round()).abs() < 1e-6 * scaled
    });
    let ticks = (0..count.min(64)).map(|i| {
        let value = (first + i as f64) * step;
        Tick {
            value,
            label: label(
                value / 10_f64.powi(exponent),
                decimals.unwrap_or(0) as usize,
            ),
        }
    });
    Axis {
        low,
        high,
        log: false,
        exponent,
        ticks: ticks.collect(),
    }
}

/// 1, 2, 2.5 or 5 times a power of ten, not below `least`.
fn nice_step(least: f64) -> f64 {
    let power = 10_f64.powf(least.log10().floor());
    let found = [1.0, 2.0, 2.5, 5.0, 10.0]
        .into_iter()
        .find(|f| f * power >= least * (1.0 - 1e-9));
    found.unwrap_or(10.0) * power
}

/// A number with thousands apart and a true minus.
fn label(value: f64, decimals: usize) -> String {
    let text = format!("{:.decimals$}", value.abs());
    let (whole, fraction) = text.split_once('.').unwrap_or((&text, ""));
    let zero = text.chars().all(|c| matches!(c, '0' | '.'));
    let mut out = String::from(if value < 0.0 && !zero { "\u{2212}" } else { "" });
    for (i, digit) in whole.chars().enumerate() {
        if i > 0 && whole.len() > 4 && (whole.len() - i).is_multiple_of(3) {
            out.push('\u{a0}');
        }
        out.push(digit);
    }
    if !fraction.is_empty() {
        out.push('.');
        out.push_str(fraction);
    }
    out
}

fn logarithmic(range: Range, padding: f64, room: usize) -> Axis {
    let (mut low, mut high) = (0.1, 10.0);
    if !range.is_empty() {
        (low, high) = (range.low.log10(), range.high.log10());
        let by = if high - low < 0.05 {
            0.5
        } else {
            padding * (high - low)
        };
        let power = |exponent: f64| 10_f64.powf(exponent.clamp(-305.0, 305.0));
        (low, high) = (power(low - by), power(high + by));
    }
    let (first, last) = (low.log10().floor() as i32, high.log10().ceil() as i32);
    let decades = high.log10() - low.log10();
    let every = (decades / room as f64).ceil().max(1.0) as i32;
    // Labels between the decades where there are few.
    let also: &[i32] = match decades {
        d if d < 0.7 => &[1, 2, 3, 4, 5, 6, 7, 8, 9],
        d if d < 1.7 => &[1, 2, 5],
        _ => &[1],
    };
    let plain = first >= -3 && last <= 5;
    let mut ticks = Vec::new();
    for decade in first..=last {
        for digit in 1..10 {
            let value = f64::from(digit) * 10_f64.powi(decade);
            if value < low * (1.0 - 1e-9) || value > high * (1.0 + 1e-9) || (every > 1 && digit > 1)
            {
                continue;
            }
            let shown = also.contains(&digit) && decade.rem_euclid(every) == 0;
            let text = match (shown, plain) {
                (false, _) => String::new(),
                (true, true) => label(value, decade.min(0).unsigned_abs() as usize),
                (true, false) if digit == 1 => format!("10^{decade}"),
                (true, false) => format!("{digit}\u{d7}10^{decade}"),
            };
            ticks.push(Tick { value, label: text });
        }
    }
    Axis {
        low,
        high,
        log: true,
        exponent: 0,
        ticks,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn labels(axis: &Axis) -> Vec<&str> {
        axis.ticks
            .iter()
            .map(|tick| tick.label.as_str())
            .filter(|label| !label.is_empty())
            .collect()
    }

    #[test]
    fn steps_are_round_and_within() {
        let axis = Axis::new(
            Range {
                low: 0.03,
                high: 0.97,
            },
            false,
            0.05,
            true,
            6,
        );
        assert_eq!(axis.low, 0.0);
        assert_eq!(labels(&axis), ["0.0", "0.2", "0.4", "0.6", "0.8", "1.0"]);
        for (low, high) in [
            (-3.0, 5.5),
            (1e-7, 3e-7),
            (-4e12, 5e11),
            (1e7, 1e7 + 0.01),
            (-1e300, 1e300),
        ] {
            let axis = Axis::new(Range { low, high }, false, 0.0, false, 6);
            assert!(axis.low <= low && axis.high >= high);
            let count = axis.ticks.len();
            assert!((2..=9).contains(&count), "{low} {high} {count}");
            let mut all = labels(&axis);
            all.dedup();
            assert_eq!(all.len(), count, "{axis:?}");
            for tick in &axis.ticks {
                assert!((-1e-6..=1.0 + 1e-6).contains(&axis.place(tick.value)));
            }
        }
    }

    #[test]
    fn ranges_of_nothing_or_of_one_value_have_an_axis() {
        for range in [
            Range::EMPTY,
            Range {
                low: 0.0,
                high: 0.0,
            },
            Range {
                low: 7.0,
                high: 7.0,
            },
        ] {
            for log in [false, true] {
                if log && range.low == 0.0 {
                    continue;
                }
                let axis = Axis::new(range, log, 0.05, true, 5);
                assert!(axis.low < axis.high && axis.ticks.len() >= 2, "{axis:?}");
                assert!(range.is_empty() || (0.0..=1.0).contains(&axis.place(range.low)));
            }
        }
    }

    #[test]
    fn labels_are_readable() {
        assert_eq!(label(-12_345.5, 1), "\u{2212}12\u{a0}345.5");
        assert_eq!(label(-0.001, 1), "0.0");
        assert_eq!(label(1000.0, 0), "1000");
        let axis = Axis::new(
            Range {
                low: 0.0,
                high: 3e7,
            },
            false,
            0.0,
            true,
            4,
        );
        assert_eq!(
            (axis.exponent, labels(&axis)),
            (7, vec!["0", "1", "2", "3"])
        );
    }

    #[test]
    fn decades_are_ticks() {
        let axis = Axis::new(
            Range {
                low: 1.0,
                high: 1000.0,
            },
            true,
            0.0,
            false,
            6,
        );
        assert_eq!(labels(&axis), ["1", "10", "100", "1000"]);
        assert_eq!(axis.ticks.len(), 28);
        let axis = Axis::new(
            Range {
                low: 1e-12,
                high: 1e12,
            },
            true,
            0.0,
            false,
            6,
        );
        assert!(labels(&axis).len() <= 8 && labels(&axis).contains(&"10^0"));
        assert!((axis.place(1.0) - 0.5).abs() < 1e-12);
    }
}
