//! HDF5 attributes, and trees of groups that only carry attributes, as JSON.

use hdf5::types::{VarLenAscii, VarLenUnicode};
use hdf5::{Attribute, Group, Location};
use serde_json::{Map, Value};

use crate::pickle::{self, Decoded};
use crate::raw::{self, StoredType};
use crate::record::{Number, number};
use crate::split::{Block, fill_f64, text};

/// Bytes of one value; larger ones are named only.
const MAX_BYTES: usize = 1 << 20;
/// Attributes and groups of one tree.
const MAX_ENTRIES: usize = 20_000;
/// Bytes of all values of one tree.
const MAX_TOTAL: usize = 16 << 20;
/// Nesting of groups.
const MAX_DEPTH: usize = 16;
/// Elements of one list.
const MAX_LIST: usize = 10_000;
/// Attributes that PyTables writes for itself.
const BOOKKEEPING: [&str; 3] = ["CLASS", "TITLE", "VERSION"];

/// The attributes of `group` and of the groups below it. A group is an object; its own
/// attributes win over a subgroup of the same name. Notes name what was left out.
pub(crate) fn tree(group: &Group, notes: &mut Vec<String>) -> Value {
    let mut walk = Walk {
        entries: 0,
        bytes: 0,
        notes,
    };
    walk.group(group, 0)
}

struct Walk<'a> {
    entries: usize,
    bytes: usize,
    notes: &'a mut Vec<String>,
}

impl Walk<'_> {
    fn group(&mut self, group: &Group, depth: usize) -> Value {
        let mut map = Map::new();
        if depth > MAX_DEPTH {
            self.notes.push(format!(
                "{} is nested too deeply and left out.",
                group.name()
            ));
            return Value::Object(map);
        }
        for name in group.member_names().unwrap_or_default() {
            // Only groups: datasets below the metadata are no values.
            if self.full() {
                break;
            }
            if let Ok(below) = group.group(&name) {
                self.entries += 1;
                map.insert(name, self.group(&below, depth + 1));
            }
        }
        for name in group.attr_names().unwrap_or_default() {
            if self.full() {
                self.notes.push(format!(
                    "{} has too many entries; some are left out.",
                    group.name()
                ));
                break;
            }
            if BOOKKEEPING.contains(&name.as_str()) {
                continue;
            }
            self.entries += 1;
            let value = match attribute(group, &name) {
                Ok((value, bytes)) => {
                    self.bytes += bytes;
                    value
                }
                Err(why) => {
                    let place = format!("{}/{name}", group.name());
                    self.notes
                        .push(format!("Attribute {place} is left out: {why}."));
                    continue;
                }
            };
            map.insert(name, value);
        }
        Value::Object(map)
    }

    fn full(&self) -> bool {
        self.entries >= MAX_ENTRIES || self.bytes >= MAX_TOTAL
    }
}

/// One attribute as JSON and its size in bytes.
pub(crate) fn attribute(location: &Location, name: &str) -> Result<(Value, usize), String> {
    let attribute = location
        .attr(name)
        .map_err(|e| crate::error::hdf5_reason(&e))?;
    let (stored, size) = raw::stored_type(&attribute).map_err(|e| crate::error::hdf5_reason(&e))?;
    if stored == StoredType::VarText {
        return variable_text(&attribute);
    }
    let bytes =
        raw::read_attribute(&attribute, MAX_BYTES).map_err(|e| crate::error::hdf5_reason(&e))?;
    if bytes.is_empty() {
        // A null dataspace: PyTables writes it for an empty text.
        let empty = matches!(stored, StoredType::Text { .. });
        return Ok((
            if empty {
                Value::from("")
            } else {
                Value::Array(Vec::new())
            },
            0,
        ));
    }
    let values: Option<Vec<Value>> = bytes
        .chunks_exact(size.max(1))
        .take(MAX_LIST + 1)
        .map(|one| element(&stored, one))
        .collect();
    let Some(mut values) = values.filter(|values| values.len() <= MAX_LIST) else {
        return Err("its type is not a plain value or list".into());
    };
    let value = match (attribute.is_scalar(), values.pop()) {
        (true, Some(value)) => value,
        (_, last) => {
            values.extend(last);
            Value::Array(values)
        }
    };
    Ok((value, bytes.len()))
}

