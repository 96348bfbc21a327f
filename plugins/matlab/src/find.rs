//! Which table is in a file, and where its columns are.

use crate::container::Variable;
use crate::matrix::{Array, Data, Value};
use crate::tracks;
use crate::unpack::{load, nothing};
use puncta_sdk::{ColumnInfo, Element, Failure, Map};
use puncta_shared_import::Mapping;
use puncta_shared_records::names::{self, Placed, Raw};
use puncta_shared_records::{Field, Number, damaged, minflux};
use serde_json::json;
use std::fs::File;

/// What the person said.
#[derive(Debug)]
pub struct Options<'o> {
    /// What the person says of columns and units.
    pub mapping: &'o Mapping,
    /// Keep rows that are not valid.
    pub all: bool,
}

/// A column as the file has it.
#[derive(Clone, Debug)]
pub struct Column {
    /// Its name, unit and type.
    pub raw: Raw,
    /// Its values.
    pub values: Values,
}

/// Values of a column.
#[derive(Clone, Debug)]
pub enum Values {
    /// Numbers of an array, from one of them on.
    Stored {
        /// Number of the variable.
        variable: usize,
        /// The array.
        array: Array,
        /// First value.
        first: usize,
        /// How it is read, once it has been placed.
        field: Box<Field>,
    },
    /// Numbers gathered from small arrays.
    Gathered(Vec<f64>),
    /// Whole numbers gathered.
    Whole(Vec<i64>),
}

impl Values {
    /// Where they are: the variable, and the byte in it or in the file.
    pub fn place(&self) -> (usize, u64) {
        match self {
            Values::Stored {
                variable,
                array,
                first,
                ..
            } => match array.data {
                Data::At(at) => (*variable, at + (first * array.stored.number.bytes()) as u64),
                Data::Kept(_) => (*variable, 0),
            },
            _ => (0, 0),
        }
    }
}

/// The table of a file.
#[derive(Debug, Default)]
pub struct Table {
    /// Name of the format.
    pub format: &'static str,
    /// How sure that is.
    pub confidence: f64,
    /// Rows, valid or not.
    pub rows: usize,
    /// Columns of the file.
    pub columns: Vec<Column>,
    /// Columns of the host.
    pub placed: Vec<Placed>,
    /// Whether rows are those of tracks.
    pub tracks: bool,
    /// Which rows are valid; all if it is empty.
    pub valid: Vec<bool>,
    /// The file's other small values.
    pub metadata: Map,
    /// For the person.
    pub notes: Vec<String>,
}

/// Finds the table.
pub fn find(
    name: &str,
    file: &File,
    variables: &[Variable],
    options: &Options<'_>,
) -> Result<Table, Failure> {
    let variable = |name: &str| variables.iter().position(|known| known.name == name);
    let tracked = variable("trackedPar").and_then(|at| tracks::spot_on(&variables[at].value));
    let linked = variable("tracksFinal").and_then(|at| tracks::u_track(&variables[at].value));
    let saved = variable("saveloc").and_then(|at| smap(at, &variables[at].value));
    let mut table = if let Some(table) = tracked.or(linked).or(saved) {
        table
    } else if let Some(table) = microscope(name, file, variables, options)? {
        table
    } else {
        vectors(variables).ok_or_else(|| nothing(name, variables))?
    };
    let mut left = 500;
    for variable in variables {
        if let Some(value) = tree(&variable.value, &mut left, 0) {
            table.metadata.insert(variable.name.clone(), value);
        }
    }
    let raw: Vec<Raw> = table
        .columns
        .iter()
        .map(|column| column.raw.clone())
        .collect();
    let (placed, notes) = names::place(name, options.mapping, &raw)?;
    table.placed = placed;
    table.notes.extend(notes);
    for one in &mut table.placed {
        if let Some(Values::Stored { array, .. }) = table.columns.get(one.place).map(|c| &c.values)
        {
            let float = matches!(array.class, Number::F64 | Number::F32);
            let same = array.class == array.stored.number;
            one.info.type_.element = if one.converts() || (float && !same) || one.minus > 0.0 {
                Element::F64
            } else {
                array.stored.number.element()
            };
        } else if one.converts() {
            one.info.type_.element = Element::F64;
        }
    }
    Ok(table)
}

