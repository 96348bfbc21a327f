//! A session: results by key, and runs of recipes that compute only what is new.

use super::flight::{Flag, Flight, lock};
use super::memo::Memo;
use super::run::Run;
use super::{Checked, Conversion, Key, PluginRef, RunReport};
use crate::job::Progress;
use puncta_documents::{Failure, Header, Map, Operation};
use std::collections::{BTreeMap, HashMap};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex};

/// What a run tells the person, and how the person stops it. Called from the run's threads.
pub trait Watch: Sync {
    /// A step begins.
    fn started(&self, _step: &str) {}
    /// How far a step is.
    fn progress(&self, _step: &str, _fraction: f64, _phase: &str) {}
    /// What a step says: level 1 error, 2 warning, 3 information, 4 detail.
    fn message(&self, _step: &str, _level: u32, _text: &str) {}
    /// A step has ended, or need not run.
    fn finished(&self, _report: &super::StepReport) {}
    /// Whether the person wants the run to stop. Polled often.
    fn cancelled(&self) -> bool {
        false
    }
}

/// A run that nobody watches or stops.
impl Watch for () {}

/// One call of an operation.
pub struct Call<'a, O> {
    /// Name of the step.
    pub step: &'a str,
    /// The operation.
    pub operation: &'a Operation,
    /// The plugin that has it.
    pub plugin: &'a PluginRef,
    /// Canonical parameters; limits are numbers in the units of their columns.
    pub parameters: &'a Map,
    /// Objects with their ports, in the order of the operation's ports; columns have the units
    /// that the ports ask for.
    pub inputs: &'a [(&'a str, O)],
    /// Key of the step.
    pub key: Key,
}

/// What runs the steps.
pub trait Runner: Sync {
    /// Handle of an immutable object; cheap to clone.
    type Object: Clone + Send + Sync;

    /// What an object is.
    fn header(object: &Self::Object) -> &Header;

    /// Memory that comes free when the object is dropped.
    fn bytes(object: &Self::Object) -> u64;

    /// The result of a call that was kept outside this session.
    fn recall(&self, _call: &Call<'_, Self::Object>) -> Option<Vec<(String, Self::Object)>> {
        None
    }

    /// Calls an operation. The result has an object for each output port; several for those with
    /// `many`, none or one for those with `optional`.
    ///
    /// # Errors
    /// Why the call failed; a cancelled one says so with [`Failure::cancelled`].
    fn call(
        &self,
        call: &Call<'_, Self::Object>,
        job: &dyn Progress,
    ) -> Result<Vec<(String, Self::Object)>, Failure>;

    /// The object with some columns multiplied by a factor, as f64 in the new unit.
    ///
    /// # Errors
    /// Why that is not possible.
    fn convert(
        &self,
        object: &Self::Object,
        conversions: &[Conversion],
        job: &dyn Progress,
    ) -> Result<Self::Object, Failure>;
}

/// Objects for a recipe's inputs by name, each with its key (see
/// [`source_key`](super::key::source_key)); several for inputs with `many`.
pub type Inputs<O> = BTreeMap<String, Vec<(Key, O)>>;

/// What a run is to give.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Wanted {
    /// What `[outputs]` names, except files that cannot be written.
    Outputs,
    /// Every output of every step.
    Everything,
    /// References such as `image` or `good.table`.
    References(Vec<String>),
}

/// Threads and memory of a session.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limits {
    /// Steps that run at once.
    pub parallel: usize,
    /// Bytes of results that are kept.
    pub memory: u64,
}

impl Default for Limits {
    /// Two steps at once, 2 GiB.
    fn default() -> Limits {
        Limits {
            parallel: 2,
            memory: 2 << 30,
        }
    }
}

/// The order of edits: a run with a newer ticket ends those with older ones.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Ticket(u64);

/// Results by key, and runs of recipes. Share it between threads.
pub struct Session<R: Runner> {
    pub(crate) runner: R,
    pub(crate) parallel: usize,
    tickets: AtomicU64,
    pub(crate) shared: Mutex<Shared<R::Object>>,
}

pub(crate) struct Shared<O> {
    pub memo: Memo<O>,
    /// Calls under way.
    pub flights: HashMap<Key, Arc<Flight<O>>>,
    /// Runs under way.
    pub runs: Vec<(Ticket, Arc<Flag>)>,
    /// Runs with older tickets do not begin any more.
    pub oldest: Ticket,
}

impl<R: Runner> Session<R> {
    /// An empty session.
    pub fn new(runner: R, limits: Limits) -> Session<R> {
        Session {
            runner,
            parallel: limits.parallel.max(1),
            tickets: AtomicU64::new(1),
            shared: Mutex::new(Shared {
                memo: Memo::new(limits.memory),
                flights: HashMap::new(),
                runs: Vec::new(),
                oldest: Ticket(0),
            }),
        }
    }

    /// What runs the steps.
    pub fn runner(&self) -> &R {
        &self.runner
    }

    /// A ticket for a run; take it when the edit is made, not when the run begins.
    pub fn ticket(&self) -> Ticket {
        Ticket(self.tickets.fetch_add(1, Ordering::Relaxed))
    }

    /// Stops every run so far, including those whose ticket is taken but that have not begun.
    pub fn supersede(&self) {
        let ticket = self.ticket();
        let mut shared = lock(&self.shared);
        shared.oldest = shared.oldest.max(ticket);
        for (_, flag) in shared.runs.iter().filter(|(older, _)| *older < ticket) {
            flag.stop();
        }
    }

    /// Runs the steps that something wanted needs and whose results are not there, and returns when
    /// all is done or stopped. Runs with older tickets are stopped, except for calls whose results
    /// this run needs as well.
    ///
    /// A step that fails leaves the rest standing: those that need it are skipped. Results do not
    /// depend on how many steps run at once.
    pub fn run(
        &self,
        plan: &Checked,
        inputs: &Inputs<R::Object>,
        wanted: &Wanted,
        ticket: Ticket,
        watch: &dyn Watch,
    ) -> RunReport<R::Object> {
        Run::new(self, plan, inputs, wanted, watch).run(ticket)
    }

    /// Bytes of results that are kept.
    pub fn memory(&self) -> u64 {
        lock(&self.shared).memo.bytes()
    }

    /// Sets how many bytes of results are kept.
    pub fn set_memory(&self, bytes: u64) {
        let gone = lock(&self.shared).memo.set_budget(bytes);
        drop(gone);
    }

    /// Lets steps that failed be tried again. Failures that may pass by themselves (memory, files,
    /// crashes) are always tried again.
    pub fn forget_failures(&self) {
        lock(&self.shared).memo.forget_failures();
    }

    /// Drops every result.
    pub fn clear(&self) {
        let gone = lock(&self.shared).memo.clear();
        drop(gone);
    }
}
