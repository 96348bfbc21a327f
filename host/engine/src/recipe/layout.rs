//! Where every key and value of a TOML text stands, so that an edit can leave all else as it is.

use std::collections::HashMap;
use std::ops::Range;
use toml_parser::decoder::Encoding;
use toml_parser::parser::{Event, EventKind, RecursionGuard, parse_document};
use toml_parser::{ParseError, Source};

/// Deepest nesting; the reader of values has the same limit.
const DEEPEST: u32 = 80;

/// One part of a dotted key.
pub(crate) struct KeyPart {
    pub name: String,
    pub span: Range<usize>,
}

/// A key with its value.
pub(crate) struct Pair {
    pub keys: Vec<KeyPart>,
    pub value: Node,
}

impl Pair {
    /// From the first letter of the key to the last of the value.
    pub fn span(&self) -> Range<usize> {
        let start = self
            .keys
            .first()
            .map_or(self.value.span.start, |key| key.span.start);
        start..self.value.span.end
    }
}

/// A value.
pub(crate) struct Node {
    pub span: Range<usize>,
    pub shape: Shape,
}

pub(crate) enum Shape {
    Scalar,
    Array(Vec<Node>),
    Inline(Vec<Pair>),
}

/// A header with the pairs below it; the first section of a text has no header.
pub(crate) struct Section {
    pub header: Option<Range<usize>>,
    pub path: Vec<KeyPart>,
    pub pairs: Vec<Pair>,
}

impl Section {
    /// Where its last pair, or else its header, ends.
    pub fn end(&self) -> usize {
        let header = self.header.as_ref().map_or(0, |header| header.end);
        self.pairs.last().map_or(header, |pair| pair.value.span.end)
    }

    pub fn is(&self, path: &[&str]) -> bool {
        self.path.len() == path.len() && self.below(path)
    }

    /// Whether it defines `path` or something in it.
    pub fn below(&self, path: &[&str]) -> bool {
        self.path.len() >= path.len()
            && self
                .path
                .iter()
                .zip(path)
                .all(|(part, name)| part.name == *name)
    }
}

/// A text's sections in their order.
pub(crate) struct Layout {
    pub sections: Vec<Section>,
}

impl Layout {
    /// Finds everything in a text; of a text that is no valid TOML, as much as can be told.
    pub fn scan(text: &str) -> Layout {
        let source = Source::new(text);
        let tokens = source.lex().into_vec();
        let mut events: Vec<Event> = Vec::with_capacity(tokens.len());
        let mut guard = RecursionGuard::new(&mut events, DEEPEST);
        let mut errors: Option<ParseError> = None;
        parse_document(&tokens, &mut guard, &mut errors);
        events.retain(|event| {
            !matches!(
                event.kind(),
                EventKind::Whitespace | EventKind::Comment | EventKind::Newline | EventKind::Error
            )
        });
        Scanner {
            source,
            events: &events,
            at: 0,
        }
        .document()
    }

    /// Shows each definition: its full path, and its value unless it is a header.
    pub fn visit<'a>(&'a self, visit: &mut dyn FnMut(&[&'a KeyPart], Option<&'a Node>)) {
        for section in &self.sections {
            let mut path: Vec<&KeyPart> = section.path.iter().collect();
            if section.header.is_some() {
                visit(&path, None);
            }
            for pair in &section.pairs {
                visit_pair(pair, &mut path, visit);
            }
        }
    }

    /// For each key that defines something once more: where it was defined first.
    pub fn repeated(&self) -> HashMap<usize, usize> {
        let mut first: HashMap<Vec<&str>, usize> = HashMap::new();
        let mut repeated = HashMap::new();
        self.visit(&mut |path, _| {
            for (at, part) in path.iter().enumerate() {
                let start = part.span.start;
                let known = *first
                    .entry(names(path.get(..=at).unwrap_or(&[])))
                    .or_insert(start);
                if known < start {
                    repeated.insert(start, known);
                }
            }
        });
        repeated
    }

    /// The section whose header holds `offset`, from there to the next header.
    pub fn section_at(&self, offset: usize) -> Option<Range<usize>> {
        let start = |section: &Section| section.header.as_ref().map_or(0, |header| header.start);
        let next = self
            .sections
            .partition_point(|section| start(section) <= offset);
        let header = self.sections.get(next.checked_sub(1)?)?.header.as_ref()?;
        let end = self.sections.get(next).map_or(usize::MAX, start);
        header.contains(&offset).then_some(header.start..end)
    }
}

fn names<'a>(path: &[&'a KeyPart]) -> Vec<&'a str> {
    path.iter().map(|part| part.name.as_str()).collect()
}

fn visit_pair<'a>(
    pair: &'a Pair,
    path: &mut Vec<&'a KeyPart>,
    visit: &mut dyn FnMut(&[&'a KeyPart], Option<&'a Node>),
) {
    let before = path.len();
    path.extend(&pair.keys);
    visit(path, Some(&pair.value));
    if let Shape::Inline(pairs) = &pair.value.shape {
        for inner in pairs {
            visit_pair(inner, path, visit);
        }
    }
    path.truncate(before);
}

struct Scanner<'a> {
    source: Source<'a>,
    events: &'a [Event],
    at: usize,
}

