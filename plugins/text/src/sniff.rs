//! Finding out how a text file is written, from its start.

use crate::decode;
use crate::dialect::Dialect;
use crate::encoding::{self, Encoding};
use crate::flavours::Flavour;
use crate::number::{self, Number};
use crate::options::{Delimiter, Options};
use crate::record::{self, Line};
use crate::schema::Kind;
use crate::wording::{count, quoted};
use puncta_sdk::{Failure, FailureCode};
use puncta_shared_import::Columns;

mod kind;

/// How much of the start of a file is looked at.
pub const HEAD: usize = 256 << 10;
/// How many lines of data are looked at for the delimiter.
const SAMPLE: usize = 40;
/// More columns than this are no table of localisations.
const COLUMNS: usize = 4096;

/// Finds out how a file is written from its first [`HEAD`] bytes (the whole file if it is shorter).
pub fn sniff(head: &[u8], file_name: &str) -> Result<Dialect, Failure> {
    sniff_with(head, file_name, &Options::default())
}

/// Like [`sniff`]; what the person says wins.
pub fn sniff_with(head: &[u8], file_name: &str, options: &Options) -> Result<Dialect, Failure> {
    let (encoding, mark) = encoding::detect(head);
    if encoding != Encoding::Bytes {
        let text = encoding::from_utf16(head.get(mark..).unwrap_or(&[]), encoding);
        let mut dialect = Head::new(&text, head.len() < HEAD, file_name, options)?.dialect()?;
        dialect.encoding = encoding;
        return Ok(dialect);
    }
    let text = head.get(mark..).unwrap_or(&[]);
    let mut dialect = Head::new(text, head.len() < HEAD, file_name, options)?.dialect()?;
    dialect.data_start += mark as u64;
    Ok(dialect)
}

/// The start of a file, in lines.
struct Head<'a> {
    file: &'a str,
    options: &'a Options,
    line_end: u8,
    comments: Vec<&'a [u8]>,
    /// The first line that is neither blank nor a comment.
    first: Line<'a>,
    /// The lines behind it that hold values.
    rest: Vec<Line<'a>>,
}

/// The names of the columns and where they stand.
struct Names {
    names: Vec<String>,
    delimiter: Delimiter,
    /// The first line that is no comment holds data.
    is_data: bool,
    /// The names are those of the last comment.
    from_hash: bool,
}

fn is_comment(line: &[u8]) -> bool {
    record::trim(line).first() == Some(&b'#')
}

