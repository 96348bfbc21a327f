//! Rows of columns of the host as Arrow arrays.

use arrow_array::types::UInt32Type;
use arrow_array::{
    ArrayRef, BooleanArray, DictionaryArray, FixedSizeListArray, Float32Array, Float64Array,
    Int8Array, Int16Array, Int32Array, Int64Array, RecordBatch, RecordBatchOptions, StringArray,
    UInt8Array, UInt16Array, UInt32Array, UInt64Array,
};
use arrow_schema::{DataType, Schema};
use puncta_sdk::input::ColumnRef;
use puncta_sdk::{Failure, Input};
use std::ops::Range;
use std::sync::Arc;

/// A column of the table that is written.
pub struct Source<'a> {
    name: &'a str,
    values: ColumnRef<'a>,
    type_: DataType,
    /// Entries of a dictionary.
    entries: Option<Arc<StringArray>>,
}

/// The columns of a schema.
pub fn sources<'a>(input: &Input<'a>, schema: &'a Schema) -> Result<Vec<Source<'a>>, Failure> {
    let one = |field: &'a arrow_schema::FieldRef| {
        let values = input.column(0, field.name())?;
        let entries = match values {
            ColumnRef::Dictionary(_, texts) => {
                let entries = (0..texts.len()).map(|i| Some(texts.get(i)));
                Some(Arc::new(entries.collect::<StringArray>()))
            }
            _ => None,
        };
        Ok(Source {
            name: field.name(),
            values,
            type_: field.data_type().clone(),
            entries,
        })
    };
    schema.fields().iter().map(one).collect()
}

impl Source<'_> {
    /// These rows as an array.
    pub fn array(&self, rows: Range<usize>) -> Result<ArrayRef, Failure> {
        let broken = |_| Failure::internal(format!("column {} does not fit Arrow", self.name));
        let width = match self.type_ {
            DataType::FixedSizeList(_, width) => usize::try_from(width).unwrap_or(1),
            _ => 1,
        };
        let short = || Failure::internal(format!("column {} is too short", self.name));
        let range = rows.start * width..rows.end * width;
        macro_rules! plain {
            ($array:ident, $values:expr) => {
                Arc::new($array::new(
                    $values.get(range).ok_or_else(short)?.to_vec().into(),
                    None,
                ))
            };
        }
        let flat: ArrayRef = match self.values {
            ColumnRef::U8(values) => plain!(UInt8Array, values),
            ColumnRef::I8(values) => plain!(Int8Array, values),
            ColumnRef::U16(values) => plain!(UInt16Array, values),
            ColumnRef::I16(values) => plain!(Int16Array, values),
            ColumnRef::U32(values) => plain!(UInt32Array, values),
            ColumnRef::I32(values) => plain!(Int32Array, values),
            ColumnRef::U64(values) => plain!(UInt64Array, values),
            ColumnRef::I64(values) => plain!(Int64Array, values),
            ColumnRef::F32(values) => plain!(Float32Array, values),
            ColumnRef::F64(values) => plain!(Float64Array, values),
            ColumnRef::Bool(values) => {
                let values = values.get(range).ok_or_else(short)?;
                let values = values.iter().map(|value| Some(*value != 0));
                Arc::new(values.collect::<BooleanArray>())
            }
            ColumnRef::Utf8(texts) => {
                let bytes: usize = rows.clone().map(|i| texts.get(i).len()).sum();
                if i32::try_from(bytes).is_err() {
                    let message = format!("the texts of column {} are too long", self.name);
                    return Err(Failure::bad_input(message));
                }
                Arc::new(StringArray::from_iter_values(rows.map(|i| texts.get(i))))
            }
            ColumnRef::Dictionary(codes, _) => {
                let codes = codes.get(range).ok_or_else(short)?.to_vec();
                let entries = self.entries.clone().ok_or_else(short)?;
                let keys = UInt32Array::new(codes.into(), None);
                Arc::new(DictionaryArray::<UInt32Type>::try_new(keys, entries).map_err(broken)?)
            }
        };
        match &self.type_ {
            DataType::FixedSizeList(item, width) => {
                let list = FixedSizeListArray::try_new(Arc::clone(item), *width, flat, None);
                Ok(Arc::new(list.map_err(broken)?))
            }
            _ => Ok(flat),
        }
    }
}

/// These rows of all columns.
pub fn batch(
    schema: &Arc<Schema>,
    sources: &[Source<'_>],
    rows: Range<usize>,
) -> Result<RecordBatch, Failure> {
    let arrays: Result<Vec<ArrayRef>, Failure> = sources
        .iter()
        .map(|source| source.array(rows.clone()))
        .collect();
    let options = RecordBatchOptions::new().with_row_count(Some(rows.len()));
    RecordBatch::try_new_with_options(Arc::clone(schema), arrays?, &options)
        .map_err(|error| Failure::internal(format!("the table does not fit Arrow: {error}")))
}
