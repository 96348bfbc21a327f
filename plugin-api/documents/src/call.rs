//! A call: what the host asks, what the plugin plans, what an output will be.

use crate::{Header, Map};
use serde::{Deserialize, Serialize};

/// Format of [`Request`].
pub const REQUEST: &str = "puncta.request/1";
/// Format of [`Plan`].
pub const PLAN: &str = "puncta.plan/1";
/// Format of [`Output`].
pub const OUTPUT: &str = "puncta.output/1";

/// What the host asks a plugin to prepare. Format `puncta.request/1`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Request {
    /// Operation id with revision.
    pub operation: String,
    /// Canonical parameters: defaults applied, units converted.
    #[serde(default)]
    pub parameters: Map,
    /// Inputs in the order of the manifest's ports.
    #[serde(default)]
    pub inputs: Vec<InputRef>,
    /// File to read, or to write.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub file: Option<FileRef>,
    /// Bytes that a call may use in all; outputs beyond are refused.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub memory: Option<u64>,
    /// Members that this version does not know.
    #[serde(flatten)]
    pub rest: Map,
}

impl Request {
    /// Rows of all inputs together.
    #[must_use]
    pub fn rows(&self) -> u64 {
        self.inputs.iter().map(|input| input.header.rows()).sum()
    }
}

/// An input object of a call.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct InputRef {
    /// Port that it is bound to.
    pub port: String,
    /// What it is.
    pub header: Header,
}

/// A file of a call.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FileRef {
    /// Where the plugin is to read or write.
    pub path: String,
    /// The name the person knows it by; differs from `path` while a file is being written.
    pub name: String,
    /// Bytes, for reading.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub size: Option<u64>,
}

/// Columns that `run` will read.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Read {
    /// Place in the request's inputs.
    pub input: usize,
    /// Part of that input.
    #[serde(default)]
    pub part: usize,
    /// Names, in the order in which the host will give them.
    pub columns: Vec<String>,
}

/// The three forms of output.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum OutputForm {
    /// A new object.
    #[default]
    Object,
    /// An input with columns added or replaced.
    Columns,
    /// Strictly increasing row numbers of an input: column `row`, u32 or u64.
    Selection,
}

/// An output, planned or begun. Format `puncta.output/1`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Output {
    /// Name of the output port.
    pub output: String,
    /// Form.
    #[serde(default)]
    pub form: OutputForm,
    /// For columns and selections: place in the request's inputs.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub of: Option<usize>,
    /// The object with the largest number of rows it may have, or the columns that are added.
    pub header: Header,
}

/// A reader's answer on a file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Probe {
    /// Name of the format, such as `ThunderSTORM csv`.
    pub format: String,
    /// 0 (cannot tell) to 1 (certain).
    pub confidence: f64,
}

/// What a call will do. Format `puncta.plan/1`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Plan {
    /// Columns that `run` reads.
    #[serde(default)]
    pub read: Vec<Read>,
    /// Outputs, as far as they are known before the run.
    #[serde(default)]
    pub outputs: Vec<Output>,
    /// Bytes of working memory beside inputs and outputs.
    #[serde(default)]
    pub memory: u64,
    /// Whether `run` polls for cancel at least every 50 ms.
    #[serde(default = "yes")]
    pub interruptible: bool,
    /// Readers: what the file is.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub probe: Option<Probe>,
    /// Sentences that the person should see.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub notes: Vec<String>,
    /// Members that this version does not know.
    #[serde(flatten)]
    pub rest: Map,
}

fn yes() -> bool {
    true
}

/// An empty plan, of a call that can be interrupted as one that does not say otherwise.
impl Default for Plan {
    fn default() -> Plan {
        Plan {
            read: Vec::new(),
            outputs: Vec::new(),
            memory: 0,
            interruptible: yes(),
            probe: None,
            notes: Vec::new(),
            rest: Map::new(),
        }
    }
}
