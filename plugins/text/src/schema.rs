//! The columns that a table will have, before any value is read.

/// The type of a column.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[allow(missing_docs, reason = "the names are those of the types")]
pub enum Kind {
    F64,
    F32,
    I64,
    I32,
    I16,
    I8,
    U64,
    U32,
    U16,
    U8,
    Bool,
    Text,
}

const KINDS: &[(Kind, &str)] = &[
    (Kind::F64, "f64"),
    (Kind::F32, "f32"),
    (Kind::I64, "i64"),
    (Kind::I32, "i32"),
    (Kind::I16, "i16"),
    (Kind::I8, "i8"),
    (Kind::U64, "u64"),
    (Kind::U32, "u32"),
    (Kind::U16, "u16"),
    (Kind::U8, "u8"),
    (Kind::Bool, "bool"),
    (Kind::Text, "utf8"),
];

/// The start of the comment that says the types of all columns.
pub const TYPES: &str = "puncta.text/1 types=";

impl Kind {
    /// Its name in files.
    pub fn name(self) -> &'static str {
        KINDS
            .iter()
            .find(|(k, _)| *k == self)
            .map_or("f64", |(_, n)| n)
    }

    /// The types in a comment of our own files.
    pub fn list(comment: &str) -> Option<Vec<Kind>> {
        let words = comment.strip_prefix(TYPES)?.split(',');
        words
            .map(|w| KINDS.iter().find(|(_, n)| *n == w.trim()).map(|(k, _)| *k))
            .collect()
    }
}

/// One column of the table to be.
#[derive(Debug, Clone, PartialEq)]
pub struct ColumnPlan {
    /// Its name.
    pub name: String,
    /// Its name in the file.
    pub source: String,
    /// The place of its values in a row of the file, from 0.
    pub field: usize,
    /// Its unit, or `unknown`.
    pub unit: String,
    /// How to say the unit, where it is unknown.
    pub remedy: Option<String>,
    /// `position`, `error`, `time`, `group`, `probability:<channel>` or none.
    pub role: Option<String>,
    /// One line on it, with what was done to the file's values.
    pub description: String,
    /// Its type.
    pub kind: Kind,
    /// Values are those of the file times 10^shift (within the one rounding) ...
    pub shift: i32,
    /// ... times this factor ...
    pub factor: f64,
    /// ... minus this.
    pub base: i32,
    /// The base is a guess from the kind of file: a 0 in the file says that it is wrong.
    pub base_guessed: bool,
    /// The column has the values of this earlier column.
    pub copy_of: Option<usize>,
    /// The type is not to be changed again.
    pub settled: bool,
}

/// A change of plan that the values of the file ask for; the read starts again with it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Change {
    /// The column needs this type.
    Kind {
        /// Index of the column.
        column: usize,
        /// The type that holds all of its values.
        kind: Kind,
    },
    /// A frame 0 was found: frames count from 0.
    FramesFromZero {
        /// Index of the column.
        column: usize,
    },
}

/// The columns of a table and where their values come from.
#[derive(Debug, Clone, PartialEq)]
pub struct Plan {
    /// The columns.
    pub columns: Vec<ColumnPlan>,
    /// Number of values in a row of the file.
    pub fields: usize,
    /// No table of this file has more rows.
    pub max_rows: u64,
    /// The number of rows by the length of the first lines.
    pub expected_rows: u64,
}

impl Plan {
    /// Takes over a change that the values asked for.
    pub fn apply(&mut self, change: &Change) {
        let (Change::Kind { column, .. } | Change::FramesFromZero { column }) = change;
        let Some(plan) = self.columns.get_mut(*column) else {
            return;
        };
        match change {
            Change::Kind { kind, .. } => {
                // An integer column that turns out to hold fractions stays f64.
                plan.settled |= plan.kind != Kind::F64 && *kind == Kind::F64;
                plan.kind = *kind;
            }
            Change::FramesFromZero { .. } => {
                plan.base = 0;
                plan.base_guessed = false;
                plan.description = "Frame number, from 0 as in the file".to_owned();
            }
        }
        let settled = plan.clone();
        for copy in self
            .columns
            .iter_mut()
            .filter(|c| c.copy_of == Some(*column))
        {
            copy.kind = settled.kind;
            copy.base = settled.base;
        }
    }
}
