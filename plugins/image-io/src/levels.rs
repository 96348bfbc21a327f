//! The numbers that a file stores for the values of an image.

use crate::pixels::{Pixel, Pixels, Summary, each_type};
use puncta_sdk::prelude::*;

/// Type of the numbers in a file.
#[derive(Choice, Clone, Copy, Debug, PartialEq, Eq)]
pub enum NumberType {
    /// That of the image.
    Same,
    /// 32-bit floating point.
    Float,
    /// 16-bit whole numbers, unchanged where they fit, otherwise scaled.
    Uint16,
    /// 8-bit whole numbers, unchanged where they fit, otherwise scaled.
    Uint8,
    /// 32-bit whole numbers with a sign; refused where the values are others.
    Int32,
}

/// How values become the numbers of a file.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Levels {
    /// Type of the numbers.
    kind: NumberType,
    /// Value = first + second * number, where that is not the number itself.
    pub(crate) linear: Option<[f64; 2]>,
}

impl Levels {
    /// How to store an image of these values as `kind`. `range` is what scaling spreads over the
    /// whole range of whole numbers, by default the smallest and the largest value.
    pub(crate) fn new(
        kind: NumberType,
        values: &Summary,
        labels: bool,
        range: [Option<f64>; 2],
    ) -> Result<Levels, Failure> {
        let (low, high) = match kind {
            NumberType::Same | NumberType::Float => return Ok(Levels { kind, linear: None }),
            NumberType::Uint16 => (0.0, 65535.0),
            NumberType::Uint8 => (0.0, 255.0),
            NumberType::Int32 => (f64::from(i32::MIN), f64::from(i32::MAX)),
        };
        let fits = values.whole && values.min >= low && values.max <= high;
        let given = range[0].is_some() || range[1].is_some();
        if fits && !given {
            return Ok(Levels { kind, linear: None });
        }
        if labels || kind == NumberType::Int32 {
            let name = if kind == NumberType::Int32 {
                "32-bit"
            } else {
                "these"
            };
            let message = format!(
                "the values {} to {} are not all whole numbers that {name} integers hold",
                values.min, values.max
            );
            let failure = Failure::bad_parameter("pixel_type", message);
            return Err(failure.remedy("choose the pixel type same or float"));
        }
        let (min, max) = (
            range[0].unwrap_or(values.min),
            range[1].unwrap_or(values.max),
        );
        let sound = min.is_finite() && max.is_finite() && max >= min;
        if !sound {
            let message = format!("values from {min} to {max} cannot be scaled to whole numbers");
            let failure = Failure::bad_parameter("scale_min", message);
            return Err(
                failure.remedy("give scale_min below scale_max, or choose the pixel type float")
            );
        }
        let step = if max > min { (max - min) / high } else { 1.0 };
        Ok(Levels {
            kind,
            linear: Some([min, step]),
        })
    }

    /// Bits of a number of a file, and its TIFF sample format (1 unsigned, 2 signed, 3 float).
    pub(crate) fn format(&self, pixels: &Pixels<'_>) -> (u16, u16) {
        match self.kind {
            NumberType::Float => (32, 3),
            NumberType::Uint16 => (16, 1),
            NumberType::Uint8 => (8, 1),
            NumberType::Int32 => (32, 2),
            NumberType::Same => match pixels {
                Pixels::U8(_) => (8, 1),
                Pixels::U16(_) => (16, 1),
                Pixels::U32(_) => (32, 1),
                Pixels::I32(_) => (32, 2),
                Pixels::F32(_) => (32, 3),
                Pixels::F64(_) => (64, 3),
            },
        }
    }

    /// The number, before rounding, that stands for a value.
    pub(crate) fn number(&self, value: f64) -> f64 {
        match self.linear {
            Some([low, step]) => (value - low) / step,
            None => value,
        }
    }

    /// The bytes of the numbers in the order of this machine, replacing `out`. NaN becomes 0 in
    /// whole numbers.
    pub(crate) fn bytes(&self, pixels: &Pixels<'_>, out: &mut Vec<u8>) {
        out.clear();
        match (self.kind, pixels) {
            (NumberType::Same, Pixels::U8(v)) => out.extend_from_slice(v),
            (NumberType::Same, Pixels::U16(v)) => put(v, out, u16::to_ne_bytes),
            (NumberType::Same, Pixels::U32(v)) => put(v, out, u32::to_ne_bytes),
            (NumberType::Same, Pixels::I32(v)) => put(v, out, i32::to_ne_bytes),
            (NumberType::Same | NumberType::Float, Pixels::F32(v)) => put(v, out, f32::to_ne_bytes),
            (NumberType::Same, Pixels::F64(v)) => put(v, out, f64::to_ne_bytes),
            (NumberType::Float, _) => self.convert(pixels, out, |v| (v as f32).to_ne_bytes()),
            // Rounded: a cast of a float cuts off, saturates, and gives 0 for NaN.
            (NumberType::Uint16, _) => {
                self.convert(pixels, out, |v| ((v + 0.5) as u16).to_ne_bytes());
            }
            (NumberType::Uint8, _) => self.convert(pixels, out, |v| [(v + 0.5) as u8]),
            (NumberType::Int32, _) => self.convert(pixels, out, |v| (v as i32).to_ne_bytes()),
        }
    }

