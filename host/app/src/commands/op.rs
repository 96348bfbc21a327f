//! `puncta op NAME INPUT... --param value -o OUT`.

use crate::cli::Op;
use crate::context::{Context, bound};
use crate::exit::Ended;
use crate::flags;
use crate::objects::Described;
use crate::saved;
use puncta_engine::documents::{Failure, Kind, Map, Operation, OperationKind, Port, schema};
use puncta_engine::files::check_target;
use puncta_engine::headless::{Saved, Saving};
use puncta_engine::provenance::{InputRecord, Lineage, StepRecord};
use puncta_engine::{Called, Invocation, Object, ReadFile};
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// What was given for flags that come from schemas.
pub struct Given {
    /// Parameters.
    pub parameters: Map,
    /// Options of the reader.
    pub reader: Map,
    /// Options of the writer.
    pub writer: Map,
}

/// A file for a port, with the name of the object in it.
#[derive(Debug, PartialEq, Eq)]
struct Input {
    port: String,
    file: PathBuf,
    object: Option<String>,
}

pub fn run(
    context: &Context,
    op: &Op,
    operation: &Operation,
    mut given: Given,
) -> Result<Ended, Failure> {
    check_kind(operation)?;
    flags::assigned(operation, &op.set, &mut given.parameters)?;
    // What is wrong is said before a large file is read.
    schema::canonical(&operation.parameters, &given.parameters)?;
    let inputs = bind(operation, &op.inputs)?;
    let targets = targets(operation, &op.output)?;
    for (port, path) in &targets {
        check_target(path, op.overwrite)?;
        context
            .engine
            .can_save(path, op.writer.as_deref(), port.kind)?;
    }
    let (reader, options) = (op.reader.as_deref(), &given.reader);
    let mut files = Files {
        context,
        reader,
        options,
        read: Vec::new(),
    };
    let (names, objects) = files.objects(operation, &inputs)?;
    let invocation = Invocation {
        operation: operation.id.clone(),
        parameters: given.parameters,
        inputs: objects,
        file: None,
    };
    context.watch.begin(&operation.title);
    let called = context.engine.call(&invocation, &context.progress())?;
    context.watch.end();
    drop(invocation);
    let mut saved = Vec::new();
    if !targets.is_empty() {
        let made = Made {
            files: &files,
            inputs: &inputs,
            names: &names,
            operation,
            called: &called,
        };
        let lineage = made.lineage()?;
        for out in outputs(&targets, &called)? {
            let saving = Saving {
                path: &out.path,
                writer: op.writer.as_deref(),
                options: &given.writer,
                overwrite: op.overwrite,
            };
            let made = Lineage {
                object: out.reference,
                number: out.number,
                ..lineage.clone()
            };
            saved.push(context.save(saving, out.object, made)?);
        }
    }
    print(context, operation, &called, &saved)?;
    Ok(Ended::Done)
}

fn check_kind(operation: &Operation) -> Result<(), Failure> {
    let (kind, remedy) = match operation.kind {
        OperationKind::Operation => return Ok(()),
        OperationKind::Reader => ("reader", "use puncta info FILE, or puncta convert"),
        OperationKind::Writer => ("writer", "use puncta convert IN OUT"),
    };
    let message = format!("{} is a {kind} and no operation", operation.id);
    Err(Failure::bad_parameter("name", message).remedy(remedy))
}

fn print(
    context: &Context,
    operation: &Operation,
    called: &Called,
    saved: &[Saved],
) -> Result<(), Failure> {
    if !saved.is_empty() && !context.json {
        return context
            .output
            .text(&saved.iter().map(saved::text).collect::<String>());
    }
    let describe = |(name, object): &(String, Object)| Described::of(name, object);
    let all: Result<Vec<Described>, Failure> = match saved.is_empty() {
        true => context
            .engine
            .pool()
            .install(|| called.outputs.iter().map(describe).collect()),
        false => Ok(Vec::new()),
    };
    let all = all?;
    if context.json {
        return context.output.json(&json!({
            "operation": operation.id,
            "parameters": called.parameters,
            "objects": all.iter().map(Described::json).collect::<Vec<Value>>(),
            "written": saved.iter().map(saved::json).collect::<Vec<Value>>(),
        }));
    }
    context.output.text(
        &all.iter()
            .map(Described::text)
            .collect::<Vec<_>>()
            .join("\n"),
    )
}

