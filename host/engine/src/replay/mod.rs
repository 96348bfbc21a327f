//! Doing again what a saved file was made by: its inputs, its recipe, and what is not as it was.

mod again;
mod compare;

pub use compare::{Comparison, compare};

use crate::engine::Engine;
use crate::job::Progress;
use crate::provenance::{CallRecord, FileRecord, InputRecord, Platform, Provenance};
use crate::recipe::{Binding, Input, Place, Recipe, Reference, Step};
use puncta_documents::{Failure, FailureCode, Kind, Operation};
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// Something that is not as it was when the file was written.
#[derive(Clone, Debug, PartialEq)]
pub struct Difference {
    /// What, where, what to do.
    pub failure: Failure,
    /// Whether the file cannot be computed again because of it.
    pub missing: bool,
}

/// Files that were given for inputs by name, instead of those on record.
pub type Given = BTreeMap<String, Vec<PathBuf>>;

/// A file that is to be made again.
#[derive(Clone, Debug)]
pub struct Replay {
    /// What is on record.
    pub provenance: Provenance,
    /// Files of the inputs, by name.
    pub inputs: BTreeMap<String, Vec<PathBuf>>,
    /// Everything that is not as it was.
    pub differences: Vec<Difference>,
    /// Whether another processor or system made the file.
    pub elsewhere: bool,
}

impl Replay {
    /// Looks for what a file was made of and compares it with the record. An input is looked for
    /// where it was, then beside the file, under the name that it had.
    ///
    /// # Errors
    /// When an input of `given` is none of the file's, an input cannot be read, or the person
    /// stopped it.
    pub fn new(
        engine: &Engine,
        provenance: Provenance,
        folder: &Path,
        given: &Given,
        progress: &dyn Progress,
    ) -> Result<Replay, Failure> {
        check_given(&provenance, given)?;
        let mut differences = Vec::new();
        let mut inputs = BTreeMap::new();
        for (name, records) in &provenance.inputs {
            let named = given.get(name).map(Vec::as_slice);
            let mut paths = Vec::new();
            for (at, record) in records.iter().enumerate() {
                let named = named.map(|named| named.get(at));
                let found = locate(name, record, folder, named, progress)?;
                paths.push(found.path);
                differences.extend(found.difference);
            }
            inputs.insert(name.clone(), paths);
        }
        let mut seen = BTreeSet::new();
        let readers = provenance.inputs.values().flatten().map(|one| &one.reader);
        let steps = provenance.steps.iter().map(|step| &step.call);
        for call in readers.chain(steps).chain(&provenance.writer) {
            if seen.insert((&call.operation, &call.plugin.library)) {
                differences.extend(changed(engine, call));
            }
        }
        let elsewhere = provenance.platform != Platform::here();
        Ok(Replay {
            provenance,
            inputs,
            differences,
            elsewhere,
        })
    }

    /// The recipe that makes the object. `kinds` are those of the inputs' objects.
    #[must_use]
    pub fn recipe(&self, kinds: &BTreeMap<String, Kind>) -> Recipe {
        let place = Place::default();
        let input = |(name, records): (&String, &Vec<InputRecord>)| {
            let first = records.first()?;
            Some(Input {
                name: name.clone(),
                kind: *kinds.get(name)?,
                many: records.len() > 1,
                reader: Some(first.reader.operation.clone()),
                options: first.reader.parameters.clone(),
                object: Some(first.object.clone()),
                place,
            })
        };
        let bind = |(port, from): (&String, &Vec<String>)| Binding {
            port: port.clone(),
            place,
            from: from.iter().map(|text| reference(text)).collect(),
        };
        let steps = self.provenance.steps.iter().map(|step| Step {
            name: step.name.clone(),
            op: step.call.operation.clone(),
            op_place: place,
            inputs: step.inputs.iter().map(bind).collect(),
            set: step.call.parameters.clone(),
            set_places: BTreeMap::new(),
            place,
        });
        Recipe {
            inputs: self.provenance.inputs.iter().filter_map(input).collect(),
            steps: steps.collect(),
            outputs: Vec::new(),
        }
    }

    /// How far values may be from those on record, as a share of a column's largest magnitude: the
    /// sum of what the operations state.
    #[must_use]
    pub fn tolerance(&self, engine: &Engine) -> f64 {
        let steps = self.provenance.steps.iter();
        steps
            .filter_map(|step| engine.operation(&step.call.operation).ok())
            .map(|(_, operation)| operation.tolerance)
            .sum()
    }
}

