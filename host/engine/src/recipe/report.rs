//! What a run did: a state and a record for each step, and the results.

use super::{Conversion, Key, PluginRef};
use puncta_documents::{Failure, Map};
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;

/// How a step ended.
#[derive(Clone, Debug, PartialEq)]
pub enum StepState {
    /// It ran.
    Computed,
    /// Its result was there, or nothing that is wanted needs it again.
    Cached,
    /// It could not run, or its run failed.
    Failed(Failure),
    /// It did not run because the named step failed.
    Skipped {
        /// The step that failed.
        because: Arc<str>,
    },
    /// It was stopped, or never begun.
    Cancelled,
}

/// How a step ended, and what its result depends on.
#[derive(Clone, Debug, PartialEq)]
pub struct StepReport {
    /// Name of the step.
    pub name: Arc<str>,
    /// How it ended.
    pub state: StepState,
    /// How long it ran; zero unless it ran now.
    pub duration: Duration,
    /// Its key; absent when something before it cannot run.
    pub key: Option<Key>,
    /// What it did, for provenance: when it was computed, now or before.
    pub record: Option<Arc<Record>>,
}

impl StepReport {
    /// Why there is no result; `None` when there is one.
    #[must_use]
    pub fn message(&self) -> Option<String> {
        match &self.state {
            StepState::Computed | StepState::Cached => None,
            StepState::Failed(failure) => Some(failure.to_string()),
            StepState::Skipped { because } => Some(format!("not run because {because} failed")),
            StepState::Cancelled => Some("stopped before it was finished".into()),
        }
    }
}

/// What a step did: everything its result depends on.
#[derive(Clone, Debug, PartialEq)]
pub struct Record {
    /// Operation id.
    pub operation: Arc<str>,
    /// Plugin with version and hash.
    pub plugin: Arc<PluginRef>,
    /// Parameters after defaults, units and limits.
    pub parameters: Arc<Map>,
    /// Ports that were bound, in the operation's order.
    pub inputs: Vec<RecordInput>,
}

/// What was bound to a port.
#[derive(Clone, Debug, PartialEq)]
pub struct RecordInput {
    /// Port.
    pub port: String,
    /// Keys of what is bound: of an input, of several as one list, or of an output of a step.
    pub keys: Vec<Key>,
    /// Columns that were converted: place of the object at the port, and the conversion.
    pub conversions: Vec<(usize, Conversion)>,
}

impl Record {
    /// The record as JSON, for provenance files.
    #[must_use]
    pub fn to_json(&self) -> Value {
        let conversion = |(object, conversion): &(usize, Conversion)| {
            json!({
                "object": object,
                "column": conversion.column,
                "from": conversion.from,
                "to": conversion.to,
                "factor": puncta_documents::number::to_value(conversion.factor),
            })
        };
        let input = |input: &RecordInput| {
            let keys: Vec<String> = input.keys.iter().map(Key::to_string).collect();
            let mut out = json!({"port": input.port, "keys": keys});
            if !input.conversions.is_empty() {
                out["converted"] = input.conversions.iter().map(conversion).collect();
            }
            out
        };
        json!({
            "operation": &*self.operation,
            "plugin": {
                "id": self.plugin.id,
                "version": self.plugin.version,
                "library": Key::from_bytes(self.plugin.library).to_string(),
            },
            "parameters": &*self.parameters,
            "inputs": self.inputs.iter().map(input).collect::<Vec<_>>(),
        })
    }
}

/// Objects that were asked for, with their key.
#[derive(Clone, Debug)]
pub struct Found<O> {
    /// Key of the output or input.
    pub key: Key,
    /// One object, or several where the output or input has several.
    pub objects: Vec<O>,
}

/// What a run did.
#[derive(Clone, Debug)]
pub struct RunReport<O> {
    /// Steps that were needed, in the order of the plan.
    pub steps: Vec<StepReport>,
    /// Results by reference, as far as they are there.
    pub results: BTreeMap<String, Found<O>>,
    /// Whether it was stopped, by the person or by a newer run.
    pub cancelled: bool,
}

impl<O> RunReport<O> {
    /// The report of a step.
    #[must_use]
    pub fn step(&self, name: &str) -> Option<&StepReport> {
        self.steps.iter().find(|step| &*step.name == name)
    }
}
