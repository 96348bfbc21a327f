//! How one call is made: with which data, on how many threads, and what the host refuses.

use crate::item::Item;
use crate::memory::Around;
use puncta_engine::documents::{FileRef, Header, InputRef, Map, Request};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

/// When a call is told to stop.
#[derive(Clone, Debug, Default)]
pub enum Stop {
    /// Never.
    #[default]
    Never,
    /// At so many questions and reports of progress, and from then on.
    AtPoll(u64),
    /// When this is set.
    Flag(Arc<AtomicBool>),
}

/// A call and its circumstances.
#[derive(Clone, Debug)]
pub struct Setting {
    /// Operation.
    pub operation: String,
    /// Parameters in their canonical form.
    pub parameters: Map,
    /// Objects by port.
    pub inputs: Vec<(String, Arc<Item>)>,
    /// File to read or write.
    pub file: Option<FileRef>,
    /// Threads of `parallel_for`.
    pub threads: usize,
    /// When it is cancelled.
    pub stop: Stop,
    /// Around inputs.
    pub inputs_around: Around,
    /// Whether writing to an input ends the process.
    pub read_only: bool,
    /// Around outputs.
    pub outputs_around: Around,
    /// What the memory of outputs holds at first.
    pub fill: u8,
    /// The n-th request for memory is refused, and all after it.
    pub refuse_from: Option<u64>,
}

impl Setting {
    /// A call of an operation with nothing.
    pub fn new(operation: &str, parameters: Map) -> Setting {
        Setting {
            operation: operation.into(),
            parameters,
            inputs: Vec::new(),
            file: None,
            threads: 2,
            stop: Stop::Never,
            inputs_around: Around::Slack,
            read_only: false,
            outputs_around: Around::Slack,
            fill: 0,
            refuse_from: None,
        }
    }

    /// What the plugin is asked to prepare.
    pub fn request(&self) -> Request {
        Request {
            operation: self.operation.clone(),
            parameters: self.parameters.clone(),
            inputs: self
                .inputs
                .iter()
                .map(|(port, item)| InputRef {
                    port: port.clone(),
                    header: item.header.clone(),
                })
                .collect(),
            file: self.file.clone(),
            memory: Some(4 << 30),
            rest: Map::new(),
        }
    }

    /// Headers of the inputs.
    pub fn headers(&self) -> impl Iterator<Item = &Header> {
        self.inputs.iter().map(|(_, item)| &item.header)
    }

    /// With another table in place of each table that `change` gives one for.
    pub fn with_tables(&self, change: impl Fn(&Item) -> Option<Item>) -> Option<Setting> {
        let mut changed = false;
        let mut setting = self.clone();
        for (_, item) in &mut setting.inputs {
            if item.header.kind == puncta_engine::documents::Kind::Table
                && let Some(other) = change(item)
            {
                changed = true;
                *item = Arc::new(other);
            }
        }
        changed.then_some(setting)
    }
}
