//! Standard output and plain text: tables, numbers, names that cannot disturb a terminal.

use puncta_engine::documents::Failure;
use std::borrow::Cow;
use std::cell::Cell;
use std::io::{ErrorKind, Write};
use std::path::Path;

/// Standard output. A reader that has seen enough (`| head`) ends the output, not the program.
#[derive(Debug, Default)]
pub struct Output {
    closed: Cell<bool>,
}

impl Output {
    /// Writes text as it is.
    pub fn text(&self, text: &str) -> Result<(), Failure> {
        if self.closed.get() {
            return Ok(());
        }
        let mut out = std::io::stdout().lock();
        match out.write_all(text.as_bytes()).and_then(|()| out.flush()) {
            Ok(()) => Ok(()),
            Err(error) if error.kind() == ErrorKind::BrokenPipe => {
                self.closed.set(true);
                Ok(())
            }
            Err(error) => Err(Failure::io(
                "write to",
                Path::new("standard output"),
                &error,
            )),
        }
    }

    /// Writes a JSON document.
    pub fn json(&self, value: &serde_json::Value) -> Result<(), Failure> {
        self.text(&format!("{value:#}\n"))
    }
}

/// Text of a file or plugin, with control characters made visible.
pub fn plain(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        if c.is_control() {
            out.extend(c.escape_default())
        } else {
            out.push(c)
        }
    }
    out
}

/// Text of at most `most` characters.
pub fn short(text: &str, most: usize) -> Cow<'_, str> {
    if text.chars().count() <= most {
        return text.into();
    }
    text.chars()
        .take(most.saturating_sub(3))
        .chain("...".chars())
        .collect()
}

/// A number with six significant digits.
pub fn number(value: f64) -> String {
    let size = value.abs();
    if value == 0.0 || !value.is_finite() {
        return format!("{value}");
    }
    if !(1e-4..1e9).contains(&size) {
        return trim(&format!("{value:.5e}"));
    }
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
    let decimals = (5.0 - size.log10().floor()).clamp(0.0, 9.0) as usize;
    trim(&format!("{value:.decimals$}"))
}

/// Without zeros that say nothing.
fn trim(text: &str) -> String {
    let (digits, exponent) = match text.split_once('e') {
        Some((digits, exponent)) => (digits, format!("e{exponent}")),
        None => (text, String::new()),
    };
    let digits = match digits.contains('.') {
        true => digits.trim_end_matches('0').trim_end_matches('.'),
        false => digits,
    };
    format!("{digits}{exponent}")
}

/// A whole number with a space between thousands.
pub fn count(value: u64) -> String {
    let digits = value.to_string();
    let mut out = String::new();
    for (place, digit) in digits.chars().enumerate() {
        if place > 0 && (digits.len() - place).is_multiple_of(3) {
            out.push(' ');
        }
        out.push(digit);
    }
    out
}

/// Rows of cells as aligned columns; `right` says which columns end flush.
pub fn table(rows: &[Vec<String>], right: &[bool], indent: usize) -> String {
    let columns = rows.iter().map(Vec::len).max().unwrap_or(0);
    let width = |column: usize| {
        let cells = rows.iter().filter_map(|row| row.get(column));
        cells.map(|cell| cell.chars().count()).max().unwrap_or(0)
    };
    let widths: Vec<usize> = (0..columns).map(width).collect();
    let mut out = String::new();
    for row in rows {
        let mut line = " ".repeat(indent);
        for (column, (cell, width)) in row.iter().zip(&widths).enumerate() {
            let gap = " ".repeat(width.saturating_sub(cell.chars().count()));
            if column > 0 {
                line.push_str("  ");
            }
            if right.get(column).copied().unwrap_or(false) {
                line.push_str(&gap);
                line.push_str(cell);
            } else {
                line.push_str(cell);
                line.push_str(&gap);
            }
        }
        out.push_str(line.trim_end());
        out.push('\n');
    }
    out
}

/// A paragraph in lines of at most `width` characters, unless a word is longer.
pub fn wrap(text: &str, width: usize) -> String {
    let mut out = String::new();
    let mut length = 0;
    for word in text.split_whitespace() {
        let count = word.chars().count();
        if length > 0 && length + 1 + count > width {
            out.push('\n');
            length = 0;
        } else if length > 0 {
            out.push(' ');
            length += 1;
        }
        out.push_str(word);
        length += count;
    }
    out.push('\n');
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_have_six_digits() {
        for (value, text) in [
            (0.0, "0"),
            (1.0, "1"),
            (130.0, "130"),
            (-0.000_123_456_7, "-0.000123457"),
            (12_345.678_9, "12345.7"),
            (123_456_789.0, "123456789"),
            (1.234_567_8e12, "1.23457e12"),
            (1e-9, "1e-9"),
            (f64::INFINITY, "inf"),
            (f64::NAN, "NaN"),
        ] {
            assert_eq!(number(value), text);
        }
        assert_eq!(count(0), "0");
        assert_eq!(count(1_234_567), "1 234 567");
    }

    #[test]
    fn columns_are_aligned() {
        let row = |cells: [&str; 3]| cells.map(String::from).to_vec();
        let text = table(
            &[row(["a", "1", ""]), row(["bcd", "22", "\u{b5}m"])],
            &[false, true],
            2,
        );
        assert_eq!(text, "  a     1\n  bcd  22  \u{b5}m\n");
        assert_eq!(table(&[], &[], 0), "");
        assert_eq!(wrap("one two three  four", 9), "one two\nthree\nfour\n");
        assert_eq!(short("abcdef", 5), "ab...");
        assert_eq!(short("abcde", 5), "abcde");
    }
}
