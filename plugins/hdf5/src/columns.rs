//! Turns stored fields into named columns with units and roles.

use std::collections::HashSet;

use puncta_sdk::{Element, Failure};

use crate::error::{damaged, hdf5_reason, unsupported};
use crate::info::{ColumnInfo, TableInfo};
use crate::open::{self, Opened};
use crate::raw::{self, StoredType};
use crate::record::{Fields, Leaf, flatten};
use crate::storage::{self, Shape};

const EXPORT: &str = "export it again as a localisation table";

/// A dataset of records that has been checked against the file's length.
pub(crate) struct Records {
    pub dataset: String,
    pub rows: u64,
    pub record: usize,
    /// Bytes that are loaded at a time.
    pub block: usize,
    pub fields: Fields,
}

/// Looks at a dataset of records without reading them.
///
/// # Errors
/// A dataset that is damaged, is no list of records or has no field that can be read.
pub(crate) fn records(opened: &Opened, at: &str) -> Result<Records, Failure> {
    let file = &opened.name;
    let dataset = open::dataset(opened, at)?;
    let (stored, record) = raw::stored_type(&dataset).map_err(|error| {
        damaged(format!(
            "{file} is damaged at the type of {at} ({})",
            hdf5_reason(&error)
        ))
    })?;
    let shape = dataset.shape();
    let (StoredType::Compound { .. }, [rows]) = (&stored, shape.as_slice()) else {
        let found = format!(
            "an array of {} dimensions of {}",
            shape.len(),
            type_name(&stored)
        );
        return Err(unsupported(
            format!("{file}, dataset {at}: a list of records is expected, but it is {found}"),
            EXPORT,
        ));
    };
    let rows = *rows as u64;
    let fields = flatten(&stored);
    if !fields.leaves.iter().any(Leaf::is_number) {
        let skipped = fields.skipped.join(", ");
        return Err(unsupported(
            format!("{file}, dataset {at}: no column of its records holds numbers ({skipped})"),
            EXPORT,
        ));
    }
    let shape = Shape {
        file,
        dataset: at,
        length: opened.length,
        rows,
        record,
    };
    let storage = storage::plan(&dataset, &shape)?;
    Ok(Records {
        dataset: at.to_owned(),
        rows,
        record,
        block: storage.block_bytes(record),
        fields,
    })
}

/// A sentence on members of the root that are not among `read`.
pub(crate) fn note_unread(members: &[String], read: &[&str], notes: &mut Vec<String>) {
    let unread = |member: &&String| !read.contains(&format!("/{member}").as_str());
    let others: Vec<_> = members.iter().filter(unread).map(String::as_str).collect();
    if !others.is_empty() {
        notes.push(format!("Not read from this file: {}.", others.join(", ")));
    }
}

fn type_name(stored: &StoredType) -> &str {
    match stored {
        StoredType::Int { .. } => "integers",
        StoredType::Float { .. } => "floating-point numbers",
        StoredType::Bool => "truth values",
        StoredType::Text { .. } | StoredType::VarText => "texts",
        StoredType::Compound { .. } => "records",
        StoredType::Array { .. } => "lists",
        StoredType::Other { name, .. } => name,
    }
}

impl Records {
    /// The numeric field of that name.
    pub(crate) fn number(&self, name: &str) -> Option<&Leaf> {
        self.fields
            .leaves
            .iter()
            .find(|leaf| leaf.name == name && leaf.is_number())
    }

    /// The table of these records.
    pub(crate) fn table(
        self,
        port: &'static str,
        name: &str,
        sort_by: Option<Leaf>,
        meanings: impl Fn(&Leaf) -> Vec<Meaning>,
    ) -> TableInfo {
        TableInfo {
            port,
            name: name.to_owned(),
            columns: build(&self.fields, meanings),
            dataset: self.dataset,
            rows: self.rows,
            segments: Vec::new(),
            tracks: false,
            record: self.record,
            block: self.block,
            sort_by,
            field: None,
        }
    }

