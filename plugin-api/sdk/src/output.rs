//! Outputs of a running call.

use crate::raw::RawColumn;
use crate::{Failure, Header, Job};
use puncta_abi as abi;
use puncta_documents::header::HEADER;
use puncta_documents::{ColumnInfo, ColumnType, Element, Output};

/// The numbers or texts of an output column, for writing.
#[derive(Debug)]
#[allow(missing_docs)]
pub enum ColumnMut<'a> {
    U8(&'a mut [u8]),
    I8(&'a mut [i8]),
    U16(&'a mut [u16]),
    I16(&'a mut [i16]),
    U32(&'a mut [u32]),
    I32(&'a mut [i32]),
    U64(&'a mut [u64]),
    I64(&'a mut [i64]),
    F32(&'a mut [f32]),
    F64(&'a mut [f64]),
    /// 0 or 1.
    Bool(&'a mut [u8]),
    Utf8(TextsMut<'a>),
    /// Codes into the texts.
    Dictionary(&'a mut [u32], TextsMut<'a>),
}

/// Texts for writing: text `i` is `offsets[i]..offsets[i + 1]` of `bytes`; `offsets[0]` is 0.
#[derive(Debug)]
pub struct TextsMut<'a> {
    /// One more than there are texts.
    pub offsets: &'a mut [u64],
    /// Room for UTF-8.
    pub bytes: &'a mut [u8],
}

/// One group of columns of an output.
#[derive(Debug, Default)]
pub struct OutputPart {
    columns: Vec<RawColumn>,
}

/// An output that has been begun. What is not finished when the call returns is dropped.
#[derive(Debug)]
pub struct OutputObject<'j> {
    job: &'j Job,
    object: u64,
    output: Output,
    parts: Vec<OutputPart>,
    changed: bool,
}

/// Commits rows of an output while its columns are being written.
#[derive(Clone, Copy, Debug)]
pub struct Committer<'j> {
    job: &'j Job,
    object: u64,
}

impl Committer<'_> {
    /// Makes the next `rows` rows of a part usable, and their memory certain.
    ///
    /// # Errors
    /// When the host has no room, or the person cancelled.
    pub fn commit(&self, part: usize, rows: u64) -> Result<(), Failure> {
        self.job.host().commit(self.object, part, rows)
    }
}

/// Header of a selection of `rows` rows: its one column `row` holds row numbers.
#[must_use]
pub fn selection_header(name: &str, rows: u64) -> Header {
    Header::table(name, rows, vec![ColumnInfo::new("row", Element::U32, "1")])
}

impl<'j> OutputObject<'j> {
    pub(crate) fn begin(job: &'j Job, output: Output) -> Result<OutputObject<'j>, Failure> {
        let object = job.host().begin(&output)?;
        let mut begun = OutputObject {
            job,
            object,
            output,
            parts: Vec::new(),
            changed: false,
        };
        begun.load()?;
        Ok(begun)
    }

    fn load(&mut self) -> Result<(), Failure> {
        self.parts = (0..self.output.header.parts.len())
            .map(|part| {
                let wanted = self.output.header.parts[part].columns.len();
                let columns = self.job.host().columns(self.object, part, wanted)?;
                Ok(OutputPart {
                    columns: columns.into_iter().map(RawColumn).collect(),
                })
            })
            .collect::<Result<_, Failure>>()?;
        Ok(())
    }

    /// The header, to be completed before `finish`: metadata, descriptions, dictionary entries.
    pub fn header_mut(&mut self) -> &mut Header {
        self.changed = true;
        &mut self.output.header
    }

    /// The header.
    #[must_use]
    pub fn header(&self) -> &Header {
        &self.output.header
    }

    /// All columns of a part, in the order of the header.
    ///
    /// # Errors
    /// When there is no such part.
    #[allow(unsafe_code)]
    pub fn columns_mut(&mut self, part: usize) -> Result<Vec<ColumnMut<'_>>, Failure> {
        let group = self.parts.get(part).ok_or_else(|| no_part(part))?;
        // SAFETY: `&mut self` is borrowed as long as the slices live, and columns are disjoint.
        group
            .columns
            .iter()
            .map(|raw| unsafe { column_mut(*raw) })
            .collect()
    }

    /// A column of f64 of the first part.
    ///
    /// # Errors
    /// When there is no such column, or it has another type.
    pub fn f64_mut(&mut self, name: &str) -> Result<&mut [f64], Failure> {
        match self.column_mut(0, name)? {
            ColumnMut::F64(values) => Ok(values),
            _ => Err(wrong_type(name, Element::F64)),
        }
    }

    /// A column of f32 of the first part.
    ///
    /// # Errors
    /// When there is no such column, or it has another type.
    pub fn f32_mut(&mut self, name: &str) -> Result<&mut [f32], Failure> {
        match self.column_mut(0, name)? {
            ColumnMut::F32(values) => Ok(values),
            _ => Err(wrong_type(name, Element::F32)),
        }
    }

    /// A column of u32 of the first part, such as the `row` of a selection.
    ///
    /// # Errors
    /// When there is no such column, or it has another type.
    pub fn u32_mut(&mut self, name: &str) -> Result<&mut [u32], Failure> {
        match self.column_mut(0, name)? {
            ColumnMut::U32(values) => Ok(values),
            _ => Err(wrong_type(name, Element::U32)),
        }
    }

    /// Several columns of f64 of the first part at once.
    ///
    /// # Errors
    /// When there is no such column, it has another type, or one is named twice.
    pub fn f64s_mut<const N: usize>(
        &mut self,
        names: [&str; N],
    ) -> Result<[&mut [f64]; N], Failure> {
        let places = names.map(|name| {
            self.output
                .header
                .parts
                .first()
                .and_then(|part| part.columns.iter().position(|column| column.name == name))
        });
        let mut all: Vec<Option<ColumnMut<'_>>> =
            self.columns_mut(0)?.into_iter().map(Some).collect();
        let mut out: [&mut [f64]; N] = std::array::from_fn(|_| Default::default());
        for (slot, (place, name)) in out.iter_mut().zip(places.into_iter().zip(names)) {
            match place
                .and_then(|place| all.get_mut(place))
                .and_then(Option::take)
            {
                Some(ColumnMut::F64(values)) => *slot = values,
                Some(_) => return Err(wrong_type(name, Element::F64)),
                None => return Err(no_column(name)),
            }
        }
        Ok(out)
    }

    /// A column of a part.
    ///
    /// # Errors
    /// When there is no such column.
    #[allow(unsafe_code)]
    pub fn column_mut(&mut self, part: usize, name: &str) -> Result<ColumnMut<'_>, Failure> {
        let columns = &self
            .output
            .header
            .parts
            .get(part)
            .ok_or_else(|| no_part(part))?
            .columns;
        let place = columns
            .iter()
            .position(|column| column.name == name)
            .ok_or_else(|| no_column(name))?;
        let raw = self
            .parts
            .get(part)
            .and_then(|group| group.columns.get(place));
        // SAFETY: `&mut self` is borrowed as long as the slice lives.
        unsafe { column_mut(*raw.ok_or_else(|| no_column(name))?) }
    }

    /// Makes room for `rows` rows in all of a part.
    ///
    /// # Errors
    /// When the host has no room.
    pub fn grow(&mut self, part: usize, rows: u64) -> Result<(), Failure> {
        self.job.host().grow(self.object, part, rows)?;
        self.load()
    }

    /// Makes the next `rows` rows of a part usable. Memory is reserved here, so that a full machine
    /// is an error and no crash: commit before writing many rows.
    ///
    /// # Errors
    /// When the host has no room, or the person cancelled.
    pub fn commit(&mut self, part: usize, rows: u64) -> Result<(), Failure> {
        self.committer().commit(part, rows)
    }

    /// Commits rows while the columns are being written, from any thread.
    #[must_use]
    pub fn committer(&self) -> Committer<'j> {
        Committer {
            job: self.job,
            object: self.object,
        }
    }

    /// Finishes with all rows that were begun.
    ///
    /// # Errors
    /// When the host refuses what was written.
    pub fn finish(self) -> Result<(), Failure> {
        let rows: Vec<u64> = self
            .output
            .header
            .parts
            .iter()
            .map(|part| part.rows)
            .collect();
        self.finish_rows(&rows)
    }

    /// Finishes with so many rows in each part.
    ///
    /// # Errors
    /// When the host refuses what was written.
    pub fn finish_rows(self, rows: &[u64]) -> Result<(), Failure> {
        let header = if self.changed {
            puncta_documents::write(&self.output.header, HEADER)
        } else {
            String::new()
        };
        self.job.host().finish(self.object, rows, &header)
    }
}

fn no_part(part: usize) -> Failure {
    Failure::internal(format!("the output has no part {part}"))
}

fn no_column(name: &str) -> Failure {
    Failure::internal(format!(
        "the output has no column {name}, or it was asked for twice"
    ))
}

fn wrong_type(name: &str, element: Element) -> Failure {
    Failure::internal(format!(
        "column {name} of the output is not {}",
        element.name()
    ))
}

/// # Safety
/// The column is used through the result only, as long as that lives.
#[allow(unsafe_code)]
unsafe fn column_mut<'a>(raw: RawColumn) -> Result<ColumnMut<'a>, Failure> {
    let broken = || Failure::internal("the host gave an output column wrongly");
    let ColumnType { element, .. } = raw.type_().ok_or_else(broken)?;
    let abi::Column { rows, entries, .. } = raw.0;
    // SAFETY: the element decides the slice's type; the rest is the caller's promise.
    unsafe {
        let texts = |count: u64| -> Result<TextsMut<'a>, Failure> {
            Ok(TextsMut {
                offsets: raw.offsets_mut(count).ok_or_else(broken)?,
                bytes: raw.text_mut().ok_or_else(broken)?,
            })
        };
        Ok(match element {
            Element::U8 => ColumnMut::U8(raw.slice_mut().ok_or_else(broken)?),
            Element::I8 => ColumnMut::I8(raw.slice_mut().ok_or_else(broken)?),
            Element::U16 => ColumnMut::U16(raw.slice_mut().ok_or_else(broken)?),
            Element::I16 => ColumnMut::I16(raw.slice_mut().ok_or_else(broken)?),
            Element::U32 => ColumnMut::U32(raw.slice_mut().ok_or_else(broken)?),
            Element::I32 => ColumnMut::I32(raw.slice_mut().ok_or_else(broken)?),
            Element::U64 => ColumnMut::U64(raw.slice_mut().ok_or_else(broken)?),
            Element::I64 => ColumnMut::I64(raw.slice_mut().ok_or_else(broken)?),
            Element::F32 => ColumnMut::F32(raw.slice_mut().ok_or_else(broken)?),
            Element::F64 => ColumnMut::F64(raw.slice_mut().ok_or_else(broken)?),
            Element::Bool => ColumnMut::Bool(raw.slice_mut().ok_or_else(broken)?),
            Element::Utf8 => ColumnMut::Utf8(texts(rows)?),
            Element::Dictionary => {
                ColumnMut::Dictionary(raw.slice_mut().ok_or_else(broken)?, texts(entries)?)
            }
        })
    }
}
