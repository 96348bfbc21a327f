//! rapidSTORM: the XML line that names the columns, and rows with tracks inside.

use crate::wording::quoted;
use memchr::memmem;
use puncta_sdk::Failure;

/// The start of the first line.
pub const START: &[u8] = b"<localizations";
/// More fields than this are no table.
const FIELDS: usize = 256;

/// One column: its identifier and its unit, as the file spells them.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Field {
    /// What it is.
    pub identifier: String,
    /// Empty where none is said.
    pub unit: String,
}

/// The columns; those of the inner list when rows hold tracks.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Fields {
    /// Of each row.
    pub outer: Vec<Field>,
    /// Of each localisation in a row that is a track.
    pub inner: Option<Vec<Field>>,
}

/// Reads the line. It is scanned for tags: entities, declarations and nesting beyond one level are
/// not part of the format.
///
/// # Errors
/// A tag without its end, a field without an identifier, or no field.
pub fn fields(line: &[u8], file: &str) -> Result<Fields, Failure> {
    let damaged = |what: &str| Failure::bad_file(format!("{file}, line 1: {what}"));
    let mut fields = Fields::default();
    let mut depth = 0;
    let mut at = 0;
    while let Some(open) = memchr::memchr(b'<', line.get(at..).unwrap_or(&[])) {
        let rest = line.get(at + open..).unwrap_or(&[]);
        let end = memchr::memchr(b'>', rest).ok_or_else(|| damaged("a tag has no end"))?;
        let tag = rest.get(1..end).unwrap_or(&[]);
        at += open + end + 1;
        if tag.starts_with(b"/localizations") {
            depth -= 1;
        } else if tag.starts_with(b"localizations") {
            depth += 1;
            if depth > 2 || depth == 2 && fields.inner.is_some() {
                return Err(damaged("localisations are nested more than once"));
            }
            if depth == 2 {
                fields.inner = Some(Vec::new());
            }
        } else if tag.starts_with(b"field") {
            let identifier = attribute(tag, b"identifier")
                .ok_or_else(|| damaged("a field has no identifier"))?;
            let unit = attribute(tag, b"unit").unwrap_or_default();
            let field = Field { identifier, unit };
            match &mut fields.inner {
                Some(inner) if depth == 2 => inner.push(field),
                // What follows a nested list is part of no known file.
                Some(_) => return Err(damaged("a field stands behind the nested localisations")),
                None => fields.outer.push(field),
            }
        } else {
            return Err(damaged(&format!("the tag {} is not known", quoted(tag))));
        }
    }
    let count = fields.outer.len() + fields.inner.as_ref().map_or(0, Vec::len);
    let empty = fields.inner.as_ref().is_some_and(Vec::is_empty);
    if fields.outer.is_empty() || empty || count > FIELDS {
        return Err(damaged(&format!("it names {count} fields")));
    }
    Ok(fields)
}

fn attribute(tag: &[u8], name: &[u8]) -> Option<String> {
    let mut at = 0;
    loop {
        let found = at + memmem::find(tag.get(at..)?, name)?;
        at = found + name.len();
        let before = tag.get(found.checked_sub(1)?);
        let rest = tag.get(at..)?.strip_prefix(b"=\"");
        if let (Some(b' '), Some(rest)) = (before, rest) {
            let end = memchr::memchr(b'"', rest)?;
            return Some(crate::encoding::text(rest.get(..end)?).into_owned());
        }
    }
}

impl Fields {
    /// The names of the columns with their units, as a header would spell them.
    pub fn names(&self) -> Vec<String> {
        let name = |prefix: &str, field: &Field| match field.unit.as_str() {
            "" | "dimensionless" => format!("{prefix}{}", field.identifier),
            "A/D count" => format!("{prefix}{} [ADU]", field.identifier),
            unit => format!("{prefix}{} [{unit}]", field.identifier),
        };
        match &self.inner {
            None => self.outer.iter().map(|f| name("", f)).collect(),
            Some(inner) => {
                let track = std::iter::once("Track".to_owned());
                let outer = self.outer.iter().map(|f| name("Track-", f));
                track
                    .chain(outer)
                    .chain(inner.iter().map(|f| name("", f)))
                    .collect()
            }
        }
    }
}

