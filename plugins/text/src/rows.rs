//! Rows of text into columns: the inner loop.

use crate::number;
use crate::options::Delimiter;
use crate::record;
use crate::schema::Kind;
use crate::sink::Sink;

/// Room behind the data of a buffer that may be read (and is never taken as data).
pub const PADDING: usize = 64;

/// Why a row could not be taken.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Problem {
    /// This text is no number.
    NotNumber(Vec<u8>),
    /// The row has another number of values.
    Count(usize),
    /// A quote is not closed on its line.
    OpenQuote,
    /// Something stands behind a closing quote.
    BehindQuote,
    /// The value needs another type.
    Needs(Kind),
    /// The value does not fit in the type that the file says.
    Misfit(Vec<u8>),
    /// A frame 0 where frames should count from 1.
    FrameZero,
}

/// A problem with its place.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Fault {
    /// Line ends between the start of the piece and the row.
    pub lines: u64,
    /// Index of the field.
    pub field: usize,
    /// What it is.
    pub problem: Problem,
}

/// How rows are written.
#[derive(Debug, Clone, Copy)]
pub struct Layout {
    /// Between values.
    pub delimiter: Delimiter,
    /// Decimal point.
    pub point: u8,
    /// Last byte of a line end.
    pub line_end: u8,
    /// An empty value may stand behind the last one.
    pub trailing: bool,
    /// Lines that start with `#` are comments.
    pub comments: bool,
    /// Quoted values may hold line ends.
    pub multiline: bool,
}

/// A piece of text: whole rows in `bytes[..end]`, the last one with its line end, and at least
/// [`PADDING`] bytes behind.
#[derive(Debug, Clone, Copy)]
pub struct Piece<'b> {
    /// The text.
    pub bytes: &'b [u8],
    /// Where it ends.
    pub end: usize,
    /// How it is written.
    pub layout: Layout,
}

