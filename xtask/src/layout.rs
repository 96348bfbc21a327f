//! What changed between two layouts of the ABI, and whether it breaks what was built before.

use std::collections::BTreeMap;

/// A table: size, alignment, and members by name with their offsets.
#[derive(Debug, Default, PartialEq, Eq)]
struct Table {
    size: String,
    fields: Vec<(String, String)>,
}

/// A layout as `plugin-api/abi/layout.txt` writes it down.
#[derive(Debug, Default)]
pub struct Layout {
    /// The ABI number.
    pub number: u32,
    tables: BTreeMap<String, Table>,
}

impl Layout {
    /// Reads a layout; lines that it does not know are left out.
    #[must_use]
    pub fn read(text: &str) -> Layout {
        let mut layout = Layout::default();
        let mut current = String::new();
        for line in text.lines() {
            let words: Vec<&str> = line.split_whitespace().collect();
            match words.as_slice() {
                ["ABI", "number", number, ..] => {
                    layout.number = number.trim_end_matches(',').parse().unwrap_or(0);
                }
                [name, "size", size, "align", align] => {
                    current = (*name).to_owned();
                    let table = layout.tables.entry(current.clone()).or_default();
                    table.size = format!("{size} bytes, aligned to {align}");
                }
                [offset, field] => {
                    let table = layout.tables.entry(current.clone()).or_default();
                    table
                        .fields
                        .push(((*field).to_owned(), (*offset).to_owned()));
                }
                _ => {}
            }
        }
        layout
    }
}

/// What differs between a layout and a later one.
#[derive(Debug, Default, PartialEq, Eq)]
pub struct Difference {
    /// Sentences about what is new and disturbs nobody.
    pub added: Vec<String>,
    /// Sentences about what plugins that were built before would stumble over.
    pub broken: Vec<String>,
}

/// Compares a layout with a later one.
#[must_use]
pub fn difference(old: &Layout, new: &Layout) -> Difference {
    let mut found = Difference::default();
    for name in new
        .tables
        .keys()
        .filter(|name| !old.tables.contains_key(*name))
    {
        found.added.push(format!("the table {name} is new"));
    }
    for (name, before) in &old.tables {
        let Some(after) = new.tables.get(name) else {
            found.broken.push(format!("the table {name} is gone"));
            continue;
        };
        if before.size != after.size {
            let (before, after) = (&before.size, &after.size);
            found
                .broken
                .push(format!("the table {name} has {after}, and had {before}"));
        }
        for (field, offset) in &before.fields {
            match after.fields.iter().find(|(known, _)| known == field) {
                None => found.broken.push(format!("{name}.{field} is gone")),
                Some((_, now)) if now != offset => found.broken.push(format!(
                    "{name}.{field} is at byte {now}, and was at {offset}"
                )),
                Some(_) => {}
            }
        }
        for (field, offset) in &after.fields {
            if !before.fields.iter().any(|(known, _)| known == field) {
                found
                    .broken
                    .push(format!("{name}.{field} is new at byte {offset}"));
            }
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    const OLD: &str = "ABI number 1, 64-bit\nStr size 16 align 8\n  0 ptr\n  8 len\nHost size 8 align 8\n  0 get\n";

    #[test]
    fn a_new_table_breaks_nothing() {
        let (old, new) = (
            Layout::read(OLD),
            Layout::read(&format!("{OLD}More size 4 align 4\n  0 x\n")),
        );
        let found = difference(&old, &new);
        assert_eq!(found.added, ["the table More is new"]);
        assert!(found.broken.is_empty());
        assert_eq!(difference(&old, &old), Difference::default());
    }

    #[test]
    fn every_other_change_is_named() {
        let old = Layout::read(OLD);
        let broken = |text: &str| difference(&old, &Layout::read(text)).broken.join("; ");
        let moved = OLD.replace("  8 len", "  4 len");
        assert_eq!(broken(&moved), "Str.len is at byte 4, and was at 8");
        let longer = OLD.replace("Host size 8", "Host size 16") + "  8 more\n";
        let said = broken(&longer);
        assert!(said.contains("Host has 16 bytes") && said.contains("Host.more is new"));
        let gone = OLD.replace("  0 ptr\n", "");
        assert_eq!(broken(&gone), "Str.ptr is gone");
        let (without, _) = OLD.split_at(OLD.find("Host").unwrap_or(0));
        assert_eq!(broken(without), "the table Host is gone");
        let renamed = OLD.replace("ptr", "bytes");
        assert!(broken(&renamed).contains("Str.ptr is gone; Str.bytes is new at byte 0"));
    }
}
