//! A new name for a step, everywhere in the text.

use super::layout::{KeyPart, Layout, Node, Pair, Shape};
use super::splice::{Splice, read};
use super::values::{quoted, toml_key};
use serde_json::Value;
use std::ops::Range;

impl Splice {
    /// Renames a member of a table of the root, and the references to it.
    pub fn rename(&mut self, table: &str, name: &str, new: &str) {
        let layout = Layout::scan(&self.text);
        let mut changes: Vec<(Range<usize>, String)> = Vec::new();
        for section in &layout.sections {
            keys(&section.path, &[], &[table, name], new, &mut changes);
            let above: Vec<&str> = section.path.iter().map(|part| &*part.name).collect();
            for pair in &section.pairs {
                pair_keys(pair, &above, &[table, name], new, &mut changes);
            }
        }
        layout.visit(&mut |parts, node| {
            let path: Vec<&str> = parts.iter().map(|part| part.name.as_str()).collect();
            let refers = matches!(path.as_slice(), ["steps", _, "in", _] | ["outputs", _])
                || matches!(path.as_slice(), ["outputs", _, "from"]);
            if let Some(node) = node.filter(|_| refers) {
                self.references(node, name, new, &mut changes);
            }
        });
        changes.sort_by_key(|(span, _)| span.start);
        changes.dedup();
        for (span, text) in changes.into_iter().rev() {
            self.replace(span, &text);
        }
    }

    fn references(
        &self,
        node: &Node,
        name: &str,
        new: &str,
        changes: &mut Vec<(Range<usize>, String)>,
    ) {
        match &node.shape {
            Shape::Array(items) => {
                items
                    .iter()
                    .for_each(|item| self.references(item, name, new, changes));
            }
            Shape::Scalar => {
                if let Some(Value::String(text)) = read(self.slice(node.span.clone()))
                    && let Some(rest) = text.strip_prefix(name)
                    && (rest.is_empty() || rest.starts_with('.'))
                {
                    changes.push((node.span.clone(), quoted(&format!("{new}{rest}"))));
                }
            }
            Shape::Inline(_) => {}
        }
    }
}

/// The keys of a path that rename `path`'s last part.
fn keys(
    parts: &[KeyPart],
    above: &[&str],
    path: &[&str],
    new: &str,
    changes: &mut Vec<(Range<usize>, String)>,
) {
    let full: Vec<&str> = above
        .iter()
        .copied()
        .chain(parts.iter().map(|part| part.name.as_str()))
        .collect();
    if full.starts_with(path)
        && let Some(place) = path.len().checked_sub(above.len() + 1)
        && let Some(part) = parts.get(place)
    {
        changes.push((part.span.clone(), toml_key(new)));
    }
}

fn pair_keys(
    pair: &Pair,
    above: &[&str],
    path: &[&str],
    new: &str,
    changes: &mut Vec<(Range<usize>, String)>,
) {
    keys(&pair.keys, above, path, new, changes);
    if let Shape::Inline(pairs) = &pair.value.shape {
        let mut above = above.to_vec();
        above.extend(pair.keys.iter().map(|part| part.name.as_str()));
        pairs
            .iter()
            .for_each(|pair| pair_keys(pair, &above, path, new, changes));
    }
}
