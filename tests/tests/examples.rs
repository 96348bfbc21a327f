//! Every operation's declared example runs, with the same bits in this process and in a worker,
//! and with one, two and three threads. An operation without an example fails.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use puncta_engine::documents::manifest::{Example, Step};
use puncta_engine::documents::{Map, Operation, OperationKind};
use puncta_engine::engine::{Invocation, Options};
use puncta_engine::{Engine, Isolation, Object};
use puncta_tests::{Bundle, fingerprint, unwatched};
use std::collections::BTreeMap;
use std::path::Path;

/// The libraries of all plugins of the bundle.
fn packages() -> Vec<String> {
    let folders = std::fs::read_dir(puncta_tests::root().join("plugins")).unwrap();
    let folders = folders.flatten().map(|folder| folder.path());
    let plugins = folders.filter(|folder| folder.join("Cargo.toml").is_file());
    let name = |folder: std::path::PathBuf| folder.file_name()?.to_str().map(String::from);
    let mut names: Vec<String> = plugins
        .filter_map(name)
        .map(|name| format!("puncta_plugin_{}", name.replace('-', "_")))
        .collect();
    names.sort();
    names
}

/// What a call planned and what it gave.
struct Ran {
    plan: String,
    outputs: Vec<(String, Object)>,
}

impl Ran {
    fn print(&self) -> String {
        self.plan.clone() + &fingerprint(&self.outputs)
    }
}

fn run_step(engine: &Engine, step: &Step) -> Result<Object, String> {
    let outputs = call(engine, &step.op, &step.parameters, &step.inputs)?.outputs;
    let wanted = step.output.as_deref();
    let found = outputs
        .into_iter()
        .find(|(port, _)| wanted.is_none_or(|name| name == port));
    found
        .map(|(_, object)| object)
        .ok_or_else(|| format!("{} gave no output", step.op))
}

fn call(
    engine: &Engine,
    operation: &str,
    parameters: &Map,
    inputs: &BTreeMap<String, Step>,
) -> Result<Ran, String> {
    let mut invocation = Invocation {
        operation: operation.into(),
        parameters: parameters.clone(),
        ..Invocation::default()
    };
    for (port, step) in inputs {
        invocation
            .inputs
            .push((port.clone(), run_step(engine, step)?));
    }
    let told = |failure: puncta_engine::documents::Failure| failure.to_string();
    let progress = unwatched();
    let mut prepared = engine.prepare(&invocation, &progress).map_err(told)?;
    let plan = serde_json::to_string(&**prepared.plan()).map_err(|error| error.to_string())?;
    let outputs = prepared.run(&progress).map_err(told)?;
    Ok(Ran { plan, outputs })
}

fn run_example(engine: &Engine, operation: &Operation, folder: &Path) -> Result<String, String> {
    let example = operation.example.as_ref().ok_or("it declares no example")?;
    match operation.kind {
        OperationKind::Operation => {
            let ran = call(engine, &operation.id, &example.parameters, &example.inputs)?;
            if ran.outputs.is_empty() && !operation.outputs.is_empty() {
                return Err("its example gives nothing".into());
            }
            Ok(ran.print())
        }
        OperationKind::Reader => read(engine, operation, example, folder),
        OperationKind::Writer => write(engine, operation, example, folder),
    }
}

fn read(
    engine: &Engine,
    operation: &Operation,
    example: &Example,
    folder: &Path,
) -> Result<String, String> {
    let file = example.file.as_ref().ok_or("its example has no file")?;
    let bytes = match (&file.text, &file.hex) {
        (Some(text), _) => text.as_bytes().to_vec(),
        (None, Some(hex)) => hex
            .as_bytes()
            .chunks(2)
            .map(|pair| u8::from_str_radix(std::str::from_utf8(pair).unwrap(), 16))
            .collect::<Result<_, _>>()
            .map_err(|error| error.to_string())?,
        (None, None) => return Err("its example's file is empty".into()),
    };
    let path = folder.join(&file.name);
    std::fs::write(&path, bytes).map_err(|error| error.to_string())?;
    // The reader is found by itself, which the example is to show as well.
    let read = engine.read(&path, None, &example.parameters, &unwatched());
    let read = read.map_err(|failure| failure.to_string())?;
    if read.reader != operation.id {
        return Err(format!("its example is read by {}", read.reader));
    }
    let said = format!("{} {:?} {:?} ", read.format, read.options, read.notes);
    Ok(said + &fingerprint(&read.objects))
}

fn write(
    engine: &Engine,
    operation: &Operation,
    example: &Example,
    folder: &Path,
) -> Result<String, String> {
    let rule = operation.file.as_ref().ok_or("it has no file rule")?;
    let suffix = rule.suffixes.first().ok_or("it has no suffix")?;
    let (_, step) = example
        .inputs
        .iter()
        .next()
        .ok_or("its example has no input")?;
    let object = run_step(engine, step)?;
    let path = folder.join(format!("example{suffix}"));
    let parameters = &example.parameters;
    let written = engine.write(
        &path,
        Some(&operation.id),
        parameters,
        &object,
        true,
        &unwatched(),
    );
    let mut hasher = blake3::Hasher::new();
    for file in written.map_err(|failure| failure.to_string())?.files {
        hasher.update(&std::fs::read(file).map_err(|error| error.to_string())?);
    }
    Ok(hasher.finalize().to_string())
}

/// Number of operations, and what is wrong with their examples.
fn try_all(bundle: &Bundle) -> (usize, Vec<String>) {
    let engine = |isolation, threads| {
        Engine::open(Options {
            isolation,
            threads,
            ..bundle.options()
        })
        .unwrap()
    };
    let first = engine(Isolation::ByPlugin, 2);
    let others = [
        ("a worker", engine(Isolation::Always, 2)),
        ("one thread", engine(Isolation::ByPlugin, 1)),
        ("three threads", engine(Isolation::ByPlugin, 3)),
    ];
    let folder = tempfile::tempdir().unwrap();
    let mut problems = Vec::new();
    let mut count = 0;
    for (_, operation) in first.catalogue().operations() {
        count += 1;
        match run_example(&first, operation, folder.path()) {
            Ok(expected) => {
                for (name, other) in &others {
                    match run_example(other, operation, folder.path()) {
                        Ok(print) if print == expected => {}
                        Ok(_) => {
                            problems.push(format!("{}: {name} gives other bits", operation.id))
                        }
                        Err(why) => problems.push(format!("{}: {name}: {why}", operation.id)),
                    }
                }
            }
            Err(why) => problems.push(format!("{}: {why}", operation.id)),
        }
    }
    (count, problems)
}

#[test]
fn every_example_gives_the_same_bits_everywhere() {
    let packages = packages();
    let names: Vec<&str> = packages.iter().map(String::as_str).collect();
    assert!(names.contains(&"puncta_plugin_filter"), "{names:?}");
    let (count, problems) = try_all(&Bundle::of(&names));
    assert!(problems.is_empty(), "{}", problems.join("\n"));
    assert!(
        count >= names.len(),
        "only {count} operations are installed"
    );
}

#[test]
fn what_has_no_example_or_other_bits_is_found() {
    let (_, problems) = try_all(&Bundle::of(&["puncta_test_sample"]));
    let found = |problem: &str| problems.iter().any(|one| one == problem);
    assert!(
        found("test.misbehave/1: it declares no example"),
        "{problems:?}"
    );
    assert!(
        found("test.process/1: a worker gives other bits"),
        "{problems:?}"
    );
}
