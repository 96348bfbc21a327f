//! Calls: prepare, run, assemble what came out.

use super::{Engine, Isolation, check, only_in_process};
use crate::job::Progress;
use crate::plugins::catalogue::Installed;
use crate::plugins::context::Resources;
use crate::plugins::library;
use crate::plugins::{Finished, JobContext};
use crate::recipe::Key;
use crate::room::{Room, needed};
use crate::store::{Object, Selection, Stored};
use crate::worker;
use puncta_documents::{
    Failure, FailureCode, FileRef, InputRef, Kind, Map, Operation, OutputForm, Plan, Request,
    schema,
};
use std::sync::Arc;
use std::time::Instant;

/// What to call, with what.
#[derive(Clone, Debug, Default)]
pub struct Invocation {
    /// Operation id.
    pub operation: String,
    /// Parameters as given; defaults and units are applied.
    pub parameters: Map,
    /// Objects by port.
    pub inputs: Vec<(String, Object)>,
    /// File to read or write.
    pub file: Option<FileRef>,
}

/// What a call gave.
#[derive(Clone, Debug, Default)]
pub struct Called {
    /// Outputs by port, in the order in which they were finished.
    pub outputs: Vec<(String, Object)>,
    /// Parameters after defaults.
    pub parameters: Map,
    /// Columns that were converted for it.
    pub converted: Vec<check::Converted>,
}

enum Backend {
    InProcess(library::Prepared),
    Worker(Box<worker::Prepared>),
}

/// A call that is checked and planned; it may run more than once.
pub struct PreparedCall {
    backend: Backend,
    plugin: Arc<Installed>,
    operation: String,
    parameters: Map,
    inputs: Vec<Object>,
    converted: Vec<check::Converted>,
    resources: Resources,
    room: Arc<Room>,
}

impl Engine {
    /// Checks and plans a call.
    ///
    /// # Errors
    /// What the engine's checks or the plugin refuse.
    pub fn prepare(
        &self,
        invocation: &Invocation,
        progress: &Arc<dyn Progress>,
    ) -> Result<PreparedCall, Failure> {
        let (plugin, operation) = self.operation(&invocation.operation)?;
        let parameters = schema::canonical(&operation.parameters, &invocation.parameters)
            .map_err(|failure| failure.context(&operation.id))?;
        let (bound, converted) =
            check::inputs(operation, &parameters, &invocation.inputs, &self.pool)?;
        let request = Request {
            operation: operation.id.clone(),
            parameters: parameters.clone(),
            inputs: bound
                .iter()
                .map(|(port, object)| InputRef {
                    port: port.clone(),
                    header: object.header().clone(),
                })
                .collect(),
            file: invocation.file.clone(),
            memory: Some(self.options.memory),
            rest: Map::new(),
        };
        let backend = self
            .backend(plugin, &request, progress)
            .map_err(|failure| blame(failure, plugin, &operation.id))?;
        let call = PreparedCall {
            backend,
            plugin: Arc::clone(plugin),
            operation: operation.id.clone(),
            parameters,
            inputs: bound.into_iter().map(|(_, object)| object).collect(),
            converted,
            resources: self.resources(),
            room: Arc::clone(&self.room),
        };
        self.check_plan(operation, &call)?;
        Ok(call)
    }

    fn backend(
        &self,
        plugin: &Arc<Installed>,
        request: &Request,
        progress: &Arc<dyn Progress>,
    ) -> Result<Backend, Failure> {
        if self.place(plugin)? {
            let context = JobContext::new(Vec::new(), Arc::clone(progress), self.resources());
            let prepared = self.library(plugin)?.prepare(&context, request)?;
            if prepared.plan().interruptible {
                return Ok(Backend::InProcess(prepared));
            }
            // What cannot be stopped would keep the person from the session.
            if self.options.isolation == Isolation::OnlyInProcess {
                let message = format!(
                    "{} cannot be stopped while it runs, and therefore runs only in a process of its own",
                    request.operation
                );
                return Err(only_in_process(message));
            }
        }
        let copy = self.copy(plugin)?;
        let name = &plugin.packed.manifest.id;
        self.workers
            .prepare(&copy, plugin.packed.door, name, request, &**progress)
            .map(|prepared| Backend::Worker(Box::new(prepared)))
    }

