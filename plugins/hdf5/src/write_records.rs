//! Records from columns, for datasets that h5py and PyTables read as structured arrays.

use hdf5::plist::file_access::FileAccessBuilder;
use hdf5::types::{CompoundField, CompoundType, FloatSize, IntSize, TypeDescriptor};
use hdf5::{Dataset, File, FileBuilder, Location};
use puncta_sdk::input::ColumnRef;
use puncta_sdk::{Failure, Run};

use std::path::Path;

use crate::error::hdf5_reason;
use crate::raw;

/// Rows that are written at a time, and rows of a chunk.
const ROWS: usize = 1 << 16;
const CHUNK: usize = 1 << 14;

/// A new file. It has the oldest layout that holds what we write, whose groups keep no time: the
/// same table gives the same bytes at every hour.
pub(crate) fn create(path: &Path) -> Result<File, Failure> {
    let mut builder = FileBuilder::new();
    builder.with_fapl(FileAccessBuilder::libver_earliest);
    builder.create(path).map_err(|e| failed("the file", &e))
}

/// How a column is stored.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Stored {
    /// As it is.
    Same,
    /// As u32, from any number.
    U32,
    /// As f32, times the factor of the field.
    F32,
}

/// A field of the records.
pub(crate) struct Field<'a> {
    pub(crate) name: String,
    pub(crate) values: ColumnRef<'a>,
    pub(crate) stored: Stored,
    /// For numbers that are stored as f32.
    pub(crate) factor: f64,
    /// Bytes of a text of fixed length.
    text: usize,
}