/// A vector as a column.
fn stored(variable: usize, array: &Array, first: usize, raw: Raw) -> Column {
    let info = ColumnInfo::new(&raw.source, array.stored.number.element(), "");
    let field = Box::new(Field::new(info, array.stored, 0));
    let values = Values::Stored {
        variable,
        array: array.clone(),
        first,
        field,
    };
    Column { raw, values }
}

fn element(array: &Array) -> Element {
    array.class.element()
}

/// SMAP's `saveloc.loc`.
fn smap(variable: usize, saved: &Value) -> Option<Table> {
    let Value::Struct {
        names: fields,
        values,
    } = saved.field("loc")?
    else {
        return None;
    };
    let rows = saved
        .field("loc")?
        .field("frame")
        .or(saved.field("loc")?.field("xnm"))?;
    let rows = rows.array()?.count();
    let mut table = Table {
        format: "SMAP mat",
        confidence: 1.0,
        rows,
        ..Table::default()
    };
    for (name, value) in fields.iter().zip(values) {
        let Some(array) = value.array().filter(|array| array.count() == rows) else {
            continue;
        };
        let mut raw = Raw::named(name, element(array), None);
        if name == "frame" {
            raw = raw.from_one();
        }
        if name == "locprecnm" && saved.field("loc")?.field("ynmerr").is_some() {
            raw.named.twin = None;
        }
        table.columns.push(stored(variable, array, 0, raw));
    }
    Some(table)
}

/// MINFLUX: `itr.loc` of all iterations, or flat `loc`.
fn microscope(
    name: &str,
    file: &File,
    variables: &[Variable],
    options: &Options<'_>,
) -> Result<Option<Table>, Failure> {
    let at = |name: &str| variables.iter().position(|known| known.name == name);
    let old = at("itr").filter(|at| variables[*at].value.field("loc").is_some());
    let places = match old {
        Some(at) => variables[at].value.field("loc"),
        None => at("loc").map(|at| &variables[at].value),
    };
    let (Some(places), Some(_)) = (places.and_then(Value::array), at("tid")) else {
        return Ok(None);
    };
    let Some(&rows) = places.sizes.first().filter(|rows| **rows > 0) else {
        return Ok(None);
    };
    let mut table = Table {
        format: "MINFLUX mat",
        confidence: 1.0,
        rows,
        ..Table::default()
    };
    for (place, variable) in variables.iter().enumerate() {
        let Some(array) = variable.value.array() else {
            continue;
        };
        table.add(place, &variable.name, array, 1);
        let flag = matches!(variable.name.as_str(), "vld" | "fnl") && !options.all;
        if flag && array.is_vector() && array.count() == rows {
            let bytes = load(name, file, variable, array)?;
            let values = bytes.chunks_exact(array.stored.number.bytes());
            let truth = values.map(|bytes| bytes.iter().any(|byte| *byte != 0));
            let before = std::mem::take(&mut table.valid);
            let and = |(i, now): (usize, bool)| now && before.get(i).copied().unwrap_or(true);
            table.valid = truth.enumerate().map(and).collect();
        }
    }
    if let Some(place) = old
        && let Value::Struct { names, values } = &variables[place].value
    {
        let iterations = match *places.sizes {
            [_, count, _] => count,
            _ => 1,
        };
        for (field, value) in names.iter().zip(values) {
            if let Some(array) = value.array() {
                table.add(place, field, array, iterations);
            }
        }
    }
    match table
        .columns
        .iter()
        .any(|column| column.raw.named.name == "x")
    {
        true => Ok(Some(table)),
        false => Err(damaged(format!("{name} has no column loc of x, y and z"))),
    }
}

