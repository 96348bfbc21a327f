//! Changes of single values, lines and sections of a TOML text.

use super::layout::{KeyPart, Layout, Node, Pair, Section, Shape};
use super::values::{to_toml, toml_key};
use serde_json::{Map, Value};
use std::ops::Range;
use toml::de::DeTable;

/// A text under edit. What an edit finds no place for, it leaves out: the caller compares.
pub(crate) struct Splice {
    pub(crate) text: String,
    newline: &'static str,
}

/// Where a new key can go.
enum Room {
    /// After the pairs of an inline table.
    Inline(Range<usize>, Option<usize>),
    /// On a line of its own after this offset; the section's path has this many parts.
    Line(usize, usize),
}

impl Splice {
    pub fn new(text: &str) -> Splice {
        let first = text.find('\n').unwrap_or(0);
        let newline = if text.get(..first).is_some_and(|line| line.ends_with('\r')) {
            "\r\n"
        } else {
            "\n"
        };
        Splice {
            text: text.to_owned(),
            newline,
        }
    }

    pub fn finish(self) -> String {
        self.text
    }

    pub(crate) fn replace(&mut self, range: Range<usize>, with: &str) {
        if self.text.get(range.clone()).is_some() {
            self.text.replace_range(range, with);
        }
    }

    pub(crate) fn slice(&self, range: Range<usize>) -> &str {
        self.text.get(range).unwrap_or("")
    }

    /// Whether something has exactly this path.
    pub fn has(&self, path: &[&str]) -> bool {
        let mut found = false;
        Layout::scan(&self.text).visit(&mut |parts, _| found |= same(parts, path));
        found
    }

    /// Whether the value at a path is a list.
    pub fn is_list(&self, path: &[&str]) -> bool {
        let mut found = false;
        Layout::scan(&self.text).visit(&mut |parts, node| {
            found |=
                same(parts, path) && node.is_some_and(|node| matches!(node.shape, Shape::Array(_)));
        });
        found
    }

    /// Gives a path a value; parts that have it already are left alone.
    pub fn put(&mut self, path: &[&str], value: &Value) {
        let layout = Layout::scan(&self.text);
        let mut exact: Option<Range<usize>> = None;
        let mut inside = false;
        layout.visit(&mut |parts, node| {
            if same(parts, path)
                && let Some(node) = node
            {
                exact = Some(node.span.clone());
            }
            inside |= below(parts, path);
        });
        let Some(text) = to_toml(value) else {
            return;
        };
        match (exact, value) {
            (Some(span), _) => self.change(path, &span, value, &text),
            (None, Value::Object(map)) if inside => self.merge(path, map),
            (None, _) => {
                if inside {
                    self.remove(path);
                }
                self.insert(path, &text);
            }
        }
    }

    fn change(&mut self, path: &[&str], span: &Range<usize>, value: &Value, text: &str) {
        let old = read(self.slice(span.clone()));
        match (&old, value) {
            (Some(old), value) if old == value => {}
            (Some(Value::Object(old)), Value::Object(new))
                if !old.is_empty() && !new.is_empty() =>
            {
                self.merge(path, new);
            }
            (Some(Value::Array(old)), Value::Array(new)) if old.len() == new.len() => {
                self.change_items(path, old, new);
            }
            _ => self.replace(span.clone(), text),
        }
    }

    /// Changes the members that differ, one by one.
    fn merge(&mut self, path: &[&str], new: &Map<String, Value>) {
        for gone in self
            .members(path)
            .iter()
            .filter(|name| !new.contains_key(*name))
        {
            self.remove(&[path, &[gone]].concat());
        }
        for (name, value) in new {
            self.put(&[path, &[name]].concat(), value);
        }
    }

    fn members(&self, path: &[&str]) -> Vec<String> {
        let mut names = Vec::new();
        Layout::scan(&self.text).visit(&mut |parts, _| {
            if below(parts, path)
                && let Some(part) = parts.get(path.len())
                && !names.contains(&part.name)
            {
                names.push(part.name.clone());
            }
        });
        names
    }

    fn change_items(&mut self, path: &[&str], old: &[Value], new: &[Value]) {
        let mut spans: Vec<Range<usize>> = Vec::new();
        Layout::scan(&self.text).visit(&mut |parts, node| {
            if same(parts, path)
                && let Some(Node {
                    shape: Shape::Array(items),
                    ..
                }) = node
            {
                spans = items.iter().map(|item| item.span.clone()).collect();
            }
        });
        // From the end, so that the earlier places stay true.
        for ((old, new), span) in old.iter().zip(new).zip(spans).rev() {
            if old != new
                && let Some(text) = to_toml(new)
            {
                self.replace(span, &text);
            }
        }
    }

