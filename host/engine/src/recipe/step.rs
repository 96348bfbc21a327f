//! One step of a run: its inputs, units and limits, the call, the check of what came back.

use super::check::{Bound, CheckedStep, Source};
use super::flight::{Flight, Outcome, Outputs, Reporter, lock};
use super::report::{Record, RecordInput};
use super::run::Run;
use super::session::{Call, Runner};
use super::units::{check_units, resolve_limits};
use super::{Key, a_kind, key};
use crate::job::Progress;
use puncta_documents::{Failure, FailureCode, Map, Operation};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;

/// How a step was done.
pub(crate) struct Performed<O> {
    pub outcome: Outcome<O>,
    /// Whether it ran here and now, and not elsewhere or before.
    pub here: bool,
}

/// Whether a step runs here or waits for a call that is under way.
enum Turn<O> {
    Here(Arc<Flight<O>>),
    Wait(Arc<Flight<O>>),
}

impl<R: Runner> Run<'_, R> {
    /// Runs a step, or waits for the run of it that is under way.
    pub(crate) fn perform(&self, at: usize) -> Performed<R::Object> {
        let elsewhere = |outcome| Performed {
            outcome,
            here: false,
        };
        let (Some(step), Some(Some(key))) = (self.plan.steps.get(at), self.keys.get(at)) else {
            return elsewhere(Outcome::Cancelled);
        };
        loop {
            if self.flag.poll(self.watch) {
                return elsewhere(Outcome::Cancelled);
            }
            match self.turn(key) {
                Err(done) => return elsewhere(done),
                Ok(Turn::Wait(flight)) => {
                    match flight.wait(&self.flag, self.watch, &step.name) {
                        // The run that it belonged to was stopped just before this one joined.
                        Outcome::Cancelled => {}
                        outcome => return elsewhere(outcome),
                    }
                }
                Ok(Turn::Here(flight)) => {
                    let mut recalled = false;
                    let outcome = self.guarded(step, *key, &flight, &mut recalled);
                    self.land(*key, &flight, &outcome);
                    return Performed {
                        outcome,
                        here: !recalled,
                    };
                }
            }
        }
    }

    fn turn(&self, key: &Key) -> Result<Turn<R::Object>, Outcome<R::Object>> {
        use super::memo::Held;
        let mut shared = lock(&self.session.shared);
        match (shared.memo.held(key), shared.memo.record(key)) {
            (Some(Held::Outputs(outputs, _)), Some(record)) => {
                return Err(Outcome::Done(outputs.clone(), record));
            }
            (Some(Held::Failure(failure)), _) => return Err(Outcome::Failed(failure.clone())),
            _ => {}
        }
        if let Some(flight) = shared.flights.get(key) {
            flight.join(&self.flag);
            return Ok(Turn::Wait(flight.clone()));
        }
        let flight = Arc::new(Flight::new(self.flag.clone()));
        shared.flights.insert(*key, flight.clone());
        Ok(Turn::Here(flight))
    }

    /// Remembers how a call ended, and tells those that wait for it.
    fn land(&self, key: Key, flight: &Flight<R::Object>, outcome: &Outcome<R::Object>) {
        let bytes = match outcome {
            Outcome::Done(outputs, _) => outputs
                .iter()
                .map(|(_, object)| R::bytes(object))
                .fold(0, u64::saturating_add),
            _ => 0,
        };
        let gone = {
            let mut shared = lock(&self.session.shared);
            shared.flights.remove(&key);
            match outcome {
                Outcome::Done(outputs, record) => {
                    shared
                        .memo
                        .insert(key, outputs.clone(), bytes, record.clone())
                }
                Outcome::Failed(failure) => {
                    shared.memo.fail(key, failure);
                    Vec::new()
                }
                Outcome::Cancelled => Vec::new(),
            }
        };
        flight.finish(outcome.clone());
        drop(gone);
    }

    fn guarded(
        &self,
        step: &CheckedStep,
        key: Key,
        flight: &Flight<R::Object>,
        recalled: &mut bool,
    ) -> Outcome<R::Object> {
        let job = Reporter {
            flight,
            flag: &self.flag,
            watch: self.watch,
            step: &step.name,
        };
        let work = || {
            self.watch.started(&step.name);
            self.compute(step, key, &job, recalled)
        };
        match catch_unwind(AssertUnwindSafe(work)) {
            Ok(Ok((outputs, record))) => Outcome::Done(Arc::new(outputs), Arc::new(record)),
            Ok(Err(failure)) if failure.is_cancelled() => Outcome::Cancelled,
            Ok(Err(failure)) => Outcome::Failed(failure),
            Err(_) => {
                let message = format!("{} stopped by a defect of the program", step.op);
                let remedy = "run it again, and report it if it happens again";
                Outcome::Failed(Failure::new(FailureCode::Crashed, message).remedy(remedy))
            }
        }
    }

    fn compute(
        &self,
        step: &CheckedStep,
        key: Key,
        job: &dyn Progress,
        recalled: &mut bool,
    ) -> Result<(Outputs<R::Object>, Record), Failure> {
        let missing = || Failure::internal(format!("{} has no operation", step.name));
        let operation = step.operation.as_deref().ok_or_else(missing)?;
        let mut objects = Vec::with_capacity(step.ports.len());
        let mut inputs = Vec::with_capacity(step.ports.len());
        for bound in &step.ports {
            inputs.push(self.bind(step, operation, bound, &mut objects, job)?);
        }
        let parameters = if step.limits {
            Arc::new(limits::<R>(step, operation, &objects)?)
        } else {
            step.parameters.clone()
        };
        let call = Call {
            step: &step.name,
            operation,
            plugin: &step.plugin,
            parameters: &parameters,
            inputs: &objects,
            key,
        };
        let kept = self.session.runner.recall(&call);
        *recalled = kept.is_some();
        let outputs = match kept {
            Some(outputs) => outputs,
            None => self.session.runner.call(&call, job)?,
        };
        check_outputs::<R>(operation, &step.plugin.id, &outputs)?;
        let record = Record {
            operation: step.op.clone(),
            plugin: step.plugin.clone(),
            parameters,
            inputs,
        };
        Ok((outputs, record))
    }

    /// The objects of a port, in the units that it asks for.
    fn bind<'p>(
        &self,
        step: &CheckedStep,
        operation: &'p Operation,
        bound: &Bound,
        objects: &mut Vec<(&'p str, R::Object)>,
        job: &dyn Progress,
    ) -> Result<RecordInput, Failure> {
        let missing = || Failure::internal(format!("{} has no such input", step.op));
        let port = operation.inputs.get(bound.port).ok_or_else(missing)?;
        let mut conversions = Vec::new();
        let mut count = 0;
        for source in &bound.sources {
            for object in self.objects(*source) {
                let needed = check_units(port, &step.parameters, R::header(&object))?;
                let object = if needed.is_empty() {
                    object
                } else {
                    self.session.runner.convert(&object, &needed, job)?
                };
                conversions.extend(needed.into_iter().map(|one| (count, one)));
                objects.push((port.name.as_str(), object));
                count += 1;
            }
        }
        if count == 0 && !port.optional {
            let message = format!("nothing came for the input {} of {}", port.name, step.op);
            let remedy = "the step before it gave no such result; bind something else";
            return Err(Failure::bad_input(message).remedy(remedy));
        }
        let keys = bound
            .sources
            .iter()
            .filter_map(|source| self.source_key(*source))
            .collect();
        Ok(RecordInput {
            port: port.name.clone(),
            keys,
            conversions,
        })
    }

    /// The key of an input or of an output of a step.
    pub(crate) fn source_key(&self, source: Source) -> Option<Key> {
        match source {
            Source::Input(at) => self.input_keys.get(at).copied().flatten(),
            Source::Step { step, output } => {
                let key = self.keys.get(step).copied().flatten()?;
                let operation = self.plan.steps.get(step)?.operation.as_ref()?;
                Some(key::output_key(&key, &operation.outputs.get(output)?.name))
            }
        }
    }
}

