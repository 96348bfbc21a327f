//! What a file holds, before any heavy reading.

use puncta_sdk::Element;
use serde_json::Value;

use crate::derived::Compute;
use crate::record::Leaf;

/// The formats that this crate reads.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Format {
    /// Picasso `.hdf5` with its `.yaml` beside it.
    Picasso,
    /// PYME fit results, `.h5r`.
    PymeH5r,
    /// PYME's saved tables, `.hdf`.
    PymeHdf,
    /// DECODE `.h5`.
    Decode,
    /// storm-analysis `.hdf5`.
    StormAnalysis,
    /// SMAP `_sml.mat`, MATLAB 7.3.
    Smap,
    /// Abberior's MINFLUX export as MATLAB 7.3.
    MinfluxMat,
    /// pyMINFLUX `.pmx`.
    Pmx,
    /// SPTAnalyser `.h5`.
    SptAnalyser,
}

impl Format {
    /// Its name for the person.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Picasso => "Picasso hdf5",
            Self::PymeH5r => "PYME h5r",
            Self::PymeHdf => "PYME hdf",
            Self::Decode => "DECODE h5",
            Self::StormAnalysis => "storm-analysis hdf5",
            Self::Smap => "SMAP mat",
            Self::MinfluxMat => "MINFLUX mat",
            Self::Pmx => "pyMINFLUX pmx",
            Self::SptAnalyser => "SPTAnalyser h5",
        }
    }
}

/// All of them.
pub(crate) const FORMATS: [Format; 9] = [
    Format::Picasso,
    Format::PymeH5r,
    Format::PymeHdf,
    Format::Decode,
    Format::StormAnalysis,
    Format::Smap,
    Format::MinfluxMat,
    Format::Pmx,
    Format::SptAnalyser,
];

/// A file's tables and metadata.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct FileInfo {
    pub(crate) format: Format,
    /// `localisations` first where there are any, then `events` and others.
    pub(crate) tables: Vec<TableInfo>,
    pub(crate) metadata: Value,
    /// Sentences for the person: what was assumed, what is missing, what is left out.
    pub(crate) notes: Vec<String>,
    /// Camera pixel in nm, where the file says it.
    pub(crate) pixel: Option<f64>,
    /// The number of the first frame by the format.
    pub(crate) frame_base: u8,
}

/// Rows of datasets that follow each other in a table.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Segment {
    /// Group of the datasets, with `/` at its end.
    pub(crate) group: String,
    pub(crate) rows: u64,
}

/// Where the values of a column stand, for tables that have a dataset for each column.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Place {
    /// A dataset below the segment's group; the rows run along `axis`, `lead` says the index along
    /// the others, and `width` numbers of the last axis are one row.
    Dataset {
        name: String,
        axis: usize,
        lead: Vec<u64>,
        width: u64,
    },
    /// One number for each segment.
    Numbers(Vec<f64>),
}

impl Place {
    /// A dataset that is a list along `axis`.
    pub(crate) fn list(name: &str, axis: usize) -> Place {
        Place::at(name, axis, Vec::new())
    }

    /// A list along `axis` at these places of the axes before it.
    pub(crate) fn at(name: &str, axis: usize, lead: Vec<u64>) -> Place {
        Place::Dataset {
            name: name.to_owned(),
            axis,
            lead,
            width: 1,
        }
    }
}

/// One table of a file.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct TableInfo {
    /// Output: `localisations`, `events`, `fiducials` or `tables`.
    pub(crate) port: &'static str,
    /// Object name.
    pub(crate) name: String,
    /// Dataset in the file, such as `/locs`.
    pub(crate) dataset: String,
    pub(crate) rows: u64,
    pub(crate) columns: Vec<ColumnInfo>,
    /// For tables that have a dataset for each column.
    pub(crate) segments: Vec<Segment>,
    /// Rows belong to tracks.
    pub(crate) tracks: bool,
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
    pub(crate) unit: String,
    /// How to say the unit, where it is unknown.
    pub(crate) remedy: Option<String>,
    pub(crate) role: Option<String>,
    /// Name in the file, nested names joined with underscores.
    pub(crate) source: String,
    pub(crate) description: String,
    pub(crate) leaf: Leaf,
    /// Values are multiplied by this while they become `f64`.
    pub(crate) factor: Option<f64>,
    /// Subtracted from the values behind that.
    pub(crate) base: u8,
    /// For tables that have a dataset for each column.
    pub(crate) place: Option<Place>,
    /// Computed from other fields of the record.
    pub(crate) compute: Option<Compute>,
}

impl TableInfo {
    /// The column of that canonical name.
    pub(crate) fn column(&self, name: &str) -> Option<&ColumnInfo> {
        self.columns.iter().find(|column| column.name == name)
    }
}