    fn insert(&mut self, path: &[&str], value: &str) {
        let layout = Layout::scan(&self.text);
        for known in (0..path.len()).rev() {
            let (prefix, rest) = path.split_at(known);
            let Some(room) = room(&layout, prefix) else {
                continue;
            };
            match room {
                Room::Inline(span, last) => {
                    let pair = format!("{} = {value}", dotted(rest));
                    match last {
                        Some(last) => self.replace(last..last, &format!(", {pair}")),
                        None => self.replace(span.start + 1..span.end - 1, &format!(" {pair} ")),
                    }
                }
                // The first section takes new tables only as sections of their own.
                Room::Line(..) if known == 0 && path.len() > 1 => {
                    let (section, key) = path.split_at(path.len() - 1);
                    let lines = [
                        format!("[{}]", dotted(section)),
                        format!("{} = {value}", dotted(key)),
                    ];
                    self.add_section(&lines, &[]);
                }
                Room::Line(at, depth) => {
                    let key = path.get(depth..).unwrap_or(&[]);
                    self.add_line(at, &format!("{} = {value}", dotted(key)));
                }
            }
            return;
        }
    }

    /// Adds a line after the one that holds `at`, as far in as that one.
    fn add_line(&mut self, at: usize, line: &str) {
        let start = self
            .text
            .get(..at)
            .and_then(|text| text.rfind('\n'))
            .map_or(0, |at| at + 1);
        let first = self.slice(start..self.text.len()).chars();
        let indent: String = first.take_while(|c| *c == ' ' || *c == '\t').collect();
        let end = self.line_end(at);
        let open = !self.slice(0..end).ends_with('\n') && end > 0;
        let before = if open { self.newline } else { "" };
        let new = format!("{before}{indent}{line}{}", self.newline);
        self.replace(end..end, &new);
    }

    /// Adds a section after the last one of the first of these names that has any, or at the end.
    /// The name "" stands for what comes before the first section.
    pub fn add_section(&mut self, lines: &[String], after: &[&str]) {
        let layout = Layout::scan(&self.text);
        let last = |name: &&str| {
            let fits = |section: &&Section| match *name {
                "" => section.header.is_none(),
                name => section.header.is_some() && section.below(&[name]),
            };
            layout
                .sections
                .iter()
                .rfind(fits)
                .map(|section| (section.end(), name.is_empty()))
        };
        let body = format!("{}{}", lines.join(self.newline), self.newline);
        let end = match after.iter().find_map(last) {
            Some((0, true)) | None => self.text.trim_end().len(),
            Some((end, _)) => end,
        };
        let end = self.line_end(end);
        let open = if end == 0 || self.slice(0..end).ends_with('\n') {
            ""
        } else {
            self.newline
        };
        let blank = if end == 0 { "" } else { self.newline };
        let next = self
            .slice(end..self.text.len())
            .trim_start_matches([' ', '\t']);
        let gap = if next.is_empty() || next.starts_with(['\n', '\r']) {
            ""
        } else {
            self.newline
        };
        self.replace(end..end, &format!("{open}{blank}{body}{gap}"));
    }

    /// Removes everything at and below a path.
    pub fn remove(&mut self, path: &[&str]) {
        // One at a time from the end: each removal moves what comes after it.
        while let Some(range) = self.last_removal(path) {
            if range.is_empty() {
                return;
            }
            self.replace(range, "");
        }
    }

    fn last_removal(&self, path: &[&str]) -> Option<Range<usize>> {
        let layout = Layout::scan(&self.text);
        for (at, section) in layout.sections.iter().enumerate().rev() {
            if section.header.is_some() && section.below(path) {
                let next = layout
                    .sections
                    .get(at + 1)
                    .and_then(|next| next.header.as_ref());
                return Some(self.section_range(section, next));
            }
            let mut parts: Vec<&KeyPart> = section.path.iter().collect();
            if let Some(range) = self.pair_removal(&section.pairs, &mut parts, path, None) {
                return Some(range);
            }
        }
        None
    }

