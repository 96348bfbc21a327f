//! Where in a recipe something stands, and what is wrong there.

use puncta_documents::Failure;
use std::fmt;

/// A place in a recipe's text, both counted from 1; the column in characters.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Place {
    /// Line.
    pub line: u32,
    /// Column.
    pub column: u32,
}

/// The part of a recipe that a problem belongs to.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Subject {
    /// The text as a whole.
    Recipe,
    /// An input.
    Input(String),
    /// A step.
    Step(String),
    /// A file to write.
    Output(String),
}

/// Something wrong in a recipe. Its text is one sentence with place and remedy.
#[derive(Clone, Debug, PartialEq)]
pub struct Problem {
    /// Where.
    pub place: Place,
    /// What it belongs to.
    pub subject: Subject,
    /// What, and what to do.
    pub failure: Failure,
}

impl Problem {
    pub(crate) fn new(place: Place, subject: Subject, failure: Failure) -> Problem {
        Problem {
            place,
            subject,
            failure,
        }
    }
}

impl fmt::Display for Problem {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Place { line, column } = self.place;
        write!(f, "line {line}, column {column}: {}", self.failure)
    }
}

impl std::error::Error for Problem {}

/// Characters between two checkpoints.
const BLOCK: usize = 64;

/// Turns byte offsets into places in constant time, however long a line is.
pub(crate) struct Lines<'a> {
    text: &'a str,
    starts: Vec<usize>,
    /// Characters before each multiple of `BLOCK` bytes.
    counts: Vec<usize>,
}

impl<'a> Lines<'a> {
    pub fn new(text: &'a str) -> Lines<'a> {
        let newlines = text.bytes().enumerate().filter(|(_, byte)| *byte == b'\n');
        let starts = std::iter::once(0)
            .chain(newlines.map(|(at, _)| at + 1))
            .collect();
        let mut counts = Vec::with_capacity(text.len() / BLOCK + 1);
        let mut count = 0;
        for block in text.as_bytes().chunks(BLOCK) {
            counts.push(count);
            count += characters(block);
        }
        counts.push(count);
        Lines {
            text,
            starts,
            counts,
        }
    }

    pub fn place(&self, offset: usize) -> Place {
        let offset = offset.min(self.text.len());
        let line = self.starts.partition_point(|start| *start <= offset).max(1);
        let start = self.starts.get(line - 1).copied().unwrap_or(0);
        let column = self.before(offset).saturating_sub(self.before(start)) + 1;
        let short = |number: usize| u32::try_from(number).unwrap_or(u32::MAX);
        Place {
            line: short(line),
            column: short(column),
        }
    }

    fn before(&self, offset: usize) -> usize {
        let block = offset / BLOCK;
        let rest = self
            .text
            .as_bytes()
            .get(block * BLOCK..offset)
            .unwrap_or(&[]);
        self.counts.get(block).copied().unwrap_or(0) + characters(rest)
    }
}

/// First bytes of UTF-8 characters.
fn characters(bytes: &[u8]) -> usize {
    bytes.iter().filter(|byte| **byte & 0xc0 != 0x80).count()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_count_lines_and_characters() {
        let long = "\u{b5}".repeat(3000);
        let text = format!("a\n{long}x\n");
        let lines = Lines::new(&text);
        assert_eq!(lines.place(0), Place { line: 1, column: 1 });
        assert_eq!(lines.place(1), Place { line: 1, column: 2 });
        assert_eq!(lines.place(2), Place { line: 2, column: 1 });
        assert_eq!(
            lines.place(2 + 6000),
            Place {
                line: 2,
                column: 3001
            }
        );
        assert_eq!(lines.place(text.len()), Place { line: 3, column: 1 });
        assert_eq!(lines.place(usize::MAX), Place { line: 3, column: 1 });
        assert_eq!(Lines::new("").place(0), Place { line: 1, column: 1 });
    }
}
