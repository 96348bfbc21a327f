//! Columns into text, on all threads, written in order.

use crate::options::Delimiter;
use puncta_sdk::Failure;
use puncta_sdk::input::ColumnRef;
use puncta_sdk::run::Run;
use std::io::{self, Write};
use std::ops::Range;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};

/// Rows that one thread formats at a time.
const ROWS: usize = 8 << 10;

/// A column of the file to be.
#[derive(Debug, Clone)]
pub struct Column<'a> {
    /// Its name as it stands in the header.
    pub name: String,
    /// Its values, `width` a row.
    pub values: ColumnRef<'a>,
    /// Values a row.
    pub width: usize,
    /// Which of them this column takes.
    pub part: usize,
    /// Added to each number.
    pub base: i32,
}

/// Why a table could not be written.
#[derive(Debug)]
pub enum WriteError {
    /// The disk refused.
    Io(io::Error),
    /// The person cancelled.
    Cancelled,
}

impl WriteError {
    /// For the person.
    pub fn failure(self, path: &std::path::Path) -> Failure {
        match self {
            WriteError::Io(error) => Failure::io("write", path, &error),
            WriteError::Cancelled => Failure::cancelled(),
        }
    }
}

/// The byte between values.
pub fn byte(delimiter: Delimiter) -> u8 {
    match delimiter {
        Delimiter::Byte(byte) => byte,
        Delimiter::Blanks => b' ',
    }
}

/// Whose turn it is to write.
struct Turn<'o> {
    block: usize,
    out: &'o mut (dyn Write + Send),
    end: Option<WriteError>,
}

/// What all threads share.
struct Writing<'w, 'o> {
    columns: &'w [Column<'w>],
    rows: usize,
    delimiter: u8,
    run: &'w dyn Run,
    next: AtomicUsize,
    turn: Mutex<Turn<'o>>,
    turned: Condvar,
}

