//! Plain columns from selections, in parallel blocks.
#![allow(unsafe_code)]

use super::layout::Layout;
use super::object::{ColumnData, Selection};
use super::region::{Number, Region, writable};
use super::segment::Segment;
use puncta_documents::{ColumnInfo, ColumnType, Element, Failure, Header};
use rayon::prelude::*;

const BLOCK: usize = 64 * 1024;

/// Makes a column in a segment of its own and lets `fill` write it.
pub(super) fn make<T: Number>(
    type_: ColumnType,
    rows: u64,
    fill: impl FnOnce(&mut [T]),
) -> Result<ColumnData, Failure> {
    let mut info = ColumnInfo::new("column", type_.element, "1");
    info.type_ = type_;
    let layout = Layout::of(&Header::table("", rows, vec![info]))?;
    let segment = Segment::create(layout.bytes)?;
    segment.commit(0..layout.bytes)?;
    let bytes = type_.row_bytes() as u64 * rows;
    let count = usize::try_from(bytes).unwrap_or(0) / size_of::<T>();
    // SAFETY: a fresh segment with room for the column, and nothing else uses it.
    fill(unsafe { writable(segment.base(), 0, count) });
    let segment = segment.seal(layout.bytes)?;
    let data = Some(Region::new(&segment, 0, bytes)?);
    Ok(ColumnData {
        type_,
        rows,
        data,
        offsets: None,
        text: None,
        entries: 0,
    })
}

/// The selected rows of a column.
///
/// # Errors
/// When there is no memory for them.
pub fn gather(column: &ColumnData, selection: &Selection) -> Result<ColumnData, Failure> {
    let rows = selection.rows();
    match column.type_.element {
        Element::Utf8 => return gather_texts(column, rows),
        // Codes are gathered; the texts they point to stay as they are.
        Element::Dictionary => {
            let mut out = gather_numbers::<u32>(column, rows)?;
            out.offsets.clone_from(&column.offsets);
            out.text.clone_from(&column.text);
            out.entries = column.entries;
            return Ok(out);
        }
        _ => {}
    }
    match column.type_.element.bytes() {
        1 => gather_numbers::<u8>(column, rows),
        2 => gather_numbers::<u16>(column, rows),
        4 => gather_numbers::<u32>(column, rows),
        _ => gather_numbers::<u64>(column, rows),
    }
}

fn gather_numbers<T: Number>(column: &ColumnData, rows: &[u32]) -> Result<ColumnData, Failure> {
    let from: &[T] = column.data.as_ref().map_or(&[], Region::slice);
    let width = column.type_.width as usize;
    if rows
        .last()
        .is_some_and(|last| (*last as usize + 1) * width > from.len())
    {
        return Err(Failure::internal("a selection leaves its table"));
    }
    make::<T>(column.type_, rows.len() as u64, |out| {
        out.par_chunks_mut(BLOCK * width)
            .zip(rows.par_chunks(BLOCK))
            .for_each(|(out, rows)| {
                if width == 1 {
                    for (value, row) in out.iter_mut().zip(rows) {
                        *value = from[*row as usize];
                    }
                } else {
                    for (list, row) in out.chunks_exact_mut(width).zip(rows) {
                        let begin = *row as usize * width;
                        list.copy_from_slice(&from[begin..begin + width]);
                    }
                }
            });
    })
}

fn gather_texts(column: &ColumnData, rows: &[u32]) -> Result<ColumnData, Failure> {
    let offsets: &[u64] = column.offsets.as_ref().map_or(&[], Region::slice);
    let text: &[u8] = column.text.as_ref().map_or(&[], Region::slice);
    let range = |row: u32| -> std::ops::Range<usize> {
        let place = |i: usize| offsets.get(i).map_or(0, |place| *place as usize);
        place(row as usize)..place(row as usize + 1)
    };
    make_texts(rows.len(), |i| {
        let row = rows.get(i).copied().unwrap_or(0);
        text.get(range(row)).unwrap_or(&[])
    })
}