impl Piece<'_> {
    #[inline(always)]
    fn byte(&self, at: usize) -> u8 {
        self.bytes.get(at).copied().unwrap_or(0)
    }

    /// Where the next line starts, if the one at `at` is blank or a comment.
    #[inline(always)]
    fn skipped(&self, at: usize) -> Option<usize> {
        if self.byte(at) > b'#' {
            None
        } else {
            self.skipped_slowly(at)
        }
    }

    fn skipped_slowly(&self, at: usize) -> Option<usize> {
        let mut at = record::skip_blanks(self.bytes, at, self.layout.delimiter);
        while self.byte(at) == b'\r' && self.layout.line_end != b'\r' {
            at += 1;
        }
        match self.byte(at) {
            byte if byte == self.layout.line_end => Some(at + 1),
            b'#' if self.layout.comments => Some(self.line_end(at) + 1),
            _ => None,
        }
    }

    /// The place of the line end at or behind `at`.
    fn line_end(&self, at: usize) -> usize {
        let rest = self.bytes.get(at..self.end).unwrap_or(&[]);
        memchr::memchr(self.layout.line_end, rest).map_or(self.end, |i| at + i)
    }

    /// The number of rows and of line ends from `start`, where no value holds a line end.
    pub fn count(&self, start: usize) -> (usize, u64) {
        let (mut rows, mut lines) = (0, 0);
        let mut at = start;
        while at < self.end {
            at = match self.skipped(at) {
                Some(next) => next,
                None => {
                    rows += 1;
                    self.line_end(at) + 1
                }
            };
            lines += 1;
        }
        (rows, lines)
    }

    /// The number of rows and of line ends, and the end of the last whole row, where values in
    /// quotes may hold line ends.
    pub fn count_quoted(&self, start: usize) -> (usize, u64, usize) {
        let (mut rows, mut lines, mut at) = (0, 0, start);
        while at < self.end {
            let skipped = self.skipped(at);
            let Some(next) = skipped.or_else(|| self.row_end(at)) else {
                break;
            };
            let row = self.bytes.get(at..next).unwrap_or(&[]);
            lines += memchr::memchr_iter(self.layout.line_end, row).count() as u64;
            rows += usize::from(skipped.is_none());
            at = next;
        }
        (rows, lines, at)
    }

    /// Behind the line end of the row at `at`, past line ends in quotes.
    fn row_end(&self, at: usize) -> Option<usize> {
        let text = self.bytes.get(..self.end)?;
        let (delimiter, line_end) = (self.layout.delimiter, self.layout.line_end);
        let mut at = at;
        loop {
            at = record::skip_blanks(text, at, delimiter);
            if text.get(at) == Some(&b'"') {
                at = record::unquote(text, at)?.1;
            }
            at += self.stop(text.get(at..)?)?;
            if text.get(at) == Some(&line_end) {
                return Some(at + 1);
            }
            at += 1;
        }
    }

    /// The first delimiter or line end.
    #[inline(always)]
    fn stop(&self, text: &[u8]) -> Option<usize> {
        match self.layout.delimiter {
            Delimiter::Byte(byte) => memchr::memchr2(byte, self.layout.line_end, text),
            Delimiter::Blanks => memchr::memchr3(b' ', b'\t', self.layout.line_end, text),
        }
    }

    /// Takes all rows from `start`; returns their number.
    pub fn take(&self, start: usize, sinks: &mut [Sink<'_>]) -> Result<usize, Fault> {
        let (mut at, mut row, mut lines) = (start, 0, 0);
        let last = sinks.len().wrapping_sub(1);
        while at < self.end {
            if let Some(next) = self.skipped(at) {
                at = next;
                lines += 1;
                continue;
            }
            let begin = at;
            for (field, sink) in sinks.iter_mut().enumerate() {
                at = match self.value(at, field == last, row, sink) {
                    Ok(next) => next,
                    Err(problem) => {
                        let problem = match problem {
                            Problem::Count(_) => Problem::Count(self.fields(begin)),
                            other => other,
                        };
                        return Err(Fault {
                            lines,
                            field,
                            problem,
                        });
                    }
                };
            }
            row += 1;
            lines += 1;
            if self.layout.multiline {
                let text = self.bytes.get(begin..at.saturating_sub(1)).unwrap_or(&[]);
                lines += memchr::memchr_iter(self.layout.line_end, text).count() as u64;
            }
        }
        Ok(row)
    }

    /// The number of values in the row at `at`.
    fn fields(&self, at: usize) -> usize {
        let line = self.bytes.get(at..self.line_end(at)).unwrap_or(&[]);
        let fields = record::split(record::trim(line), self.layout.delimiter);
        fields.len()
    }

    /// Takes one value; returns where the next one starts.
    #[inline(always)]
    fn value(
        &self,
        at: usize,
        last: bool,
        row: usize,
        sink: &mut Sink<'_>,
    ) -> Result<usize, Problem> {
        let window = self.bytes.get(at..).and_then(|rest| rest.first_chunk());
        if let Some((decimal, len)) = window.and_then(|w| number::short(w, self.layout.point)) {
            let stop = at + len;
            let byte = self.byte(stop);
            let next = if last {
                if byte == self.layout.line_end {
                    stop + 1
                } else if byte == b'\r' && self.byte(stop + 1) == self.layout.line_end {
                    stop + 2
                } else {
                    0
                }
            } else if Delimiter::Byte(byte) == self.layout.delimiter {
                stop + 1
            } else {
                0
            };
            if next != 0 && sink.put(row, decimal) {
                return Ok(next);
            }
        }
        self.value_slowly(at, last, row, sink)
    }

    #[inline(never)]
    fn value_slowly(
        &self,
        at: usize,
        last: bool,
        row: usize,
        sink: &mut Sink<'_>,
    ) -> Result<usize, Problem> {
        let text = self.bytes.get(..self.end).unwrap_or(&[]);
        let start = record::skip_blanks(text, at, self.layout.delimiter);
        if text.get(start) == Some(&b'"') {
            return self.quoted(start, last, row, sink);
        }
        let rest = text.get(start..).unwrap_or(&[]);
        let stop = start + self.stop(rest).unwrap_or(rest.len());
        let value = record::trim(text.get(start..stop).unwrap_or(&[]));
        if value.is_empty() && self.layout.delimiter == Delimiter::Blanks {
            return Err(Problem::Count(0));
        }
        let next = self.behind(stop, last)?;
        sink.take(row, value, self.layout.point)?;
        Ok(next)
    }

    fn quoted(
        &self,
        start: usize,
        last: bool,
        row: usize,
        sink: &mut Sink<'_>,
    ) -> Result<usize, Problem> {
        let text = self.bytes.get(..self.end).unwrap_or(&[]);
        let line = if self.layout.multiline {
            self.end
        } else {
            self.line_end(start)
        };
        let text = text
            .get(..line + usize::from(line < self.end))
            .unwrap_or(text);
        let (value, close) = record::unquote(text, start).ok_or(Problem::OpenQuote)?;
        let rest = text.get(close..).unwrap_or(&[]);
        let stop = close + self.stop(rest).unwrap_or(rest.len());
        if !record::trim(text.get(close..stop).unwrap_or(&[])).is_empty() {
            return Err(Problem::BehindQuote);
        }
        let next = self.behind(stop, last)?;
        sink.take(row, &value, self.layout.point)?;
        Ok(next)
    }

    /// Where the next value or row starts, when a value stops at `stop`.
    fn behind(&self, stop: usize, last: bool) -> Result<usize, Problem> {
        let line_end = self.layout.line_end;
        let ends = |at: usize| at >= self.end || self.byte(at) == line_end;
        let next = match self.layout.delimiter {
            _ if ends(stop) => stop,
            Delimiter::Byte(_) => stop + 1,
            Delimiter::Blanks => {
                let mut at = record::skip_blanks(self.bytes, stop, Delimiter::Blanks);
                while self.byte(at) == b'\r' && line_end != b'\r' {
                    at += 1;
                }
                at
            }
        };
        let over = ends(stop) || self.layout.delimiter == Delimiter::Blanks && ends(next);
        if over {
            return if last {
                Ok(next + 1)
            } else {
                Err(Problem::Count(0))
            };
        }
        if !last {
            return Ok(next);
        }
        let end = self.line_end(next);
        let rest = self.bytes.get(next..end).unwrap_or(&[]);
        if self.layout.trailing && record::trim(rest).is_empty() {
            return Ok(end + 1);
        }
        Err(Problem::Count(0))
    }
}

#[cfg(test)]
#[path = "rows_tests.rs"]
mod tests;
