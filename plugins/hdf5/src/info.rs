//! What a file holds, before any heavy reading.

use puncta_sdk::Element;
use serde_json::Value;

use crate::record::Leaf;

/// The formats that this crate reads.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Format {
    /// Picasso `.hdf5` with its `.yaml` beside it.
    Picasso,
    /// PYME fit results, `.h5r`.
    PymeH5r,
}

/// A file's tables and metadata.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct FileInfo {
    pub(crate) format: Format,
    /// `localisations` first where there are any, then `events` and `fiducials`.
    pub(crate) tables: Vec<TableInfo>,
    pub(crate) metadata: Value,
    /// Sentences for the person: what was assumed, what is missing, what is left out.
    pub(crate) notes: Vec<String>,
}

/// One table of a file.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct TableInfo {
    /// Object name: `localisations`, `events` or `fiducials`.
    pub(crate) name: String,
    /// Dataset in the file, such as `/locs`.
    pub(crate) dataset: String,
    pub(crate) rows: u64,
    pub(crate) columns: Vec<ColumnInfo>,
    /// Bytes of one stored record.
    pub(crate) record: usize,
    /// Bytes of records that are loaded at a time.
    pub(crate) block: usize,
    /// Field whose values put the rows in order, where the format asks for it.
    pub(crate) sort_by: Option<Leaf>,
    /// Field of view in stored units, to count localisations outside it.
    pub(crate) field: Option<FieldOfView>,
}

/// The camera's field of view in pixels and the fields that hold the position.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct FieldOfView {
    pub(crate) width: f64,
    pub(crate) height: f64,
    pub(crate) x: Leaf,
    pub(crate) y: Leaf,
}

/// One column of a table.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct ColumnInfo {
    /// Canonical name.
    pub(crate) name: String,
    pub(crate) element: Element,
    /// Unit such as `nm`, `frame`, `photon` or `1`; `unknown` where the file does not say.
    pub(crate) unit: &'static str,
    pub(crate) role: Option<&'static str>,
    /// Name in the file, nested names joined with underscores.
    pub(crate) source: String,
    pub(crate) description: String,
    pub(crate) leaf: Leaf,
    /// Values are multiplied by this while they become `f64`.
    pub(crate) factor: Option<f64>,
}

impl TableInfo {
    /// The column of that canonical name.
    pub(crate) fn column(&self, name: &str) -> Option<&ColumnInfo> {
        self.columns.iter().find(|column| column.name == name)
    }
}
