//! Numbers as files store them.

use puncta_sdk::Element;

/// Kinds of stored number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[allow(missing_docs)]
pub enum Number {
    U8,
    I8,
    U16,
    I16,
    U32,
    I32,
    U64,
    I64,
    /// Becomes f32.
    F16,
    F32,
    F64,
    /// One byte, anything but 0 is true.
    Bool,
}

/// A stored number with its byte order.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Stored {
    /// Kind.
    pub number: Number,
    /// Whether the most significant byte comes first.
    pub big_endian: bool,
}

impl Number {
    /// Bytes of one.
    #[must_use]
    pub fn bytes(self) -> usize {
        match self {
            Number::U8 | Number::I8 | Number::Bool => 1,
            Number::U16 | Number::I16 | Number::F16 => 2,
            Number::U32 | Number::I32 | Number::F32 => 4,
            Number::U64 | Number::I64 | Number::F64 => 8,
        }
    }

    /// The type of a column that keeps it as it is.
    #[must_use]
    pub fn element(self) -> Element {
        match self {
            Number::U8 => Element::U8,
            Number::I8 => Element::I8,
            Number::U16 => Element::U16,
            Number::I16 => Element::I16,
            Number::U32 => Element::U32,
            Number::I32 => Element::I32,
            Number::U64 => Element::U64,
            Number::I64 => Element::I64,
            Number::F16 | Number::F32 => Element::F32,
            Number::F64 => Element::F64,
            Number::Bool => Element::Bool,
        }
    }

    /// Little-endian.
    #[must_use]
    pub fn little(self) -> Stored {
        Stored {
            number: self,
            big_endian: false,
        }
    }

    /// The number with a name such as `float32`, `uint8` or `double`.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Number> {
        Some(match name {
            "uint8" | "u8" => Number::U8,
            "int8" | "i8" => Number::I8,
            "uint16" | "u16" => Number::U16,
            "int16" | "i16" => Number::I16,
            "uint32" | "u32" => Number::U32,
            "int32" | "i32" => Number::I32,
            "uint64" | "u64" => Number::U64,
            "int64" | "i64" => Number::I64,
            "float16" | "f16" => Number::F16,
            "float32" | "single" | "f32" => Number::F32,
            "float64" | "double" | "f64" => Number::F64,
            "bool8" | "bool" => Number::Bool,
            _ => return None,
        })
    }
}

/// IEEE 754 binary16 as f32, exactly.
#[must_use]
pub fn half(bits: u16) -> f32 {
    let (sign, exponent, fraction) = (bits >> 15, (bits >> 10) & 0x1f, bits & 0x3ff);
    let size = match exponent {
        0 => f32::from(fraction) / 16_777_216.0,
        31 if fraction == 0 => f32::INFINITY,
        31 => f32::NAN,
        _ => {
            let scale = f32::from_bits((u32::from(exponent) + 112) << 23);
            scale * (1.0 + f32::from(fraction) / 1024.0)
        }
    };
    if sign == 1 { -size } else { size }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn half_precision_is_that_of_the_standard() {
        for (bits, value) in [
            (0x0000, 0.0),
            (0x0001, 5.960_464_5e-8),
            (0x3c00, 1.0),
            (0x3555, 0.333_251_95),
            (0xc000, -2.0),
            (0x7bff, 65_504.0),
            (0xfc00, f32::NEG_INFINITY),
        ] {
            assert_eq!(half(bits), value, "{bits:x}");
        }
        assert!(half(0x7e00).is_nan());
    }
}