    /// A sentence on fields that are left out.
    pub(crate) fn note_skipped(&self, notes: &mut Vec<String>) {
        if !self.fields.skipped.is_empty() {
            let names = self.fields.skipped.join(", ");
            notes.push(format!(
                "Columns of {} that cannot be read: {names}.",
                self.dataset
            ));
        }
    }
}

/// What a format says about one of its fields.
pub(crate) struct Meaning {
    pub name: String,
    pub unit: &'static str,
    pub role: Option<&'static str>,
    pub description: String,
    /// `Some` makes the column `f64`, multiplied by this.
    pub factor: Option<f64>,
}

impl Meaning {
    /// A field that keeps its name and type.
    pub(crate) fn plain(name: &str, unit: &'static str) -> Self {
        Self {
            name: name.to_owned(),
            unit,
            role: None,
            description: String::new(),
            factor: None,
        }
    }

    pub(crate) fn role(mut self, role: &'static str) -> Self {
        self.role = Some(role);
        self
    }

    pub(crate) fn described(mut self, description: impl Into<String>) -> Self {
        self.description = description.into();
        self
    }

    pub(crate) fn scaled(mut self, factor: f64) -> Self {
        self.factor = Some(factor);
        self
    }
}

/// Builds the columns: a field gives one for each of its meanings. Canonical names come first in
/// the choice of names, so that a field which already has such a name gets a number at its end.
pub(crate) fn build(fields: &Fields, meanings: impl Fn(&Leaf) -> Vec<Meaning>) -> Vec<ColumnInfo> {
    let leaves = fields.leaves.iter();
    let mut columns: Vec<_> = leaves
        .flat_map(|leaf| {
            meanings(leaf)
                .into_iter()
                .map(|meaning| column(leaf, meaning))
        })
        .collect();
    let mut taken = HashSet::new();
    for renamed in [true, false] {
        for column in columns
            .iter_mut()
            .filter(|c| (c.name != c.source) == renamed)
        {
            let wanted = column.name.clone();
            let mut number = 2;
            while !taken.insert(column.name.clone()) {
                column.name = format!("{wanted}_{number}");
                number += 1;
            }
        }
    }
    columns
}

fn column(leaf: &Leaf, meaning: Meaning) -> ColumnInfo {
    let factor = meaning.factor.filter(|_| leaf.is_number());
    ColumnInfo {
        name: tidy(&meaning.name),
        element: if factor.is_some() {
            Element::F64
        } else {
            leaf.element()
        },
        unit: meaning.unit.to_owned(),
        remedy: None,
        role: meaning.role.map(str::to_owned),
        source: leaf.name.clone(),
        description: meaning.description,
        leaf: leaf.clone(),
        factor,
        base: 0,
        place: None,
        compute: None,
    }
}

/// Letters, digits and underscores only; never empty.
fn tidy(name: &str) -> String {
    let name: String = name
        .chars()
        .map(|c| {
            if c.is_alphanumeric() || c == '_' {
                c
            } else {
                '_'
            }
        })
        .collect();
    if name.is_empty() {
        "_".to_owned()
    } else {
        name
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::record::{LeafType, Number};

    fn leaf(name: &str) -> Leaf {
        let stored = LeafType::Number {
            number: Number::F32,
            big_endian: false,
        };
        Leaf {
            name: name.into(),
            offset: 0,
            stored,
        }
    }

    #[test]
    fn canonical_names_win_and_names_stay_unique() {
        let leaves = vec![leaf("t"), leaf("frame"), leaf("odd name"), leaf("odd_name")];
        let fields = Fields {
            leaves,
            skipped: Vec::new(),
        };
        let columns = build(&fields, |leaf| match leaf.name.as_str() {
            "frame" => vec![Meaning::plain("t", "frame")],
            name => vec![Meaning::plain(name, "unknown")],
        });
        let names: Vec<_> = columns.iter().map(|c| c.name.as_str()).collect();
        assert_eq!(names, ["t_2", "t", "odd_name", "odd_name_2"]);
    }
}