/// Names, and objects by port.
type Objects = (Vec<String>, Vec<(String, Object)>);

/// Files that are read once, however often they are named.
struct Files<'a> {
    context: &'a Context,
    reader: Option<&'a str>,
    options: &'a Map,
    read: Vec<(PathBuf, ReadFile)>,
}

impl Files<'_> {
    fn get(&mut self, path: &Path) -> Result<&ReadFile, Failure> {
        let place = match self.read.iter().position(|(known, _)| known == path) {
            Some(place) => place,
            None => {
                let read = self.context.read(path, self.reader, self.options)?;
                read.notes
                    .iter()
                    .for_each(|note| self.context.watch.note(note));
                self.read.push((path.to_owned(), read));
                self.read.len() - 1
            }
        };
        let found = self.read.get(place).map(|(_, read)| read);
        found.ok_or_else(|| Failure::internal("a file that was read is gone"))
    }

    /// Objects for all inputs: their names in the files, and the objects by port.
    fn objects(&mut self, operation: &Operation, inputs: &[Input]) -> Result<Objects, Failure> {
        let (mut names, mut objects) = Objects::default();
        for input in inputs {
            let port = operation.inputs.iter().find(|port| port.name == input.port);
            let (name, object) = self.object(input, port.map(|port| port.kind))?;
            names.push(name);
            objects.push((input.port.clone(), object));
        }
        Ok((names, objects))
    }

    /// The named object, or the first of the kind that the port takes.
    fn object(&mut self, input: &Input, kind: Option<Kind>) -> Result<(String, Object), Failure> {
        let read = self.get(&input.file)?;
        let fits = |(_, object): &&(String, Object)| Some(object.header().kind) == kind;
        let found = match &input.object {
            None => read.objects.iter().find(fits),
            Some(name) => read.objects.iter().find(|(known, _)| known == name),
        };
        match found {
            Some((name, object)) => Ok((name.clone(), object.clone())),
            None => {
                let first = read.objects.first().map(|(name, _)| name.clone());
                let object = read.object(input.object.as_deref()).cloned();
                let object = object.map_err(|failure| failure.context(input.file.display()))?;
                Ok((input.object.clone().or(first).unwrap_or_default(), object))
            }
        }
    }
}

/// Which file goes to which port.
fn bind(operation: &Operation, texts: &[String]) -> Result<Vec<Input>, Failure> {
    let names: Vec<&str> = operation
        .inputs
        .iter()
        .map(|port| port.name.as_str())
        .collect();
    let mut inputs: Vec<Input> = Vec::new();
    for text in texts {
        let (port, file) = bound(text, &names);
        let free = |port: &&Port| port.many || inputs.iter().all(|one| one.port != port.name);
        let port = match port {
            Some(port) => port.to_owned(),
            None => match operation.inputs.iter().find(free) {
                Some(port) => port.name.clone(),
                None => {
                    let message = format!("there is no input for {text}");
                    let remedy = match names.as_slice() {
                        [] => format!("{} takes none", operation.id),
                        names => format!("the inputs of {} are {}", operation.id, names.join(", ")),
                    };
                    return Err(Failure::bad_parameter("input", message).remedy(remedy));
                }
            },
        };
        let (file, object) = split_object(file);
        inputs.push(Input { port, file, object });
    }
    for port in operation.inputs.iter().filter(|port| !port.optional) {
        if inputs.iter().all(|input| input.port != port.name) {
            let message = format!("{} needs a {} as {}", operation.id, port.kind, port.name);
            return Err(Failure::bad_parameter("input", message)
                .remedy(format!("add a file, or {}=FILE", port.name)));
        }
    }
    Ok(inputs)
}

/// `FILE:OBJECT`, unless there is a file of the whole name.
fn split_object(file: PathBuf) -> (PathBuf, Option<String>) {
    if !file.exists()
        && let Some((path, object)) = file.to_str().and_then(|text| text.rsplit_once(':'))
        && Path::new(path).exists()
    {
        return (path.into(), Some(object.to_owned()));
    }
    (file, None)
}

