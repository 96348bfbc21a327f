//! Splits stored records into columns.
//!
//! A block is either whole records one after another, or byte planes (what HDF5's shuffle filter
//! stores: byte 0 of all records, then byte 1 of all, ...). Planes are taken apart directly, which
//! saves the pass that puts the records together again.

use crate::column::PartRows;
use crate::record::{Leaf, LeafType, Number};

/// Stored rows in memory.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Block<'a> {
    /// Records of `record` bytes.
    Records { bytes: &'a [u8], record: usize },
    /// Byte plane `k` is `bytes[k * rows..(k + 1) * rows]`.
    Planes { bytes: &'a [u8], rows: usize },
}

/// Calls `convert` on the `N` bytes at `offset` of each row, from the block's first row on.
fn gather<const N: usize, U>(
    block: Block<'_>,
    offset: usize,
    out: &mut [U],
    convert: impl Fn([u8; N]) -> U,
) {
    match block {
        Block::Records { bytes, record } => {
            for (value, row) in out.iter_mut().zip(bytes.chunks_exact(record.max(1))) {
                if let Some(field) = row.get(offset..).and_then(|rest| rest.first_chunk::<N>()) {
                    *value = convert(*field);
                }
            }
        }
        Block::Planes { bytes, rows } => {
            let count = out.len().min(rows);
            let planes: [&[u8]; N] = std::array::from_fn(|k| {
                let start = (offset + k) * rows;
                bytes.get(start..start + count).unwrap_or_default()
            });
            if planes.iter().any(|plane| plane.len() != count) {
                return;
            }
            let planes = planes.map(|plane| &plane[..count]);
            for (i, value) in out[..count].iter_mut().enumerate() {
                *value = convert(std::array::from_fn(|k| planes[k][i]));
            }
        }
    }
}

/// IEEE half precision to single; exact.
fn half_to_single(bits: u16) -> f32 {
    let sign = if bits & 0x8000 == 0 { 1.0 } else { -1.0 };
    let exponent = i32::from(bits >> 10 & 0x1f);
    let fraction = f32::from(bits & 0x3ff);
    sign * match exponent {
        0 => fraction * 2f32.powi(-24),
        31 if fraction == 0.0 => f32::INFINITY,
        31 => f32::NAN,
        _ => (1.0 + fraction / 1024.0) * 2f32.powi(exponent - 15),
    }
}

/// Expands to a `gather` of one stored number type with either byte order.
macro_rules! numbers {
    ($block:expr, $at:expr, $big:expr, $out:expr, $type:ty, $convert:expr) => {
        if $big {
            gather($block, $at, $out, |bytes| {
                $convert(<$type>::from_be_bytes(bytes))
            })
        } else {
            gather($block, $at, $out, |bytes| {
                $convert(<$type>::from_le_bytes(bytes))
            })
        }
    };
}

/// Fills `out` with the field's values as `f64`.
pub(crate) fn fill_f64(
    block: Block<'_>,
    offset: usize,
    number: Number,
    big: bool,
    factor: f64,
    out: &mut [f64],
) {
    match number {
        Number::U8 => numbers!(block, offset, big, out, u8, |v| f64::from(v) * factor),
        Number::I8 => numbers!(block, offset, big, out, i8, |v| f64::from(v) * factor),
        Number::U16 => numbers!(block, offset, big, out, u16, |v| f64::from(v) * factor),
        Number::I16 => numbers!(block, offset, big, out, i16, |v| f64::from(v) * factor),
        Number::U32 => numbers!(block, offset, big, out, u32, |v| f64::from(v) * factor),
        Number::I32 => numbers!(block, offset, big, out, i32, |v| f64::from(v) * factor),
        Number::U64 => numbers!(block, offset, big, out, u64, |v| v as f64 * factor),
        Number::I64 => numbers!(block, offset, big, out, i64, |v| v as f64 * factor),
        Number::F16 => {
            numbers!(block, offset, big, out, u16, |v| f64::from(half_to_single(
                v
            )) * factor)
        }
        Number::F32 => numbers!(block, offset, big, out, f32, |v| f64::from(v) * factor),
        Number::F64 => numbers!(block, offset, big, out, f64, |v| v * factor),
        Number::Bool => {
            numbers!(block, offset, big, out, u8, |v| f64::from(u8::from(v != 0))
                * factor)
        }
    }
}

/// Fills the rows of one column. A type that does not match the field leaves them as they are;
/// the reader checks that before.
pub(crate) fn fill(block: Block<'_>, leaf: &Leaf, factor: Option<f64>, out: PartRows<'_>) {
    let at = leaf.offset;
    let (number, big) = match leaf.stored {
        LeafType::Number { number, big_endian } => (number, big_endian),
        LeafType::Text { size } => {
            if let PartRows::Utf8(texts, count) = out {
                fill_text(block, at, size, count, |text| texts.push(text));
            }
            return;
        }
    };
    match (number, out) {
        (_, PartRows::F64(out)) => fill_f64(block, at, number, big, factor.unwrap_or(1.0), out),
        (Number::U8, PartRows::U8(out)) => numbers!(block, at, big, out, u8, |v| v),
        (Number::I8, PartRows::I8(out)) => numbers!(block, at, big, out, i8, |v| v),
        (Number::U16, PartRows::U16(out)) => numbers!(block, at, big, out, u16, |v| v),
        (Number::I16, PartRows::I16(out)) => numbers!(block, at, big, out, i16, |v| v),
        (Number::U32, PartRows::U32(out)) => numbers!(block, at, big, out, u32, |v| v),
        (Number::I32, PartRows::I32(out)) => numbers!(block, at, big, out, i32, |v| v),
        (Number::U64, PartRows::U64(out)) => numbers!(block, at, big, out, u64, |v| v),
        (Number::I64, PartRows::I64(out)) => numbers!(block, at, big, out, i64, |v| v),
        (Number::F32, PartRows::F32(out)) => numbers!(block, at, big, out, f32, |v| v),
        (Number::F16, PartRows::F32(out)) => numbers!(block, at, big, out, u16, half_to_single),
        (Number::Bool, PartRows::Bool(out)) => {
            numbers!(block, at, big, out, u8, |v| u8::from(v != 0));
        }
        _ => {}
    }
}

/// Fills sort keys: integers as they are, floating-point numbers by their total order.
pub(crate) fn fill_keys(block: Block<'_>, leaf: &Leaf, out: &mut [i64]) {
    let at = leaf.offset;
    let LeafType::Number {
        number,
        big_endian: big,
    } = leaf.stored
    else {
        return;
    };
    let order = |v: f64| {
        let bits = v.to_bits() as i64;
        bits ^ (((bits >> 63) as u64) >> 1) as i64
    };
    match number {
        Number::U8 | Number::Bool => numbers!(block, at, big, out, u8, i64::from),
        Number::I8 => numbers!(block, at, big, out, i8, i64::from),
        Number::U16 => numbers!(block, at, big, out, u16, i64::from),
        Number::I16 => numbers!(block, at, big, out, i16, i64::from),
        Number::U32 => numbers!(block, at, big, out, u32, i64::from),
        Number::I32 => numbers!(block, at, big, out, i32, i64::from),
        Number::U64 => numbers!(block, at, big, out, u64, |v| i64::try_from(v)
            .unwrap_or(i64::MAX)),
        Number::I64 => numbers!(block, at, big, out, i64, |v| v),
        Number::F16 => {
            numbers!(block, at, big, out, u16, |v| order(f64::from(
                half_to_single(v)
            )))
        }
        Number::F32 => numbers!(block, at, big, out, f32, |v| order(f64::from(v))),
        Number::F64 => numbers!(block, at, big, out, f64, order),
    }
}

fn fill_text(
    block: Block<'_>,
    offset: usize,
    size: usize,
    count: usize,
    mut push: impl FnMut(&str),
) {
    let mut field = Vec::with_capacity(size);
    for row in 0..count {
        field.clear();
        match block {
            Block::Records { bytes, record } => {
                let start = row * record + offset;
                field.extend_from_slice(bytes.get(start..start + size).unwrap_or_default());
            }
            Block::Planes { bytes, rows } => {
                field.extend((offset..offset + size).filter_map(|k| bytes.get(k * rows + row)));
            }
        }
        push(&text(&field));
    }
}

/// Stored text up to its first NUL; bytes that are not UTF-8 become U+FFFD.
pub(crate) fn text(bytes: &[u8]) -> String {
    let end = bytes.iter().position(|&b| b == 0).unwrap_or(bytes.len());
    String::from_utf8_lossy(&bytes[..end]).into_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shuffled(records: &[u8], record: usize) -> Vec<u8> {
        let rows = records.len() / record;
        (0..records.len())
            .map(|i| records[i % rows * record + i / rows])
            .collect()
    }

    #[test]
    fn planes_and_records_give_the_same_columns() {
        let record = 7;
        let bytes: Vec<u8> = (0..70_u8).map(|i| i.wrapping_mul(37)).collect();
        let planes = shuffled(&bytes, record);
        let blocks = [
            Block::Records {
                bytes: &bytes,
                record,
            },
            Block::Planes {
                bytes: &planes,
                rows: 10,
            },
        ];
        let stored = LeafType::Number {
            number: Number::I32,
            big_endian: true,
        };
        let leaf = Leaf {
            name: "v".into(),
            offset: 2,
            stored,
        };
        let columns = blocks.map(|block| {
            let mut out = [0_i32; 10];
            fill(block, &leaf, None, PartRows::I32(&mut out));
            out
        });
        assert_eq!(columns[0], columns[1]);
        assert_eq!(
            columns[0][1],
            i32::from_be_bytes([bytes[9], bytes[10], bytes[11], bytes[12]])
        );
    }

    #[test]
    fn half_precision_is_exact() {
        let cases = [
            (0x3c00, 1.0),
            (0xc000, -2.0),
            (0x7bff, 65504.0),
            (0x0001, 2f32.powi(-24)),
        ];
        for (bits, value) in cases {
            assert_eq!(half_to_single(bits), value);
        }
        assert!(half_to_single(0x7e00).is_nan());
        assert_eq!(half_to_single(0xfc00), f32::NEG_INFINITY);
    }

    #[test]
    fn keys_of_floats_follow_their_order() {
        let values = [f32::NEG_INFINITY, -3.0, -0.5, 0.0, 1e-9, 2.0, f32::INFINITY];
        let bytes: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
        let stored = LeafType::Number {
            number: Number::F32,
            big_endian: false,
        };
        let mut keys = [0; 7];
        let leaf = Leaf {
            name: "t".into(),
            offset: 0,
            stored,
        };
        fill_keys(
            Block::Records {
                bytes: &bytes,
                record: 4,
            },
            &leaf,
            &mut keys,
        );
        assert!(keys.is_sorted());
    }

    #[test]
    fn short_blocks_leave_the_rest_untouched() {
        let mut out = [7.0; 3];
        let block = Block::Records {
            bytes: &[0; 8],
            record: 4,
        };
        fill_f64(block, 0, Number::F32, false, 2.0, &mut out);
        assert_eq!(out, [0.0, 0.0, 7.0]);
        fill_f64(block, 2, Number::F32, false, 2.0, &mut out);
        assert_eq!(out, [0.0, 0.0, 7.0]);
    }
}
