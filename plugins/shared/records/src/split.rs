//! A tile of records into columns.

use crate::number::{Number, Stored, half};
use puncta_sdk::ColumnInfo;
use puncta_sdk::output::ColumnMut;

/// A column and where its values stand in a record.
#[derive(Clone, Debug)]
pub struct Field {
    /// What the column will be. Its element is the stored one's own, f64 or i64; nothing else.
    pub info: ColumnInfo,
    /// How values are stored.
    pub stored: Stored,
    /// Byte of the first value in its record, or in the picked sub-record.
    pub at: usize,
    /// Whether it stands in the sub-record that the selection picks.
    pub picked: bool,
    /// Columns of f64: values are multiplied with this.
    pub factor: f64,
    /// Columns of f64 and i64: then this is added.
    pub shift: f64,
}

impl Field {
    /// A field that keeps its type.
    #[must_use]
    pub fn new(mut info: ColumnInfo, stored: Stored, at: usize) -> Field {
        info.type_.element = stored.number.element();
        Field {
            info,
            stored,
            at,
            picked: false,
            factor: 1.0,
            shift: 0.0,
        }
    }

    /// As f64, multiplied with a factor.
    #[must_use]
    pub fn scaled(mut self, factor: f64) -> Field {
        self.info.type_.element = puncta_sdk::Element::F64;
        self.factor = factor;
        self
    }

    /// Counts from 0 instead of 1: i64, or f64 where the file has floating point.
    #[must_use]
    pub fn from_one(mut self) -> Field {
        let whole = !matches!(
            self.stored.number,
            Number::F16 | Number::F32 | Number::F64 | Number::U64
        );
        self.info.type_.element = if whole {
            puncta_sdk::Element::I64
        } else {
            puncta_sdk::Element::F64
        };
        self.shift = -1.0;
        self
    }
}

/// Places of a row: bytes of its record and of the picked sub-record, from the begin of the tile.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Pick {
    /// Record.
    pub record: u32,
    /// Sub-record.
    pub sub: u32,
}

/// Rows of a tile.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Tile<'t> {
    pub bytes: &'t [u8],
    pub record: usize,
    /// Without, all rows.
    pub picks: Option<&'t [Pick]>,
}

/// Copies a field of all rows of a tile.
pub(crate) fn split(tile: Tile<'_>, field: &Field, to: &mut ColumnMut<'_>) {
    macro_rules! whole {
        ($to:expr, $type:ty) => {
            copy(
                tile,
                field,
                <$type>::from_le_bytes,
                <$type>::from_be_bytes,
                $to,
            )
        };
    }
    match to {
        ColumnMut::F64(to) => split_f64(tile, field, to),
        ColumnMut::I64(to) => split_i64(tile, field, to),
        ColumnMut::U8(to) => whole!(to, u8),
        ColumnMut::I8(to) => whole!(to, i8),
        ColumnMut::U16(to) => whole!(to, u16),
        ColumnMut::I16(to) => whole!(to, i16),
        ColumnMut::U32(to) => whole!(to, u32),
        ColumnMut::I32(to) => whole!(to, i32),
        ColumnMut::U64(to) => whole!(to, u64),
        ColumnMut::F32(to) if field.stored.number == Number::F16 => copy(
            tile,
            field,
            |bytes| half(u16::from_le_bytes(bytes)),
            |bytes| half(u16::from_be_bytes(bytes)),
            to,
        ),
        ColumnMut::F32(to) => whole!(to, f32),
        ColumnMut::Bool(to) => copy(
            tile,
            field,
            |[byte]: [u8; 1]| u8::from(byte != 0),
            |[byte]| u8::from(byte != 0),
            to,
        ),
        ColumnMut::Utf8(_) | ColumnMut::Dictionary(..) => {}
    }
}

macro_rules! every {
    ($tile:expr, $field:expr, $to:expr, $make:expr; $($kind:ident: $type:ty),*) => {
        match $field.stored.number {
            $(Number::$kind => copy(
                $tile,
                $field,
                |bytes| $make(<$type>::from_le_bytes(bytes).into()),
                |bytes| $make(<$type>::from_be_bytes(bytes).into()),
                $to,
            ),)*
            _ => {}
        }
    };
}

