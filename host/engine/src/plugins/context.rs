//! A running call, as the host's tables see it: inputs, open outputs, finished outputs.

use crate::job::Progress;
use crate::store::layout::{Layout, Place};
use crate::store::object::{ColumnData, Object, Stored};
use crate::store::segment::{Region, Segment};
use puncta_documents::{Element, Failure, FailureCode, Header, Kind, Output, OutputForm, Plan};
use rayon::prelude::*;
use std::ops::Range;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

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

#[derive(Default)]
struct State {
    open: Vec<Option<OpenOutput>>,
    finished: Vec<Finished>,
    failure: Option<Failure>,
    refusal: Option<Failure>,
}

/// A running call.
pub struct JobContext {
    inputs: Vec<Object>,
    plan: Mutex<Arc<Plan>>,
    progress: Arc<dyn Progress>,
    pool: Arc<rayon::ThreadPool>,
    state: Mutex<State>,
}

/// Number of the first output; smaller numbers are inputs.
pub const FIRST_OUTPUT: u64 = 1 << 32;

impl JobContext {
    /// The context of a call with these inputs.
    #[must_use]
    pub fn new(
        inputs: Vec<Object>,
        progress: Arc<dyn Progress>,
        pool: Arc<rayon::ThreadPool>,
    ) -> Arc<JobContext> {
        Arc::new(JobContext {
            inputs,
            plan: Mutex::new(Arc::default()),
            progress,
            pool,
            state: Mutex::default(),
        })
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Progress and cancel.
    #[must_use]
    pub fn progress(&self) -> &dyn Progress {
        &*self.progress
    }

    /// Threads for `parallel_for`.
    #[must_use]
    pub fn pool(&self) -> &rayon::ThreadPool {
        &self.pool
    }

    /// Sets the plan whose columns `run` may read.
    pub fn set_plan(&self, plan: Arc<Plan>) {
        *self.plan.lock().unwrap_or_else(PoisonError::into_inner) = plan;
    }

    /// Columns that the plan names for a part of an input.
    ///
    /// # Errors
    /// When the plan names none, a column does not exist, or there is no memory to gather it.
    pub fn input_columns(&self, input: usize, part: usize) -> Result<Vec<ColumnData>, Failure> {
        let plan = Arc::clone(&self.plan.lock().unwrap_or_else(PoisonError::into_inner));
        let object = self
            .inputs
            .get(input)
            .ok_or_else(|| Failure::internal("no such input"))?;
        let read = plan
            .read
            .iter()
            .find(|read| read.input == input && read.part == part);
        let names = read.map_or(&[][..], |read| &read.columns);
        self.pool
            .install(|| names.iter().map(|name| object.column(part, name)).collect())
    }

    /// Remembers why the call is about to fail.
    pub fn fail(&self, failure: Failure) {
        self.state().failure = Some(failure);
    }

    /// Remembers why the host refused what the plugin asked of it.
    pub fn refuse(&self, refusal: Failure) {
        self.state().refusal = Some(refusal);
    }

    /// The reason that the plugin gave, if any. Where the plugin only knows that the host refused
    /// something, the host's reason.
    pub fn take_failure(&self) -> Option<Failure> {
        let mut state = self.state();
        let (given, refusal) = (state.failure.take(), state.refusal.take());
        let own = given.as_ref().is_some_and(|failure| {
            !matches!(failure.code, FailureCode::Internal | FailureCode::Resources)
        });
        if own { given } else { refusal.or(given) }
    }

    /// Begins an output.
    ///
    /// # Errors
    /// When its header cannot be used, or there is no memory.
    pub fn begin(&self, output: Output) -> Result<u64, Failure> {
        self.check_output(&output)?;
        let layout = Layout::of(&output.header)?;
        let segment = Segment::create(layout.bytes)?;
        let committed = vec![0; output.header.parts.len()];
        let mut state = self.state();
        state.open.push(Some(OpenOutput {
            output,
            segment,
            layout,
            committed,
        }));
        Ok(FIRST_OUTPUT + state.open.len() as u64 - 1)
    }

    fn check_output(&self, output: &Output) -> Result<(), Failure> {
        let refuse = |why: String| {
            Err(Failure::internal(format!(
                "output {}: {why}",
                output.output
            )))
        };
        for part in &output.header.parts {
            for (i, column) in part.columns.iter().enumerate() {
                if part.columns[..i]
                    .iter()
                    .any(|earlier| earlier.name == column.name)
                {
                    return refuse(format!("two columns are named {}", column.name));
                }
            }
        }
        if let Some(image) = &output.header.image
            && image.voxels() != Some(output.header.rows())
        {
            return refuse("the image's size is not its number of values".into());
        }
        if output.form == OutputForm::Object {
            return Ok(());
        }
        let rows = output
            .of
            .and_then(|of| self.inputs.get(of))
            .map(|input| input.header().rows());
        match rows {
            Some(rows) if rows != output.header.rows() => refuse(format!(
                "it has room for {} rows, not {rows}",
                output.header.rows()
            )),
            Some(_) => Ok(()),
            None => refuse("it belongs to no input".into()),
        }
    }

    fn with_open<T>(
        &self,
        object: u64,
        use_it: impl FnOnce(&mut OpenOutput) -> Result<T, Failure>,
    ) -> Result<T, Failure> {
        let place = object.wrapping_sub(FIRST_OUTPUT);
        let mut state = self.state();
        let open = usize::try_from(place)
            .ok()
            .and_then(|place| state.open.get_mut(place));
        match open.and_then(Option::as_mut) {
            Some(open) => use_it(open),
            None => Err(Failure::internal("no such output, or it is finished")),
        }
    }

    /// Places of the columns of a part of an output, with the address of its memory.
    ///
    /// # Errors
    /// When there is no such output or part.
    #[allow(clippy::type_complexity)]
    pub fn output_columns(
        &self,
        object: u64,
        part: usize,
    ) -> Result<Vec<(puncta_documents::ColumnInfo, Place, *mut u8, u64)>, Failure> {
        self.with_open(object, |open| {
            let (Some(group), Some(places)) = (
                open.output.header.parts.get(part),
                open.layout.parts.get(part),
            ) else {
                return Err(Failure::internal("no such part"));
            };
            let base = open.segment.base();
            let columns = group.columns.iter().cloned().zip(places);
            Ok(columns
                .map(|(info, place)| (info, *place, base, group.rows))
                .collect())
        })
    }

    /// Makes room for more rows.
    ///
    /// # Errors
    /// When there is no such output, or no memory.
    #[allow(unsafe_code)]
    pub fn grow(&self, object: u64, part: usize, rows: u64) -> Result<(), Failure> {
        self.with_open(object, |open| {
            let mut header = open.output.header.clone();
            let group = header
                .parts
                .get_mut(part)
                .ok_or_else(|| Failure::internal("no such part"))?;
            if rows <= group.rows {
                return Ok(());
            }
            group.rows = rows;
            let layout = Layout::of(&header)?;
            let segment = Segment::create(layout.bytes)?;
            let rows = open.output.header.parts.iter().map(|part| part.rows);
            let old = open.layout.parts.iter().zip(rows);
            let old = old.flat_map(|(places, rows)| places.iter().map(move |place| (place, rows)));
            for ((old, rows), new) in old.zip(layout.parts.iter().flatten()) {
                // Rows may be written before they are committed, so all there was room for move.
                let numbers = (old.data, new.data, old.row_bytes * rows);
                let texts = old.offset_count * 8;
                for (from, to, count) in [
                    numbers,
                    (old.offsets, new.offsets, texts),
                    (old.text, new.text, old.text_bytes),
                ] {
                    // SAFETY: both ranges lie in their segments, as the layouts say, which differ.
                    unsafe {
                        let from = open.segment.base().wrapping_add(from as usize);
                        let to = segment.base().wrapping_add(to as usize);
                        std::ptr::copy_nonoverlapping(from, to, count as usize);
                    }
                }
            }
            open.output.header = header;
            open.layout = layout;
            open.segment = segment;
            Ok(())
        })
    }

    /// Makes the next rows of a part usable, and their memory certain.
    ///
    /// # Errors
    /// When there is no such output, no room or no memory, or the call is cancelled.
    pub fn commit(&self, object: u64, part: usize, rows: u64) -> Result<(), Failure> {
        if self.progress.cancelled() {
            return Err(Failure::cancelled());
        }
        self.with_open(object, |open| {
            let room = open
                .output
                .header
                .parts
                .get(part)
                .map_or(0, |group| group.rows);
            let begin = open.committed.get(part).copied().unwrap_or(0);
            let end = begin.saturating_add(rows);
            if end > room {
                return Err(Failure::internal(
                    "more rows are committed than there is room for",
                ));
            }
            let ranges = open.layout.parts[part].iter().map(|place| {
                place.data + begin * place.row_bytes..place.data + end * place.row_bytes
            });
            commit_ranges(&open.segment, ranges.collect(), &self.pool)?;
            open.committed[part] = end;
            Ok(())
        })
    }

    /// Ends an output.
    ///
    /// # Errors
    /// When it has more rows than room, or what was written is no possible content.
    pub fn finish(&self, object: u64, rows: &[u64], header: Option<Header>) -> Result<(), Failure> {
        let place = usize::try_from(object.wrapping_sub(FIRST_OUTPUT)).unwrap_or(usize::MAX);
        let open = self.state().open.get_mut(place).and_then(Option::take);
        let open =
            open.ok_or_else(|| Failure::internal("no such output, or it is already finished"))?;
        let finished = seal(open, rows, header)?;
        self.state().finished.push(finished);
        Ok(())
    }

    /// Takes a figure or report.
    ///
    /// # Errors
    /// When the document does not say which output it is.
    pub fn emit(&self, document: serde_json::Value) -> Result<(), Failure> {
        let text = |name: &str| document.get(name).and_then(|value| value.as_str());
        let kind = match text("format") {
            Some(puncta_documents::findings::FIGURE) => Kind::Figure,
            Some(puncta_documents::findings::REPORT) => Kind::Report,
            _ => {
                return Err(Failure::internal(
                    "a document that is neither figure nor report",
                ));
            }
        };
        let output = text("output").unwrap_or_default().to_owned();
        let object = Object::document(kind, &output, document);
        let form = OutputForm::Object;
        self.state().finished.push(Finished {
            output,
            form,
            of: None,
            object,
        });
        Ok(())
    }

    /// What was finished, in the order of finishing. What was only begun is dropped.
    pub fn take_finished(&self) -> Vec<Finished> {
        let mut state = self.state();
        state.open.clear();
        std::mem::take(&mut state.finished)
    }
}

/// Bytes that one thread gets at a time.
const COMMIT_PIECE: u64 = 8 << 20;

/// Makes memory certain, with all threads where the caller is none of the pool: a task of the pool
/// that waits for others may be given work that waits for it.
fn commit_ranges(
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

fn seal(open: OpenOutput, rows: &[u64], header: Option<Header>) -> Result<Finished, Failure> {
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
