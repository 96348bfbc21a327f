//! Recipes run by this engine: what is installed, how a step is called, where inputs come from.

use super::relay::watched;
use super::save::is_document;
use super::{Engine, Invocation, ReadFile};
use crate::job::Progress;
use crate::provenance::{
    CallRecord, ConversionRecord, InputRecord, Lineage, PluginRecord, StepRecord,
};
use crate::recipe::check::{Source, check};
use crate::recipe::{
    self, Call, Checked, CheckedStep, Conversion, Key, PluginRef, Recipe, Record, Runner, key,
};
use crate::store::Object;
use puncta_documents::{Failure, FailureCode, Header, Kind, Map, Operation, OperationKind};
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::sync::Arc;

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

    fn withheld(&self, id: &str) -> Option<Failure> {
        self.catalogue().withheld(id)
    }

    fn withheld_file(&self, file: &str, kind: OperationKind) -> Option<Failure> {
        self.catalogue().withheld_file(file, kind)
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
        let invocation = invocation(call);
        watched(job, |progress| {
            self.0.call_kept(&invocation, &call.key, progress)
        })
    }

    fn recall(&self, call: &Call<'_, Object>) -> Option<Vec<(String, Object)>> {
        self.0.recall(&invocation(call), &call.key)
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

fn invocation(call: &Call<'_, Object>) -> Invocation {
    let own = |(port, object): &(&str, Object)| ((*port).to_owned(), object.clone());
    Invocation {
        operation: call.operation.id.clone(),
        parameters: call.parameters.clone(),
        inputs: call.inputs.iter().map(own).collect(),
        file: None,
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
) -> Lineage {
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
    let steps = steps.iter().filter_map(|at| plan.steps.get(*at));
    let steps = steps.filter_map(|step| step_record(plan, step, &*record(&step.name)?));
    Lineage {
        object: plan.name_of(source).unwrap_or_default(),
        number: 0,
        inputs: files.collect(),
        steps: steps.collect(),
    }
}

fn step_record(plan: &Checked, step: &CheckedStep, record: &Record) -> Option<StepRecord> {
    let operation = step.operation.as_ref()?;
    let bound = step.ports.iter().filter_map(|bound| {
        let sources = bound
            .sources
            .iter()
            .filter_map(|source| plan.name_of(*source));
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
        call: CallRecord {
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
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::provenance::FileRecord;
    use serde_json::json;

    struct Installed(Operation);

    impl recipe::Catalogue for Installed {
        fn operation(&self, id: &str) -> Option<&Operation> {
            (id == self.0.id).then_some(&self.0)
        }
        fn plugin(&self, _id: &str) -> Option<PluginRef> {
            Some(PluginRef {
                id: "a".into(),
                version: "1".into(),
                library: [1; 32],
            })
        }
        fn operations(&self) -> Vec<&Operation> {
            vec![&self.0]
        }
    }

    #[test]
    fn only_what_a_result_was_made_of_is_named() {
        let operation: Operation = serde_json::from_value(json!({
            "id": "a.b/1", "kind": "operation", "title": "B",
            "inputs": [{"name": "table", "kind": "table"}],
            "outputs": [{"name": "out", "kind": "table"}]
        }))
        .unwrap();
        assert_eq!(operation.kind, OperationKind::Operation);
        let text = "format = \"puncta.recipe/1\"
            inputs = { one = { kind = \"table\" }, two = { kind = \"table\" } }
            steps.z = { op = \"a.b/1\", in.table = \"one\" }
            steps.y = { op = \"a.b/1\", in.table = \"z\" }
            steps.x = { op = \"a.b/1\", in.table = \"two\" }";
        let plan = check(&recipe::parse(text).unwrap(), &Installed(operation));
        assert!(plan.problems.is_empty(), "{:?}", plan.problems);
        let call = CallRecord {
            operation: "r/1".into(),
            plugin: PluginRecord {
                id: "r".into(),
                version: "1".into(),
                library: String::new(),
            },
            parameters: Map::new(),
        };
        let file = |name: &str| InputRecord {
            file: FileRecord {
                name: name.into(),
                path: None,
                bytes: 1,
                blake3: String::new(),
            },
            format: String::new(),
            object: String::new(),
            reader: call.clone(),
        };
        let files = BTreeMap::from([
            ("one".to_owned(), vec![file("1.csv")]),
            ("two".to_owned(), vec![file("2.csv")]),
        ]);
        let record = |_: &str| {
            let parameters = Arc::new(Map::from_iter([("seed".to_owned(), "7".into())]));
            let plugin = Arc::new(PluginRef {
                library: [1; 32],
                ..PluginRef::default()
            });
            Some(Arc::new(Record {
                operation: "a.b/1".into(),
                plugin,
                parameters,
                inputs: vec![],
            }))
        };
        let source = plan.source("y").unwrap();
        let Lineage { inputs, steps, .. } = lineage(&plan, source, &files, &record);
        assert_eq!(inputs.keys().collect::<Vec<_>>(), ["one"]);
        let names: Vec<&str> = steps.iter().map(|step| step.name.as_str()).collect();
        assert_eq!(names, ["z", "y"]);
        assert_eq!(steps[0].inputs["table"], ["one"]);
        assert_eq!(steps[1].inputs["table"], ["z.out"]);
        assert_eq!(steps[1].call.parameters["seed"], json!("7"));
        assert_eq!(steps[1].call.plugin.library, "01".repeat(32));
    }
}
