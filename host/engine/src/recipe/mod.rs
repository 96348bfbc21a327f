//! Recipes: graphs of operations as TOML text.
//!
//! [`parse`] reads a text, [`check`] compares it with what the installed plugins offer and orders
//! the steps, [`Session`] runs what is new, [`edit`] changes a text and keeps every other byte.

mod begin;
mod board;
pub mod check;
mod check_files;
mod closest;
pub mod edit;
mod entries;
mod files;
mod flight;
pub mod graph;
pub mod key;
mod layout;
mod memo;
mod order;
pub mod parse;
mod place;
mod rename;
mod report;
mod run;
pub mod session;
mod splice;
mod step;
pub mod units;
mod values;
mod wiring;

#[cfg(test)]
mod cancel_tests;
#[cfg(test)]
mod mock;
#[cfg(test)]
mod random;
#[cfg(test)]
mod session_tests;

pub(crate) use closest::several as closest_names;

pub use check::{Bound, Checked, CheckedInput, CheckedOutput, CheckedStep, Source, check};
pub use files::output_path;
pub use key::Key;
pub use parse::parse;
pub use place::{Place, Problem, Subject};
pub use report::{Found, Record, RecordInput, RunReport, StepReport, StepState};
pub use session::{Call, Inputs, Limits, Runner, Session, Ticket, Wanted, Watch};
pub use units::{Conversion, check_units};

use puncta_documents::{Failure, Kind, Map, Operation, OperationKind};
use std::collections::BTreeMap;

/// Format of a recipe.
pub const RECIPE: &str = "puncta.recipe/1";
/// Largest recipe in bytes.
pub const MAX_TEXT: usize = 16 << 20;
/// Most steps, inputs or outputs of a recipe.
pub const MAX_ENTRIES: usize = 10_000;

/// What the engine needs to know of the installed plugins.
pub trait Catalogue {
    /// The operation, reader or writer with this id.
    fn operation(&self, id: &str) -> Option<&Operation>;
    /// The plugin that has the operation with this id.
    fn plugin(&self, id: &str) -> Option<PluginRef>;
    /// All operations, readers and writers: to choose a writer, and to name the closest ids.
    fn operations(&self) -> Vec<&Operation>;
    /// Why an operation that is not among them cannot be used, if a plugin that has it is there.
    fn withheld(&self, _id: &str) -> Option<Failure> {
        None
    }
    /// The same for a reader or writer of files of this name.
    fn withheld_file(&self, _file: &str, _kind: OperationKind) -> Option<Failure> {
        None
    }
}

/// A plugin as provenance names it.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct PluginRef {
    /// Id, such as `puncta.filter`.
    pub id: String,
    /// Version.
    pub version: String,
    /// BLAKE3 of its library.
    pub library: [u8; 32],
}

/// A kind with its article, for sentences.
pub(crate) fn a_kind(kind: Kind) -> String {
    let article = if kind == Kind::Image { "an" } else { "a" };
    format!("{article} {kind}")
}

/// A recipe as its text says it; nothing in it is known to exist.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Recipe {
    /// Files, in the order of the text.
    pub inputs: Vec<Input>,
    /// Steps, in the order of the text.
    pub steps: Vec<Step>,
    /// Files to write, in the order of the text.
    pub outputs: Vec<OutputFile>,
}

impl Recipe {
    /// The step with this name.
    #[must_use]
    pub fn step(&self, name: &str) -> Option<&Step> {
        self.steps.iter().find(|step| step.name == name)
    }

    /// The input with this name.
    #[must_use]
    pub fn input(&self, name: &str) -> Option<&Input> {
        self.inputs.iter().find(|input| input.name == name)
    }
}

/// A file, or several, that a recipe starts from.
#[derive(Clone, Debug, PartialEq)]
pub struct Input {
    /// Name.
    pub name: String,
    /// Kind of object.
    pub kind: Kind,
    /// Whether it binds several files.
    pub many: bool,
    /// Id of the reader; chosen by the file if absent.
    pub reader: Option<String>,
    /// Parameters of the reader.
    pub options: Map,
    /// Name of the object, in a file that holds several.
    pub object: Option<String>,
    /// Where it stands.
    pub place: Place,
}

/// One operation of a recipe.
#[derive(Clone, Debug, PartialEq)]
pub struct Step {
    /// Name.
    pub name: String,
    /// Operation id.
    pub op: String,
    /// Where the id stands.
    pub op_place: Place,
    /// What is bound to the ports, in the order of the text.
    pub inputs: Vec<Binding>,
    /// Parameters that are set. TOML's inf and nan are the strings of `puncta_documents::number`.
    pub set: Map,
    /// Where each of them stands.
    pub set_places: BTreeMap<String, Place>,
    /// Where the step stands.
    pub place: Place,
}

/// What is bound to a port.
#[derive(Clone, Debug, PartialEq)]
pub struct Binding {
    /// Port.
    pub port: String,
    /// Where the port stands.
    pub place: Place,
    /// Objects.
    pub from: Vec<Reference>,
}

/// An input, a step, or `step.output`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Reference {
    /// Name of an input or step.
    pub source: String,
    /// Output port; the first if absent.
    pub output: Option<String>,
    /// Where it stands.
    pub place: Place,
}

impl std::fmt::Display for Reference {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match &self.output {
            Some(output) => write!(f, "{}.{output}", self.source),
            None => f.write_str(&self.source),
        }
    }
}

/// A file that a recipe writes.
#[derive(Clone, Debug, PartialEq)]
pub struct OutputFile {
    /// Path below the output folder; may hold `{input}`.
    pub file: String,
    /// What is written.
    pub from: Reference,
    /// Id of the writer; chosen by the suffix if absent.
    pub writer: Option<String>,
    /// Parameters of the writer.
    pub set: Map,
    /// Where it stands.
    pub place: Place,
}
