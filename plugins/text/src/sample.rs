//! What the values of a sample of rows look like, column by column.

use crate::dialect::Dialect;
use crate::encoding::Source;
use crate::number::{self, Number};
use crate::record;
use crate::sniff::HEAD;
use puncta_sdk::{Failure, FailureCode};

/// Places in the file that are looked at besides its start, and bytes at each.
const PLACES: u64 = 8;
const PLACE: usize = 16 << 10;

/// Counts of one column.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Tally {
    /// Values that are numbers.
    pub numbers: u64,
    /// Values that are neither numbers nor missing.
    pub words: u64,
    /// Empty values, and NaN.
    pub missing: u64,
    /// Those of them that say it in a word, such as None.
    pub nothing: u64,
    /// All numbers are whole.
    pub whole: bool,
    /// The lowest whole number.
    pub low: i64,
    /// The highest whole number.
    pub high: i64,
    /// A number is below 1.
    pub below_one: bool,
}

impl Default for Tally {
    fn default() -> Tally {
        Tally {
            numbers: 0,
            words: 0,
            missing: 0,
            nothing: 0,
            whole: true,
            low: 0,
            high: 0,
            below_one: false,
        }
    }
}

impl Tally {
    fn add(&mut self, text: &[u8], quoted: bool, point: u8) {
        match number::general(text, point, 0) {
            None => self.words += 1,
            Some(Number::Special(v)) if v.is_nan() && quoted && !text.is_empty() => self.words += 1,
            Some(Number::Special(v)) if v.is_nan() => {
                self.missing += 1;
                let words: [&[u8]; 2] = [b"none", b"null"];
                self.nothing += u64::from(words.iter().any(|w| text.eq_ignore_ascii_case(w)));
            }
            Some(Number::Decimal(d)) => {
                self.numbers += 1;
                self.below_one |= d.negative || d.mantissa == 0;
                match d.whole() {
                    Some(v) => {
                        self.low = self.low.min(v);
                        self.high = self.high.max(v);
                    }
                    None => self.whole = false,
                }
            }
            Some(_) => {
                self.numbers += 1;
                self.whole = false;
            }
        }
    }
}

/// Counts of all columns, and the length of an average row in bytes.
#[derive(Debug, Clone, PartialEq)]
pub struct Sample {
    /// One entry a column of the file.
    pub tallies: Vec<Tally>,
    /// Mean length of a row with its line end.
    pub line_bytes: f64,
}

/// Looks at the start of the data and at a few places behind it.
pub fn sample(source: &dyn Source, end: u64, dialect: &Dialect) -> Result<Sample, Failure> {
    let mut sample = Counter::new(dialect);
    let first = dialect.data_start;
    sample.window(source, first, end, HEAD)?;
    let behind = end.saturating_sub(first + HEAD as u64);
    if behind > PLACES * PLACE as u64 {
        for place in 1..=PLACES {
            let at = first + HEAD as u64 + (behind - PLACE as u64) / PLACES * place;
            sample.window(source, at.min(end - PLACE as u64), end, PLACE)?;
        }
    }
    let line_bytes = sample.bytes as f64 / (sample.rows.max(1)) as f64;
    Ok(Sample {
        tallies: sample.tallies,
        line_bytes,
    })
}

struct Counter<'a> {
    dialect: &'a Dialect,
    tallies: Vec<Tally>,
    rows: u64,
    bytes: u64,
}

impl<'a> Counter<'a> {
    fn new(dialect: &'a Dialect) -> Counter<'a> {
        let tallies = vec![Tally::default(); dialect.names.len()];
        Counter {
            dialect,
            tallies,
            rows: 0,
            bytes: 0,
        }
    }

    fn window(
        &mut self,
        source: &dyn Source,
        at: u64,
        end: u64,
        size: usize,
    ) -> Result<(), Failure> {
        let size = usize::try_from(end.saturating_sub(at))
            .unwrap_or(size)
            .min(size);
        let mut bytes = vec![0; size];
        let got = source.read_at(at, &mut bytes).map_err(|e| {
            Failure::new(
                FailureCode::Io,
                format!("{} cannot be read at byte {at}: {e}", self.dialect.file),
            )
        })?;
        bytes.truncate(got);
        let inside = at > self.dialect.data_start;
        let partial = at + (got as u64) < end;
        for line in record::lines(&bytes, self.dialect.line_end).skip(usize::from(inside)) {
            if !(partial && line.next >= bytes.len()) {
                self.line(line);
            }
        }
        Ok(())
    }

    fn line(&mut self, line: record::Line<'_>) {
        let text = record::trim(line.text);
        if text.is_empty() || text.first() == Some(&b'#') {
            return;
        }
        let fields = record::split(line.text, self.dialect.delimiter);
        let extra = usize::from(self.dialect.trailing);
        if fields.len() < self.tallies.len() || fields.len() > self.tallies.len() + extra {
            return;
        }
        self.rows += 1;
        self.bytes += (line.next - line.start) as u64;
        for (tally, field) in self.tallies.iter_mut().zip(&fields) {
            tally.add(&field.text, field.quoted, self.dialect.point);
        }
    }
}