#[allow(clippy::cast_precision_loss)]
fn split_f64(tile: Tile<'_>, field: &Field, to: &mut [f64]) {
    let (factor, shift) = (field.factor, field.shift);
    // Without a change, -0 and the bits of NaN stay.
    let plain = factor == 1.0 && shift == 0.0;
    match field.stored.number {
        Number::F64 if plain => copy(tile, field, f64::from_le_bytes, f64::from_be_bytes, to),
        Number::U64 => copy(
            tile,
            field,
            |bytes| u64::from_le_bytes(bytes) as f64 * factor + shift,
            |bytes| u64::from_be_bytes(bytes) as f64 * factor + shift,
            to,
        ),
        Number::I64 => copy(
            tile,
            field,
            |bytes| i64::from_le_bytes(bytes) as f64 * factor + shift,
            |bytes| i64::from_be_bytes(bytes) as f64 * factor + shift,
            to,
        ),
        Number::F16 => copy(
            tile,
            field,
            |bytes| f64::from(half(u16::from_le_bytes(bytes))) * factor + shift,
            |bytes| f64::from(half(u16::from_be_bytes(bytes))) * factor + shift,
            to,
        ),
        _ => every!(tile, field, to, |value: f64| value * factor + shift;
            U8: u8, I8: i8, U16: u16, I16: i16, U32: u32, I32: i32, F32: f32, F64: f64, Bool: u8),
    }
}

fn split_i64(tile: Tile<'_>, field: &Field, to: &mut [i64]) {
    #[allow(clippy::cast_possible_truncation)]
    let shift = field.shift as i64;
    every!(tile, field, to, |value: i64| value.wrapping_add(shift);
        U8: u8, I8: i8, U16: u16, I16: i16, U32: u32, I32: i32, I64: i64, Bool: u8);
}

/// Copies values of `N` bytes, as many of a row as a row of the column has.
fn copy<T, const N: usize>(
    tile: Tile<'_>,
    field: &Field,
    little: impl Fn([u8; N]) -> T,
    big: impl Fn([u8; N]) -> T,
    to: &mut [T],
) {
    if field.stored.big_endian {
        copy_rows(tile, field, big, to);
    } else {
        copy_rows(tile, field, little, to);
    }
}

fn copy_rows<T, const N: usize>(
    tile: Tile<'_>,
    field: &Field,
    read: impl Fn([u8; N]) -> T,
    to: &mut [T],
) {
    let width = field.info.type_.width as usize;
    if let Some(picks) = tile.picks {
        for (pick, to) in picks.iter().zip(to.chunks_mut(width)) {
            let place = if field.picked { pick.sub } else { pick.record };
            let bytes = tile.bytes.get(place as usize + field.at..).unwrap_or(&[]);
            for (bytes, to) in bytes.as_chunks::<N>().0.iter().zip(to) {
                *to = read(*bytes);
            }
        }
    } else if tile.record == N * width {
        for (bytes, to) in tile.bytes.as_chunks::<N>().0.iter().zip(to) {
            *to = read(*bytes);
        }
    } else if width == 1 {
        let records = tile.bytes.chunks_exact(tile.record.max(1));
        for (record, to) in records.zip(to) {
            if let Some(bytes) = record.get(field.at..).and_then(<[u8]>::first_chunk) {
                *to = read(*bytes);
            }
        }
    } else {
        let records = tile.bytes.chunks_exact(tile.record.max(1));
        for (record, to) in records.zip(to.chunks_mut(width)) {
            let bytes = record.get(field.at..).unwrap_or(&[]);
            for (bytes, to) in bytes.as_chunks::<N>().0.iter().zip(to) {
                *to = read(*bytes);
            }
        }
    }
}

/// Cuts the first `count` values off a column.
#[must_use]
pub fn front<'a>(column: &mut ColumnMut<'a>, count: usize) -> ColumnMut<'a> {
    macro_rules! cut {
        ($($kind:ident),*) => {
            match column {
                $(ColumnMut::$kind(rest) => {
                    let whole = std::mem::take(rest);
                    let (first, after) = whole.split_at_mut(count.min(whole.len()));
                    *rest = after;
                    ColumnMut::$kind(first)
                })*
                ColumnMut::Utf8(_) | ColumnMut::Dictionary(..) => ColumnMut::U8(&mut []),
            }
        };
    }
    cut!(U8, I8, U16, I16, U32, I32, U64, I64, F32, F64, Bool)
}
