//! Where the values of a field go.

use crate::encoding;
use crate::number::{self, Decimal, Number};
use crate::rows::Problem;
use crate::schema::{ColumnPlan, Kind};

/// The part of a column that one piece of the file fills.
#[derive(Debug)]
pub enum Part<'a> {
    /// Values that no column takes.
    Skip,
    /// Most columns.
    F64(&'a mut [f64]),
    /// Frames and indices.
    I32(&'a mut [i32]),
    /// Large integers.
    I64(&'a mut [i64]),
    /// Other types of our own files.
    F32(&'a mut [f32]),
    /// Sixteen bits.
    I16(&'a mut [i16]),
    /// Eight bits.
    I8(&'a mut [i8]),
    /// Unsigned.
    U64(&'a mut [u64]),
    /// Unsigned.
    U32(&'a mut [u32]),
    /// Unsigned.
    U16(&'a mut [u16]),
    /// Unsigned, or a truth value.
    U8(&'a mut [u8]),
    /// Words, put behind those of the earlier pieces later.
    Text(crate::columns::Words),
}

/// Where the values of one field of a row go, and what is done to them.
#[derive(Debug)]
pub struct Sink<'a> {
    /// The room.
    pub part: Part<'a>,
    /// Values are taken times 10^shift,
    pub shift: i32,
    /// times this,
    pub factor: f64,
    /// minus this.
    pub base: i32,
    /// A value below the base contradicts it.
    pub base_guessed: bool,
    /// `factor` and `base` change nothing.
    pub plain: bool,
    /// The type is not to be changed.
    pub settled: bool,
}

impl<'a> Sink<'a> {
    /// A sink for values that no column takes.
    pub fn skip() -> Sink<'a> {
        Sink {
            part: Part::Skip,
            shift: 0,
            factor: 1.0,
            base: 0,
            base_guessed: false,
            plain: true,
            settled: true,
        }
    }

    /// A sink for the values of a column.
    pub fn new(part: Part<'a>, column: &ColumnPlan) -> Sink<'a> {
        Sink {
            part,
            shift: column.shift,
            factor: column.factor,
            base: column.base,
            base_guessed: column.base_guessed,
            plain: column.factor == 1.0 && column.base == 0,
            settled: column.settled,
        }
    }
}

impl Part<'_> {
    /// Takes the values of another part of the same type and length.
    pub fn copy_from(&mut self, other: &Part<'_>) {
        match (self, other) {
            (Part::F64(to), Part::F64(from)) if to.len() == from.len() => to.copy_from_slice(from),
            (Part::I32(to), Part::I32(from)) if to.len() == from.len() => to.copy_from_slice(from),
            (Part::I64(to), Part::I64(from)) if to.len() == from.len() => to.copy_from_slice(from),
            _ => {}
        }
    }
}

/// Puts an integer into a slot, if it fits.
fn store<T: TryFrom<i64>>(slots: &mut [T], row: usize, value: i64) -> bool {
    match (slots.get_mut(row), T::try_from(value)) {
        (Some(slot), Ok(value)) => {
            *slot = value;
            true
        }
        _ => false,
    }
}

impl Sink<'_> {
    /// Takes the common cases; `false` means only that [`Sink::take`] must look.
    #[inline(always)]
    pub fn put(&mut self, row: usize, decimal: Decimal) -> bool {
        match &mut self.part {
            Part::Skip => true,
            Part::F64(slots) => {
                let value = match decimal.exact(self.shift) {
                    Some(value) => value,
                    // Large integers may need another type.
                    None if decimal.exponent == 0 => return false,
                    None => number::value(decimal, self.shift),
                };
                let Some(slot) = slots.get_mut(row) else {
                    return false;
                };
                *slot = value;
                if !self.plain {
                    *slot = value * self.factor - f64::from(self.base);
                    return !self.base_guessed || *slot >= 0.0;
                }
                true
            }
            Part::I32(slots) => match decimal.whole() {
                Some(value) if value >= i64::from(self.base) || !self.base_guessed => {
                    store(slots, row, value.wrapping_sub(i64::from(self.base)))
                }
                _ => false,
            },
            _ => false,
        }
    }

    /// Takes any value.
    pub fn take(&mut self, row: usize, text: &[u8], point: u8) -> Result<(), Problem> {
        match &mut self.part {
            Part::Skip => return Ok(()),
            Part::Text(words) => {
                words.push(&encoding::text(text));
                return Ok(());
            }
            _ => {}
        }
        let Some(number) = number::general(text, point, self.shift) else {
            return Err(Problem::NotNumber(text.to_vec()));
        };
        if matches!(self.part, Part::F64(_) | Part::F32(_)) {
            self.take_float(row, number, text)
        } else {
            self.take_integer(row, number, text)
        }
    }

    fn take_float(&mut self, row: usize, number: Number, text: &[u8]) -> Result<(), Problem> {
        let value = match number {
            Number::Decimal(decimal) => {
                let large = decimal.exponent == 0 && decimal.mantissa > 1 << 53;
                if large && self.plain && self.shift == 0 && !self.settled {
                    let lost = decimal.mantissa as f64 as u128 != u128::from(decimal.mantissa);
                    if lost && decimal.whole().is_some() {
                        return Err(Problem::Needs(Kind::I64));
                    }
                }
                number::value(decimal, self.shift)
            }
            Number::Long(value) | Number::Special(value) => value,
        };
        let value = if self.plain {
            value
        } else {
            value * self.factor - f64::from(self.base)
        };
        if self.base_guessed && value < 0.0 {
            return Err(Problem::FrameZero);
        }
        match &mut self.part {
            Part::F64(slots) => slots.get_mut(row).map(|slot| *slot = value),
            Part::F32(slots) => slots.get_mut(row).map(|slot| *slot = single(text, value)),
            _ => None,
        };
        Ok(())
    }

    fn take_integer(&mut self, row: usize, number: Number, text: &[u8]) -> Result<(), Problem> {
        let base = i64::from(self.base);
        let whole = match number {
            Number::Decimal(decimal) => decimal.whole(),
            _ => None,
        };
        if whole.is_some_and(|v| self.base_guessed && v < base) {
            return Err(Problem::FrameZero);
        }
        let value = whole.and_then(|v| v.checked_sub(base));
        let stored = match (&mut self.part, value) {
            (Part::I32(s), Some(v)) => store(s, row, v),
            (Part::I64(s), Some(v)) => store(s, row, v),
            (Part::I16(s), Some(v)) => store(s, row, v),
            (Part::I8(s), Some(v)) => store(s, row, v),
            (Part::U32(s), Some(v)) => store(s, row, v),
            (Part::U16(s), Some(v)) => store(s, row, v),
            (Part::U8(s), Some(v)) => store(s, row, v),
            (Part::U64(s), _) => unsigned(s, row, text),
            _ => false,
        };
        match (stored, &self.part, value) {
            (true, ..) => Ok(()),
            (false, Part::I32(_), Some(_)) if !self.settled => Err(Problem::Needs(Kind::I64)),
            (false, Part::I32(_) | Part::I64(_), _) if !self.settled => {
                Err(Problem::Needs(Kind::F64))
            }
            _ => Err(Problem::Misfit(text.to_vec())),
        }
    }
}

/// The nearest f32 of the text itself, so that a value is not rounded twice.
fn single(text: &[u8], value: f64) -> f32 {
    std::str::from_utf8(text)
        .ok()
        .and_then(|t| t.parse().ok())
        .unwrap_or(value as f32)
}

fn unsigned(slots: &mut [u64], row: usize, text: &[u8]) -> bool {
    let value = std::str::from_utf8(text).ok().and_then(|t| t.parse().ok());
    match (slots.get_mut(row), value) {
        (Some(slot), Some(value)) => {
            *slot = value;
            true
        }
        _ => false,
    }
}