    fn check_plan(&self, operation: &Operation, call: &PreparedCall) -> Result<(), Failure> {
        let plan = call.plan();
        for read in &plan.read {
            let object = call.inputs.get(read.input);
            let part = object.and_then(|object| object.header().parts.get(read.part));
            let (Some(object), Some(part)) = (object, part) else {
                let message = format!("the plan of {} reads an input it has not", operation.id);
                return Err(Failure::internal(message));
            };
            for name in &read.columns {
                if part.column(name).is_none() && name != "row" {
                    let names: Vec<&str> = part.columns.iter().map(|c| c.name.as_str()).collect();
                    let message = format!("{} has no column {name}", object.header().name);
                    return Err(
                        Failure::bad_input(message).remedy(format!("it has {}", names.join(", ")))
                    );
                }
            }
        }
        if plan.memory > self.options.memory {
            let gigabytes = |bytes: u64| bytes.div_ceil(1 << 30);
            let message = format!(
                "{} would need {} GB of memory, and {} GB are allowed",
                operation.id,
                gigabytes(plan.memory),
                gigabytes(self.options.memory)
            );
            return Err(Failure::new(FailureCode::Resources, message));
        }
        Ok(())
    }

    fn planned(
        &self,
        invocation: &Invocation,
        progress: &Arc<dyn Progress>,
    ) -> Result<PreparedCall, Failure> {
        let prepared = self.prepare(invocation, progress)?;
        for note in &prepared.plan().notes {
            progress.message(2, note);
        }
        Ok(prepared)
    }

    /// The outputs of a call that were kept on disk.
    pub(super) fn recall(
        &self,
        invocation: &Invocation,
        key: &Key,
    ) -> Option<Vec<(String, Object)>> {
        let finished = self.results.get(key)?;
        let (_, operation) = self.operation(&invocation.operation).ok()?;
        let (parameters, inputs) = (&invocation.parameters, &invocation.inputs);
        let (bound, _) = check::inputs(operation, parameters, inputs, &self.pool).ok()?;
        let inputs: Vec<Object> = bound.into_iter().map(|(_, object)| object).collect();
        let assembled = self.pool.install(|| {
            let all = finished.into_iter().map(|one| assemble(one, &inputs));
            all.collect::<Result<_, Failure>>()
        });
        Some(with_tables(assembled.ok()?))
    }

    /// Runs a call whose outputs are kept on disk if that is worth it.
    pub(super) fn call_kept(
        &self,
        invocation: &Invocation,
        key: &Key,
        progress: &Arc<dyn Progress>,
    ) -> Result<Vec<(String, Object)>, Failure> {
        let mut prepared = self.planned(invocation, progress)?;
        let begun = Instant::now();
        let finished = prepared.finish(progress)?;
        self.results.put(key, &finished, begun.elapsed());
        prepared.assembled(finished)
    }

    /// Checks, plans and runs a call.
    ///
    /// # Errors
    /// What the engine's checks or the plugin refuse.
    pub fn call(
        &self,
        invocation: &Invocation,
        progress: &Arc<dyn Progress>,
    ) -> Result<Called, Failure> {
        let mut prepared = self.planned(invocation, progress)?;
        let outputs = prepared.run(progress)?;
        let PreparedCall {
            parameters,
            converted,
            ..
        } = prepared;
        Ok(Called {
            outputs,
            parameters,
            converted,
        })
    }
}

impl PreparedCall {
    /// What the call will do.
    #[must_use]
    pub fn plan(&self) -> &Arc<Plan> {
        match &self.backend {
            Backend::InProcess(prepared) => prepared.plan(),
            Backend::Worker(prepared) => prepared.plan(),
        }
    }

    /// Id of the operation.
    #[must_use]
    pub fn operation_id(&self) -> &str {
        &self.operation
    }

    /// The plugin that is called.
    #[must_use]
    pub fn plugin(&self) -> &Arc<Installed> {
        &self.plugin
    }

    /// Parameters after defaults.
    #[must_use]
    pub fn parameters(&self) -> &Map {
        &self.parameters
    }

    /// Runs it.
    ///
    /// # Errors
    /// What the plugin fails with.
    pub fn run(&mut self, progress: &Arc<dyn Progress>) -> Result<Vec<(String, Object)>, Failure> {
        let finished = self.finish(progress)?;
        self.assembled(finished)
    }

