//! Texts of files inside sentences.

/// Text of a file as it can stand in a sentence: in quotes, without control characters, at most 40
/// letters.
pub fn quoted(bytes: &[u8]) -> String {
    let text = crate::encoding::text(bytes);
    let plain = |c: char| if c.is_control() { '\u{fffd}' } else { c };
    let mut short: String = text.chars().take(40).map(plain).collect();
    if text.chars().nth(40).is_some() {
        short.push('…');
    }
    format!("\"{short}\"")
}

/// A number with its noun.
pub fn count(number: usize, noun: &str) -> String {
    format!("{number} {noun}{}", if number == 1 { "" } else { "s" })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn strange_bytes_are_shown_harmlessly() {
        assert_eq!(quoted(b"a\0b"), "\"a\u{fffd}b\"");
        assert_eq!(quoted(&[b'x'; 50]), format!("\"{}…\"", "x".repeat(40)));
        assert_eq!(count(1, "value"), "1 value");
        assert_eq!(count(0, "value"), "0 values");
    }
}
