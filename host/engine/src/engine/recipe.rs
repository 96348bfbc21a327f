//! Recipes run by this engine: what is installed, how a step is called, where inputs come from.

use super::save::is_document;
use super::{Engine, Invocation, ReadFile};
use crate::job::Progress;
use crate::provenance::{ConversionRecord, InputRecord, PluginRecord, StepRecord};
use crate::recipe::check::{Source, check};
use crate::recipe::{self, Call, Checked, Conversion, Key, PluginRef, Recipe, Record, Runner, key};
use crate::store::Object;
use puncta_documents::{Failure, FailureCode, Header, Kind, Map, Operation};
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// How often a running step looks whether the person wants to stop.
const POLL: Duration = Duration::from_millis(10);

impl recipe::Catalogue for Engine {
    fn operation(&self, id: &str) -> Option<&Operation> {
        // A recipe names the revision: another one may mean something else.
        let (_, operation) = self.catalogue().find(id)?;
        (operation.id == id).then_some(operation)
    }

    fn plugin(&self, id: &str) -> Option<PluginRef> {
        let (plugin, _) = self.catalogue().find(id)?;
        let packed = &plugin.packed;
        let library = blake3::Hash::from_hex(&packed.hash).ok()?;
        let (id, version) = (packed.manifest.id.clone(), packed.manifest.version.clone());
        Some(PluginRef {
            id,
            version,
            library: *library.as_bytes(),
        })
    }

    fn operations(&self) -> Vec<&Operation> {
        self.catalogue()
            .operations()
            .map(|(_, operation)| operation)
            .collect()
    }
}

/// Runs the steps of recipes as calls of an engine.
#[derive(Clone)]
pub struct Steps(pub Arc<Engine>);

impl Runner for Steps {
    type Object = Object;

    fn header(object: &Object) -> &Header {
        object.header()
    }

    fn bytes(object: &Object) -> u64 {
        object.bytes()
    }

    fn call(
        &self,
        call: &Call<'_, Object>,
        job: &dyn Progress,
    ) -> Result<Vec<(String, Object)>, Failure> {
        let own = |(port, object): &(&str, Object)| ((*port).to_owned(), object.clone());
        let invocation = Invocation {
            operation: call.operation.id.clone(),
            parameters: call.parameters.clone(),
            inputs: call.inputs.iter().map(own).collect(),
            file: None,
        };
        watched(job, |progress| self.0.call(&invocation, progress)).map(|called| called.outputs)
    }

    fn convert(
        &self,
        object: &Object,
        conversions: &[Conversion],
        _job: &dyn Progress,
    ) -> Result<Object, Failure> {
        let mut object = object.clone();
        for one in conversions {
            if one.part != 0 {
                let message = format!("column {} is not in the first part", one.column);
                return Err(Failure::bad_input(message));
            }
            let convert = || object.converted(&one.column, one.factor, &one.to);
            object = self.0.pool().install(convert)?;
        }
        Ok(object)
    }
}

/// An object from a file, as an input of a recipe.
#[derive(Clone, Debug)]
pub struct SourceFile {
    /// The object.
    pub object: Object,
    /// What it depends on: reader, options, content of the file.
    pub key: Key,
    /// The same for provenance.
    pub record: InputRecord,
    /// Sentences that the person should see.
    pub notes: Vec<String>,
}

impl Engine {
    /// Checks a recipe against what is installed.
    #[must_use]
    pub fn check_recipe(&self, recipe: &Recipe) -> Checked {
        let mut checked = check(recipe, self);
        let mut forgiven = BTreeSet::new();
        for (output, said) in checked.outputs.iter().zip(&recipe.outputs) {
            let kind = output.source.and_then(|source| kind(&checked, source));
            let missing = output
                .failure
                .as_ref()
                .is_some_and(|one| one.code == FailureCode::Unsupported);
            // Figures and reports are saved without a writer.
            if missing
                && said.writer.is_none()
                && said.set.is_empty()
                && kind.is_some_and(|kind| is_document(Path::new(&output.file), kind))
            {
                forgiven.insert(output.file.clone());
            }
        }
        for output in &mut checked.outputs {
            if forgiven.contains(&output.file) {
                output.failure = None;
            }
        }
        checked.problems.retain(|problem| match &problem.subject {
            recipe::Subject::Output(file) => !forgiven.contains(file),
            _ => true,
        });
        checked
    }