    fn finish(&mut self, progress: &Arc<dyn Progress>) -> Result<Vec<Finished>, Failure> {
        if progress.cancelled() {
            return Err(Failure::cancelled());
        }
        let room = Arc::clone(&self.room);
        let _share = room.take(needed(self.plan()), &**progress)?;
        self.finished(progress)
            .map_err(|failure| blame(failure, &self.plugin, &self.operation))
    }

    fn assembled(&self, finished: Vec<Finished>) -> Result<Vec<(String, Object)>, Failure> {
        let (inputs, id) = (&self.inputs, &self.operation);
        let assembled = finished.into_iter().map(|one| {
            // Only selections have work for the pool, and waking it takes longer than the rest.
            let assembled = match one.form {
                OutputForm::Selection => self.resources.threads.install(|| assemble(one, inputs)),
                _ => assemble(one, inputs),
            };
            assembled.map_err(|failure| blame(failure, &self.plugin, id))
        });
        Ok(with_tables(assembled.collect::<Result<_, Failure>>()?))
    }

    fn finished(&mut self, progress: &Arc<dyn Progress>) -> Result<Vec<Finished>, Failure> {
        match &mut self.backend {
            Backend::InProcess(prepared) => {
                let (inputs, resources) = (self.inputs.clone(), self.resources.clone());
                let context = JobContext::new(inputs, Arc::clone(progress), resources);
                prepared.run(&context)?;
                Ok(context.take_finished())
            }
            Backend::Worker(prepared) => {
                // Gathering selections uses the pool.
                gather(&self.resources.threads, &self.inputs, prepared.plan())?;
                prepared.run(&self.inputs, &**progress)
            }
        }
    }
}

/// Names plugin and operation in the sentence of a failure that is not the person's.
fn blame(failure: Failure, plugin: &Installed, operation: &str) -> Failure {
    let id = &plugin.packed.manifest.id;
    let says = |name: &str| failure.message.contains(name);
    let theirs = matches!(
        failure.code,
        FailureCode::Crashed | FailureCode::Internal | FailureCode::Resources
    );
    match (says(operation), says(id)) {
        _ if !theirs => failure,
        (true, true) => failure,
        (false, true) => failure.context(operation),
        (true, false) => failure.context(format!("the plugin {id}")),
        (false, false) => failure.context(format!("{operation} of the plugin {id}")),
    }
}

/// Gives figures the tables of the same call that their series name.
fn with_tables(outputs: Vec<(String, Object)>) -> Vec<(String, Object)> {
    let table = |port: &str| {
        let mut named = outputs.iter().filter(|(name, _)| name == port);
        named.find_map(|(_, one)| (one.header().kind == Kind::Table).then_some(one))
    };
    let figures = outputs.iter().map(|(name, object)| {
        let figure = object.header().kind == Kind::Figure;
        let object = if figure {
            object.with_tables(table)
        } else {
            object.clone()
        };
        (name.clone(), object)
    });
    figures.collect()
}

/// Gathers the columns that a plan reads, with all threads.
fn gather(pool: &rayon::ThreadPool, inputs: &[Object], plan: &Plan) -> Result<(), Failure> {
    pool.install(|| {
        for read in &plan.read {
            let Some(object) = inputs.get(read.input) else {
                continue;
            };
            for name in read.columns.iter().filter(|name| *name != "row") {
                object.column(read.part, name)?;
            }
        }
        Ok(())
    })
}

fn assemble(finished: Finished, inputs: &[Object]) -> Result<(String, Object), Failure> {
    let Finished {
        output,
        form,
        of,
        object,
    } = finished;
    let input = || {
        of.and_then(|of| inputs.get(of))
            .ok_or_else(|| Failure::internal(format!("output {output} belongs to no input")))
    };
    let object = match form {
        OutputForm::Object => object,
        OutputForm::Columns => {
            let infos = object
                .header()
                .parts
                .first()
                .map(|part| part.columns.clone());
            let columns: Vec<Arc<Stored>> = object.columns(0).to_vec();
            input()?.with_columns(infos.unwrap_or_default().into_iter().zip(columns).collect())?
        }
        OutputForm::Selection => {
            let input = input()?;
            let rows = object.column(0, "row")?;
            let selection = Selection::new(&rows, input.header().rows())?;
            input.select(&Arc::new(selection))?
        }
    };
    Ok((output, object))
}
