//! Words of a text file.

use puncta_sdk::Failure;

/// Words of a text, one after the other.
#[derive(Clone, Debug)]
pub struct Words<'a> {
    bytes: &'a [u8],
    at: usize,
}

impl<'a> Words<'a> {
    /// The words from byte `at` on.
    #[must_use]
    pub fn new(bytes: &'a [u8], at: usize) -> Words<'a> {
        Words { bytes, at }
    }

    /// Bytes that are left.
    #[must_use]
    pub fn left(&self) -> usize {
        self.bytes.len() - self.at.min(self.bytes.len())
    }

    /// The number of the line, from 1.
    #[must_use]
    pub fn line(&self) -> usize {
        let read = &self.bytes[..self.at.min(self.bytes.len())];
        read.iter().filter(|byte| **byte == b'\n').count() + 1
    }

    /// The next number.
    ///
    /// # Errors
    /// When the text ends, or the word is no number.
    pub fn number(&mut self, what: &str) -> Result<f64, Failure> {
        let Some(word) = self.next() else {
            let message = format!("line {} ends within {what}", self.line());
            return Err(Failure::bad_file(message).remedy("get a whole copy of the file"));
        };
        number(word).ok_or_else(|| {
            let (line, word) = (self.line(), shown(word));
            Failure::bad_file(format!("\"{word}\" in line {line} ({what}) is no number"))
        })
    }
}

impl<'a> Iterator for Words<'a> {
    type Item = &'a [u8];

    fn next(&mut self) -> Option<&'a [u8]> {
        let rest = self.bytes.get(self.at..)?;
        let begin = rest.iter().position(|byte| !byte.is_ascii_whitespace())?;
        let word = &rest[begin..];
        let end = word
            .iter()
            .position(u8::is_ascii_whitespace)
            .unwrap_or(word.len());
        self.at += begin + end;
        Some(&word[..end])
    }
}

/// The number that a word is.
#[must_use]
pub fn number(word: &[u8]) -> Option<f64> {
    std::str::from_utf8(word).ok()?.parse().ok()
}

/// A word for a message: its beginning, without what cannot be printed.
#[must_use]
pub fn shown(word: &[u8]) -> String {
    let text = String::from_utf8_lossy(&word[..word.len().min(24)]);
    text.chars().filter(|c| !c.is_control()).collect()
}

/// Lines without their ends, with the byte at which the next begins.
pub fn lines(bytes: &[u8]) -> impl Iterator<Item = (&[u8], usize)> {
    let mut at = 0;
    std::iter::from_fn(move || {
        let rest = bytes.get(at..).filter(|rest| !rest.is_empty())?;
        let end = rest.iter().position(|byte| *byte == b'\n');
        let line = &rest[..end.unwrap_or(rest.len())];
        at += end.map_or(rest.len(), |end| end + 1);
        Some((line.strip_suffix(b"\r").unwrap_or(line), at))
    })
}