impl Scanner<'_> {
    fn peek(&self) -> Option<EventKind> {
        self.events.get(self.at).map(Event::kind)
    }

    fn next(&mut self) -> Option<(EventKind, Range<usize>)> {
        let event = self.events.get(self.at)?;
        self.at += 1;
        Some((event.kind(), event.span().start()..event.span().end()))
    }

    fn document(mut self) -> Layout {
        let first = Section {
            header: None,
            path: Vec::new(),
            pairs: Vec::new(),
        };
        let mut sections = vec![first];
        while let Some(kind) = self.peek() {
            match kind {
                EventKind::StdTableOpen | EventKind::ArrayTableOpen => {
                    sections.push(self.section());
                }
                EventKind::SimpleKey => {
                    if let (Some(pair), Some(last)) = (self.pair(), sections.last_mut()) {
                        last.pairs.push(pair);
                    }
                }
                _ => self.at += 1,
            }
        }
        Layout { sections }
    }

    fn section(&mut self) -> Section {
        let mut span = self.next().map_or(0..0, |(_, span)| span);
        let path = self.keys();
        if let Some(last) = path.last() {
            span.end = last.span.end;
        }
        if matches!(
            self.peek(),
            Some(EventKind::StdTableClose | EventKind::ArrayTableClose)
        ) && let Some((_, close)) = self.next()
        {
            span.end = close.end;
        }
        Section {
            header: Some(span),
            path,
            pairs: Vec::new(),
        }
    }

    fn keys(&mut self) -> Vec<KeyPart> {
        let mut keys = Vec::new();
        while let Some(kind @ (EventKind::SimpleKey | EventKind::KeySep)) = self.peek() {
            let encoding = self.events.get(self.at).and_then(Event::encoding);
            if let (Some((_, span)), EventKind::SimpleKey) = (self.next(), kind) {
                keys.push(KeyPart {
                    name: self.decode(&span, encoding),
                    span,
                });
            }
        }
        keys
    }

    fn decode(&self, span: &Range<usize>, encoding: Option<Encoding>) -> String {
        let raw = self.source.input().get(span.clone()).unwrap_or("");
        let mut name = String::new();
        let span = toml_parser::Span::new_unchecked(span.start, span.end);
        let mut errors: Option<ParseError> = None;
        toml_parser::Raw::new_unchecked(raw, encoding, span).decode_key(&mut name, &mut errors);
        name
    }

    fn pair(&mut self) -> Option<Pair> {
        let keys = self.keys();
        if self.peek() != Some(EventKind::KeyValSep) {
            return None;
        }
        self.at += 1;
        let value = self.value()?;
        Some(Pair { keys, value })
    }

    fn value(&mut self) -> Option<Node> {
        match self.peek()? {
            EventKind::Scalar => self.next().map(|(_, span)| Node {
                span,
                shape: Shape::Scalar,
            }),
            EventKind::ArrayOpen => {
                let (_, mut span) = self.next()?;
                let mut list = Vec::new();
                while let Some(kind) = self.peek() {
                    match kind {
                        EventKind::ArrayClose => {
                            span.end = self.next().map_or(span.end, |(_, close)| close.end);
                            break;
                        }
                        EventKind::ValueSep => self.at += 1,
                        _ => list.push(self.value()?),
                    }
                }
                Some(Node {
                    span,
                    shape: Shape::Array(list),
                })
            }
            EventKind::InlineTableOpen => {
                let (_, mut span) = self.next()?;
                let mut pairs = Vec::new();
                while let Some(kind) = self.peek() {
                    match kind {
                        EventKind::InlineTableClose => {
                            span.end = self.next().map_or(span.end, |(_, close)| close.end);
                            break;
                        }
                        EventKind::ValueSep => self.at += 1,
                        EventKind::SimpleKey => pairs.extend(self.pair()),
                        _ => return None,
                    }
                }
                Some(Node {
                    span,
                    shape: Shape::Inline(pairs),
                })
            }
            _ => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_definition_is_found_with_its_path() {
        let text = "a.\"b c\" = 1 # x\r\n[ s . good ]\r\nset = { p.q = [1, 2], r = 'z' }\n";
        let layout = Layout::scan(text);
        let mut seen = Vec::new();
        layout.visit(&mut |path, node| {
            let value = node.map(|node| text[node.span.clone()].to_owned());
            seen.push((names(path).join("/"), value));
        });
        let value = |text: &str| Some(text.to_owned());
        assert_eq!(
            seen,
            [
                ("a/b c".into(), value("1")),
                ("s/good".into(), None),
                ("s/good/set".into(), value("{ p.q = [1, 2], r = 'z' }")),
                ("s/good/set/p/q".into(), value("[1, 2]")),
                ("s/good/set/r".into(), value("'z'")),
            ]
        );
        assert_eq!(
            &text[layout.sections[1].header.clone().unwrap()],
            "[ s . good ]"
        );
    }

    #[test]
    fn damaged_texts_are_scanned_too() {
        for text in [
            "[",
            "[[a",
            "a = [",
            "a = {b",
            "a = {b = ",
            "= 1",
            "a.=1",
            "\u{feff}",
            "a={[}",
        ] {
            Layout::scan(text);
        }
        Layout::scan(&"a=[".repeat(5000));
        Layout::scan(&format!("a={}", "{b=".repeat(5000)));
    }
}