impl<'a> Head<'a> {
    fn new(
        text: &'a [u8],
        whole: bool,
        file: &'a str,
        options: &'a Options,
    ) -> Result<Head<'a>, Failure> {
        let has = |byte: u8| memchr::memchr(byte, text).is_some();
        let line_end = if has(b'\r') && !has(b'\n') {
            b'\r'
        } else {
            b'\n'
        };
        let complete = if whole {
            text.len()
        } else {
            memchr::memrchr(line_end, text).map_or(0, |at| at + 1)
        };
        let skip = usize::try_from(options.skip_rows).unwrap_or(usize::MAX);
        let text = text.get(..complete).unwrap_or(text);
        let mut lines = record::lines(text, line_end).skip(skip);
        let mut comments = Vec::new();
        let first = loop {
            match lines.next() {
                None => return Err(nothing(file, whole, text, skip, &comments)),
                Some(line) if is_comment(line.text) => comments.push(line.text),
                Some(line) if record::trim(line.text).is_empty() => {}
                Some(line) => break line,
            }
        };
        let filled = |l: &Line<'_>| !record::trim(l.text).is_empty() && !is_comment(l.text);
        let rest: Vec<Line<'a>> = lines.filter(filled).take(SAMPLE).collect();
        let head = Head {
            file,
            options,
            line_end,
            comments,
            first,
            rest,
        };
        head.check_text()?;
        Ok(head)
    }

    /// Refuses bytes that are no text.
    fn check_text(&self) -> Result<(), Failure> {
        let lines = std::iter::once(&self.first).chain(&self.rest);
        for line in lines {
            let odd = |b: &u8| *b < 9 || (14..32).contains(b) && *b != 0x1a;
            if let Some(at) = line.text.iter().position(odd) {
                // ELYRA puts a NUL between the table and the settings of the microscope.
                let settings = line.text.first() == Some(&0);
                if settings && memchr::memmem::find(self.first.text, b"First Frame").is_some() {
                    break;
                }
                let message = format!(
                    "{} is no text table: byte {} of line {} is a control character",
                    self.file,
                    at + 1,
                    line.number
                );
                return Err(Failure::new(FailureCode::NotMine, message)
                    .remedy("open it with the reader of its format"));
            }
        }
        Ok(())
    }

    fn dialect(&self) -> Result<Dialect, Failure> {
        let found = match self.rapidstorm()? {
            Some(names) => names,
            None => self.names()?,
        };
        let (delimiter, is_data, from_hash) = (found.delimiter, found.is_data, found.from_hash);
        let (names, trailing) = self.without_trailing(found.names, delimiter, is_data);
        let nameless = names.is_empty();
        let (mut names, listed) = self.listed(names, delimiter)?;
        if !listed {
            self.check_names(&names, delimiter)?;
        }
        let comments = self.comments(from_hash && !listed);
        let types = comments.iter().find_map(|c| Kind::list(c));
        let types = types.filter(|types| types.len() == names.len());
        let (flavour, assumed) = match &types {
            Some(_) => (Flavour::Typed, false),
            None => self.kind(
                &names,
                &comments,
                (from_hash, nameless && !listed),
                delimiter,
            ),
        };
        let bare = nameless && !listed;
        let positions = flavour.positions(names.len(), self.file).filter(|_| bare);
        let above = match flavour {
            Flavour::Trackmate if !is_data => self.units_below(&mut names, delimiter),
            _ => 0,
        };
        let below = self.rest.get(above);
        let data = if is_data { Some(&self.first) } else { below };
        let (lateral_unit, pixel) = decode::lateral(flavour, &comments);
        Ok(Dialect {
            file: self.file.to_owned(),
            flavour,
            positions,
            assumed,
            nameless: bare,
            pixel,
            lateral_unit,
            encoding: Encoding::Bytes,
            delimiter,
            point: self.point(delimiter, is_data),
            line_end: self.line_end,
            names,
            listed,
            comments,
            data_start: data.map_or(self.first.next, |l| l.start) as u64,
            data_line: data.map_or(self.first.number + 1, |l| l.number),
            trailing,
            types: types.unwrap_or_default(),
        })
    }

    /// The names in the header, or in the last comment; none where there are none.
    fn names(&self) -> Result<Names, Failure> {
        let wrapped = unwrap_line(self.first.text);
        let header = wrapped.as_deref().unwrap_or(self.first.text);
        let delimiter = self
            .options
            .delimiter
            .unwrap_or_else(|| self.delimiter(header));
        let numeric = |f: &record::Field<'_>| is_number(&f.text, b'.') || is_number(&f.text, b',');
        let is_data = wrapped.is_none() && record::split(header, delimiter).iter().any(numeric);
        let width = self.width(delimiter);
        let names = if is_data {
            let hash = self
                .comments
                .last()
                .map(|c| record::names(without_mark(c), delimiter));
            hash.filter(|names| names.len() == width)
        } else {
            Some(record::names(header, delimiter))
        };
        let from_hash = is_data && names.is_some();
        let names = names.unwrap_or_default();
        if names.len().max(width) > COLUMNS {
            let message = format!("{} has more than {COLUMNS} columns", self.file);
            return Err(Failure::new(FailureCode::NotMine, message));
        }
        Ok(Names {
            names,
            delimiter,
            is_data,
            from_hash,
        })
    }

    /// The delimiter by which most lines have as many values as the first.
    fn delimiter(&self, header: &[u8]) -> Delimiter {
        let candidates = [
            Delimiter::Byte(b','),
            Delimiter::Byte(b'\t'),
            Delimiter::Byte(b';'),
            Delimiter::Byte(b'|'),
            Delimiter::Blanks,
        ];
        let score = |delimiter: Delimiter| {
            let names = record::names(header, delimiter);
            let wanted = names.len() - usize::from(names.last().is_some_and(String::is_empty));
            let fits = |l: &&Line<'_>| {
                let fields = record::split(l.text, delimiter);
                let last = fields.last().is_some_and(record::Field::is_missing);
                fields.len() == wanted || last && fields.len() == wanted + 1
            };
            let fitting = self.rest.iter().filter(fits).count();
            // Words between blanks are a table only where some of them are numbers.
            let prose = delimiter == Delimiter::Blanks
                && !self.rest.is_empty()
                && (fitting == 0 || !self.rest.iter().any(|l| has_number(l, delimiter)));
            if wanted < 2 || prose {
                (0, 0)
            } else {
                (fitting + 1, wanted.min(3))
            }
        };
        let mut best = (Delimiter::Byte(b','), (0, 0));
        for candidate in candidates {
            let score = score(candidate);
            if score > best.1 {
                best = (candidate, score);
            }
        }
        best.0
    }

    /// The number of values in most of the first lines of data.
    fn width(&self, delimiter: Delimiter) -> usize {
        let fields = record::split(self.first.text, delimiter);
        let last = fields.len() > 1 && fields.last().is_some_and(record::Field::is_missing);
        let all_end_so = self.rest.iter().all(|l| {
            let fields = record::split(l.text, delimiter);
            fields.last().is_some_and(record::Field::is_missing)
        });
        fields.len() - usize::from(last && all_end_so)
    }

    /// `,` where values are written `1,5` and none is written `1.5`.
    fn point(&self, delimiter: Delimiter, is_data: bool) -> u8 {
        if delimiter == Delimiter::Byte(b',') {
            return b'.';
        }
        let first = std::iter::once(&self.first).filter(|_| is_data);
        let mut commas = false;
        for line in first.chain(&self.rest) {
            for field in record::split(line.text, delimiter) {
                if field.text.contains(&b'.') && is_number(&field.text, b'.') {
                    return b'.';
                }
                commas |= field.text.contains(&b',') && is_number(&field.text, b',');
            }
        }
        if commas { b',' } else { b'.' }
    }

    /// Drops the empty last name of a header with a delimiter behind its last name.
    fn without_trailing(
        &self,
        mut names: Vec<String>,
        delimiter: Delimiter,
        is_data: bool,
    ) -> (Vec<String>, bool) {
        if names.len() > 1 && names.last().is_some_and(String::is_empty) {
            names.pop();
            return (names, true);
        }
        let wanted = if names.is_empty() {
            self.width(delimiter)
        } else {
            names.len()
        };
        let first = std::iter::once(&self.first).filter(|_| is_data);
        let mut lines = first.chain(&self.rest).peekable();
        let trailing = lines.peek().is_some()
            && lines.all(|l| {
                let fields = record::split(l.text, delimiter);
                fields.len() == wanted + 1 && fields.last().is_some_and(record::Field::is_missing)
            });
        (names, trailing)
    }

    /// The person's list of names, or the file's own names.
    fn listed(
        &self,
        names: Vec<String>,
        delimiter: Delimiter,
    ) -> Result<(Vec<String>, bool), Failure> {
        let fields = if names.is_empty() {
            self.width(delimiter)
        } else {
            names.len()
        };
        match &self.options.mapping.columns {
            Columns::List(list) if list.len() == fields => Ok((list.clone(), true)),
            Columns::List(list) => {
                let message = format!(
                    "{} has {} but {} given",
                    self.file,
                    count(fields, "column"),
                    if list.len() == 1 {
                        "1 name is".into()
                    } else {
                        format!("{} names are", list.len())
                    }
                );
                Err(Failure::bad_parameter("columns", message)
                    .remedy("give one name for each column in order, and - to leave one out"))
            }
            _ if names.is_empty() => {
                let names = (1..=fields).map(|k| format!("column_{k}")).collect();
                Ok((names, false))
            }
            _ => Ok((names, false)),
        }
    }

    fn check_names(&self, names: &[String], delimiter: Delimiter) -> Result<(), Failure> {
        for (k, name) in names.iter().enumerate() {
            let same = names
                .iter()
                .take(k)
                .position(|n| n == name && !name.is_empty());
            if let Some(same) = same {
                let name = quoted(name.as_bytes());
                let (a, b) = (same + 1, k + 1);
                let message = format!("{} calls both columns {a} and {b} {name}", self.file);
                return Err(Failure::bad_file(message)
                    .remedy("name all columns in order, such as columns = \"x,y,t\""));
            }
        }
        if names.len() < 2
            && !self.rest.is_empty()
            && !self.rest.iter().any(|l| has_number(l, delimiter))
        {
            let message = format!("{} is text, but no table with a delimiter", self.file);
            return Err(Failure::new(FailureCode::NotMine, message));
        }
        Ok(())
    }
}

