//! The settings of the microscope behind a Zeiss ELYRA table.

use crate::dialect::Dialect;
use crate::encoding::{self, Source};
use crate::piece;
use crate::table::bytes;
use puncta_sdk::Failure;

/// Bytes of settings that are read.
pub const MOST: usize = 64 << 10;

/// Where the settings start: a NUL, or a line that begins with a letter.
pub fn start(source: &dyn Source, dialect: &Dialect) -> Result<u64, Failure> {
    let mut at = dialect.data_start;
    let mut line_start = true;
    while at < source.len() {
        let piece = bytes(source, at, piece::SIZE, &dialect.file)?;
        if piece.is_empty() {
            break;
        }
        let nul = memchr::memchr(0, &piece);
        let first = line_start && piece.first().is_some_and(u8::is_ascii_alphabetic);
        let mut ends = memchr::memchr_iter(dialect.line_end, &piece).map(|i| i + 1);
        let letter = |i: &usize| piece.get(*i).is_some_and(u8::is_ascii_alphabetic);
        let words = if first { Some(0) } else { ends.find(letter) };
        if let Some(found) = nul.into_iter().chain(words).min() {
            return Ok(at + found as u64);
        }
        line_start = piece.last() == Some(&dialect.line_end);
        at += piece.len() as u64;
    }
    Ok(source.len())
}

/// `name : value` lines.
pub fn settings(bytes: &[u8]) -> Vec<(String, String)> {
    let text = encoding::text(bytes);
    let pairs = text.lines().filter_map(|line| {
        let (name, value) = line.trim_matches(['\0', ' ', '\r']).split_once(':')?;
        let (name, value) = (name.trim(), value.trim());
        (!name.is_empty() && !value.is_empty()).then(|| (name.to_owned(), value.to_owned()))
    });
    pairs.take(256).collect()
}
