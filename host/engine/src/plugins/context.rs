//! A running call, as the host's tables see it: inputs, open outputs, finished outputs.

use super::outputs::{Finished, OpenOutput, commit_ranges, first_offsets, seal};
use crate::job::Progress;
use crate::store::SegmentPool;
use crate::store::layout::{Layout, Place};
use crate::store::object::{ColumnData, Object};
use crate::store::segment::Segment;
use puncta_documents::{Failure, FailureCode, Header, Kind, Output, OutputForm, Plan};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

#[derive(Default)]
struct State {
    open: Vec<Option<OpenOutput>>,
    finished: Vec<Finished>,
    failure: Option<Failure>,
    refusal: Option<Failure>,
    /// Bytes that the outputs have so far.
    bytes: u64,
    /// Columns that were given to the plugin: row numbers have no other owner.
    given: Vec<ColumnData>,
}

/// A running call.
pub struct JobContext {
    inputs: Vec<Object>,
    plan: Mutex<Arc<Plan>>,
    progress: Arc<dyn Progress>,
    resources: Resources,
    state: Mutex<State>,
}

/// What a call may use.
#[derive(Clone, Debug)]
pub struct Resources {
    /// Threads for `parallel_for`.
    pub threads: Arc<rayon::ThreadPool>,
    /// Memory that earlier results left.
    pub memory: Arc<SegmentPool>,
    /// Bytes that its outputs may have together.
    pub budget: u64,
}

/// Number of the first output; smaller numbers are inputs.
pub const FIRST_OUTPUT: u64 = 1 << 32;
/// Most outputs of a call, figures and reports among them.
const MAX_OUTPUTS: usize = 4096;

fn too_many() -> Failure {
    Failure::internal(format!("the plugin gives more than {MAX_OUTPUTS} outputs"))
}

impl JobContext {
    /// The context of a call with these inputs.
    #[must_use]
    pub fn new(
        inputs: Vec<Object>,
        progress: Arc<dyn Progress>,
        resources: Resources,
    ) -> Arc<JobContext> {
        Arc::new(JobContext {
            inputs,
            plan: Mutex::new(Arc::default()),
            progress,
            resources,
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
        &self.resources.threads
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
        let columns = || names.iter().map(|name| object.column(part, name)).collect();
        let columns: Vec<ColumnData> = self
            .resources
            .threads
            .install::<_, Result<_, Failure>>(columns)?;
        self.state().given.extend_from_slice(&columns);
        Ok(columns)
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
        let segment = Segment::create_in(&self.resources.memory, layout.bytes)?;
        first_offsets(&segment, &layout);
        let committed = vec![0; output.header.parts.len()];
        let mut state = self.state();
        if state.open.len() >= MAX_OUTPUTS {
            return Err(too_many());
        }
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
        if let Err(why) = output.header.check() {
            return refuse(why);
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
        self.afford(object, part, rows)?;
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
            commit_ranges(&open.segment, ranges.collect(), &self.resources.threads)?;
            open.committed[part] = end;
            Ok(())
        })
    }

    /// Counts rows that are about to be committed.
    fn afford(&self, object: u64, part: usize, rows: u64) -> Result<(), Failure> {
        let row_bytes = self.with_open(object, |open| {
            let places = open.layout.parts.get(part);
            Ok(places.map_or(0, |places| {
                places.iter().map(|place| place.row_bytes).sum::<u64>()
            }))
        })?;
        let mut state = self.state();
        let bytes = state.bytes.saturating_add(rows.saturating_mul(row_bytes));
        if bytes > self.resources.budget {
            let megabytes = |bytes: u64| bytes.div_ceil(1 << 20);
            let message = format!(
                "the results would need {} MB of memory, and {} MB are allowed",
                megabytes(bytes),
                megabytes(self.resources.budget)
            );
            let failure = Failure::new(FailureCode::Resources, message);
            return Err(failure.remedy("use a smaller part of the data or a coarser result"));
        }
        state.bytes = bytes;
        Ok(())
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
        let mut state = self.state();
        if state.finished.len() >= MAX_OUTPUTS {
            return Err(too_many());
        }
        state.finished.push(Finished {
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