    fn pair_removal<'a>(
        &self,
        pairs: &'a [Pair],
        parts: &mut Vec<&'a KeyPart>,
        path: &[&str],
        table: Option<&Range<usize>>,
    ) -> Option<Range<usize>> {
        for (at, pair) in pairs.iter().enumerate().rev() {
            let depth = parts.len();
            parts.extend(&pair.keys);
            let found = if same(parts, path) || below(parts, path) {
                Some(match table {
                    Some(table) => inline_range(pairs, at, table),
                    None => self.lines(pair.span()),
                })
            } else if let Shape::Inline(inner) = &pair.value.shape {
                self.pair_removal(inner, parts, path, Some(&pair.value.span))
            } else {
                None
            };
            parts.truncate(depth);
            if found.is_some() {
                return found;
            }
        }
        None
    }

    /// The whole lines of a range.
    fn lines(&self, range: Range<usize>) -> Range<usize> {
        let start = self
            .text
            .get(..range.start)
            .and_then(|text| text.rfind('\n'));
        start.map_or(0, |at| at + 1)..self.line_end(range.end)
    }

    /// A section with the comment directly above it and the blank lines after it.
    fn section_range(&self, section: &Section, next: Option<&Range<usize>>) -> Range<usize> {
        let header = section.header.clone().unwrap_or(0..0);
        let start = self.comment_start(header.start);
        let mut end = self.line_end(section.end());
        let limit = next.map_or(self.text.len(), |next| self.comment_start(next.start));
        while end < limit && self.slice(end..self.line_end(end)).trim().is_empty() {
            end = self.line_end(end);
        }
        start..end
    }

    /// Where the lines of comment directly above the line of `at` begin.
    fn comment_start(&self, at: usize) -> usize {
        let mut start = self.lines(at..at).start;
        while start > 0 {
            let above = self.lines(start - 1..start - 1).start;
            if !self.slice(above..start).trim_start().starts_with('#') {
                break;
            }
            start = above;
        }
        start
    }

    /// The offset after the line end of the line that holds `at`.
    fn line_end(&self, at: usize) -> usize {
        let rest = self.slice(at..self.text.len());
        rest.find('\n').map_or(self.text.len(), |end| at + end + 1)
    }
}

fn same(parts: &[&KeyPart], path: &[&str]) -> bool {
    parts.len() == path.len()
        && parts
            .iter()
            .zip(path)
            .all(|(part, name)| part.name == *name)
}

fn below(parts: &[&KeyPart], path: &[&str]) -> bool {
    parts.len() > path.len()
        && parts
            .iter()
            .zip(path)
            .all(|(part, name)| part.name == *name)
}

fn dotted(path: &[&str]) -> String {
    path.iter()
        .map(|name| toml_key(name))
        .collect::<Vec<_>>()
        .join(".")
}

/// The value of a piece of TOML.
pub(crate) fn read(text: &str) -> Option<Value> {
    let text = format!("v = {text}");
    let table = DeTable::parse(&text).ok()?;
    super::values::to_map(table.get_ref()).ok()?.remove("v")
}

/// Where a new member of the table at `path` goes.
fn room(layout: &Layout, path: &[&str]) -> Option<Room> {
    let mut inline = None;
    layout.visit(&mut |parts, node| {
        if same(parts, path)
            && let Some(Node {
                span,
                shape: Shape::Inline(pairs),
            }) = node
        {
            inline = Some(Room::Inline(
                span.clone(),
                pairs.last().map(|pair| pair.value.span.end),
            ));
        }
    });
    if inline.is_some() {
        return inline;
    }
    if let Some(section) = layout.sections.iter().find(|section| section.is(path)) {
        return Some(Room::Line(section.end(), section.path.len()));
    }
    // Dotted keys: after the last one that goes through the path.
    layout.sections.iter().rev().find_map(|section| {
        let through = |pair: &&Pair| {
            let parts: Vec<&KeyPart> = section.path.iter().chain(&pair.keys).collect();
            section.path.len() < path.len() && below(&parts, path)
        };
        let pair = section.pairs.iter().rfind(through)?;
        Some(Room::Line(pair.value.span.end, section.path.len()))
    })
}

/// One pair of an inline table, with the comma that it does not leave behind.
fn inline_range(pairs: &[Pair], at: usize, table: &Range<usize>) -> Range<usize> {
    let Some(pair) = pairs.get(at) else {
        return 0..0;
    };
    let span = pair.span();
    if let Some(next) = pairs.get(at + 1) {
        return span.start..next.span().start;
    }
    match at.checked_sub(1).and_then(|before| pairs.get(before)) {
        Some(before) => before.value.span.end..span.end,
        None => table.start + 1..table.end - 1,
    }
}
