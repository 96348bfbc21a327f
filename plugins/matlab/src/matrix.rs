//! What a MATLAB file holds, as a tree. Large arrays stay in the file.

use puncta_shared_records::{Number, Stored};
use std::rc::Rc;

/// A value.
#[derive(Clone, Debug)]
pub enum Value {
    /// Numbers or truth values.
    Numbers(Array),
    /// Texts.
    Text(String),
    /// Structures: all fields of the first element, then of the second, ...
    Struct {
        /// Names of the fields.
        names: Rc<[String]>,
        /// Values of all elements.
        values: Vec<Value>,
    },
    /// Cell arrays, sparse matrices, objects, functions, complex numbers.
    Other,
}

/// An array of numbers, column by column.
#[derive(Clone, Debug)]
pub struct Array {
    /// Sizes.
    pub sizes: Box<[usize]>,
    /// How numbers are stored, which may be smaller than they are.
    pub stored: Stored,
    /// What they are.
    pub class: Number,
    /// Where the bytes are.
    pub data: Data,
}

/// Where an array's bytes are.
#[derive(Clone, Debug)]
pub enum Data {
    /// Here.
    Kept(Box<[u8]>),
    /// In a variable, from this byte on: of the file, or of the decompressed variable.
    At(u64),
}

impl Array {
    /// Values there are.
    pub fn count(&self) -> usize {
        self.sizes.iter().product()
    }

    /// Whether it is a row or a column.
    pub fn is_vector(&self) -> bool {
        let sizes: Vec<usize> = self
            .sizes
            .iter()
            .copied()
            .filter(|size| *size != 1)
            .collect();
        sizes.len() <= 1
    }

    /// All values of an array that is here.
    pub fn values(&self) -> Option<Vec<f64>> {
        let Data::Kept(bytes) = &self.data else {
            return None;
        };
        let size = self.stored.number.bytes();
        Some(
            bytes
                .chunks_exact(size)
                .map(|bytes| number(self.stored, bytes))
                .collect(),
        )
    }

    /// The first value of an array that is here.
    pub fn first(&self) -> Option<f64> {
        let Data::Kept(bytes) = &self.data else {
            return None;
        };
        let bytes = bytes.get(..self.stored.number.bytes())?;
        Some(number(self.stored, bytes))
    }
}

#[allow(clippy::cast_precision_loss)]
fn number(stored: Stored, bytes: &[u8]) -> f64 {
    macro_rules! read {
        ($type:ty) => {
            bytes.first_chunk().map_or(f64::NAN, |bytes| {
                if stored.big_endian {
                    <$type>::from_be_bytes(*bytes) as f64
                } else {
                    <$type>::from_le_bytes(*bytes) as f64
                }
            })
        };
    }
    match stored.number {
        Number::U8 | Number::Bool => read!(u8),
        Number::I8 => read!(i8),
        Number::U16 => read!(u16),
        Number::I16 => read!(i16),
        Number::U32 => read!(u32),
        Number::I32 => read!(i32),
        Number::U64 => read!(u64),
        Number::I64 => read!(i64),
        Number::F16 => f64::NAN,
        Number::F32 => read!(f32),
        Number::F64 => read!(f64),
    }
}

impl Value {
    /// The field of a single structure.
    pub fn field(&self, name: &str) -> Option<&Value> {
        let Value::Struct { names, values } = self else {
            return None;
        };
        let place = names.iter().position(|known| known == name)?;
        (values.len() == names.len()).then(|| values.get(place))?
    }

    /// The array, if it is one.
    pub fn array(&self) -> Option<&Array> {
        match self {
            Value::Numbers(array) => Some(array),
            _ => None,
        }
    }
}
