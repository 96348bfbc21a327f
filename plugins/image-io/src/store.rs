//! Numbers of a file into the one column of an image.

use puncta_sdk::output::ColumnMut;
use puncta_sdk::{Element, Failure};

/// The type of the numbers in a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Stored {
    U8,
    I8,
    U16,
    I16,
    U32,
    I32,
    U64,
    I64,
    F16,
    F32,
    F64,
}

impl Stored {
    pub(crate) fn size(self) -> usize {
        match self {
            Stored::U8 | Stored::I8 => 1,
            Stored::U16 | Stored::I16 | Stored::F16 => 2,
            Stored::U32 | Stored::I32 | Stored::F32 => 4,
            Stored::U64 | Stored::I64 | Stored::F64 => 8,
        }
    }

    /// The type of an image that holds all its numbers; those of 64 bits become f64.
    pub(crate) fn element(self) -> Element {
        match self {
            Stored::U8 => Element::U8,
            Stored::U16 => Element::U16,
            Stored::I8 | Stored::I16 | Stored::I32 => Element::I32,
            Stored::U32 => Element::U32,
            Stored::F16 | Stored::F32 => Element::F32,
            Stored::U64 | Stored::I64 | Stored::F64 => Element::F64,
        }
    }

    /// Number `at` of the bytes as f64.
    fn number(self, bytes: &[u8], at: usize, big: bool) -> f64 {
        macro_rules! take {
            ($type:ty) => {{
                let size = size_of::<$type>();
                let bytes = bytes.get(at * size..(at + 1) * size);
                let bytes = bytes.and_then(|b| b.try_into().ok()).unwrap_or_default();
                if big {
                    <$type>::from_be_bytes(bytes)
                } else {
                    <$type>::from_le_bytes(bytes)
                }
            }};
        }
        match self {
            Stored::U8 => f64::from(take!(u8)),
            Stored::I8 => f64::from(take!(i8)),
            Stored::U16 => f64::from(take!(u16)),
            Stored::I16 => f64::from(take!(i16)),
            Stored::U32 => f64::from(take!(u32)),
            Stored::I32 => f64::from(take!(i32)),
            Stored::U64 => take!(u64) as f64,
            Stored::I64 => take!(i64) as f64,
            Stored::F16 => half(take!(u16)),
            Stored::F32 => f64::from(take!(f32)),
            Stored::F64 => take!(f64),
        }
    }
}

/// A number of 16 bits.
pub(crate) fn half(bits: u16) -> f64 {
    let (exponent, fraction) = (i32::from(bits >> 10 & 31), f64::from(bits & 1023));
    let size = match exponent {
        31 if fraction == 0.0 => f64::INFINITY,
        31 => f64::NAN,
        0 => fraction * 2f64.powi(-24),
        _ => (1.0 + fraction / 1024.0) * 2f64.powi(exponent - 15),
    };
    if bits >> 15 == 1 { -size } else { size }
}

/// Numbers of a file: bytes as stored.
#[derive(Clone, Copy)]
pub(crate) struct Numbers<'a> {
    pub(crate) bytes: &'a [u8],
    pub(crate) stored: Stored,
    pub(crate) big_endian: bool,
    /// Every so many numbers, from this one on.
    pub(crate) step: usize,
    pub(crate) first: usize,
    /// Value = first + second x number.
    pub(crate) linear: Option<[f64; 2]>,
}

impl Numbers<'_> {
    /// Puts `count` values into the column from `at` on.
    ///
    /// # Errors
    /// An image that has no room for them.
    pub(crate) fn put(
        &self,
        out: &mut ColumnMut<'_>,
        at: usize,
        count: usize,
    ) -> Result<(), Failure> {
        let room = || Failure::internal("the image has no room for its numbers");
        let value = |k: usize| {
            let number =
                self.stored
                    .number(self.bytes, self.first + k * self.step, self.big_endian);
            self.linear
                .map_or(number, |[offset, step]| offset + step * number)
        };
        macro_rules! fill {
            ($out:expr, $type:ty) => {{
                let part = $out.get_mut(at..at + count).ok_or_else(room)?;
                for (k, place) in part.iter_mut().enumerate() {
                    *place = value(k) as $type;
                }
            }};
        }
        match out {
            ColumnMut::U8(out) => fill!(out, u8),
            ColumnMut::U16(out) => fill!(out, u16),
            ColumnMut::I32(out) => fill!(out, i32),
            ColumnMut::U32(out) => fill!(out, u32),
            ColumnMut::F32(out) => fill!(out, f32),
            ColumnMut::F64(out) => fill!(out, f64),
            _ => return Err(Failure::internal("an image of an unplanned type")),
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_of_every_type() {
        assert_eq!(half(0x3c00), 1.0);
        assert_eq!(half(0xc500), -5.0);
        assert_eq!(half(0x0001), 2f64.powi(-24));
        assert!(half(0x7e00).is_nan() && half(0xfc00) == f64::NEG_INFINITY);
        assert_eq!(Stored::I16.number(&[0xff, 0xfe], 0, true), -2.0);
        assert_eq!(Stored::U16.number(&[9, 9, 1, 2], 1, false), 513.0);
        let mut values = [0.0_f64; 2];
        let numbers = Numbers {
            bytes: &[1, 2, 3, 4],
            stored: Stored::U8,
            big_endian: false,
            step: 2,
            first: 1,
            linear: Some([10.0, 0.5]),
        };
        numbers.put(&mut ColumnMut::F64(&mut values), 0, 2).unwrap();
        assert_eq!(values, [11.0, 12.0]);
        assert!(numbers.put(&mut ColumnMut::F64(&mut values), 1, 2).is_err());
    }
}
