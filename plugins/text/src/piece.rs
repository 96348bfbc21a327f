//! Pieces of a file that end at line ends.

use crate::encoding::Source;
use crate::rows::PADDING;
use puncta_sdk::{Failure, FailureCode};

/// Bytes of the file in one piece; small enough to stay in a core's cache between counting the
/// rows and reading the values.
pub const SIZE: usize = 1 << 20;
/// The longest line.
pub const LONGEST: usize = 16 << 20;
/// What is read at a time behind a piece to reach the end of its last line.
const STEP: usize = 16 << 10;

/// A reused buffer with one piece.
#[derive(Debug, Default)]
pub struct Buffer {
    bytes: Vec<u8>,
    len: usize,
}

impl Buffer {
    /// The data with its padding.
    pub fn bytes(&self) -> &[u8] {
        self.bytes.get(..self.len + PADDING).unwrap_or(&self.bytes)
    }

    /// Where the data ends.
    pub fn end(&self) -> usize {
        self.len
    }

    fn make_room(&mut self, more: usize) {
        let wanted = self.len + more + PADDING;
        if self.bytes.len() < wanted {
            self.bytes.resize(wanted, 0);
        }
    }

    /// Reads up to `count` bytes from `at` behind what is there.
    pub fn extend(&mut self, source: &dyn Source, at: u64, count: usize) -> Result<usize, Failure> {
        self.make_room(count);
        let room = self
            .bytes
            .get_mut(self.len..self.len + count)
            .unwrap_or(&mut []);
        match source.read_at(at, room) {
            Ok(got) if got == count => {
                self.len += got;
                Ok(got)
            }
            Ok(_) => Err(
                Failure::bad_file("the file became shorter while it was read")
                    .remedy("wait until it is written, and open it again"),
            ),
            Err(e) => Err(Failure::new(
                FailureCode::Io,
                format!("the file cannot be read at byte {at}: {e}"),
            )),
        }
    }

    /// Ends the data with a line end, if it has none.
    pub fn close(&mut self, line_end: u8) {
        if self.len > 0 && self.bytes.get(self.len - 1) != Some(&line_end) {
            self.make_room(1);
            if let Some(byte) = self.bytes.get_mut(self.len) {
                *byte = line_end;
            }
            self.len += 1;
        }
        self.pad();
    }

    /// Puts the padding behind the data.
    pub fn pad(&mut self) {
        self.make_room(0);
        if let Some(padding) = self.bytes.get_mut(self.len..self.len + PADDING) {
            padding.fill(0);
        }
    }

    /// Forgets the first `count` bytes.
    pub fn forget(&mut self, count: usize) {
        self.bytes.copy_within(count.min(self.len)..self.len, 0);
        self.len -= count.min(self.len);
    }

    /// Reads the lines that start in `from..to`. The data of the file is `first..end`. Returns
    /// where the first of these lines starts in the buffer; the buffer ends behind the last one.
    pub fn load(
        &mut self,
        source: &dyn Source,
        (first, end): (u64, u64),
        (from, to): (u64, u64),
        line_end: u8,
    ) -> Result<usize, Failure> {
        self.len = 0;
        // The byte before tells whether a line starts exactly at `from`.
        let begin = from.saturating_sub(1).max(first);
        let count = usize::try_from(to - begin).unwrap_or(SIZE);
        self.extend(source, begin, count)?;
        let data = self.bytes.get(..self.len).unwrap_or(&[]);
        let start = if from == first {
            0
        } else {
            memchr::memchr(line_end, data).map_or(self.len, |i| i + 1)
        };
        if start >= self.len {
            self.pad();
            return Ok(self.len);
        }
        let mut at = to;
        let mut complete = data.last() == Some(&line_end);
        while !complete && at < end {
            let count = usize::try_from(end - at).unwrap_or(STEP).min(STEP);
            let from = self.len;
            self.extend(source, at, count)?;
            at += count as u64;
            let tail = self.bytes.get(from..self.len).unwrap_or(&[]);
            if let Some(i) = memchr::memchr(line_end, tail) {
                self.len = from + i + 1;
                complete = true;
            } else if self.len > LONGEST {
                return Err(Failure::bad_file(format!(
                    "a line near byte {at} is longer than {} MiB: this is no text table",
                    LONGEST >> 20
                )));
            }
        }
        self.close(line_end);
        Ok(start)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_line_is_in_exactly_one_piece() {
        let mut text = Vec::new();
        for i in 0..300usize {
            text.extend_from_slice("x".repeat(i * 7 % 23).as_bytes());
            text.push(b'\n');
        }
        text.extend_from_slice(b"last line without an end");
        for size in [1u64, 2, 5, 64, 1000, 100_000] {
            let mut all = Vec::new();
            let mut buffer = Buffer::default();
            let end = text.len() as u64;
            let mut from = 3;
            while from < end {
                let to = (from + size).min(end);
                let start = buffer.load(&text, (3, end), (from, to), b'\n').unwrap();
                all.extend_from_slice(&buffer.bytes()[start..buffer.end()]);
                from = to;
            }
            assert_eq!(
                all.strip_suffix(b"\n").unwrap(),
                &text[3..],
                "pieces of {size}"
            );
        }
    }

    #[test]
    fn a_file_that_shrinks_is_an_error() {
        let text = b"1,2\n".to_vec();
        assert!(
            Buffer::default()
                .load(&text, (0, 10), (0, 10), b'\n')
                .is_err()
        );
    }
}