/// The rows of a file with nested tracks, one row a localisation: the number of the track, the
/// values of the track, the values of the localisation.
///
/// # Errors
/// A row that has fewer or more values than it announces.
pub fn flat(text: &[u8], fields: &Fields, file: &str) -> Result<Vec<u8>, Failure> {
    let inner = fields.inner.as_ref().map_or(0, Vec::len);
    let outer = fields.outer.len();
    let mut out = Vec::with_capacity(text.len());
    let mut track = 0_u64;
    for (number, line) in text.split(|b| *b == b'\n').enumerate().skip(1) {
        let values: Vec<&[u8]> = line
            .split(|b| b.is_ascii_whitespace())
            .filter(|v| !v.is_empty())
            .collect();
        if values.is_empty() || line.first() == Some(&b'#') {
            continue;
        }
        let damaged = |what: String| Failure::bad_file(what).row(number as u64 + 1);
        let short = || {
            damaged(format!(
                "{file}: a track announces no number of localisations"
            ))
        };
        let count = values.get(outer).and_then(|v| std::str::from_utf8(v).ok());
        let count: usize = count.and_then(|v| v.parse().ok()).ok_or_else(short)?;
        let rest = values.get(outer + 1..).unwrap_or(&[]);
        if count.checked_mul(inner) != Some(rest.len()) {
            return Err(damaged(format!(
                "{file}: a track announces {count} localisations of {inner} values, but {} values \
                 follow",
                rest.len()
            ))
            .remedy("export the file again"));
        }
        for one in rest.chunks(inner.max(1)) {
            out.extend_from_slice(track.to_string().as_bytes());
            let head = values.get(..outer).unwrap_or(&[]);
            for value in head.iter().chain(one) {
                out.push(b' ');
                out.extend_from_slice(value);
            }
            out.push(b'\n');
        }
        track += 1;
    }
    Ok(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    const NESTED: &[u8] =
        b"# <localizations insequence=\"true\"><field identifier=\"Position-0-0\" \
        unit=\"nanometer\" /><field identifier=\"Amplitude-0-0\" unit=\"A/D count\" />\
        <localizations repetitions=\"variable\"><field identifier=\"Position-0-0\" \
        semantic=\"identifier=x\" unit=\"nanometer\" /><field identifier=\"ImageNumber-0-0\" \
        unit=\"frame\" /></localizations></localizations>\n";

    #[test]
    fn nested_tracks_become_rows() {
        let fields = fields(NESTED, "f").unwrap();
        assert_eq!(
            fields.names(),
            [
                "Track",
                "Track-Position-0-0 [nanometer]",
                "Track-Amplitude-0-0 [ADU]",
                "Position-0-0 [nanometer]",
                "ImageNumber-0-0 [frame]"
            ]
        );
        let rows = |text: &str| flat(&[NESTED, text.as_bytes()].concat(), &fields, "f");
        let text = String::from_utf8(rows("5 9 2 4 0 6 1\r\n\n7 8 1 7 3\n").unwrap()).unwrap();
        assert_eq!(text, "0 5 9 4 0\n0 5 9 6 1\n1 7 8 7 3\n");
        for bad in [
            "5 9 2 4 0 6",
            "5 9 99999999999999999999 4",
            "5",
            "5 9 1 4 0 6",
        ] {
            assert!(rows(bad).unwrap_err().row.is_some(), "{bad}");
        }
    }

    #[test]
    fn what_is_no_header_is_refused() {
        let bad: [&[u8]; 5] = [
            b"<localizations><field identifier=\"a\"",
            b"<localizations><field unit=\"a\"/></localizations>",
            b"<localizations></localizations>",
            b"<localizations><!DOCTYPE x></localizations>",
            b"<localizations><localizations><localizations>",
        ];
        for line in bad {
            assert!(
                fields(line, "f").is_err(),
                "{}",
                String::from_utf8_lossy(line)
            );
        }
    }
}