/// Why a file has no first line.
fn nothing(file: &str, whole: bool, text: &[u8], skip: usize, comments: &[&[u8]]) -> Failure {
    if !whole {
        let message = format!(
            "{file} is no text table: its first {} KiB are one line",
            HEAD >> 10
        );
        return Failure::new(FailureCode::NotMine, message);
    }
    if skip > 0 && !text.is_empty() {
        let message = format!("{file} has no line behind the {skip} that are left out");
        return Failure::bad_parameter("skip_rows", message).remedy("leave out fewer lines");
    }
    Failure::bad_file(if text.is_empty() {
        format!("{file} is empty")
    } else if comments.is_empty() {
        format!("{file} holds only blank lines")
    } else {
        format!("{file} holds only comments")
    })
}

/// The text of a line that stands wholly in one pair of quotes, as spreadsheets write a header
/// that was one cell.
fn unwrap_line(line: &[u8]) -> Option<Vec<u8>> {
    let line = record::trim(line);
    if line.first() != Some(&b'"') {
        return None;
    }
    let (inner, next) = record::unquote(line, 0)?;
    let several = memchr::memchr3(b',', b'\t', b';', &inner).is_some();
    (next == line.len() && several).then(|| inner.into_owned())
}

fn without_mark(comment: &[u8]) -> &[u8] {
    let comment = record::trim(comment);
    record::trim(comment.strip_prefix(b"#").unwrap_or(comment))
}

fn has_number(line: &Line<'_>, delimiter: Delimiter) -> bool {
    record::split(line.text, delimiter)
        .iter()
        .any(|f| is_number(&f.text, b'.'))
}

/// Whether a field is a number (not a missing value).
pub fn is_number(text: &[u8], point: u8) -> bool {
    match number::general(text, point, 0) {
        Some(Number::Special(v)) => !v.is_nan(),
        other => other.is_some(),
    }
}

#[cfg(test)]
#[path = "sniff_tests.rs"]
mod tests;
