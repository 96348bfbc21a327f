//! Outputs of a call: being written, finished, checked.

use crate::store::layout::{Layout, Place};
use crate::store::object::{ColumnData, Object, Stored};
use crate::store::region::{Region, writable};
use crate::store::segment::Segment;
use puncta_documents::{Element, Failure, FailureCode, Header, Kind, Output, OutputForm};
use rayon::prelude::*;
use std::ops::Range;
use std::sync::Arc;

/// An output that its call finished.
#[derive(Clone, Debug)]
pub struct Finished {
    /// Port.
    pub output: String,
    /// Form.
    pub form: OutputForm,
    /// Input that columns or a selection belong to.
    pub of: Option<usize>,
    /// Its columns, or the document of a figure or report.
    pub object: Object,
}

/// An output that is being written.
#[derive(Debug)]
pub struct OpenOutput {
    /// What it will be; rows are the room there is.
    pub output: Output,
    /// Its memory.
    pub segment: Segment,
    /// Where its columns lie.
    pub layout: Layout,
    /// Rows committed by part.
    pub committed: Vec<u64>,
}

/// Texts begin at 0; the rest of a segment's room may hold anything.
#[allow(unsafe_code)]
pub(super) fn first_offsets(segment: &Segment, layout: &Layout) {
    for place in layout
        .parts
        .iter()
        .flatten()
        .filter(|place| place.offset_count > 0)
    {
        // SAFETY: the layout lies in the segment, which nobody else has yet.
        if let [first, ..] = unsafe { writable::<u64>(segment.base(), place.offsets, 1) } {
            *first = 0;
        }
    }
}

/// Bytes that one thread gets at a time.
const COMMIT_PIECE: u64 = 8 << 20;

/// Makes memory certain, with all threads where the caller is none of the pool: a task of the pool
/// that waits for others may be given work that waits for it.
pub(super) fn commit_ranges(
    segment: &Segment,
    ranges: Vec<Range<u64>>,
    pool: &rayon::ThreadPool,
) -> Result<(), Failure> {
    let bytes: u64 = ranges
        .iter()
        .map(|range| range.end.saturating_sub(range.start))
        .sum();
    segment.check_room(bytes)?;
    if bytes <= COMMIT_PIECE || rayon::current_thread_index().is_some() {
        return ranges
            .into_iter()
            .try_for_each(|range| segment.commit(range));
    }
    let pieces: Vec<Range<u64>> = ranges
        .into_iter()
        .flat_map(|range| {
            let end = range.end;
            let starts = range.step_by(COMMIT_PIECE as usize);
            starts.map(move |start| start..(start + COMMIT_PIECE).min(end))
        })
        .collect();
    pool.install(|| {
        pieces
            .into_par_iter()
            .try_for_each(|piece| segment.commit(piece))
    })
}

pub(super) fn seal(
    open: OpenOutput,
    rows: &[u64],
    header: Option<Header>,
) -> Result<Finished, Failure> {
    let OpenOutput {
        mut output,
        segment,
        layout,
        ..
    } = open;
    let wrong = |why: String| Failure::internal(format!("output {}: {why}", output.output));
    let mut header = match header {
        Some(header) => {
            let planned = output.header.parts.iter().flat_map(|part| &part.columns);
            let given = header.parts.iter().flat_map(|part| &part.columns);
            if !planned
                .map(|c| (&c.name, c.type_))
                .eq(given.map(|c| (&c.name, c.type_)))
            {
                return Err(wrong(
                    "its last header has other columns than its first".into(),
                ));
            }
            header
        }
        None => std::mem::replace(&mut output.header, Header::new(Kind::Table, "")),
    };
    if rows.len() != header.parts.len() || header.parts.len() != layout.parts.len() {
        return Err(wrong("the number of its parts is wrong".into()));
    }
    let mut used = 0;
    for ((part, places), rows) in header.parts.iter_mut().zip(&layout.parts).zip(rows) {
        if *rows > part.rows {
            return Err(wrong(format!(
                "{rows} rows were finished, with room for {}",
                part.rows
            )));
        }
        part.rows = *rows;
        for place in places.iter().filter(|_| *rows > 0) {
            let text_end = place.text + place.text_bytes;
            used = used.max(place.data + rows * place.row_bytes).max(text_end);
            used = used.max(place.offsets + place.offset_count * 8);
        }
    }
    for ((part, places), rows) in header.parts.iter().zip(&layout.parts).zip(rows) {
        if part
            .columns
            .iter()
            .all(|column| !column.type_.element.is_text())
        {
            for place in places {
                segment.release(place.data + rows * place.row_bytes..place.end.min(used));
            }
        }
    }
    let segment = segment.seal(used)?;
    let mut parts = Vec::with_capacity(layout.parts.len());
    for (part, places) in header.parts.iter_mut().zip(&layout.parts) {
        let mut columns = Vec::with_capacity(places.len());
        for (info, place) in part.columns.iter_mut().zip(places) {
            let column = finished_column(info, place, part.rows, &segment).map_err(|why| {
                Failure::new(
                    FailureCode::Internal,
                    format!("column {}: {why}", info.name),
                )
            })?;
            info.text_bytes = None;
            columns.push(Stored::whole(column));
        }
        parts.push(columns);
    }
    let object = Object::new(header, parts)?;
    Ok(Finished {
        output: output.output,
        form: output.form,
        of: output.of,
        object,
    })
}

fn finished_column(
    info: &puncta_documents::ColumnInfo,
    place: &Place,
    rows: u64,
    segment: &Arc<Segment>,
) -> Result<ColumnData, Failure> {
    let region = |offset: u64, bytes: u64| {
        let offset = if bytes == 0 { 0 } else { offset };
        Region::new(segment, offset, bytes)
    };
    let mut column = ColumnData {
        type_: info.type_,
        rows,
        data: None,
        offsets: None,
        text: None,
        entries: 0,
    };
    if place.row_bytes > 0 {
        column.data = Some(region(place.data, rows * place.row_bytes)?);
    }
    if info.type_.element.is_text() {
        let utf8 = info.type_.element == Element::Utf8;
        column.entries = if utf8 { 0 } else { info.entries.unwrap_or(0) };
        let texts = if utf8 { rows } else { column.entries };
        if texts + 1 > place.offset_count {
            return Err(Failure::internal("more texts than there is room for"));
        }
        let offsets = if rows == 0 {
            region(0, 0)?
        } else {
            region(place.offsets, (texts + 1) * 8)?
        };
        let places: &[u64] = offsets.slice();
        let end = places.last().copied().unwrap_or(0);
        let ordered = places.windows(2).all(|pair| pair[0] <= pair[1]);
        if !ordered || places.first().is_some_and(|first| *first != 0) || end > place.text_bytes {
            return Err(Failure::internal("the offsets of its texts are wrong"));
        }
        let text = region(place.text, end)?;
        if std::str::from_utf8(text.slice::<u8>()).is_err() {
            return Err(Failure::internal("its texts are no UTF-8"));
        }
        column.offsets = Some(offsets);
        column.text = Some(text);
    }
    if info.type_.element == Element::Dictionary {
        let codes = column.data.as_ref().map_or(&[][..], Region::slice::<u32>);
        if codes.iter().any(|code| u64::from(*code) >= column.entries) {
            return Err(Failure::internal("a code points behind its dictionary"));
        }
    }
    Ok(column)
}