impl<'a> Field<'a> {
    pub(crate) fn new(name: &str, values: ColumnRef<'a>, stored: Stored, factor: f64) -> Field<'a> {
        let mut text = 1;
        if let ColumnRef::Utf8(texts) = values {
            text = (0..texts.len())
                .map(|i| texts.get(i).len())
                .max()
                .unwrap_or(0)
                .max(1);
        }
        Field {
            name: name.to_owned(),
            values,
            stored,
            factor,
            text,
        }
    }

    /// Whether the column can be a field.
    pub(crate) fn fits(values: ColumnRef<'_>) -> bool {
        !matches!(values, ColumnRef::Dictionary(..))
    }

    fn descriptor(&self) -> TypeDescriptor {
        use ColumnRef as C;
        let int = |size| TypeDescriptor::Integer(size);
        let unsigned = |size| TypeDescriptor::Unsigned(size);
        match (self.stored, self.values) {
            (Stored::U32, _) => unsigned(IntSize::U4),
            (Stored::F32, _) | (_, C::F32(_)) => TypeDescriptor::Float(FloatSize::U4),
            (_, C::F64(_)) => TypeDescriptor::Float(FloatSize::U8),
            (_, C::I8(_)) => int(IntSize::U1),
            (_, C::I16(_)) => int(IntSize::U2),
            (_, C::I32(_)) => int(IntSize::U4),
            (_, C::I64(_)) => int(IntSize::U8),
            (_, C::U16(_)) => unsigned(IntSize::U2),
            (_, C::U32(_)) => unsigned(IntSize::U4),
            (_, C::U64(_)) => unsigned(IntSize::U8),
            (_, C::Bool(_)) => TypeDescriptor::Boolean,
            (_, C::U8(_)) => unsigned(IntSize::U1),
            (_, C::Utf8(_) | C::Dictionary(..)) => TypeDescriptor::FixedAscii(self.text),
        }
    }

    /// Puts the values of rows into their records.
    fn put(&self, first: usize, records: &mut [u8], record: usize, offset: usize) {
        macro_rules! put {
            ($values:expr, $map:expr) => {{
                let rows = records.chunks_exact_mut(record);
                for (row, value) in rows.zip($values.get(first..).unwrap_or(&[])) {
                    let bytes = $map(*value).to_ne_bytes();
                    if let Some(place) = row.get_mut(offset..offset + bytes.len()) {
                        place.copy_from_slice(&bytes);
                    }
                }
            }};
        }
        macro_rules! number {
            ($values:expr) => {
                match self.stored {
                    Stored::Same => put!($values, |v| v),
                    Stored::U32 => put!($values, |v| (v as f64).max(0.0) as u32),
                    Stored::F32 => put!($values, |v| (v as f64 * self.factor) as f32),
                }
            };
        }
        match self.values {
            ColumnRef::F64(v) => number!(v),
            ColumnRef::F32(v) => number!(v),
            ColumnRef::I64(v) => number!(v),
            ColumnRef::I32(v) => number!(v),
            ColumnRef::I16(v) => number!(v),
            ColumnRef::I8(v) => number!(v),
            ColumnRef::U64(v) => number!(v),
            ColumnRef::U32(v) => number!(v),
            ColumnRef::U16(v) => number!(v),
            ColumnRef::U8(v) | ColumnRef::Bool(v) => number!(v),
            ColumnRef::Utf8(texts) => {
                for (k, row) in records.chunks_exact_mut(record).enumerate() {
                    let text = texts.get(first + k).as_bytes();
                    if let Some(place) = row.get_mut(offset..offset + text.len()) {
                        place.copy_from_slice(text);
                    }
                }
            }
            ColumnRef::Dictionary(..) => {}
        }
    }
}

/// Writes a dataset of records: chunked, shuffled and deflated.
///
/// # Errors
/// Cancel, or what HDF5 refuses.
pub(crate) fn write(
    file: &File,
    name: &str,
    fields: &[Field<'_>],
    rows: usize,
    run: &dyn Run,
) -> Result<Dataset, Failure> {
    let mut offset = 0;
    let mut offsets = Vec::with_capacity(fields.len());
    let mut members = Vec::with_capacity(fields.len());
    for (index, field) in fields.iter().enumerate() {
        let ty = field.descriptor();
        let size = ty.size();
        offsets.push(offset);
        members.push(CompoundField {
            name: field.name.clone(),
            ty,
            offset,
            index,
        });
        offset += size;
    }
    let record = offset.max(1);
    let type_ = TypeDescriptor::Compound(CompoundType {
        fields: members,
        size: record,
    });
    let builder = file.new_dataset_builder();
    let builder = match rows {
        // PyTables appends to chunked tables only.
        0 => builder.chunk(1),
        rows => builder.chunk(rows.min(CHUNK)),
    };
    let dataset = builder
        .shuffle()
        .deflate(5)
        .packed(true)
        .empty_as(type_)
        .shape((rows..,))
        .create(name)
        .map_err(|e| failed(name, &e))?;
    let mut bytes = Vec::new();
    let mut first = 0;
    while first < rows {
        run.progress(first as f64 / rows as f64, "writing")?;
        let count = ROWS.min(rows - first);
        bytes.clear();
        bytes.resize(count * record, 0);
        for (field, offset) in fields.iter().zip(&offsets) {
            field.put(first, &mut bytes, record, *offset);
        }
        raw::write_records(&dataset, first as u64, count, &bytes).map_err(|e| failed(name, &e))?;
        first += count;
    }
    Ok(dataset)
}

/// The failure of a write.
pub(crate) fn failed(what: &str, error: &hdf5::Error) -> Failure {
    let message = format!("{what} cannot be written ({})", hdf5_reason(error));
    Failure::new(puncta_sdk::FailureCode::Io, message)
        .remedy("look whether the disk is full, or write to another folder")
}

/// Writes a text attribute as bytes of fixed length, as PyTables does.
pub(crate) fn text(place: &Location, name: &str, value: &str) -> Result<(), Failure> {
    let type_ = TypeDescriptor::FixedAscii(value.len().max(1));
    let attribute = place
        .new_attr_builder()
        .empty_as(type_)
        .create(name)
        .map_err(|e| failed(name, &e))?;
    let mut bytes = value.as_bytes().to_vec();
    bytes.resize(value.len().max(1), 0);
    raw::write_attribute(&attribute, &bytes).map_err(|e| failed(name, &e))
}
