//! A run: which steps have to be computed, and their order over a few threads.

use super::board::{Board, End};
use super::check::{Checked, CheckedStep, Source};
use super::flight::{Flag, lock};
use super::key::{list_key, step_key};
use super::report::{Found, RunReport, StepReport};
use super::session::{Inputs, Runner, Session, Ticket, Wanted, Watch};
use super::step::Performed;
use super::{Key, a_kind, check::CheckedInput};
use puncta_documents::Failure;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::{Arc, Condvar, Mutex, PoisonError};
use std::thread::Scope;
use std::time::{Duration, Instant};

/// Why a step cannot run, known before anything runs.
pub(crate) enum Blocked {
    Itself(Failure),
    Because(Arc<str>),
}

/// A run of a plan.
pub(crate) struct Run<'a, R: Runner> {
    pub session: &'a Session<R>,
    pub plan: &'a Checked,
    pub inputs: &'a Inputs<R::Object>,
    pub watch: &'a dyn Watch,
    pub flag: Arc<Flag>,
    /// Keys of the plan's inputs and steps, as far as they can be told.
    pub input_keys: Vec<Option<Key>>,
    pub keys: Vec<Option<Key>>,
    pub blocked: Vec<Option<Blocked>>,
    pub wanted: Vec<(String, Source)>,
    pub board: Mutex<Board<R::Object>>,
    changed: Condvar,
}

