//! What host and worker say to each other.

use crate::plugins::Finished;
use crate::store::object::{ColumnData, Object, Stored};
use crate::store::region::Region;
use crate::store::segment::Segment;
use puncta_documents::{ColumnType, Failure, Header, Manifest, OutputForm, Plan, Request};
use serde::{Deserialize, Serialize};
use std::collections::HashMap;
use std::os::fd::{BorrowedFd, OwnedFd};
use std::path::PathBuf;
use std::sync::Arc;

/// From the host.
#[derive(Debug, Serialize, Deserialize)]
pub enum ToWorker {
    /// Open a library, with so much private memory at most.
    Open {
        path: PathBuf,
        door: bool,
        memory: u64,
    },
    /// Prepare a call; there is one at a time.
    Prepare { request: Request },
    /// Run it. Segments that are new to the worker come as descriptors, in the order of `new`.
    Run {
        inputs: Vec<WireObject>,
        new: Vec<(u64, u64)>,
        forget: Vec<u64>,
    },
    /// Let go of segments that the host has dropped.
    Forget { segments: Vec<u64> },
    /// Forget the prepared call, if there is one, and tidy up.
    Drop,
    /// Stop what runs.
    Cancel,
}

/// From the worker.
#[derive(Debug, Serialize, Deserialize)]
pub enum FromWorker {
    /// The library is open.
    Opened { manifest: Box<Manifest> },
    /// The call is prepared.
    Prepared { plan: Plan },
    /// The call ran. Segments come as descriptors, in the order of `new`.
    Done {
        finished: Vec<WireFinished>,
        new: Vec<(u64, u64)>,
    },
    /// Nothing is left of the last call, except what a next one should not inherit.
    Rested { worn: Option<String> },
    /// What was asked failed.
    Failed { failure: Failure },
    /// Fraction and phase of what runs.
    Progress { fraction: f64, phase: String },
    /// A message for the log.
    Message { level: u32, text: String },
}

/// A range of a segment.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct WireRegion(u64, u64, u64);

/// A column.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct WireColumn {
    type_: ColumnType,
    rows: u64,
    entries: u64,
    data: Option<WireRegion>,
    offsets: Option<WireRegion>,
    text: Option<WireRegion>,
}

/// An object with the columns that are needed of it.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct WireObject {
    header: Header,
    parts: Vec<Vec<WireColumn>>,
}

/// A finished output.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct WireFinished {
    output: String,
    form: OutputForm,
    of: Option<usize>,
    object: WireObject,
}

/// Segments that a message refers to, in order of first use.
#[derive(Default)]
pub struct Sent {
    segments: Vec<Arc<Segment>>,
}

impl Sent {
    fn region(&mut self, region: Option<&Region>) -> Option<WireRegion> {
        let region = region?;
        let segment = region.segment();
        if !self.segments.iter().any(|known| known.id() == segment.id()) {
            self.segments.push(Arc::clone(segment));
        }
        Some(WireRegion(segment.id(), region.offset(), region.bytes()))
    }

    fn column(&mut self, column: &ColumnData) -> WireColumn {
        WireColumn {
            type_: column.type_,
            rows: column.rows,
            entries: column.entries,
            data: self.region(column.data.as_ref()),
            offsets: self.region(column.offsets.as_ref()),
            text: self.region(column.text.as_ref()),
        }
    }

    /// The columns of `object` that a plan reads of its input `input`.
    ///
    /// # Errors
    /// When a column does not exist, or there is no memory to gather it.
    pub fn input(
        &mut self,
        object: &Object,
        input: usize,
        plan: &Plan,
    ) -> Result<WireObject, Failure> {
        let mut header = Header::new(object.header().kind, object.header().name.clone());
        let mut parts = Vec::new();
        for (place, part) in object.header().parts.iter().enumerate() {
            let read = plan
                .read
                .iter()
                .find(|read| read.input == input && read.part == place);
            let (mut infos, mut columns) = (Vec::new(), Vec::new());
            for name in read.map_or(&[][..], |read| &read.columns) {
                let column = object.column(place, name)?;
                let info = part.column(name).cloned().unwrap_or_else(|| {
                    puncta_documents::ColumnInfo::new(name, column.type_.element, "1")
                });
                infos.push(info);
                columns.push(self.column(&column));
            }
            let (name, rows) = (part.name.clone(), part.rows);
            header.parts.push(puncta_documents::Part {
                name,
                rows,
                columns: infos,
            });
            parts.push(columns);
        }
        Ok(WireObject { header, parts })
    }