/// Writes `head`, then `rows` rows.
pub fn write(
    out: &mut (dyn Write + Send),
    head: &str,
    columns: &[Column<'_>],
    rows: usize,
    delimiter: u8,
    run: &dyn Run,
) -> Result<(), WriteError> {
    out.write_all(head.as_bytes()).map_err(WriteError::Io)?;
    let writing = Writing {
        columns,
        rows,
        delimiter,
        run,
        next: AtomicUsize::new(0),
        turn: Mutex::new(Turn {
            block: 0,
            out,
            end: None,
        }),
        turned: Condvar::new(),
    };
    let blocks = rows.div_ceil(ROWS).max(1);
    run.parallel(run.threads().clamp(1, blocks), &|_| writing.work());
    let turn = writing
        .turn
        .into_inner()
        .unwrap_or_else(PoisonError::into_inner);
    match turn.end {
        Some(end) => Err(end),
        None => turn.out.flush().map_err(WriteError::Io),
    }
}

impl<'o> Writing<'_, 'o> {
    fn lock(&self) -> MutexGuard<'_, Turn<'o>> {
        self.turn.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// One thread's work: formats blocks and writes each in its turn.
    fn work(&self) {
        let mut text = Vec::new();
        loop {
            let block = self.next.fetch_add(1, Ordering::Relaxed);
            let first = block.saturating_mul(ROWS);
            if first >= self.rows || self.lock().end.is_some() {
                return;
            }
            text.clear();
            self.format(&mut text, first..self.rows.min(first + ROWS));
            let mut turn = self.lock();
            while turn.block != block && turn.end.is_none() {
                turn = self
                    .turned
                    .wait(turn)
                    .unwrap_or_else(PoisonError::into_inner);
            }
            if turn.end.is_none() {
                let written = turn.out.write_all(&text).map_err(WriteError::Io);
                let fraction = (first + ROWS).min(self.rows) as f64 / self.rows as f64;
                let told = self.run.progress(fraction, "Writing");
                turn.end = written.and(told.map_err(|_| WriteError::Cancelled)).err();
                turn.block += 1;
            }
            drop(turn);
            self.turned.notify_all();
        }
    }

    fn format(&self, text: &mut Vec<u8>, rows: Range<usize>) {
        for row in rows {
            for (i, column) in self.columns.iter().enumerate() {
                if i > 0 {
                    text.push(self.delimiter);
                }
                value(text, column, row, self.delimiter);
            }
            text.push(b'\n');
        }
    }
}

fn value(text: &mut Vec<u8>, column: &Column<'_>, row: usize, delimiter: u8) {
    let at = row * column.width + column.part;
    macro_rules! whole {
        ($values:expr) => {
            integer(text, $values.get(at).map(|v| i128::from(*v)), column.base)
        };
    }
    match column.values {
        ColumnRef::F64(v) => double(text, v.get(at).copied(), column.base),
        ColumnRef::F32(v) => single(text, v.get(at).copied(), column.base),
        ColumnRef::U8(v) | ColumnRef::Bool(v) => whole!(v),
        ColumnRef::I8(v) => whole!(v),
        ColumnRef::U16(v) => whole!(v),
        ColumnRef::I16(v) => whole!(v),
        ColumnRef::U32(v) => whole!(v),
        ColumnRef::I32(v) => whole!(v),
        ColumnRef::U64(v) => whole!(v),
        ColumnRef::I64(v) => whole!(v),
        ColumnRef::Utf8(texts) => quote(text, texts.get(row), delimiter),
        ColumnRef::Dictionary(codes, texts) => {
            let code = codes.get(row).map_or(usize::MAX, |code| *code as usize);
            quote(text, texts.get(code), delimiter);
        }
    }
}

fn integer(text: &mut Vec<u8>, value: Option<i128>, base: i32) {
    let value = value.unwrap_or(0) + i128::from(base);
    match i64::try_from(value) {
        Ok(value) => text.extend_from_slice(itoa::Buffer::new().format(value).as_bytes()),
        Err(_) => text.extend_from_slice(itoa::Buffer::new().format(value).as_bytes()),
    }
}

/// The fewest digits that give the same number again.
fn double(text: &mut Vec<u8>, value: Option<f64>, base: i32) {
    let value = value.unwrap_or(f64::NAN);
    // Adding 0 would turn -0 into 0.
    let value = if base == 0 {
        value
    } else {
        value + f64::from(base)
    };
    match not_finite(value) {
        Some(word) => text.extend_from_slice(word.as_bytes()),
        None => text.extend_from_slice(zmij::Buffer::new().format_finite(value).as_bytes()),
    }
}

fn single(text: &mut Vec<u8>, value: Option<f32>, base: i32) {
    let value = value.unwrap_or(f32::NAN);
    let value = if base == 0 {
        value
    } else {
        value + base as f32
    };
    match not_finite(value.into()) {
        Some(word) => text.extend_from_slice(word.as_bytes()),
        None => text.extend_from_slice(zmij::Buffer::new().format_finite(value).as_bytes()),
    }
}

/// The word for a value without digits.
fn not_finite(value: f64) -> Option<&'static str> {
    if value.is_finite() {
        None
    } else if value.is_nan() {
        Some("nan")
    } else {
        Some(if value < 0.0 { "-inf" } else { "inf" })
    }
}

/// A word, in quotes where it would not come back by itself.
pub fn quote(text: &mut Vec<u8>, word: &str, delimiter: u8) {
    let bytes = word.as_bytes();
    let special = |b: &u8| matches!(b, b'"' | b'\n' | b'\r' | b'\t') || *b == delimiter;
    let edge = |b: Option<&u8>| b.is_none_or(|b| b.is_ascii_whitespace() || *b == b'#');
    if !bytes.iter().any(special) && !edge(bytes.first()) && !edge(bytes.last()) {
        text.extend_from_slice(bytes);
        return;
    }
    text.push(b'"');
    for byte in bytes {
        if *byte == b'"' {
            text.push(b'"');
        }
        text.push(*byte);
    }
    text.push(b'"');
}