fn reference(text: &str) -> Reference {
    let (source, output) = match text.split_once('.') {
        Some((source, output)) => (source, Some(output.to_owned())),
        None => (text, None),
    };
    Reference {
        source: source.to_owned(),
        output,
        place: Place::default(),
    }
}

fn check_given(provenance: &Provenance, given: &Given) -> Result<(), Failure> {
    let bad = |message| Err(Failure::bad_parameter("input", message));
    for (name, paths) in given {
        let known = provenance.inputs.get(name).map(Vec::len);
        match known {
            None => {
                let names: Vec<&str> = provenance.inputs.keys().map(String::as_str).collect();
                let message = format!("the file was made without an input {name}");
                return bad(message).map_err(|failure: Failure| match names.as_slice() {
                    [] => failure.remedy("it was made of no file; leave --input out"),
                    names => failure.remedy(format!("its inputs are {}", names.join(", "))),
                });
            }
            Some(count) if count != paths.len() => {
                return bad(format!(
                    "the input {name} was {count} files, and {} are given",
                    paths.len()
                ));
            }
            Some(_) => {}
        }
    }
    Ok(())
}

struct Located {
    path: PathBuf,
    difference: Option<Difference>,
}

/// Where an input is, and whether it is what it was.
fn locate(
    name: &str,
    record: &InputRecord,
    folder: &Path,
    given: Option<Option<&PathBuf>>,
    progress: &dyn Progress,
) -> Result<Located, Failure> {
    let recorded = record.file.path.as_ref().map(PathBuf::from);
    let beside = folder.join(&record.file.name);
    let candidates: Vec<PathBuf> = match given {
        Some(path) => path.into_iter().cloned().collect(),
        None => recorded.into_iter().chain([beside]).collect(),
    };
    let mut other = None;
    for path in candidates {
        if !path.is_file() {
            continue;
        }
        // Of another length it needs no reading.
        let same = path.metadata().is_ok_and(|m| m.len() == record.file.bytes)
            && FileRecord::of(&path, false, progress)?.blake3 == record.file.blake3;
        if same {
            let difference = None;
            return Ok(Located { path, difference });
        }
        other.get_or_insert(path);
    }
    let (message, missing) = match &other {
        Some(path) => (
            format!(
                "the input {name} is not what it was: {} has changed",
                path.display()
            ),
            false,
        ),
        None => (
            format!(
                "the input {name} is missing: there is no {}",
                record.file.path.as_ref().unwrap_or(&record.file.name)
            ),
            true,
        ),
    };
    let failure = Failure::bad_file(message)
        .remedy(format!("name the file as it was with --input {name}=FILE"));
    Ok(Located {
        path: other.unwrap_or_default(),
        difference: Some(Difference { failure, missing }),
    })
}

/// How an operation's plugin differs from the one on record.
fn changed(engine: &Engine, call: &CallRecord) -> Option<Difference> {
    let (was, operation) = (&call.plugin, &call.operation);
    let remedy = format!("install {} {} as it was", was.id, was.version);
    let exact = |(_, found): &(_, &Operation)| found.id == *operation;
    let Some((plugin, _)) = engine.catalogue().find(operation).filter(exact) else {
        let absent = || {
            let message = format!("{operation} of the plugin {} is not installed", was.id);
            Failure::new(FailureCode::Unsupported, message).remedy(remedy)
        };
        return Some(Difference {
            failure: engine
                .catalogue()
                .withheld(operation)
                .unwrap_or_else(absent),
            missing: true,
        });
    };
    let now = &plugin.packed;
    let differ = |message: String| {
        let failure = Failure::new(FailureCode::Unsupported, message).remedy(remedy);
        Some(Difference {
            failure,
            missing: false,
        })
    };
    if now.manifest.id != was.id {
        return differ(format!(
            "{operation} is of the plugin {} now, and was of {}",
            now.manifest.id, was.id
        ));
    }
    if now.manifest.version != was.version {
        return differ(format!(
            "{} has version {} now, and had {}",
            was.id, now.manifest.version, was.version
        ));
    }
    if now.hash != was.library {
        return differ(format!(
            "the library of {} {} is another build",
            was.id, was.version
        ));
    }
    None
}
