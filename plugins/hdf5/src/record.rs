//! Flat fields of a stored record: nested names joined with underscores.

use puncta_sdk::Element;

use crate::raw::{Member, StoredType};

/// Levels of nesting whose names are joined (`slicesUsed_x_start` has three).
const MAX_LEVELS: usize = 3;
/// Elements of a list inside a record that become columns of their own.
const MAX_LIST: u64 = 16;

/// A number or text at a fixed place in a record.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Leaf {
    /// Names joined with underscores.
    pub name: String,
    /// First byte in the record.
    pub offset: usize,
    pub stored: LeafType,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum LeafType {
    Number { number: Number, big_endian: bool },
    Text { size: usize },
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Number {
    U8,
    I8,
    U16,
    I16,
    U32,
    I32,
    U64,
    I64,
    F16,
    F32,
    F64,
    Bool,
}

impl Number {
    pub(crate) fn size(self) -> usize {
        match self {
            Self::U8 | Self::I8 | Self::Bool => 1,
            Self::U16 | Self::I16 | Self::F16 => 2,
            Self::U32 | Self::I32 | Self::F32 => 4,
            Self::U64 | Self::I64 | Self::F64 => 8,
        }
    }
}

impl Leaf {
    pub(crate) fn size(&self) -> usize {
        match self.stored {
            LeafType::Number { number, .. } => number.size(),
            LeafType::Text { size } => size,
        }
    }

    pub(crate) fn is_number(&self) -> bool {
        matches!(self.stored, LeafType::Number { .. })
    }

    /// The column type that keeps the stored values unchanged.
    pub(crate) fn element(&self) -> Element {
        match self.stored {
            LeafType::Text { .. } => Element::Utf8,
            LeafType::Number { number, .. } => match number {
                Number::U8 => Element::U8,
                Number::I8 => Element::I8,
                Number::U16 => Element::U16,
                Number::I16 => Element::I16,
                Number::U32 => Element::U32,
                Number::I32 => Element::I32,
                Number::U64 => Element::U64,
                Number::I64 => Element::I64,
                Number::F16 | Number::F32 => Element::F32,
                Number::F64 => Element::F64,
                Number::Bool => Element::Bool,
            },
        }
    }
}

/// The fields of a record that can become columns, and those that cannot (`name (reason)`).
#[derive(Debug, Default)]
pub(crate) struct Fields {
    pub leaves: Vec<Leaf>,
    pub skipped: Vec<String>,
}

/// Flattens a compound type; anything else gives no fields.
pub(crate) fn flatten(stored: &StoredType) -> Fields {
    let mut fields = Fields::default();
    if let StoredType::Compound { size, members } = stored {
        walk(members, &[], 0, *size, &mut fields);
    }
    fields
}

fn walk(members: &[Member], path: &[&str], base: usize, record: usize, fields: &mut Fields) {
    for member in members {
        let mut names = path.to_vec();
        names.push(&member.name);
        let name = names.join("_");
        // A corrupted type may place a member outside its record.
        let offset = base.saturating_add(member.offset);
        match &member.stored {
            StoredType::Compound { members, .. } if names.len() < MAX_LEVELS => {
                walk(members, &names, offset, record, fields);
            }
            StoredType::Compound { .. } => {
                fields
                    .skipped
                    .push(format!("{name} (nested deeper than three levels)"));
            }
            StoredType::Array { element, dims } => {
                list(&name, offset, element, dims, record, fields)
            }
            other => leaf(name, offset, other, record, fields),
        }
    }
}

fn list(
    name: &str,
    offset: usize,
    element: &StoredType,
    dims: &[u64],
    record: usize,
    fields: &mut Fields,
) {
    let size = match number(element) {
        Some((number, _)) => number.size(),
        None => return fields.skipped.push(format!("{name} (a list)")),
    };
    match dims {
        [length] if *length <= MAX_LIST => {
            for index in 0..*length as usize {
                let at = offset.saturating_add(index * size);
                leaf(format!("{name}_{index}"), at, element, record, fields);
            }
        }
        _ => fields
            .skipped
            .push(format!("{name} (an array of {dims:?} numbers)")),
    }
}

fn leaf(name: String, offset: usize, stored: &StoredType, record: usize, fields: &mut Fields) {
    let stored = match stored {
        StoredType::Text { size } if *size > 0 => LeafType::Text { size: *size },
        StoredType::VarText => {
            return fields
                .skipped
                .push(format!("{name} (variable-length text)"));
        }
        StoredType::Other { name: what, .. } => {
            return fields.skipped.push(format!("{name} ({what})"));
        }
        plain => match number(plain) {
            Some((number, big_endian)) => LeafType::Number { number, big_endian },
            None => return fields.skipped.push(format!("{name} (no value)")),
        },
    };
    let leaf = Leaf {
        name,
        offset,
        stored,
    };
    if offset
        .checked_add(leaf.size())
        .is_some_and(|end| end <= record)
    {
        fields.leaves.push(leaf);
    } else {
        fields
            .skipped
            .push(format!("{} (lies outside its record)", leaf.name));
    }
}

/// The number that a type holds, and whether it is big endian.
pub(crate) fn number(stored: &StoredType) -> Option<(Number, bool)> {
    Some(match *stored {
        StoredType::Bool => (Number::Bool, false),
        StoredType::Int {
            size,
            signed,
            big_endian,
        } => {
            let number = match (size, signed) {
                (1, false) => Number::U8,
                (1, true) => Number::I8,
                (2, false) => Number::U16,
                (2, true) => Number::I16,
                (4, false) => Number::U32,
                (4, true) => Number::I32,
                (8, false) => Number::U64,
                (8, true) => Number::I64,
                _ => return None,
            };
            (number, big_endian)
        }
        StoredType::Float { size, big_endian } => {
            let number = match size {
                2 => Number::F16,
                4 => Number::F32,
                8 => Number::F64,
                _ => return None,
            };
            (number, big_endian)
        }
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn int() -> StoredType {
        StoredType::Int {
            size: 4,
            signed: true,
            big_endian: false,
        }
    }

    fn member(name: &str, offset: usize, stored: StoredType) -> Member {
        Member {
            name: name.into(),
            offset,
            stored,
        }
    }

    #[test]
    fn nested_names_join_and_offsets_add() {
        let start = StoredType::Compound {
            size: 8,
            members: vec![member("start", 4, int())],
        };
        let x = StoredType::Compound {
            size: 12,
            members: vec![member("x", 4, start)],
        };
        let list = StoredType::Array {
            element: Box::new(int()),
            dims: vec![2],
        };
        let record = StoredType::Compound {
            size: 32,
            members: vec![
                member("slicesUsed", 8, x),
                member("p", 20, list),
                member("outside", 30, int()),
                member("s", 0, StoredType::Text { size: 4 }),
                member("v", 4, StoredType::VarText),
            ],
        };
        let fields = flatten(&record);
        let found: Vec<_> = fields
            .leaves
            .iter()
            .map(|l| (l.name.as_str(), l.offset))
            .collect();
        assert_eq!(
            found,
            [
                ("slicesUsed_x_start", 16),
                ("p_0", 20),
                ("p_1", 24),
                ("s", 0)
            ]
        );
        assert_eq!(fields.skipped.len(), 2);
        assert!(fields.skipped[0].starts_with("outside ("));
    }

    #[test]
    fn a_fourth_level_is_left_out_and_named() {
        let mut inner = StoredType::Compound {
            size: 4,
            members: vec![member("d", 0, int())],
        };
        for name in ["c", "b", "a"] {
            inner = StoredType::Compound {
                size: 4,
                members: vec![member(name, 0, inner)],
            };
        }
        let fields = flatten(&inner);
        assert!(fields.leaves.is_empty());
        assert_eq!(fields.skipped, ["a_b_c (nested deeper than three levels)"]);
    }
}