/// Which output goes to which file.
fn targets<'a>(
    operation: &'a Operation,
    texts: &[String],
) -> Result<Vec<(&'a Port, PathBuf)>, Failure> {
    let names: Vec<&str> = operation
        .outputs
        .iter()
        .map(|port| port.name.as_str())
        .collect();
    let mut targets: Vec<(&Port, PathBuf)> = Vec::new();
    for text in texts {
        let (name, path) = bound(text, &names);
        let port = match name {
            Some(name) => operation.outputs.iter().find(|port| port.name == name),
            None => {
                let free = |port: &&Port| targets.iter().all(|(taken, _)| taken.name != port.name);
                operation.outputs.iter().find(free)
            }
        };
        let port = port.ok_or_else(|| {
            Failure::bad_parameter("output", format!("there is no output for {text}")).remedy(
                format!("the outputs of {} are {}", operation.id, names.join(", ")),
            )
        })?;
        if targets.iter().any(|(_, known)| *known == path) {
            let message = format!("two outputs go to {}", path.display());
            return Err(Failure::bad_parameter("output", message).remedy("rename one of the two"));
        }
        targets.push((port, path));
    }
    Ok(targets)
}

/// A file to write.
struct Out<'a> {
    path: PathBuf,
    reference: String,
    number: usize,
    object: &'a Object,
}

/// What is written where: an output with several objects goes to numbered files.
fn outputs<'a>(targets: &[(&Port, PathBuf)], called: &'a Called) -> Result<Vec<Out<'a>>, Failure> {
    let mut out = Vec::new();
    for (port, path) in targets {
        let all: Vec<&Object> = called
            .outputs
            .iter()
            .filter(|(name, _)| *name == port.name)
            .map(|(_, object)| object)
            .collect();
        let reference = format!("result.{}", port.name);
        match all.as_slice() {
            [] => {
                let message = format!("there is no {} to write to {}", port.name, path.display());
                return Err(Failure::bad_input(message).remedy("leave this output out"));
            }
            [one] => out.push(Out {
                path: path.clone(),
                reference,
                number: 0,
                object: one,
            }),
            several => out.extend(several.iter().enumerate().map(|(number, one)| Out {
                path: numbered(path, number + 1),
                reference: reference.clone(),
                number,
                object: one,
            })),
        }
    }
    Ok(out)
}

fn numbered(path: &Path, number: usize) -> PathBuf {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let (stem, suffix) = match name.split_once('.') {
        Some((stem, suffix)) if !stem.is_empty() => (stem, format!(".{suffix}")),
        _ => (&*name, String::new()),
    };
    path.with_file_name(format!("{stem}-{number}{suffix}"))
}

/// What a call was made of, for provenance.
struct Made<'a> {
    files: &'a Files<'a>,
    inputs: &'a [Input],
    names: &'a [String],
    operation: &'a Operation,
    called: &'a Called,
}

impl Made<'_> {
    fn lineage(&self) -> Result<Lineage, Failure> {
        let (context, progress) = (self.files.context, self.files.context.progress());
        let mut records: BTreeMap<String, Vec<InputRecord>> = BTreeMap::new();
        let mut bound: BTreeMap<String, Vec<String>> = BTreeMap::new();
        for (input, name) in self.inputs.iter().zip(self.names) {
            let Some((_, read)) = self.files.read.iter().find(|(path, _)| *path == input.file)
            else {
                continue;
            };
            let record = context
                .engine
                .input_record(&input.file, read, name, &*progress)?;
            records.entry(input.port.clone()).or_default().push(record);
            // One name stands for all the files of a port.
            bound.insert(input.port.clone(), vec![input.port.clone()]);
        }
        let step = StepRecord {
            name: "result".into(),
            call: context
                .engine
                .call_record(&self.operation.id, &self.called.parameters)?,
            inputs: bound,
            converted: self.called.converted.iter().map(Into::into).collect(),
        };
        Ok(Lineage {
            inputs: records,
            steps: vec![step],
            ..Lineage::default()
        })
    }
}

#[cfg(test)]
#[path = "op_tests.rs"]
mod tests;
