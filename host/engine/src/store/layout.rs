//! Where the columns of an object lie in its segment.

use puncta_documents::{ColumnInfo, Element, Failure, FailureCode, Header};

/// Columns begin and end on this boundary.
pub const ALIGN: u64 = 64;
const PAGE: u64 = 4096;

/// Place of one column.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Place {
    /// Numbers or codes: first byte.
    pub data: u64,
    /// Bytes of one row in `data`.
    pub row_bytes: u64,
    /// Offsets of texts: first byte.
    pub offsets: u64,
    /// Number of offsets there is room for.
    pub offset_count: u64,
    /// Text: first byte.
    pub text: u64,
    /// Bytes of room for text.
    pub text_bytes: u64,
    /// First byte behind the column.
    pub end: u64,
}

/// Places of all columns of an object.
#[derive(Clone, Debug, Default)]
pub struct Layout {
    /// Places by part and column.
    pub parts: Vec<Vec<Place>>,
    /// Bytes in all.
    pub bytes: u64,
}

impl Layout {
    /// Lays out the columns of a header with room for the rows that it names.
    ///
    /// # Errors
    /// When the size does not fit.
    pub fn of(header: &Header) -> Result<Layout, Failure> {
        let mut layout = Layout::default();
        for part in &header.parts {
            let mut places = Vec::with_capacity(part.columns.len());
            for column in &part.columns {
                let place = place(column, part.rows, layout.bytes).ok_or_else(|| {
                    Failure::new(
                        FailureCode::Resources,
                        format!("{} rows of column {} are too many", part.rows, column.name),
                    )
                })?;
                layout.bytes = place.end;
                places.push(place);
            }
            layout.parts.push(places);
        }
        Ok(layout)
    }
}

fn place(column: &ColumnInfo, rows: u64, begin: u64) -> Option<Place> {
    let row_bytes = column.type_.row_bytes() as u64;
    let mut place = Place {
        row_bytes,
        ..Place::default()
    };
    let bytes = row_bytes.checked_mul(rows)?;
    // Large columns begin on a page, so that the unused tail of one can be given back.
    let large = bytes >= 16 * PAGE;
    place.data = begin.checked_next_multiple_of(if large { PAGE } else { ALIGN })?;
    let mut end = place
        .data
        .checked_add(bytes)?
        .checked_next_multiple_of(ALIGN)?;
    let texts = match column.type_.element {
        Element::Utf8 => Some(rows),
        Element::Dictionary => Some(column.entries.unwrap_or(0)),
        _ => None,
    };
    if let Some(texts) = texts {
        place.offsets = end;
        place.offset_count = texts.checked_add(1)?;
        end = end.checked_add(place.offset_count.checked_mul(8)?)?;
        place.text = end.checked_next_multiple_of(ALIGN)?;
        place.text_bytes = column.text_bytes.unwrap_or(0);
        end = place
            .text
            .checked_add(place.text_bytes)?
            .checked_next_multiple_of(ALIGN)?;
    }
    place.end = end;
    Some(place)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_are_aligned_and_disjoint() {
        let columns = vec![
            ColumnInfo::new("a", Element::U8, "1"),
            ColumnInfo::new("b", Element::F64, "nm"),
            ColumnInfo::new("c", Element::Utf8, "1").text_bytes(100),
            ColumnInfo::new("d", Element::F32, "1").width(3),
        ];
        let layout = Layout::of(&Header::table("t", 1001, columns)).unwrap();
        let mut end = 0;
        for place in &layout.parts[0] {
            assert!(place.data >= end && place.data % ALIGN == 0 && place.end % ALIGN == 0);
            end = place.end;
        }
        assert_eq!(layout.parts[0][2].offset_count, 1002);
        assert_eq!(layout.bytes, end);
    }

    #[test]
    fn absurd_sizes_are_refused() {
        let columns = vec![ColumnInfo::new("x", Element::F64, "nm")];
        assert!(Layout::of(&Header::table("t", u64::MAX / 4, columns)).is_err());
    }
}
