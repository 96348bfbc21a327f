//! The head of a .npy file, and what of its records becomes columns.

use crate::dtype::{self, Entry, Kind};
use crate::literal::{self, Literal};
use puncta_sdk::{ColumnInfo, Failure};
use puncta_shared_import::Mapping;
use puncta_shared_records::fill::Select;
use puncta_shared_records::names::{self, Raw};
use puncta_shared_records::{Field, Number, Pick, damaged, minflux, not_mine, unsupported};
use std::io::Read;

const MAGIC: &[u8] = b"\x93NUMPY";
/// A head that describes a record of a few hundred fields has some 10 kB.
const MOST_HEAD: usize = 1 << 20;

/// An array of records, or of numbers.
#[derive(Debug)]
pub struct Array {
    /// Bytes before the first record.
    pub begin: u64,
    /// Records.
    pub rows: u64,
    /// Bytes of a record.
    pub record: usize,
    entries: Vec<Entry>,
}

/// Reads the head of an array.
pub fn head(name: &str, stream: &mut dyn Read) -> Result<Array, Failure> {
    let foreign = || not_mine(name, "NumPy array");
    let broken = || damaged(format!("the head of {name} is damaged"));
    let mut start = [0; 8];
    stream.read_exact(&mut start).map_err(|_| foreign())?;
    let [magic @ .., major, _] = start;
    if magic != MAGIC {
        return Err(foreign());
    }
    let mut size = [0; 4];
    let wide = if major == 1 { 2 } else { 4 };
    stream.read_exact(&mut size[..wide]).map_err(|_| broken())?;
    let length = u32::from_le_bytes(size) as usize;
    if length > MOST_HEAD {
        return Err(broken());
    }
    let mut text = vec![0; length];
    stream.read_exact(&mut text).map_err(|_| broken())?;
    let text = String::from_utf8_lossy(&text);
    let Some(Literal::Map(members)) = literal::parse(&text) else {
        return Err(broken());
    };
    let member = |key: &str| {
        members
            .iter()
            .find(|(known, _)| known == key)
            .map(|(_, v)| v)
    };
    let (Some(descr), Some(shape)) = (member("descr"), member("shape")) else {
        return Err(broken());
    };
    if matches!(descr, Literal::Text(text) if text.trim_start_matches('|').starts_with('O')) {
        let message = format!("{name} holds Python objects, which are not read as they run code");
        return Err(unsupported(
            message,
            "save it as an array of numbers or of records",
        ));
    }
    let dimensions = match shape {
        Literal::List(sizes) => sizes.len(),
        _ => 1,
    };
    let rows = dtype::product(shape).ok_or_else(broken)? as u64;
    let (entries, record) = match descr {
        Literal::Text(text) => {
            let stored = dtype::scalar(text).ok_or_else(foreign)?;
            let entry = Entry {
                name: "value".into(),
                at: 0,
                count: 1,
                kind: Kind::Number(stored),
            };
            (vec![entry], stored.number.bytes())
        }
        records => dtype::record(records).ok_or_else(|| {
            unsupported(
                format!("{name} holds records that are no numbers"),
                "save it without Python objects",
            )
        })?,
    };
    if dimensions != 1 || record == 0 {
        // Planes and volumes are images.
        return Err(not_mine(name, "list of records"));
    }
    Ok(Array {
        begin: (8 + wide + length) as u64,
        rows,
        record,
        entries,
    })
}

/// Which records are localisations.
#[derive(Debug, Default)]
pub struct Choice {
    /// Bytes of truth values that must not be 0.
    flags: Vec<usize>,
    /// Byte of the record that is picked from the nested list.
    sub: usize,
}

impl Choice {
    /// Whether all records are taken, with nothing nested in them.
    pub fn is_plain(&self) -> bool {
        self.flags.is_empty() && self.sub == 0
    }

    /// The selection for records of `record` bytes.
    pub fn select(&self, record: usize) -> impl Fn(u64, &[u8], usize, &mut Vec<Pick>) + Sync + '_ {
        move |_, bytes, rows, picks| {
            for row in 0..rows {
                let at = row * record;
                let flag = |flag: &usize| bytes.get(at + flag).is_some_and(|byte| *byte != 0);
                if self.flags.iter().all(flag) {
                    let place = |at: usize| u32::try_from(at).unwrap_or(u32::MAX);
                    picks.push(Pick {
                        record: place(at),
                        sub: place(at + self.sub),
                    });
                }
            }
        }
    }

    /// The selection as the filling takes it.
    pub fn of<'s>(&self, select: &'s Select<'s>) -> Option<&'s Select<'s>> {
        (!self.is_plain()).then_some(select)
    }
}

