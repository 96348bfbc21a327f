//! Arrow arrays into columns of the host.

use crate::schema::{How, Planned};
use arrow_array::cast::AsArray;
use arrow_array::types::{
    ArrowPrimitiveType, Float16Type, Float32Type, Float64Type, Int8Type, Int16Type, Int32Type,
    Int64Type, UInt8Type, UInt16Type, UInt32Type, UInt64Type,
};
use arrow_array::{Array, ArrayRef};
use arrow_schema::DataType;
use puncta_sdk::Failure;
use puncta_sdk::output::ColumnMut;
use puncta_shared_records::damaged;
use puncta_shared_records::texts::Texts;
use std::collections::HashMap;

/// The texts of a column, gathered before the output is begun.
#[derive(Debug, Default)]
pub struct Gathered {
    /// All rows, or all entries of a dictionary.
    pub texts: Texts,
    /// Rows of a dictionary.
    pub codes: Vec<u32>,
    /// Missing texts, which become empty.
    pub missing: u64,
    known: HashMap<String, u32>,
}

/// Bytes of texts that one column may have.
const MOST: usize = 8 << 30;

fn changed(planned: &Planned) -> Failure {
    damaged(format!(
        "column {} is not of the type that the file's schema says",
        planned.info.name
    ))
}

impl Gathered {
    /// Adds the texts of an array.
    pub fn add(&mut self, planned: &Planned, array: &dyn Array) -> Result<(), Failure> {
        if planned.how == How::Dictionary {
            return self.add_codes(planned, array);
        }
        let texts = texts(array).ok_or_else(|| changed(planned))?;
        for i in 0..array.len() {
            let text = texts(i);
            self.missing += u64::from(text.is_none());
            self.texts.push(text.unwrap_or(""));
        }
        self.check(planned)
    }

    fn check(&self, planned: &Planned) -> Result<(), Failure> {
        if self.texts.bytes.len() > MOST {
            let message = format!("the texts of column {} exceed 8 GB", planned.info.name);
            return Err(Failure::new(puncta_sdk::FailureCode::Resources, message));
        }
        Ok(())
    }

    fn code(&mut self, text: &str) -> u32 {
        if let Some(code) = self.known.get(text) {
            return *code;
        }
        let code = u32::try_from(self.known.len()).unwrap_or(u32::MAX);
        self.known.insert(text.to_owned(), code);
        self.texts.push(text);
        code
    }

    fn add_codes(&mut self, planned: &Planned, array: &dyn Array) -> Result<(), Failure> {
        let array = array
            .as_any_dictionary_opt()
            .ok_or_else(|| changed(planned))?;
        let values = array.values();
        let texts = texts(values.as_ref()).ok_or_else(|| changed(planned))?;
        // All entries in their order, so that a table of the host keeps its codes.
        let entries: Vec<u32> = (0..values.len())
            .map(|i| self.code(texts(i).unwrap_or("")))
            .collect();
        let keys = array.normalized_keys();
        let empty = array.nulls().map(|_| self.code(""));
        for (i, key) in keys.iter().enumerate() {
            let code = match (array.is_null(i), empty) {
                (true, Some(empty)) => {
                    self.missing += 1;
                    empty
                }
                _ => *entries.get(*key).ok_or_else(|| changed(planned))?,
            };
            self.codes.push(code);
        }
        self.check(planned)
    }
}

type TextAt<'a> = Box<dyn Fn(usize) -> Option<&'a str> + 'a>;

fn texts(array: &dyn Array) -> Option<TextAt<'_>> {
    macro_rules! at {
        ($texts:expr) => {{
            let texts = $texts?;
            Box::new(move |i| (!texts.is_null(i)).then(|| texts.value(i)))
        }};
    }
    Some(match array.data_type() {
        DataType::Utf8 => at!(array.as_string_opt::<i32>()),
        DataType::LargeUtf8 => at!(array.as_string_opt::<i64>()),
        DataType::Utf8View => at!(array.as_string_view_opt()),
        _ => return None,
    })
}