/// Makes a column of UTF-8 texts in a segment of its own.
pub(super) fn make_texts<'a>(
    rows: usize,
    text: impl Fn(usize) -> &'a [u8],
) -> Result<ColumnData, Failure> {
    let total: usize = (0..rows).map(|row| text(row).len()).sum();
    let info = ColumnInfo::new("column", Element::Utf8, "1").text_bytes(total as u64);
    let layout = Layout::of(&Header::table("", rows as u64, vec![info]))?;
    let place = layout.parts[0][0];
    let segment = Segment::create(layout.bytes)?;
    segment.commit(0..layout.bytes)?;
    // SAFETY: disjoint ranges of a fresh segment that nothing else uses.
    let (offsets, bytes) = unsafe {
        (
            writable::<u64>(segment.base(), place.offsets, rows + 1),
            writable::<u8>(segment.base(), place.text, total),
        )
    };
    let mut end = 0;
    for row in 0..rows {
        let from = text(row);
        bytes[end..end + from.len()].copy_from_slice(from);
        end += from.len();
        offsets[row + 1] = end as u64;
    }
    let segment = segment.seal(layout.bytes)?;
    Ok(ColumnData {
        type_: ColumnType::scalar(Element::Utf8),
        rows: rows as u64,
        data: None,
        offsets: Some(Region::new(&segment, place.offsets, (rows as u64 + 1) * 8)?),
        text: Some(Region::new(&segment, place.text, total as u64)?),
        entries: 0,
    })
}

/// The selection that `second` makes of the rows of `first`.
///
/// # Errors
/// When there is no memory for it.
pub fn compose(first: &Selection, second: &Selection) -> Result<Selection, Failure> {
    let (from, rows) = (first.rows(), second.rows());
    if rows.last().is_some_and(|last| *last as usize >= from.len()) {
        return Err(Failure::internal("a selection leaves its table"));
    }
    let type_ = ColumnType::scalar(Element::U32);
    let column = make::<u32>(type_, rows.len() as u64, |out| {
        out.par_chunks_mut(BLOCK)
            .zip(rows.par_chunks(BLOCK))
            .for_each(|(out, rows)| {
                for (value, row) in out.iter_mut().zip(rows) {
                    *value = from[*row as usize];
                }
            });
    })?;
    Selection::new(&column, u64::from(u32::MAX) + 1)
}

/// Row numbers 0, 1, 2, ... as u64.
///
/// # Errors
/// When there is no memory for them.
pub fn row_numbers(rows: u64) -> Result<ColumnData, Failure> {
    make::<u64>(ColumnType::scalar(Element::U64), rows, |out| {
        out.par_iter_mut()
            .enumerate()
            .for_each(|(i, value)| *value = i as u64);
    })
}

/// A column of numbers times a factor, as f64.
///
/// # Errors
/// When it holds texts, or there is no memory.
pub fn scaled(column: &ColumnData, factor: f64) -> Result<ColumnData, Failure> {
    if column.type_.element.is_text() {
        return Err(Failure::bad_input(
            "a column of texts has no unit to convert",
        ));
    }
    let Some(region) = &column.data else {
        return Err(Failure::internal("a column of numbers without memory"));
    };
    let type_ = ColumnType {
        element: Element::F64,
        ..column.type_
    };
    macro_rules! scale {
        ($type:ty) => {{
            let from = region.slice::<$type>();
            make::<f64>(type_, column.rows, |out| {
                out.par_iter_mut()
                    .zip(from)
                    .for_each(|(out, value)| *out = *value as f64 * factor);
            })
        }};
    }
    match column.type_.element {
        Element::U8 | Element::Bool => scale!(u8),
        Element::I8 => scale!(i8),
        Element::U16 => scale!(u16),
        Element::I16 => scale!(i16),
        Element::U32 => scale!(u32),
        Element::I32 => scale!(i32),
        Element::U64 => scale!(u64),
        Element::I64 => scale!(i64),
        Element::F32 => scale!(f32),
        Element::F64 => scale!(f64),
        Element::Utf8 | Element::Dictionary => Err(Failure::internal("texts as numbers")),
    }
}

/// A column of numbers for tests.
#[cfg(test)]
pub(crate) fn numbers(values: &[f64]) -> ColumnData {
    let type_ = ColumnType::scalar(Element::F64);
    make::<f64>(type_, values.len() as u64, |out| {
        out.copy_from_slice(values)
    })
    .unwrap()
}