    /// A finished output.
    ///
    /// # Errors
    /// Never for outputs, which are no selections of others yet.
    pub fn finished(&mut self, finished: &Finished) -> Result<WireFinished, Failure> {
        let object = &finished.object;
        let mut parts = Vec::new();
        for place in 0..object.header().parts.len() {
            let columns = object.columns(place).iter();
            parts.push(
                columns
                    .map(|stored| stored.column().map(|column| self.column(column)))
                    .collect::<Result<_, _>>()?,
            );
        }
        Ok(WireFinished {
            output: finished.output.clone(),
            form: finished.form,
            of: finished.of,
            object: WireObject {
                header: object.header().clone(),
                parts,
            },
        })
    }

    /// The segments, in order of first use.
    #[must_use]
    pub fn segments(&self) -> &[Arc<Segment>] {
        &self.segments
    }
}

/// Number and length of segments, and their descriptors, for a message.
pub type Announced<'a> = (Vec<(u64, u64)>, Vec<BorrowedFd<'a>>);

/// What a message says of the segments that it refers to.
///
/// # Errors
/// When the system refuses to protect one.
pub fn announce(segments: &[Arc<Segment>]) -> Result<Announced<'_>, Failure> {
    let numbers = segments.iter().map(|one| (one.id(), one.bytes())).collect();
    let files = segments
        .iter()
        .map(|one| one.file())
        .collect::<Result<_, _>>()?;
    Ok((numbers, files))
}

/// Maps what came with a message.
///
/// # Errors
/// When numbers and descriptors do not agree, or a segment cannot be mapped.
pub fn accept(
    new: &[(u64, u64)],
    descriptors: Vec<OwnedFd>,
    known: &mut HashMap<u64, Arc<Segment>>,
) -> Result<(), Failure> {
    if new.len() != descriptors.len() {
        return Err(Failure::internal("a message came without its memory"));
    }
    for ((number, bytes), file) in new.iter().zip(descriptors) {
        known.insert(*number, Arc::new(Segment::open(file, *bytes)?));
    }
    Ok(())
}

impl WireColumn {
    fn unwire(&self, known: &HashMap<u64, Arc<Segment>>) -> Result<ColumnData, Failure> {
        let region = |wire: &Option<WireRegion>| -> Result<Option<Region>, Failure> {
            let Some(WireRegion(number, offset, bytes)) = wire else {
                return Ok(None);
            };
            let segment = known
                .get(number)
                .ok_or_else(|| Failure::internal("a message names memory that nobody sent"))?;
            Region::new(segment, *offset, *bytes).map(Some)
        };
        let column = ColumnData {
            type_: self.type_,
            rows: self.rows,
            entries: self.entries,
            data: region(&self.data)?,
            offsets: region(&self.offsets)?,
            text: region(&self.text)?,
        };
        let bytes = column.data.as_ref().map_or(0, Region::bytes);
        let wanted = self.rows.checked_mul(self.type_.row_bytes() as u64);
        if wanted != Some(bytes) {
            return Err(Failure::internal(
                "a column's memory does not have its rows",
            ));
        }
        Ok(column)
    }
}

impl WireObject {
    /// The object, in memory that was mapped before.
    ///
    /// # Errors
    /// When it names memory that nobody sent, or its parts do not agree.
    pub fn unwire(self, known: &HashMap<u64, Arc<Segment>>) -> Result<Object, Failure> {
        let mut parts = Vec::with_capacity(self.parts.len());
        for columns in &self.parts {
            let unwired = columns
                .iter()
                .map(|column| column.unwire(known).map(Stored::whole));
            parts.push(unwired.collect::<Result<_, _>>()?);
        }
        Object::new(self.header, parts)
    }
}

impl WireFinished {
    /// The output, in memory that was mapped before.
    ///
    /// # Errors
    /// When it names memory that nobody sent, or its parts do not agree.
    pub fn unwire(self, known: &HashMap<u64, Arc<Segment>>) -> Result<Finished, Failure> {
        let object = self.object.unwire(known)?;
        Ok(Finished {
            output: self.output,
            form: self.form,
            of: self.of,
            object,
        })
    }
}