/// Copies an array of numbers to the rows of `to`, which has room for exactly its values.
pub fn numbers(planned: &Planned, array: &ArrayRef, to: ColumnMut<'_>) -> Result<(), Failure> {
    if planned.how == How::Number {
        if let ColumnMut::F64(to) = to {
            return as_f64(planned, array, to);
        }
        return Err(changed(planned));
    }
    match to {
        ColumnMut::U8(to) => same::<UInt8Type>(planned, array, to, None),
        ColumnMut::I8(to) => same::<Int8Type>(planned, array, to, None),
        ColumnMut::U16(to) => same::<UInt16Type>(planned, array, to, None),
        ColumnMut::I16(to) => same::<Int16Type>(planned, array, to, None),
        ColumnMut::U32(to) => same::<UInt32Type>(planned, array, to, None),
        ColumnMut::I32(to) => same::<Int32Type>(planned, array, to, None),
        ColumnMut::U64(to) => same::<UInt64Type>(planned, array, to, None),
        ColumnMut::I64(to) => same::<Int64Type>(planned, array, to, None),
        ColumnMut::F32(to) => floats::<Float32Type>(planned, array, to, f32::NAN),
        ColumnMut::F64(to) => floats::<Float64Type>(planned, array, to, f64::NAN),
        ColumnMut::Bool(to) => {
            let array = array.as_boolean_opt().ok_or_else(|| changed(planned))?;
            if array.null_count() > 0 {
                return Err(changed(planned));
            }
            for (i, to) in to.iter_mut().enumerate().take(array.len()) {
                *to = array.value(i).into();
            }
            Ok(())
        }
        ColumnMut::Utf8(_) | ColumnMut::Dictionary(..) => Err(changed(planned)),
    }
}

fn floats<T: ArrowPrimitiveType>(
    planned: &Planned,
    array: &ArrayRef,
    to: &mut [T::Native],
    missing: T::Native,
) -> Result<(), Failure> {
    let Some(list) = array.as_fixed_size_list_opt() else {
        return same::<T>(planned, array, to, Some(missing));
    };
    let width = planned.info.type_.width as usize;
    if list.value_length() as usize != width {
        return Err(changed(planned));
    }
    same::<T>(planned, list.values(), to, Some(missing))?;
    if list.null_count() > 0 {
        for (i, row) in to.chunks_mut(width).enumerate() {
            if list.is_null(i) {
                row.fill(missing);
            }
        }
    }
    Ok(())
}

fn same<T: ArrowPrimitiveType>(
    planned: &Planned,
    array: &ArrayRef,
    to: &mut [T::Native],
    missing: Option<T::Native>,
) -> Result<(), Failure> {
    let array = array
        .as_primitive_opt::<T>()
        .filter(|array| array.len() == to.len())
        .ok_or_else(|| changed(planned))?;
    to.copy_from_slice(array.values());
    if array.null_count() > 0 {
        let missing = missing.ok_or_else(|| changed(planned))?;
        for (i, to) in to.iter_mut().enumerate() {
            if array.is_null(i) {
                *to = missing;
            }
        }
    }
    Ok(())
}

fn as_f64(planned: &Planned, array: &ArrayRef, to: &mut [f64]) -> Result<(), Failure> {
    if array.len() != to.len() {
        return Err(changed(planned));
    }
    let (factor, minus) = (planned.factor, planned.minus);
    macro_rules! convert {
        ($type:ty, $value:ident => $number:expr) => {{
            let values = array.as_primitive::<$type>().values();
            for (to, $value) in to.iter_mut().zip(values.iter().copied()) {
                *to = $number * factor - minus;
            }
        }};
    }
    #[allow(clippy::cast_precision_loss)]
    match array.data_type() {
        DataType::UInt8 => convert!(UInt8Type, v => f64::from(v)),
        DataType::Int8 => convert!(Int8Type, v => f64::from(v)),
        DataType::UInt16 => convert!(UInt16Type, v => f64::from(v)),
        DataType::Int16 => convert!(Int16Type, v => f64::from(v)),
        DataType::UInt32 => convert!(UInt32Type, v => f64::from(v)),
        DataType::Int32 => convert!(Int32Type, v => f64::from(v)),
        DataType::UInt64 => convert!(UInt64Type, v => v as f64),
        DataType::Int64 => convert!(Int64Type, v => v as f64),
        DataType::Float16 => convert!(Float16Type, v => v.to_f64()),
        DataType::Float32 => convert!(Float32Type, v => f64::from(v)),
        DataType::Float64 => convert!(Float64Type, v => v),
        DataType::Boolean => {
            let values = array.as_boolean();
            for (i, to) in to.iter_mut().enumerate() {
                *to = f64::from(u8::from(values.value(i))) * factor - minus;
            }
        }
        _ => return Err(changed(planned)),
    }
    if array.null_count() > 0 {
        for (i, to) in to.iter_mut().enumerate() {
            if array.is_null(i) {
                *to = f64::NAN;
            }
        }
    }
    Ok(())
}
