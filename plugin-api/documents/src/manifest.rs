//! What a plugin offers.

use crate::{Kind, Map, OutputForm, Parameter};
use serde::{Deserialize, Serialize};

/// Format of [`Manifest`].
pub const PLUGIN: &str = "puncta.plugin/1";

/// What a plugin is and offers. Format `puncta.plugin/1`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Manifest {
    /// Id, such as `puncta.filter`; its operations' ids begin with it.
    pub id: String,
    /// Name for people.
    pub title: String,
    /// Version of the plugin.
    pub version: String,
    /// One paragraph.
    #[serde(default)]
    pub description: String,
    /// SPDX expression.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub license: Option<String>,
    /// Version of the SDK it was built with; absent for plugins in C.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sdk: Option<String>,
    /// `none`: may run in the host's process; `worker`: only in a process of its own.
    #[serde(default = "worker")]
    pub isolation: String,
    /// Whether `run` may be called on several threads at once.
    #[serde(default)]
    pub reentrant: bool,
    /// Ids of host tables that it cannot do without.
    #[serde(default)]
    pub needs: Vec<String>,
    /// Operations, readers and writers, sorted by id.
    #[serde(default)]
    pub operations: Vec<Operation>,
    /// Members that this version does not know.
    #[serde(flatten)]
    pub rest: Map,
}

fn worker() -> String {
    "worker".into()
}

/// What a call is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum OperationKind {
    /// Inputs to outputs.
    Operation,
    /// A file to outputs.
    Reader,
    /// Inputs to a file.
    Writer,
}

/// An operation, reader or writer.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Operation {
    /// Id with revision, such as `puncta.filter.range/1`.
    pub id: String,
    /// Kind.
    pub kind: OperationKind,
    /// Name for people.
    pub title: String,
    /// First line: one sentence; then more.
    #[serde(default)]
    pub description: String,
    /// Inputs.
    #[serde(default)]
    pub inputs: Vec<Port>,
    /// Outputs.
    #[serde(default)]
    pub outputs: Vec<Port>,
    /// Parameters.
    #[serde(default)]
    pub parameters: Vec<Parameter>,
    /// Readers and writers: which files.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub file: Option<FileRule>,
    /// A small call that works.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub example: Option<Example>,
    /// Papers: DOI or full reference.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub citations: Vec<String>,
    /// How far results may be from those of another build or processor, as a share of the largest
    /// magnitude of a column.
    #[serde(
        default = "usual_tolerance",
        skip_serializing_if = "is_usual_tolerance"
    )]
    pub tolerance: f64,
    /// Members that this version does not know.
    #[serde(flatten)]
    pub rest: Map,
}

/// [`Operation::tolerance`] where none is stated: rounding that adds up over many values.
pub const TOLERANCE: f64 = 1e-9;

fn usual_tolerance() -> f64 {
    TOLERANCE
}

#[allow(clippy::trivially_copy_pass_by_ref)]
fn is_usual_tolerance(tolerance: &f64) -> bool {
    tolerance.to_bits() == TOLERANCE.to_bits()
}

impl Operation {
    /// The id without its revision.
    #[must_use]
    pub fn stem(&self) -> &str {
        self.id.split('/').next().unwrap_or(&self.id)
    }
}

/// An input or output.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Port {
    /// Name.
    pub name: String,
    /// Kind of object; for a writer's input, the first of the kinds it takes.
    pub kind: Kind,
    /// One line.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub description: String,
    /// Outputs: form.
    #[serde(default)]
    pub form: OutputForm,
    /// Outputs: the input that columns or a selection belong to.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub of: Option<String>,
    /// Inputs: columns that must be there.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub columns: Vec<ColumnNeed>,
    /// Inputs: may be left out. Outputs: may be missing.
    #[serde(default)]
    pub optional: bool,
    /// Inputs: takes several objects. Outputs: gives several.
    #[serde(default)]
    pub many: bool,
}

/// A column that an input must have.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ColumnNeed {
    /// Its name; or, with a leading `$`, the parameter that holds its name.
    pub name: String,
    /// Unit in which the operation needs it; the host converts. Absent: any.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub unit: Option<String>,
}

/// Which files a reader or writer is for.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct FileRule {
    /// Lower-case suffixes with the dot.
    pub suffixes: Vec<String>,
    /// First bytes as hexadecimal text; empty if the format has none.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub magic: Vec<String>,
    /// Names of the formats.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub formats: Vec<String>,
    /// Whether it reads any text or data as a last resort; asked after the others.
    #[serde(default)]
    pub generic: bool,
}

/// A small call that works: for documentation, the validator and tests.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Example {
    /// For each input port, the call that makes it.
    #[serde(default, skip_serializing_if = "std::collections::BTreeMap::is_empty")]
    pub inputs: std::collections::BTreeMap<String, Step>,
    /// Parameters that differ from the defaults.
    #[serde(default)]
    pub parameters: Map,
    /// Readers: text of a small file, or the call of a writer that makes it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub file: Option<ExampleFile>,
}

/// A file for a reader's or writer's example.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ExampleFile {
    /// Name, with the suffix that matters.
    pub name: String,
    /// Its content: text, or for binary formats hexadecimal digits in `hex`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub text: Option<String>,
    /// Its content as hexadecimal digits.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub hex: Option<String>,
}

/// A call that makes an example's input.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Step {
    /// Operation id.
    pub op: String,
    /// Parameters that differ from the defaults.
    #[serde(default)]
    pub parameters: Map,
    /// Its output; the first if absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub output: Option<String>,
    /// Its own inputs.
    #[serde(default, skip_serializing_if = "std::collections::BTreeMap::is_empty")]
    pub inputs: std::collections::BTreeMap<String, Step>,
}
