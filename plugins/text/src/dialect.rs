//! How a text file is written: its encoding, delimiter, header and kind.

use crate::encoding::Encoding;
use crate::options::Delimiter;
use crate::schema::Kind;

/// Who writes files of this kind.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Flavour {
    /// ThunderSTORM: frames from 1.
    ThunderStorm,
    /// PYME: names in a `#` line, nm, frames from 0.
    Pyme,
    /// vLUME: `#LUME VERSION` above the header.
    Vlume,
    /// Zeiss ELYRA: tabs, frames from 1, image settings behind the table.
    Elyra,
    /// Ground truth of the SMLM challenge: frames from 1.
    Challenge,
    /// SMAP's csv: `xnm`, frames from 1.
    Smap,
    /// Our own file with a line of column types.
    Typed,
    /// Any other table with named columns.
    Named,
}

impl Flavour {
    /// The number of the first frame.
    pub fn frame_base(self) -> u8 {
        match self {
            Flavour::ThunderStorm | Flavour::Elyra | Flavour::Challenge | Flavour::Smap => 1,
            _ => 0,
        }
    }

    /// A name for the person.
    pub fn label(self) -> &'static str {
        match self {
            Flavour::ThunderStorm => "ThunderSTORM",
            Flavour::Pyme => "PYME",
            Flavour::Vlume => "vLUME",
            Flavour::Elyra => "Zeiss ELYRA",
            Flavour::Challenge => "SMLM challenge",
            Flavour::Smap => "SMAP",
            Flavour::Typed => "Puncta",
            Flavour::Named => "named columns",
        }
    }
}

/// How a text file is written.
#[derive(Debug, Clone, PartialEq)]
pub struct Dialect {
    /// Name of the file, for sentences.
    pub file: String,
    /// Who writes files of this kind.
    pub flavour: Flavour,
    /// Encoding of the bytes; all offsets count bytes after conversion to UTF-8.
    pub encoding: Encoding,
    /// What stands between values.
    pub delimiter: Delimiter,
    /// The decimal point: `.` or `,`.
    pub point: u8,
    /// The last byte of a line end.
    pub line_end: u8,
    /// Names of all columns as the file gives them, or as the person listed them.
    pub names: Vec<String>,
    /// Whether the names are the person's list.
    pub listed: bool,
    /// The `#` lines above the data, without the mark.
    pub comments: Vec<String>,
    /// Where the first line of data starts.
    pub data_start: u64,
    /// Its line number, from 1.
    pub data_line: u64,
    /// A delimiter may stand behind the last value.
    pub trailing: bool,
    /// Column types where the file says them.
    pub types: Vec<Kind>,
}

/// The kind of file by its names and comments.
pub fn flavour(names: &[String], comments: &[String], from_hash: bool) -> Flavour {
    let has = |name: &str| names.iter().any(|n| n == name);
    let starts = |start: &str| names.iter().any(|n| n.starts_with(start));
    let pyme = ["y", "t", "sig", "error_x", "tIndex", "A"]
        .into_iter()
        .any(has);
    if comments.iter().any(|c| c.starts_with("LUME VERSION")) {
        Flavour::Vlume
    } else if from_hash && has("x") && pyme {
        Flavour::Pyme
    } else if has("frame") && (starts("x [") || starts("x_[")) {
        Flavour::ThunderStorm
    } else if has("First Frame") && starts("Position X") {
        Flavour::Elyra
    } else if has("Ground-truth") && has("xnano") {
        Flavour::Challenge
    } else if has("xnm") && has("locprecnm") {
        Flavour::Smap
    } else {
        Flavour::Named
    }
}