impl<'a, R: Runner> Run<'a, R> {
    pub fn new(
        session: &'a Session<R>,
        plan: &'a Checked,
        inputs: &'a Inputs<R::Object>,
        wanted: &Wanted,
        watch: &'a dyn Watch,
    ) -> Run<'a, R> {
        let count = plan.steps.len();
        let mut run = Run {
            session,
            plan,
            inputs,
            watch,
            flag: Arc::default(),
            input_keys: plan
                .inputs
                .iter()
                .map(|input| input_key::<R>(inputs, input))
                .collect(),
            keys: Vec::with_capacity(count),
            blocked: Vec::with_capacity(count),
            wanted: references(plan, wanted),
            board: Mutex::new(Board::new(count)),
            changed: Condvar::new(),
        };
        for step in &plan.steps {
            let (key, blocked) = match run.step_key(step) {
                Ok(key) => (Some(key), None),
                Err(blocked) => (None, Some(blocked)),
            };
            run.keys.push(key);
            run.blocked.push(blocked);
        }
        run
    }

    pub fn run(self, ticket: Ticket) -> RunReport<R::Object> {
        self.begin(ticket);
        if lock(&self.board).left > 0 {
            std::thread::scope(|scope| self.work(scope));
        }
        // Calls of other runs that this one has joined need not go on for it.
        let cancelled = self.flag.stopped();
        self.flag.stop();
        lock(&self.session.shared)
            .runs
            .retain(|(_, flag)| !Arc::ptr_eq(flag, &self.flag));
        self.report(cancelled)
    }

    /// The key of a step, or why it cannot run.
    fn step_key(&self, step: &CheckedStep) -> Result<Key, Blocked> {
        if let Some(failure) = &step.failure {
            return Err(Blocked::Itself(failure.clone()));
        }
        let Some(operation) = &step.operation else {
            return Err(Blocked::Itself(Failure::internal(
                "the operation is not there",
            )));
        };
        let mut keys: Vec<Key> = Vec::new();
        let mut ports = Vec::with_capacity(step.ports.len());
        for bound in &step.ports {
            let name = operation
                .inputs
                .get(bound.port)
                .map_or("", |port| port.name.as_str());
            ports.push((name, keys.len()..keys.len() + bound.sources.len()));
            for source in &bound.sources {
                match (self.source_key(*source), *source) {
                    (Some(key), _) => keys.push(key),
                    (None, Source::Input(at)) => {
                        return Err(Blocked::Itself(self.no_input(at)));
                    }
                    (None, Source::Step { step, .. }) => {
                        return Err(Blocked::Because(self.root(step)));
                    }
                }
            }
        }
        let ports = ports
            .into_iter()
            .map(|(name, range)| (name, keys.get(range).unwrap_or(&[])));
        Ok(step_key(&step.call, ports))
    }

    fn no_input(&self, at: usize) -> Failure {
        let Some(input) = self.plan.inputs.get(at) else {
            return Failure::internal("the input is not there");
        };
        let name = &input.name;
        let bound = self.inputs.get(&**name).map_or(&[][..], Vec::as_slice);
        let wrong = bound.iter().map(|(_, object)| R::header(object).kind);
        match wrong.clone().find(|kind| *kind != input.kind) {
            Some(kind) => Failure::bad_input(format!(
                "the input {name} is to be {}, and the file gives {}",
                a_kind(input.kind),
                a_kind(kind)
            ))
            .remedy(format!(
                "choose another file, or say object = \"NAME\" in [inputs.{name}]"
            )),
            None if bound.is_empty() => {
                Failure::bad_input(format!("no file is bound to the input {name}"))
                    .remedy(format!("say --input {name}=FILE"))
            }
            None => {
                let count = bound.len();
                Failure::bad_input(format!("the input {name} takes one file, not {count}")).remedy(
                    format!("say many = true in [inputs.{name}] if several are meant"),
                )
            }
        }
    }

    /// The step to blame for a step that cannot run.
    fn root(&self, at: usize) -> Arc<str> {
        match self.blocked.get(at) {
            Some(Some(Blocked::Because(root))) => root.clone(),
            _ => self
                .plan
                .steps
                .get(at)
                .map_or_else(|| "".into(), |step| step.name.clone()),
        }
    }

    /// The steps whose outputs a step needs, each once.
    pub(crate) fn needs(&self, at: usize) -> BTreeSet<usize> {
        let ports = self
            .plan
            .steps
            .get(at)
            .into_iter()
            .flat_map(|step| &step.ports);
        let sources = ports.flat_map(|bound| &bound.sources);
        sources
            .filter_map(|source| match source {
                Source::Step { step, .. } if *step < at => Some(*step),
                _ => None,
            })
            .collect()
    }

    /// Runs steps until all have ended; more threads come when more steps are ready.
    fn work<'s>(&'s self, scope: &'s Scope<'s, '_>) {
        let _guard = Guard(self);
        while let Some((at, more)) = self.next() {
            if more {
                let helper = move || self.work(scope);
                if std::thread::Builder::new()
                    .spawn_scoped(scope, helper)
                    .is_err()
                {
                    lock(&self.board).threads -= 1;
                }
            }
            let start = Instant::now();
            let done = self.perform(at);
            self.settle(at, done, start.elapsed());
        }
    }

    /// The next step, and whether another thread should help; `None` when all have ended.
    fn next(&self) -> Option<(usize, bool)> {
        let mut board = lock(&self.board);
        loop {
            if board.left == 0 {
                return None;
            }
            if let Some(at) = board.ready.pop_first() {
                let more = !board.ready.is_empty() && board.threads < self.session.parallel;
                board.threads += usize::from(more);
                return Some((at, more));
            }
            board = self
                .changed
                .wait(board)
                .unwrap_or_else(PoisonError::into_inner);
        }
    }

    /// Records how a step ended; what waited for it becomes ready, or ends too.
    fn settle(&self, at: usize, done: Performed<R::Object>, duration: Duration) {
        let mut ended = Vec::new();
        let mut free = Vec::new();
        {
            let mut board = lock(&self.board);
            let first = board.arrive(at, done, duration);
            let mut ends = vec![(at, first)];
            while let Some((at, end)) = ends.pop() {
                let Some(report) = self.end(&mut board, at, end) else {
                    continue;
                };
                ended.push(report);
                free.extend(
                    self.needs(at)
                        .into_iter()
                        .filter_map(|need| board.release(need)),
                );
                for user in board
                    .users
                    .get_mut(at)
                    .map(std::mem::take)
                    .unwrap_or_default()
                {
                    match board.lost(at) {
                        None => board.close(user),
                        Some(state) => ends.push((
                            user,
                            End {
                                state,
                                ..End::default()
                            },
                        )),
                    }
                }
            }
        }
        self.changed.notify_all();
        drop(free);
        for report in &ended {
            self.watch.finished(report);
        }
    }

    /// Writes the report of a step, once.
    fn end(&self, board: &mut Board<R::Object>, at: usize, end: End) -> Option<StepReport> {
        let place = board.reports.get_mut(at).filter(|place| place.is_none())?;
        let name = self.plan.steps.get(at)?.name.clone();
        let key = self.keys.get(at).copied().flatten();
        let End {
            state,
            duration,
            record,
        } = end;
        let report = StepReport {
            name,
            state,
            duration,
            key,
            record,
        };
        *place = Some(report.clone());
        board.left = board.left.saturating_sub(1);
        Some(report)
    }

    /// The objects of an input, or of an output of a step that has ended.
    pub(crate) fn objects(&self, source: Source) -> Vec<R::Object> {
        match source {
            Source::Input(at) => {
                let bound = self
                    .plan
                    .inputs
                    .get(at)
                    .and_then(|input| self.inputs.get(&*input.name));
                bound
                    .into_iter()
                    .flatten()
                    .map(|(_, object)| object.clone())
                    .collect()
            }
            Source::Step { step, output } => {
                let value = lock(&self.board).values.get(step).cloned().flatten();
                let operation = self
                    .plan
                    .steps
                    .get(step)
                    .and_then(|step| step.operation.as_ref());
                let port = operation.and_then(|operation| operation.outputs.get(output));
                let (Some(value), Some(port)) = (value, port) else {
                    return Vec::new();
                };
                let fitting = value.iter().filter(|(name, _)| *name == port.name);
                fitting.map(|(_, object)| object.clone()).collect()
            }
        }
    }

    fn report(self, cancelled: bool) -> RunReport<R::Object> {
        let mut results = BTreeMap::new();
        for (name, source) in &self.wanted {
            let objects = self.objects(*source);
            if let Some(key) = self.source_key(*source).filter(|_| !objects.is_empty()) {
                results.insert(name.clone(), Found { key, objects });
            }
        }
        let board = self
            .board
            .into_inner()
            .unwrap_or_else(PoisonError::into_inner);
        RunReport {
            steps: board.reports.into_iter().flatten().collect(),
            results,
            cancelled,
        }
    }
}

