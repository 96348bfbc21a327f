//! Lines and fields of a small piece of text (headers and samples).

use crate::options::Delimiter;
use std::borrow::Cow;

/// A value of a row.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Field<'a> {
    /// The value without quotes and blanks around it.
    pub text: Cow<'a, [u8]>,
    /// It stood in quotes.
    pub quoted: bool,
    /// Its quotes are not closed in this piece of text.
    pub open: bool,
}

impl Field<'_> {
    /// Nothing stands between the delimiters.
    pub fn is_missing(&self) -> bool {
        self.text.is_empty() && !self.quoted
    }
}

/// A line without its end.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Line<'a> {
    /// The bytes without the line end.
    pub text: &'a [u8],
    /// Counted from 1.
    pub number: u64,
    /// Where the line starts.
    pub start: usize,
    /// Where the next one starts.
    pub next: usize,
}

/// The lines of `text`, the last one also without a line end.
pub fn lines(text: &[u8], line_end: u8) -> impl Iterator<Item = Line<'_>> {
    let mut start = 0;
    let mut number = 0;
    std::iter::from_fn(move || {
        let rest = text.get(start..).filter(|r| !r.is_empty())?;
        let len = memchr::memchr(line_end, rest).unwrap_or(rest.len());
        let line = rest.get(..len).unwrap_or(rest);
        let begin = start;
        start += (len + 1).min(rest.len());
        number += 1;
        let line = line.strip_suffix(b"\r").unwrap_or(line);
        Some(Line {
            text: line,
            number,
            start: begin,
            next: start,
        })
    })
}

/// The text without blanks around it.
pub fn trim(text: &[u8]) -> &[u8] {
    text.trim_ascii()
}

/// The first byte that is no blank (nor tab, where a tab is no delimiter).
pub fn skip_blanks(text: &[u8], mut at: usize, delimiter: Delimiter) -> usize {
    while let Some(b' ' | b'\t') = text.get(at) {
        if delimiter == Delimiter::Byte(b'\t') && text.get(at) == Some(&b'\t') {
            break;
        }
        at += 1;
    }
    at
}

/// Reads a quoted value whose opening quote is at `at`; gives it and the place behind its closing
/// quote, `None` when there is none in `text`.
pub fn unquote(text: &[u8], at: usize) -> Option<(Cow<'_, [u8]>, usize)> {
    let start = at + 1;
    let mut from = start;
    let mut doubled = false;
    loop {
        let close = from + memchr::memchr(b'"', text.get(from..)?)?;
        if text.get(close + 1) != Some(&b'"') {
            let value = text.get(start..close)?;
            let value = if doubled {
                Cow::Owned(halve(value))
            } else {
                Cow::Borrowed(value)
            };
            return Some((value, close + 1));
        }
        doubled = true;
        from = close + 2;
    }
}

/// `""` becomes `"`.
fn halve(value: &[u8]) -> Vec<u8> {
    let mut single = Vec::with_capacity(value.len());
    let mut skip = false;
    for byte in value {
        if *byte == b'"' && !skip {
            skip = true;
            single.push(b'"');
        } else if *byte == b'"' {
            skip = false;
        } else {
            skip = false;
            single.push(*byte);
        }
    }
    single
}

/// The values of one line.
pub fn split(line: &[u8], delimiter: Delimiter) -> Vec<Field<'_>> {
    let mut fields = Vec::new();
    let mut at = 0;
    loop {
        at = skip_blanks(line, at, delimiter);
        if delimiter == Delimiter::Blanks && at >= line.len() && !fields.is_empty() {
            return fields;
        }
        let quoted = if line.get(at) == Some(&b'"') {
            Some(unquote(line, at))
        } else {
            None
        };
        let open = matches!(quoted, Some(None));
        let (mut text, from) = match quoted.flatten() {
            Some((value, next)) => (Some(value), next),
            None => (None, at),
        };
        let rest = line.get(from..).unwrap_or(&[]);
        let len = match delimiter {
            _ if open => rest.len(),
            Delimiter::Byte(byte) => memchr::memchr(byte, rest).unwrap_or(rest.len()),
            Delimiter::Blanks => memchr::memchr2(b' ', b'\t', rest).unwrap_or(rest.len()),
        };
        let plain = trim(rest.get(..len).unwrap_or(rest));
        if !plain.is_empty()
            && let Some(value) = &mut text
        {
            value.to_mut().extend_from_slice(plain);
        }
        let quoted = text.is_some();
        fields.push(Field {
            text: text.unwrap_or(Cow::Borrowed(plain)),
            quoted,
            open,
        });
        at = from + len;
        if at >= line.len() {
            return fields;
        }
        at += usize::from(delimiter != Delimiter::Blanks);
    }
}

/// The names in a header line. In a line with blanks between names a unit in brackets belongs to
/// the name before it.
pub fn names(line: &[u8], delimiter: Delimiter) -> Vec<String> {
    let fields = split(line, delimiter);
    let mut names: Vec<String> = Vec::with_capacity(fields.len());
    for field in fields {
        let text = crate::encoding::text(&field.text).trim().to_owned();
        let unit = delimiter == Delimiter::Blanks && text.starts_with(['[', '(']);
        match names.last_mut().filter(|_| unit) {
            Some(name) => {
                name.push(' ');
                name.push_str(&text);
            }
            None => names.push(text),
        }
    }
    names
}

#[cfg(test)]
mod tests {
    use super::*;

    fn texts(line: &str, delimiter: Delimiter) -> Vec<String> {
        let fields = split(line.as_bytes(), delimiter);
        fields
            .iter()
            .map(|f| String::from_utf8_lossy(&f.text).into_owned())
            .collect()
    }

    #[test]
    fn fields_with_quotes_blanks_and_nothing() {
        let comma = Delimiter::Byte(b',');
        assert_eq!(
            texts("a, b ,\"c,d\",\"e\"\"f\",", comma),
            ["a", "b", "c,d", "e\"f", ""]
        );
        assert_eq!(texts("", comma), [""]);
        assert_eq!(texts("\t1\t", Delimiter::Byte(b'\t')), ["", "1", ""]);
        assert_eq!(texts("  1 \t 2  ", Delimiter::Blanks), ["1", "2"]);
        assert!(split(b"1,\"open", comma).last().is_some_and(|f| f.open));
        assert_eq!(texts("\"\"\"\"", comma), ["\""]);
    }

    #[test]
    fn names_with_units_between_blanks() {
        assert_eq!(
            names(b"x [nm] y (nm) t", Delimiter::Blanks),
            ["x [nm]", "y (nm)", "t"]
        );
    }

    #[test]
    fn lines_with_each_line_end() {
        let all = |text: &'static [u8], end| -> Vec<(u64, &[u8], usize)> {
            lines(text, end)
                .map(|l| (l.number, l.text, l.start))
                .collect()
        };
        assert_eq!(
            all(b"a\r\nb\n\nc", b'\n'),
            [(1, &b"a"[..], 0), (2, b"b", 3), (3, b"", 5), (4, b"c", 6)]
        );
        assert_eq!(all(b"a\rb\r", b'\r'), [(1, &b"a"[..], 0), (2, b"b", 2)]);
    }
}
