//! What a person may say about a text file; it always wins over what the file seems to say.

use crate::flavours::Flavour;
use puncta_shared_import::Mapping;

/// What stands between two values of a row.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Delimiter {
    /// Exactly one of this byte.
    Byte(u8),
    /// Any run of blanks and tabs.
    Blanks,
}

/// How a file is to be read.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// Names, units, frames and axes.
    pub mapping: Mapping,
    /// The kind of file; `Auto` finds it out.
    pub dialect: Flavour,
    /// Columns that are words even where they look like numbers.
    pub text: Vec<String>,
    /// What stands between values.
    pub delimiter: Option<Delimiter>,
    /// Lines to leave out at the start of the file.
    pub skip_rows: u64,
}

impl Default for Options {
    fn default() -> Options {
        Options {
            mapping: Mapping::default(),
            dialect: Flavour::Auto,
            text: Vec::new(),
            delimiter: None,
            skip_rows: 0,
        }
    }
}
