//! Python literals, as the head of a .npy file is one. Nothing is executed.

/// A literal.
#[derive(Clone, Debug, PartialEq)]
pub enum Literal {
    /// Text.
    Text(String),
    /// A whole number.
    Whole(i64),
    /// True or False.
    Truth(bool),
    /// None.
    None,
    /// A list or a tuple.
    List(Vec<Literal>),
    /// A dictionary with keys of text.
    Map(Vec<(String, Literal)>),
}

const DEEPEST: usize = 32;

/// Reads a literal and blanks after it.
pub fn parse(text: &str) -> Option<Literal> {
    let mut rest = text.trim_start();
    let value = value(&mut rest, 0)?;
    rest.trim().is_empty().then_some(value)
}

fn value(rest: &mut &str, depth: usize) -> Option<Literal> {
    if depth > DEEPEST {
        return None;
    }
    *rest = rest.trim_start();
    let first = rest.chars().next()?;
    match first {
        '\'' | '"' => text(rest, first),
        '(' => Some(Literal::List(list(rest, ')', depth)?)),
        '[' => Some(Literal::List(list(rest, ']', depth)?)),
        '{' => map(rest, depth),
        _ => word(rest),
    }
}

fn text(rest: &mut &str, quote: char) -> Option<Literal> {
    let inner = &rest[1..];
    let end = inner.find(quote)?;
    let text = &inner[..end];
    *rest = &inner[end + 1..];
    // Names with escapes are none that a microscope writes.
    (!text.contains('\\')).then(|| Literal::Text(text.to_owned()))
}

fn word(rest: &mut &str) -> Option<Literal> {
    let end = rest
        .find([',', ')', ']', '}', ':', ' ', '\n'])
        .unwrap_or(rest.len());
    let (word, after) = rest.split_at(end);
    *rest = after;
    match word {
        "True" => Some(Literal::Truth(true)),
        "False" => Some(Literal::Truth(false)),
        "None" => Some(Literal::None),
        _ => word.trim_end_matches('L').parse().ok().map(Literal::Whole),
    }
}

fn next(rest: &mut &str, close: char) -> Option<bool> {
    *rest = rest.trim_start();
    if let Some(after) = rest.strip_prefix(',') {
        *rest = after.trim_start();
    } else if !rest.starts_with(close) {
        return None;
    }
    Some(!rest.starts_with(close))
}

fn list(rest: &mut &str, close: char, depth: usize) -> Option<Vec<Literal>> {
    *rest = rest[1..].trim_start();
    let mut all = Vec::new();
    let mut more = !rest.starts_with(close);
    while more {
        all.push(value(rest, depth + 1)?);
        more = next(rest, close)?;
    }
    *rest = &rest[1..];
    Some(all)
}

fn map(rest: &mut &str, depth: usize) -> Option<Literal> {
    *rest = rest[1..].trim_start();
    let mut all = Vec::new();
    let mut more = !rest.starts_with('}');
    while more {
        let Literal::Text(key) = value(rest, depth + 1)? else {
            return None;
        };
        *rest = rest.trim_start().strip_prefix(':')?;
        all.push((key, value(rest, depth + 1)?));
        more = next(rest, '}')?;
    }
    *rest = &rest[1..];
    Some(Literal::Map(all))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn heads_of_arrays_are_read() {
        let head = "{'descr': [('itr', [('loc', '<f8', (3,))], (5,)), ('tid', '<i4')], \
                    'fortran_order': False, 'shape': (12L,), }  \n";
        let Some(Literal::Map(members)) = parse(head) else {
            panic!()
        };
        assert_eq!(members.len(), 3);
        assert_eq!(members[2].1, Literal::List(vec![Literal::Whole(12)]));
        assert_eq!(parse("()"), Some(Literal::List(Vec::new())));
    }

    #[test]
    fn what_is_no_literal_is_refused() {
        for text in [
            "",
            "{",
            "{'a'}",
            "[1 2]",
            "__import__('os')",
            "'a",
            "[1,,2]",
            "(",
            "{'a':}",
        ] {
            assert_eq!(parse(text), None, "{text}");
        }
        assert_eq!(parse(&"[".repeat(100_000)), None);
    }
}
