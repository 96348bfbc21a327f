//! How a text file is written: its encoding, delimiter, header and kind.

use crate::encoding::Encoding;
use crate::flavours::Flavour;
use crate::options::Delimiter;
use crate::schema::Kind;

/// How a text file is written.
#[derive(Debug, Clone, PartialEq)]
pub struct Dialect {
    /// Name of the file, for sentences.
    pub file: String,
    /// Who writes files of this kind.
    pub flavour: Flavour,
    /// The columns of a kind without a header: name and unit of the host.
    pub positions: Option<&'static [(&'static str, &'static str)]>,
    /// Only the values say which kind it is, so that no unit is known.
    pub assumed: bool,
    /// There are no names in the file.
    pub nameless: bool,
    /// Camera pixel along x and y in nm, where the file says it.
    pub pixel: Option<[f64; 2]>,
    /// The unit of x and y that the file says for both.
    pub lateral_unit: Option<String>,
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