    fn convert<const N: usize>(
        &self,
        pixels: &Pixels<'_>,
        out: &mut Vec<u8>,
        write: impl Fn(f64) -> [u8; N] + Copy,
    ) {
        let [low, step] = self.linear.unwrap_or([0.0, 1.0]);
        each_type!(pixels, v => put(v, out, |v| write((v.wide() - low) / step)));
    }
}

fn put<T: Copy, const N: usize>(values: &[T], out: &mut Vec<u8>, write: impl Fn(T) -> [u8; N]) {
    out.resize(values.len() * N, 0);
    for (bytes, v) in out.as_chunks_mut::<N>().0.iter_mut().zip(values) {
        *bytes = write(*v);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use puncta_sdk::run::Serial;

    fn stored(pixels: &Pixels<'_>, kind: NumberType, range: [Option<f64>; 2]) -> (Levels, Vec<u8>) {
        let values = pixels.summary(&Serial).unwrap();
        let levels = Levels::new(kind, &values, false, range).unwrap();
        let mut out = vec![7; 3];
        levels.bytes(pixels, &mut out);
        (levels, out)
    }

    fn u16s(bytes: &[u8]) -> Vec<u16> {
        bytes
            .as_chunks::<2>()
            .0
            .iter()
            .map(|b| u16::from_ne_bytes(*b))
            .collect()
    }

    #[test]
    fn whole_counts_stay_as_they_are() {
        let pixels = Pixels::F32(&[0.0, 1.0, 65535.0]);
        let (levels, bytes) = stored(&pixels, NumberType::Uint16, [None; 2]);
        assert_eq!((levels.linear, u16s(&bytes)), (None, vec![0, 1, 65535]));
        let (levels, bytes) = stored(&Pixels::I32(&[0, 200]), NumberType::Uint8, [None; 2]);
        assert_eq!((levels.linear, bytes), (None, vec![0, 200]));
    }

    #[test]
    fn other_values_are_scaled_and_the_scale_is_known() {
        let values = [-1.5_f32, 0.0, 2.25, f32::NAN, 11.0];
        let (levels, bytes) = stored(&Pixels::F32(&values), NumberType::Uint16, [None; 2]);
        let [low, step] = levels.linear.unwrap();
        for (number, value) in u16s(&bytes)
            .into_iter()
            .zip(values)
            .filter(|(_, v)| !v.is_nan())
        {
            assert!((low + step * f64::from(number) - f64::from(value)).abs() <= step / 2.0);
        }
        assert_eq!(u16s(&bytes), [0, 7864, 19661, 0, 65535]);
        let range = [Some(0.0), Some(255.0)];
        let (levels, bytes) = stored(&Pixels::F32(&values), NumberType::Uint8, range);
        assert_eq!(
            (levels.linear, bytes),
            (Some([0.0, 1.0]), vec![0, 0, 2, 0, 11])
        );
        let (levels, bytes) = stored(&Pixels::F64(&[0.5; 3]), NumberType::Uint8, [None; 2]);
        assert_eq!((levels.linear, bytes), (Some([0.5, 1.0]), vec![0; 3]));
    }

    #[test]
    fn labels_are_never_scaled() {
        let values = Pixels::I32(&[0, 70_000]).summary(&Serial).unwrap();
        let refused = Levels::new(NumberType::Uint16, &values, true, [None; 2]).unwrap_err();
        assert!(refused.to_string().contains("0 to 70000"), "{refused}");
        let values = Pixels::F32(&[0.5]).summary(&Serial).unwrap();
        assert!(Levels::new(NumberType::Int32, &values, false, [None; 2]).is_err());
        let values = Pixels::F32(&[f32::NAN]).summary(&Serial).unwrap();
        assert!(Levels::new(NumberType::Uint8, &values, false, [None; 2]).is_err());
        let values = Pixels::F32(&[0.5]).summary(&Serial).unwrap();
        let upside_down = [Some(3.0), Some(1.0)];
        assert!(Levels::new(NumberType::Uint8, &values, false, upside_down).is_err());
    }
}