/// Parameters whose limits are numbers in the units of their columns.
fn limits<R: Runner>(
    step: &CheckedStep,
    operation: &Operation,
    objects: &[(&str, R::Object)],
) -> Result<Map, Failure> {
    let mut parameters = (*step.parameters).clone();
    let header = |port: Option<&str>| {
        let mut objects = objects.iter();
        let found = objects.find(|(name, _)| port.is_none_or(|port| port == *name));
        found.map(|(_, object)| R::header(object))
    };
    resolve_limits(&operation.parameters, &mut parameters, &header)?;
    Ok(parameters)
}

/// A plugin's outputs are not to be trusted to be those of its manifest.
fn check_outputs<R: Runner>(
    operation: &Operation,
    plugin: &str,
    outputs: &Outputs<R::Object>,
) -> Result<(), Failure> {
    let refuse = |what: String| {
        let message = format!("{} of the plugin {plugin} {what}", operation.id);
        let failure = Failure::internal(message);
        Err(failure.remedy("report it to the plugin's author"))
    };
    for (name, object) in outputs {
        let Some(port) = operation.outputs.iter().find(|port| port.name == *name) else {
            return refuse(format!("gave an output {name:?} that it does not announce"));
        };
        let kind = R::header(object).kind;
        if kind != port.kind {
            return refuse(format!(
                "gave {} as {name}, which is to be {}",
                a_kind(kind),
                a_kind(port.kind)
            ));
        }
    }
    for port in &operation.outputs {
        let count = outputs
            .iter()
            .filter(|(name, _)| *name == port.name)
            .count();
        if count == 0 && !port.optional {
            return refuse(format!("did not give its output {}", port.name));
        }
        if count > 1 && !port.many {
            return refuse(format!(
                "gave {count} objects as {}, which is to be one",
                port.name
            ));
        }
    }
    Ok(())
}