/// Lets the other threads end when one panics in what watches the run.
struct Guard<'r, 'a, R: Runner>(&'r Run<'a, R>);

impl<R: Runner> Drop for Guard<'_, '_, R> {
    fn drop(&mut self) {
        if std::thread::panicking() {
            self.0.flag.stop();
            lock(&self.0.board).left = 0;
            self.0.changed.notify_all();
        }
    }
}

/// The key of what is bound to an input, if it is what the input takes.
fn input_key<R: Runner>(inputs: &Inputs<R::Object>, input: &CheckedInput) -> Option<Key> {
    let bound = inputs.get(&*input.name)?;
    if bound
        .iter()
        .any(|(_, object)| R::header(object).kind != input.kind)
    {
        return None;
    }
    match bound.as_slice() {
        [] => None,
        [(key, _)] if !input.many => Some(*key),
        list if input.many => Some(list_key(
            &list.iter().map(|(key, _)| *key).collect::<Vec<_>>(),
        )),
        _ => None,
    }
}

/// What is wanted, by name.
fn references(plan: &Checked, wanted: &Wanted) -> Vec<(String, Source)> {
    let outputs = plan
        .outputs
        .iter()
        .filter(|output| output.failure.is_none());
    match wanted {
        Wanted::Outputs => outputs
            .filter_map(|output| Some((output.from.clone(), output.source?)))
            .collect(),
        Wanted::References(list) => list
            .iter()
            .filter_map(|name| Some((name.clone(), plan.source(name)?)))
            .collect(),
        Wanted::Everything => {
            let mut all = Vec::new();
            for (at, step) in plan.steps.iter().enumerate() {
                let ports = step
                    .operation
                    .iter()
                    .flat_map(|operation| &operation.outputs);
                let source = |output| Source::Step { step: at, output };
                all.push((step.name.to_string(), source(0)));
                all.extend(ports.enumerate().map(|(output, port)| {
                    (format!("{}.{}", step.name, port.name), source(output))
                }));
            }
            all
        }
    }
}