impl Table {
    /// The columns of a MINFLUX field: of the last of its iterations, along each axis.
    fn add(&mut self, variable: usize, name: &str, array: &Array, iterations: usize) {
        let (rows, last) = (self.rows, iterations.saturating_sub(1));
        let axes = match *array.sizes {
            _ if array.is_vector() && array.count() == rows => 0,
            [n, k] if n == rows && k == iterations => 0,
            [n, axes @ 2..=3] if n == rows && iterations == 1 => axes,
            [n, k, axes @ 2..=3] if n == rows && k == iterations => axes,
            _ => return,
        };
        let last = if array.is_vector() { 0 } else { last };
        for axis in 0..axes.max(1) {
            let along = (axes > 0).then_some(axis);
            let raw = minflux::column(name, along, element(array));
            let first = rows * (last + iterations * axis);
            if first + rows <= array.count() {
                self.columns.push(stored(variable, array, first, raw));
            }
        }
    }
}

/// The vectors of equal length of the file, or of one of its structures, that are most likely a
/// table: those with x and y, else the longest.
fn vectors(variables: &[Variable]) -> Option<Table> {
    type Found<'a> = Vec<(usize, String, &'a Array)>;
    fn collect<'a>(at: usize, value: &'a Value, depth: usize, groups: &mut Vec<Found<'a>>) {
        let Value::Struct { names, values } = value else {
            return;
        };
        if values.len() != names.len() || depth > 8 {
            return;
        }
        let mut group = Vec::new();
        for (name, value) in names.iter().zip(values) {
            match value {
                Value::Numbers(array) => group.push((at, name.clone(), array)),
                inner => collect(at, inner, depth + 1, groups),
            }
        }
        groups.push(group);
    }
    let mut groups: Vec<Found<'_>> = vec![Vec::new()];
    for (at, variable) in variables.iter().enumerate() {
        match &variable.value {
            Value::Numbers(array) => groups[0].push((at, variable.name.clone(), array)),
            value => collect(at, value, 0, &mut groups),
        }
    }
    let mut best: Option<(bool, usize, Found<'_>)> = None;
    for group in groups {
        let vectors = group
            .iter()
            .filter(|(_, _, array)| array.is_vector() && array.count() > 1);
        let longest = vectors
            .clone()
            .map(|(_, _, array)| array.count())
            .max()
            .unwrap_or(0);
        let named = |name: &str| {
            let called = |text: &str| Raw::named(text, Element::F64, None).named.name;
            vectors
                .clone()
                .find(|(_, text, _)| called(text) == name)
                .map(|v| v.2.count())
        };
        let (x, y) = (named("x"), named("y"));
        let placed = x.is_some() && x == y;
        let rows = x.filter(|_| placed).unwrap_or(longest);
        let fits = |one: &(usize, String, &Array)| one.2.is_vector() && one.2.count() == rows;
        let group: Found<'_> = group.into_iter().filter(fits).collect();
        let better = best
            .as_ref()
            .is_none_or(|(was, size, _)| (placed, rows) > (*was, *size));
        if rows > 1 && (placed || group.len() > 1) && better {
            best = Some((placed, rows, group));
        }
    }
    let (placed, rows, group) = best?;
    let columns = group
        .into_iter()
        .map(|(at, name, array)| stored(at, array, 0, Raw::named(&name, element(array), None)));
    Some(Table {
        format: "MATLAB vectors",
        confidence: if placed { 0.7 } else { 0.4 },
        rows,
        columns: columns.collect(),
        ..Table::default()
    })
}

/// Small values as JSON.
fn tree(value: &Value, left: &mut usize, depth: usize) -> Option<serde_json::Value> {
    *left = left.checked_sub(1)?;
    match value {
        Value::Text(text) => Some(json!(text)),
        Value::Numbers(array) => {
            let count = array.count();
            let number = |v: f64| {
                if v.is_finite() {
                    json!(v)
                } else {
                    json!(v.to_string().to_lowercase())
                }
            };
            match count {
                1 => array.first().map(number),
                2..=16 => Some(array.values()?.into_iter().map(number).collect()),
                _ => None,
            }
        }
        Value::Struct { names, values } if values.len() == names.len() && depth < 8 => {
            let members = names.iter().zip(values);
            let members: Map = members
                .filter_map(|(name, value)| Some((name.clone(), tree(value, left, depth + 1)?)))
                .collect();
            (!members.is_empty()).then_some(members.into())
        }
        _ => None,
    }
}