    /// Reads a file for an input: the named object, or the first of the kind.
    ///
    /// # Errors
    /// As [`Engine::read`], or when the file holds no such object.
    pub fn source(
        &self,
        path: &Path,
        reader: Option<&str>,
        options: &Map,
        (object, kind): (Option<&str>, Kind),
        progress: &Arc<dyn Progress>,
    ) -> Result<SourceFile, Failure> {
        let read = self.read(path, reader, options, progress)?;
        let (name, object) = choose(&read, object, kind)?;
        let record = self.input_record(path, &read, name, &**progress)?;
        let library = blake3::Hash::from_hex(&record.reader.plugin.library);
        let content = blake3::Hash::from_hex(&record.file.blake3);
        let (Ok(library), Ok(content)) = (library, content) else {
            return Err(Failure::internal("a hash that is none"));
        };
        let key = key::source_key(
            &read.reader,
            library.as_bytes(),
            &read.options,
            name,
            content.as_bytes(),
        );
        Ok(SourceFile {
            object: object.clone(),
            key,
            record,
            notes: read.notes.clone(),
        })
    }
}

fn kind(checked: &Checked, source: Source) -> Option<Kind> {
    match source {
        Source::Input(at) => checked.inputs.get(at).map(|input| input.kind),
        Source::Step { step, output } => {
            let operation = checked.steps.get(step)?.operation.as_ref()?;
            operation.outputs.get(output).map(|port| port.kind)
        }
    }
}

fn choose<'a>(
    read: &'a ReadFile,
    object: Option<&str>,
    kind: Kind,
) -> Result<(&'a str, &'a Object), Failure> {
    let found = read.objects.iter().find(|(name, found)| match object {
        Some(object) => name == object,
        None => found.header().kind == kind,
    });
    if let Some((name, found)) = found {
        return Ok((name, found));
    }
    let first = read.object(object)?;
    let message = format!(
        "the file holds a {}, and a {kind} is needed",
        first.header().kind
    );
    Err(Failure::bad_input(message).remedy("choose another file"))
}

/// What a result of a recipe was made of, for its provenance: the records of its files by input,
/// and its steps, each after those that it needs. `record` gives what a step did.
#[must_use]
pub fn lineage(
    plan: &Checked,
    source: Source,
    files: &BTreeMap<String, Vec<InputRecord>>,
    record: &dyn Fn(&str) -> Option<Arc<Record>>,
) -> (BTreeMap<String, Vec<InputRecord>>, Vec<StepRecord>) {
    let mut inputs = BTreeSet::new();
    let mut steps = BTreeSet::new();
    let mut open = vec![source];
    while let Some(source) = open.pop() {
        match source {
            Source::Input(at) => {
                inputs.insert(at);
            }
            Source::Step { step, .. } => {
                if let (true, Some(found)) = (steps.insert(step), plan.steps.get(step)) {
                    open.extend(found.ports.iter().flat_map(|bound| &bound.sources));
                }
            }
        }
    }
    let named = inputs.iter().filter_map(|at| plan.inputs.get(*at));
    let files = named.filter_map(|input| {
        files
            .get(&*input.name)
            .map(|records| (input.name.to_string(), records.clone()))
    });
    let steps = steps.iter().filter_map(|at| {
        let step = plan.steps.get(*at)?;
        let record = record(&step.name)?;
        let operation = step.operation.as_ref()?;
        let bound = step.ports.iter().filter_map(|bound| {
            let sources = bound
                .sources
                .iter()
                .filter_map(|source| reference(plan, *source));
            Some((
                operation.inputs.get(bound.port)?.name.clone(),
                sources.collect(),
            ))
        });
        let converted = record.inputs.iter().flat_map(|input| {
            input.conversions.iter().map(|(_, one)| ConversionRecord {
                port: input.port.clone(),
                column: one.column.clone(),
                from: one.from.clone(),
                to: one.to.clone(),
                factor: one.factor,
            })
        });
        Some(StepRecord {
            name: step.name.to_string(),
            call: crate::provenance::CallRecord {
                operation: record.operation.to_string(),
                plugin: PluginRecord {
                    id: record.plugin.id.clone(),
                    version: record.plugin.version.clone(),
                    library: Key::from_bytes(record.plugin.library).to_string(),
                },
                parameters: (*record.parameters).clone(),
            },
            inputs: bound.collect(),
            converted: converted.collect(),
        })
    });
    (files.collect(), steps.collect())
}

/// How a recipe would name a source.
fn reference(plan: &Checked, source: Source) -> Option<String> {
    match source {
        Source::Input(at) => plan.inputs.get(at).map(|input| input.name.to_string()),
        Source::Step { step, output } => {
            let step = plan.steps.get(step)?;
            let port = step.operation.as_ref()?.outputs.get(output)?;
            Some(format!("{}.{}", step.name, port.name))
        }
    }
}

