//! A file opened as a table: its dialect and the plan of its columns.

use crate::columns::ColumnMut;
use crate::dialect::Dialect;
use crate::encoding::{self, Encoding, FileSource, Source};
use crate::flavours::Flavour;
use crate::footer;
use crate::mapping;
use crate::options::Options;
use crate::rapidstorm;
use crate::read::{self, Commit, Input, Stop};
use crate::sample;
use crate::schema::Plan;
use crate::sniff::{self, HEAD};
use crate::tagged;
use puncta_sdk::run::Run;
use puncta_sdk::{Failure, FailureCode};
use std::path::Path;

/// A file whose head was looked at.
pub struct Table {
    source: Box<dyn Source>,
    end: u64,
    held: u64,
    settings: Vec<(String, String)>,
    /// How the file is written.
    pub dialect: Dialect,
    /// The columns that reading will give.
    pub plan: Plan,
}

impl Table {
    /// Looks at the head of a file and at a few places in it.
    pub fn open(path: &Path, name: &str, options: &Options) -> Result<Table, Failure> {
        let fail = |e: std::io::Error| Failure::io("open", path, &e);
        let file = std::fs::File::open(path).map_err(fail)?;
        if file.metadata().map_err(fail)?.is_dir() {
            return Err(
                Failure::bad_file(format!("{name} is a folder")).remedy("choose a file in it")
            );
        }
        let source = FileSource::new(file).map_err(fail)?;
        Table::from_source(Box::new(source), name, options)
    }

    /// The same for bytes from anywhere.
    pub fn from_source(
        source: Box<dyn Source>,
        name: &str,
        options: &Options,
    ) -> Result<Table, Failure> {
        let head = bytes(source.as_ref(), 0, HEAD, name)?;
        if let Some(flat) = flattened(source.as_ref(), &head, name)? {
            let held = flat.len() as u64;
            let head = flat.get(..HEAD).unwrap_or(&flat);
            let dialect = sniff::sniff_with(head, name, options)?;
            let mut table = Table::planned(Box::new(flat), dialect, options)?;
            table.held = held;
            return Ok(table);
        }
        let dialect = sniff::sniff_with(&head, name, options)?;
        if dialect.encoding != Encoding::Bytes {
            // Transcoded as a whole: such files are small exports, and pieces of one start anywhere.
            let len = usize::try_from(source.len()).unwrap_or(usize::MAX);
            let all = bytes(source.as_ref(), 0, len, name)?;
            let (_, mark) = encoding::detect(&all);
            let text = encoding::from_utf16(all.get(mark..).unwrap_or(&[]), dialect.encoding);
            let dialect = Dialect {
                encoding: dialect.encoding,
                ..dialect
            };
            let held = 2 * text.len() as u64;
            let mut table = Table::planned(Box::new(text), dialect, options)?;
            table.held = held;
            return Ok(table);
        }
        Table::planned(source, dialect, options)
    }

    fn planned(
        source: Box<dyn Source>,
        dialect: Dialect,
        options: &Options,
    ) -> Result<Table, Failure> {
        let mut end = source.len();
        let mut settings = Vec::new();
        if dialect.flavour == Flavour::Elyra {
            end = footer::start(source.as_ref(), &dialect)?;
            settings = footer::settings(&bytes(source.as_ref(), end, footer::MOST, &dialect.file)?);
        }
        let start = dialect.data_start.min(end);
        let dialect = Dialect {
            data_start: start,
            ..dialect
        };
        let sample = sample::sample(source.as_ref(), end, &dialect)?;
        let plan = mapping::plan(
            &dialect,
            &sample.tallies,
            end - start,
            sample.line_bytes,
            options,
        )?;
        Ok(Table {
            source,
            end,
            held: 0,
            settings,
            dialect,
            plan,
        })
    }

    /// Whether the table has this column.
    pub fn has(&self, name: &str) -> bool {
        self.plan.columns.iter().any(|c| c.name == name)
    }

    /// Bytes of the file that are held in memory as a whole.
    pub fn copied_bytes(&self) -> u64 {
        self.held
    }

    /// Settings of the microscope that stand behind the table.
    pub fn settings(&self) -> &[(String, String)] {
        &self.settings
    }

    /// No column of words has more bytes of UTF-8.
    pub fn text_room(&self) -> u64 {
        // A byte of Latin-1 becomes two.
        2 * (self.end - self.dialect.data_start)
    }

    /// Reads all rows. On [`Stop::Replan`] apply the change to `plan`, make columns anew, and read
    /// again.
    pub fn read(
        &self,
        columns: &mut [ColumnMut<'_>],
        run: &dyn Run,
        commit: Commit<'_>,
    ) -> Result<u64, Stop> {
        let input = Input {
            source: self.source.as_ref(),
            end: self.end,
            dialect: &self.dialect,
        };
        read::read(input, &self.plan, columns, run, commit)
    }
}

pub(crate) fn bytes(
    source: &dyn Source,
    at: u64,
    count: usize,
    name: &str,
) -> Result<Vec<u8>, Failure> {
    let left = usize::try_from(source.len().saturating_sub(at)).unwrap_or(usize::MAX);
    let mut bytes = vec![0; count.min(left)];
    let got = source
        .read_at(at, &mut bytes)
        .map_err(|e| Failure::new(FailureCode::Io, format!("{name} cannot be read: {e}")))?;
    bytes.truncate(got);
    Ok(bytes)
}

/// The bytes of a file whose rows are no plain table, as one; `None` for all other files. Such
/// files are held in memory as a whole.
fn flattened(source: &dyn Source, head: &[u8], name: &str) -> Result<Option<Vec<u8>>, Failure> {
    let len = usize::try_from(source.len()).unwrap_or(usize::MAX);
    if tagged::is_tagged(head) {
        return tagged::plain(&bytes(source, 0, len, name)?, name).map(Some);
    }
    let first = head.split(|b| *b == b'\n').next().unwrap_or(&[]);
    let line = first.strip_prefix(b"#").unwrap_or(first).trim_ascii();
    if !line.starts_with(rapidstorm::START) {
        return Ok(None);
    }
    let fields = rapidstorm::fields(line, name)?;
    if fields.inner.is_none() {
        return Ok(None);
    }
    let rows = rapidstorm::flat(&bytes(source, 0, len, name)?, &fields, name)?;
    Ok(Some([first, b"\n", &rows].concat()))
}