/// What the array is, for sentences and the probe.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Layout {
    /// A record a localisation, with a list of its iterations.
    Old,
    /// A record an iteration.
    New,
    /// Records of another program.
    Records,
    /// Bare numbers.
    Numbers,
}

impl Layout {
    /// Name of the format.
    pub fn name(self) -> &'static str {
        match self {
            Layout::Old => "MINFLUX npy",
            Layout::New => "MINFLUX npy (2024 and later)",
            Layout::Records => "NumPy records",
            Layout::Numbers => "NumPy numbers",
        }
    }

    /// How sure that is.
    pub fn confidence(self) -> f64 {
        match self {
            Layout::Old | Layout::New => 1.0,
            Layout::Records => 0.6,
            Layout::Numbers => 0.4,
        }
    }
}

/// What the reader makes of an array.
#[derive(Debug)]
pub struct Columns {
    /// The layout.
    pub layout: Layout,
    /// The columns.
    pub fields: Vec<Field>,
    /// The rows.
    pub choice: Choice,
    /// For the person.
    pub notes: Vec<String>,
}

/// The columns of the array of the file `file`. `all` keeps rows that are not valid.
///
/// # Errors
/// A mapping that speaks of columns that are not there.
pub fn columns(
    file: &str,
    array: &Array,
    all: bool,
    mapping: &Mapping,
) -> Result<Columns, Failure> {
    let nested = array.entries.iter().find_map(|entry| match &entry.kind {
        Kind::Nested(inner, bytes) if entry.name == "itr" && entry.count > 0 => {
            Some((entry, inner, *bytes))
        }
        _ => None,
    });
    let has = |name: &str| array.entries.iter().any(|entry| entry.name == name);
    let layout = match nested {
        Some((_, inner, _)) if inner.iter().any(|entry| entry.name == "loc") => Layout::Old,
        _ if has("loc") && has("tid") => Layout::New,
        _ if array.entries.len() == 1 && has("value") => Layout::Numbers,
        _ => Layout::Records,
    };
    let (mut raw, mut fields) = (Vec::new(), Vec::new());
    for entry in &array.entries {
        add(layout, entry, false, &mut raw, &mut fields);
    }
    let mut choice = Choice::default();
    if let (Layout::Old, Some((entry, inner, bytes))) = (layout, nested) {
        choice.sub = entry.at + (entry.count - 1) * bytes;
        for entry in inner {
            add(layout, entry, true, &mut raw, &mut fields);
        }
    }
    if !all && matches!(layout, Layout::Old | Layout::New) {
        let flag = |entry: &&Entry| {
            let truth = matches!(&entry.kind, Kind::Number(stored)
                if matches!(stored.number, Number::Bool | Number::U8));
            truth && matches!(entry.name.as_str(), "vld" | "fnl")
        };
        choice.flags = array
            .entries
            .iter()
            .filter(flag)
            .map(|entry| entry.at)
            .collect();
    }
    let (fields, notes) = names::fields(file, mapping, &raw, &fields)?;
    Ok(Columns {
        layout,
        fields,
        choice,
        notes,
    })
}

/// Adds the numbers of an entry.
fn add(layout: Layout, entry: &Entry, picked: bool, raw: &mut Vec<Raw>, fields: &mut Vec<Field>) {
    let Kind::Number(stored) = entry.kind else {
        return;
    };
    if entry.count == 0 || entry.count > 16 {
        return;
    }
    for axis in 0..entry.count {
        let along = (entry.count > 1).then_some(axis);
        let element = stored.number.element();
        let one = match layout {
            Layout::Old | Layout::New => minflux::column(&entry.name, along, element),
            Layout::Records | Layout::Numbers => {
                let axis = along.map(|axis| format!("{}_{axis}", entry.name));
                Raw::named(axis.as_ref().unwrap_or(&entry.name), element, None)
            }
        };
        let info = ColumnInfo::new(&one.source, element, "");
        let mut field = Field::new(info, stored, entry.at + axis * stored.number.bytes());
        field.picked = picked;
        raw.push(one);
        fields.push(field);
    }
}