fn variable_text(attribute: &Attribute) -> Result<(Value, usize), String> {
    if !attribute.is_scalar() && attribute.size() > MAX_LIST {
        return Err("its list is too long".into());
    }
    let texts: Vec<String> = match attribute.read_raw::<VarLenUnicode>() {
        Ok(texts) => texts.iter().map(|text| text.as_str().to_owned()).collect(),
        Err(_) => attribute
            .read_raw::<VarLenAscii>()
            .map_err(|e| crate::error::hdf5_reason(&e))?
            .iter()
            .map(|text| text.as_str().to_owned())
            .collect(),
    };
    let bytes = texts.iter().map(String::len).sum();
    let mut values: Vec<Value> = texts
        .into_iter()
        .map(|text| plain_or_pickle(text.as_bytes()))
        .collect();
    let value = match attribute.is_scalar() {
        true => values.pop().unwrap_or_default(),
        false => Value::Array(values),
    };
    Ok((value, bytes))
}

fn element(stored: &StoredType, bytes: &[u8]) -> Option<Value> {
    match stored {
        StoredType::Text { .. } => Some(plain_or_pickle(bytes)),
        StoredType::Array {
            element: inner,
            dims,
        } => {
            let count = dims.iter().try_fold(1_u64, |n, &dim| n.checked_mul(dim))?;
            let count = usize::try_from(count)
                .ok()
                .filter(|&n| n > 0 && n <= MAX_LIST)?;
            let values: Option<Vec<_>> = bytes
                .chunks_exact(bytes.len() / count)
                .map(|one| element(inner, one))
                .collect();
            Some(Value::Array(values?))
        }
        _ => {
            let (kind, big) = number(stored)?;
            numeric(kind, big, bytes)
        }
    }
}

fn numeric(kind: Number, big: bool, bytes: &[u8]) -> Option<Value> {
    let whole = |signed: bool| {
        let mut wide = [0; 8];
        wide.get_mut(..bytes.len())?.copy_from_slice(bytes);
        if big {
            wide.get_mut(..bytes.len())?.reverse();
        }
        let unused = 64 - 8 * bytes.len() as u32;
        let value = u64::from_le_bytes(wide);
        Some(if signed {
            Value::from((value << unused) as i64 >> unused)
        } else {
            Value::from(value)
        })
    };
    match kind {
        Number::Bool => Some(Value::Bool(*bytes.first()? != 0)),
        Number::F16 | Number::F32 | Number::F64 => {
            let mut value = [0.0];
            let block = Block::Records {
                bytes,
                record: bytes.len(),
            };
            fill_f64(block, 0, kind, big, 1.0, &mut value);
            Some(pickle::float(value[0]))
        }
        Number::I8 | Number::I16 | Number::I32 | Number::I64 => whole(true),
        Number::U8 | Number::U16 | Number::U32 | Number::U64 => whole(false),
    }
}

/// PyTables keeps lists, long integers and other objects as pickles in text attributes.
fn plain_or_pickle(bytes: &[u8]) -> Value {
    // Fixed text is padded with NUL, which a binary pickle may also hold before its last byte.
    let end = bytes
        .iter()
        .rposition(|&b| b != 0)
        .map_or(0, |last| last + 1);
    let trimmed = bytes.get(..end).unwrap_or_default();
    match pickle::decode(trimmed) {
        Decoded::Value(value) => value,
        Decoded::Undecoded(why) => Value::from(format!("undecoded pickle ({why})")),
        Decoded::NotPickle => Value::from(text(trimmed)),
    }
}