/// Does work that needs progress for itself, while another thread passes on what it says.
fn watched<T>(
    job: &dyn Progress,
    work: impl FnOnce(&Arc<dyn Progress>) -> Result<T, Failure>,
) -> Result<T, Failure> {
    let relay = Arc::new(Relay::default());
    relay.cancelled.store(job.cancelled(), Ordering::Relaxed);
    let progress: Arc<dyn Progress> = Arc::clone(&relay) as Arc<dyn Progress>;
    std::thread::scope(|scope| {
        let ended = Ended(&relay);
        let forward = || relay.forward(job);
        std::thread::Builder::new()
            .spawn_scoped(scope, forward)
            .map_err(|_| {
                Failure::new(
                    FailureCode::Resources,
                    "the system gives no thread for a step",
                )
            })?;
        let done = work(&progress);
        drop(ended);
        done
    })
}

#[derive(Default)]
struct Relay {
    cancelled: AtomicBool,
    said: Mutex<Said>,
    news: Condvar,
}

#[derive(Default)]
struct Said {
    progress: Option<(f64, String)>,
    messages: Vec<(u32, String)>,
    over: bool,
}

/// Ends the passing on, also when the work panics.
struct Ended<'a>(&'a Relay);

impl Drop for Ended<'_> {
    fn drop(&mut self) {
        self.0.said().over = true;
        self.0.news.notify_all();
    }
}

impl Relay {
    fn said(&self) -> MutexGuard<'_, Said> {
        self.said.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn forward(&self, job: &dyn Progress) {
        let mut said = self.said();
        loop {
            let news = std::mem::take(&mut *said);
            drop(said);
            for (level, text) in &news.messages {
                job.message(*level, text);
            }
            if let Some((fraction, phase)) = &news.progress {
                job.progress(*fraction, phase);
            }
            if news.over {
                return;
            }
            if job.cancelled() {
                self.cancelled.store(true, Ordering::Relaxed);
            }
            said = self.said();
            // Messages and the end are passed on at once, progress when it is time to look.
            if said.messages.is_empty() && !said.over {
                let waited = self.news.wait_timeout(said, POLL);
                said = waited.unwrap_or_else(PoisonError::into_inner).0;
            }
        }
    }
}

impl Progress for Relay {
    fn progress(&self, fraction: f64, phase: &str) {
        let mut said = self.said();
        match &mut said.progress {
            Some((last, text)) => {
                *last = fraction;
                if text != phase {
                    phase.clone_into(text);
                }
            }
            none => *none = Some((fraction, phase.to_owned())),
        }
    }

    fn message(&self, level: u32, text: &str) {
        self.said().messages.push((level, text.to_owned()));
        self.news.notify_all();
    }

    fn cancelled(&self) -> bool {
        self.cancelled.load(Ordering::Relaxed)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::job::Cancel;

    #[derive(Default)]
    struct Notes(Mutex<Vec<String>>);

    impl Progress for Notes {
        fn progress(&self, fraction: f64, phase: &str) {
            self.0.lock().unwrap().push(format!("{fraction} {phase}"));
        }
        fn message(&self, level: u32, text: &str) {
            self.0.lock().unwrap().push(format!("{level} {text}"));
        }
        fn cancelled(&self) -> bool {
            false
        }
    }

    #[test]
    fn what_work_says_arrives() {
        let notes = Notes::default();
        let done = watched(&notes, |progress| {
            progress.message(2, "one");
            progress.message(3, "two");
            progress.progress(0.5, "half");
            Ok(7)
        });
        assert_eq!(done, Ok(7));
        let said = notes.0.lock().unwrap();
        let messages: Vec<&String> = said.iter().filter(|text| !text.contains("half")).collect();
        assert_eq!(messages, ["2 one", "3 two"]);
        assert_eq!(said.last().map(String::as_str), Some("0.5 half"));
    }

    #[test]
    fn cancel_reaches_the_work() {
        let cancel = Cancel::default();
        let done: Result<(), Failure> = watched(&cancel, |progress| {
            assert!(!progress.cancelled());
            cancel.cancel();
            while !progress.cancelled() {
                std::thread::yield_now();
            }
            Err(Failure::cancelled())
        });
        assert!(done.unwrap_err().is_cancelled());
    }

    #[test]
    fn a_panic_in_the_work_ends_it() {
        let caught = std::panic::catch_unwind(|| {
            watched::<()>(&crate::job::Unwatched, |_| panic!("on purpose"))
        });
        assert!(caught.is_err());
    }
}
