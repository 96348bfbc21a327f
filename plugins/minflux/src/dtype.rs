//! Types of NumPy arrays: where each number of a record is.

use crate::literal::Literal;
use puncta_shared_records::{Number, Stored};

/// A field of a record.
#[derive(Clone, Debug, PartialEq)]
pub struct Entry {
    /// Its name.
    pub name: String,
    /// Byte in the record, or in one element of the nested list.
    pub at: usize,
    /// Numbers of it.
    pub count: usize,
    /// What it holds.
    pub kind: Kind,
}

/// What a field holds.
#[derive(Clone, Debug, PartialEq)]
pub enum Kind {
    /// Numbers.
    Number(Stored),
    /// Records of so many bytes.
    Nested(Vec<Entry>, usize),
    /// Texts and padding, of which there is nothing to read.
    Other,
}

/// Most fields of a record, nested ones included.
const MOST_FIELDS: usize = 4096;
/// Most bytes of a record.
const MOST_BYTES: usize = 16 << 20;

/// The fields of a record and its bytes. None for pickled objects and what is no type.
pub fn record(descr: &Literal) -> Option<(Vec<Entry>, usize)> {
    let mut left = MOST_FIELDS;
    entries(descr, &mut left, 0)
}

fn entries(descr: &Literal, left: &mut usize, depth: usize) -> Option<(Vec<Entry>, usize)> {
    let Literal::List(fields) = descr else {
        return None;
    };
    if depth > 8 {
        return None;
    }
    let (mut all, mut at) = (Vec::new(), 0_usize);
    for field in fields {
        *left = left.checked_sub(1)?;
        let Literal::List(parts) = field else {
            return None;
        };
        let (name, type_, shape) = match parts.as_slice() {
            [name, type_] => (name, type_, None),
            [name, type_, shape] => (name, type_, Some(shape)),
            _ => return None,
        };
        let name = match name {
            Literal::Text(name) => name.clone(),
            // A title and a name.
            Literal::List(both) => match both.as_slice() {
                [_, Literal::Text(name)] => name.clone(),
                _ => return None,
            },
            _ => return None,
        };
        let count = shape.map_or(Some(1), product)?;
        let (kind, bytes) = kind(type_, left, depth)?;
        all.push(Entry {
            name,
            at,
            count,
            kind,
        });
        at = at.checked_add(bytes.checked_mul(count)?)?;
        if at > MOST_BYTES {
            return None;
        }
    }
    Some((all, at))
}

fn kind(type_: &Literal, left: &mut usize, depth: usize) -> Option<(Kind, usize)> {
    match type_ {
        Literal::Text(text) => match scalar(text) {
            Some(stored) => Some((Kind::Number(stored), stored.number.bytes())),
            None => Some((Kind::Other, other(text)?)),
        },
        nested => {
            let (entries, bytes) = entries(nested, left, depth + 1)?;
            Some((Kind::Nested(entries, bytes), bytes))
        }
    }
}

/// The product of a shape; an empty one is a single value.
pub fn product(shape: &Literal) -> Option<usize> {
    match shape {
        Literal::Whole(count) => usize::try_from(*count).ok(),
        Literal::List(sizes) => sizes.iter().try_fold(1_usize, |product, size| match size {
            Literal::Whole(size) => product.checked_mul(usize::try_from(*size).ok()?),
            _ => None,
        }),
        _ => None,
    }
}

/// The number that a type such as `<f8` is.
pub fn scalar(text: &str) -> Option<Stored> {
    let (order, name) = match text.split_at_checked(1)? {
        (order @ ("<" | ">" | "|" | "="), name) => (order, name),
        _ => ("<", text),
    };
    let number = match name {
        "b1" | "?" => Number::Bool,
        "u1" => Number::U8,
        "i1" => Number::I8,
        "u2" => Number::U16,
        "i2" => Number::I16,
        "u4" => Number::U32,
        "i4" => Number::I32,
        "u8" => Number::U64,
        "i8" => Number::I64,
        "f2" => Number::F16,
        "f4" => Number::F32,
        "f8" => Number::F64,
        _ => return None,
    };
    Some(Stored {
        number,
        big_endian: order == ">",
    })
}

/// Bytes of texts and padding.
fn other(text: &str) -> Option<usize> {
    let name = text.trim_start_matches(['<', '>', '|', '=']);
    let (kind, size) = name.split_at_checked(1)?;
    let size: usize = size.parse().ok()?;
    match kind {
        "S" | "a" | "V" => Some(size),
        "U" => size.checked_mul(4),
        "c" | "m" | "M" => Some(size),
        _ => None,
    }
}
