//! Columns to be filled, and columns to be written.

use crate::sink::Part;

/// Words of a text column: value i is `bytes[ends[i-1]..ends[i]]`, UTF-8.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Words {
    /// All values behind each other.
    pub bytes: Vec<u8>,
    /// Where each value ends.
    pub ends: Vec<u64>,
}

impl Words {
    /// Adds a value.
    pub fn push(&mut self, value: &str) {
        self.bytes.extend_from_slice(value.as_bytes());
        self.ends.push(self.bytes.len() as u64);
    }

    /// Value i, empty where there is none.
    pub fn get(&self, i: usize) -> &str {
        let end = self.ends.get(i).copied().unwrap_or(0);
        let start = if i == 0 {
            0
        } else {
            self.ends.get(i - 1).copied().unwrap_or(0)
        };
        let value = self.bytes.get(start as usize..end as usize).unwrap_or(&[]);
        std::str::from_utf8(value).unwrap_or("")
    }

    /// The number of values.
    pub fn len(&self) -> usize {
        self.ends.len()
    }

    /// Whether there is no value.
    pub fn is_empty(&self) -> bool {
        self.ends.is_empty()
    }
}

/// Room for the values of one column, for as many rows as the plan's bound.
#[derive(Debug)]
#[allow(
    missing_docs,
    reason = "the names are those of the types; Bool and U8 are U8"
)]
pub enum ColumnMut<'a> {
    F64(&'a mut [f64]),
    F32(&'a mut [f32]),
    I64(&'a mut [i64]),
    I32(&'a mut [i32]),
    I16(&'a mut [i16]),
    I8(&'a mut [i8]),
    U64(&'a mut [u64]),
    U32(&'a mut [u32]),
    U16(&'a mut [u16]),
    U8(&'a mut [u8]),
    Text(TextMut<'a>),
}

/// Room for the words of one column.
#[derive(Debug)]
pub struct TextMut<'a> {
    /// One more than there are rows; the first is set to 0.
    offsets: &'a mut [u64],
    bytes: &'a mut [u8],
    rows: usize,
    used: usize,
}

impl<'a> TextMut<'a> {
    /// Room in a host's column.
    pub fn new(offsets: &'a mut [u64], bytes: &'a mut [u8]) -> TextMut<'a> {
        if let Some(first) = offsets.first_mut() {
            *first = 0;
        }
        TextMut {
            offsets,
            bytes,
            rows: 0,
            used: 0,
        }
    }

    /// Puts words behind those that are there; `false` when there is no room.
    pub fn append(&mut self, words: &Words) -> bool {
        let end = self.used + words.bytes.len();
        let from = self.rows + 1;
        let (Some(bytes), Some(offsets)) = (
            self.bytes.get_mut(self.used..end),
            self.offsets.get_mut(from..from + words.ends.len()),
        ) else {
            return false;
        };
        bytes.copy_from_slice(&words.bytes);
        for (offset, end) in offsets.iter_mut().zip(&words.ends) {
            *offset = self.used as u64 + end;
        }
        self.used = end;
        self.rows += words.ends.len();
        true
    }
}

macro_rules! for_each_slice {
    ($column:expr, $slots:ident => $do:expr, $words:ident => $text:expr) => {
        match $column {
            ColumnMut::F64($slots) => ColumnMut::F64($do),
            ColumnMut::F32($slots) => ColumnMut::F32($do),
            ColumnMut::I64($slots) => ColumnMut::I64($do),
            ColumnMut::I32($slots) => ColumnMut::I32($do),
            ColumnMut::I16($slots) => ColumnMut::I16($do),
            ColumnMut::I8($slots) => ColumnMut::I8($do),
            ColumnMut::U64($slots) => ColumnMut::U64($do),
            ColumnMut::U32($slots) => ColumnMut::U32($do),
            ColumnMut::U16($slots) => ColumnMut::U16($do),
            ColumnMut::U8($slots) => ColumnMut::U8($do),
            ColumnMut::Text($words) => ColumnMut::Text($text),
        }
    };
}

impl<'a> ColumnMut<'a> {
    /// The same room for a shorter time.
    pub fn reborrow(&mut self) -> ColumnMut<'_> {
        for_each_slice!(self, s => &mut **s, t => TextMut::new(t.offsets, t.bytes))
    }

    /// Splits off room for the next `rows` rows; `None` when there is less.
    pub fn split(&mut self, rows: usize) -> Option<Part<'a>> {
        Some(match self {
            ColumnMut::F64(s) => Part::F64(s.split_off_mut(..rows)?),
            ColumnMut::F32(s) => Part::F32(s.split_off_mut(..rows)?),
            ColumnMut::I64(s) => Part::I64(s.split_off_mut(..rows)?),
            ColumnMut::I32(s) => Part::I32(s.split_off_mut(..rows)?),
            ColumnMut::I16(s) => Part::I16(s.split_off_mut(..rows)?),
            ColumnMut::I8(s) => Part::I8(s.split_off_mut(..rows)?),
            ColumnMut::U64(s) => Part::U64(s.split_off_mut(..rows)?),
            ColumnMut::U32(s) => Part::U32(s.split_off_mut(..rows)?),
            ColumnMut::U16(s) => Part::U16(s.split_off_mut(..rows)?),
            ColumnMut::U8(s) => Part::U8(s.split_off_mut(..rows)?),
            ColumnMut::Text(_) => Part::Text(Words::default()),
        })
    }
}
