//! `puncta replay FILE`.

use crate::cli::Replay as Arguments;
use crate::commands::run::Steady;
use crate::context::Context;
use crate::exit::{self, Ended, say, sentence};
use puncta_engine::documents::{Failure, Map};
use puncta_engine::headless::name;
use puncta_engine::provenance::{self, FileRecord, SUFFIX};
use puncta_engine::replay::{Comparison, Difference, Given, Replay, compare};
use puncta_engine::{Object, Written};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};

pub fn run(context: &Context, arguments: &Arguments) -> Result<Ended, Failure> {
    let file = subject(&arguments.file);
    let record = read(&file)?;
    let folder = puncta_engine::files::folder_of(&file);
    let given = given(&arguments.input)?;
    let progress = context.progress();
    let replay = Replay::new(&context.engine, record, folder, &given, &*progress)?;
    let state = State::of(&file, &replay.provenance.file, context)?;
    refuse(&replay.differences, arguments.anyway, &file, state)?;
    let watch = Steady(&context.watch);
    let object = replay.run(&context.engine, &progress, &watch)?;
    context.watch.end();
    let place =
        tempfile::tempdir().map_err(|error| Failure::io("make", &std::env::temp_dir(), &error))?;
    let written = write(context, &replay, &object, place.path())?;
    let found = judge(context, &replay, (&file, state), &written)?;
    print(context, &file, &replay, &found)?;
    Ok(if found.good() {
        Ended::Done
    } else {
        Ended::Failed
    })
}

/// The file itself, whether it or its provenance is named.
fn subject(path: &Path) -> PathBuf {
    let text = path.to_string_lossy();
    match text.strip_suffix(SUFFIX) {
        Some(file) => file.into(),
        None => path.to_owned(),
    }
}

fn read(file: &Path) -> Result<provenance::Provenance, Failure> {
    let beside = provenance::path_of(file);
    if !beside.exists() {
        let message = format!("there is no {}", beside.display());
        return Err(Failure::bad_file(message)
            .remedy("a file can be made again only with its provenance beside it"));
    }
    provenance::read(&beside)
}

fn given(texts: &[String]) -> Result<Given, Failure> {
    let mut given = Given::new();
    for text in texts {
        let (name, file) = text.split_once('=').ok_or_else(|| {
            let message = format!("--input {text} does not name the input");
            Failure::bad_parameter("input", message).remedy("write NAME=FILE")
        })?;
        given.entry(name.into()).or_default().push(file.into());
    }
    Ok(given)
}

/// The saved file as it is now.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum State {
    AsRecorded,
    Changed,
    Gone,
}

impl State {
    fn of(file: &Path, record: &FileRecord, context: &Context) -> Result<State, Failure> {
        if !file.is_file() {
            return Ok(State::Gone);
        }
        let now = FileRecord::of(file, false, &*context.progress())?;
        Ok(if now.blake3 == record.blake3 {
            State::AsRecorded
        } else {
            State::Changed
        })
    }

    fn sentence(self, file: &Path) -> String {
        let name = name(file);
        match self {
            State::AsRecorded => format!("{name} itself is as it was written"),
            State::Changed => format!("{name} itself has changed since it was written"),
            State::Gone => format!("{name} itself is not there"),
        }
    }
}

/// Says everything that is not as it was; the last one is the failure.
fn refuse(all: &[Difference], anyway: bool, file: &Path, state: State) -> Result<(), Failure> {
    let fatal = all.iter().any(|one| one.missing);
    let Some((last, others)) = all.split_last() else {
        return Ok(());
    };
    if anyway && !fatal {
        all.iter().for_each(|one| say(&sentence(&one.failure)));
        return Ok(());
    }
    others.iter().for_each(|one| say(&sentence(&one.failure)));
    let mut failure = last.failure.clone();
    let rest = match (fatal, state) {
        (true, _) => format!("nothing can be computed; {}", state.sentence(file)),
        (false, State::AsRecorded) => "with --anyway it is computed again and the values are \
                                       compared instead of the bytes"
            .to_owned(),
        (false, _) => format!(
            "with --anyway it is computed again and its hash is compared; {}",
            state.sentence(file)
        ),
    };
    let remedy = failure.remedy.take().unwrap_or_default();
    failure.remedy = Some(format!("{remedy}; {rest}"));
    if !others.is_empty() {
        let others = others.iter().map(|one| exit::json(&one.failure));
        failure.rest.insert("others".into(), others.collect());
    }
    Err(failure)
}

fn write(
    context: &Context,
    replay: &Replay,
    object: &Object,
    folder: &Path,
) -> Result<Written, Failure> {
    let record = &replay.provenance;
    let path = folder.join(Path::new(&record.file.name).file_name().unwrap_or_default());
    let none = Map::new();
    let (writer, options) = match &record.writer {
        Some(call) => (Some(call.operation.as_str()), &call.parameters),
        None => (None, &none),
    };
    let engine = &context.engine;
    engine.save(&path, writer, options, object, false, &context.progress())
}

/// What came of it.
enum Found {
    /// Every file has the bytes on record.
    Same,
    /// The bytes differ; the values do by this much, and may by the tolerance.
    Values(Comparison, f64),
    /// The bytes differ, and the values cannot be compared.
    Other(String),
}

impl Found {
    fn good(&self) -> bool {
        match self {
            Found::Same => true,
            Found::Values(by, tolerance) => by.within(*tolerance),
            Found::Other(_) => false,
        }
    }
}

fn judge(
    context: &Context,
    replay: &Replay,
    (file, state): (&Path, State),
    written: &Written,
) -> Result<Found, Failure> {
    let record = &replay.provenance;
    let records = std::iter::once(&record.file).chain(&record.beside);
    let mut other = None;
    for was in records {
        let same_name = |path: &&PathBuf| name(path) == was.name;
        let now = written.files.iter().find(same_name);
        let same = match now {
            Some(path) => FileRecord::of(path, false, &*context.progress())?.blake3 == was.blake3,
            None => false,
        };
        if !same {
            other.get_or_insert(was.name.clone());
        }
    }
    let Some(other) = other else {
        return Ok(Found::Same);
    };
    let Some(now) = written.files.first().filter(|_| state == State::AsRecorded) else {
        return Ok(Found::Other(format!(
            "{other} has other bytes, and {}, so that the values cannot be compared",
            state.sentence(file)
        )));
    };
    Ok(match values(context, file, now) {
        Ok(by) => Found::Values(by, replay.tolerance(&context.engine)),
        Err(failure) => Found::Other(format!("{other} has other bytes: {failure}")),
    })
}

/// Compares what two files hold.
fn values(context: &Context, was: &Path, now: &Path) -> Result<Comparison, Failure> {
    let (was, now) = (
        context.read(was, None, &Map::new())?,
        context.read(now, None, &Map::new())?,
    );
    let (was, now) = (was.object(None)?, now.object(None)?);
    compare(was, now)
}

fn print(context: &Context, file: &Path, replay: &Replay, found: &Found) -> Result<(), Failure> {
    let name = name(file);
    let text = match found {
        Found::Same => format!("{name}: the same bytes"),
        Found::Values(by, _) if by.different == 0 => {
            format!("{name}: other bytes, and the same {} values", by.values)
        }
        Found::Values(by, tolerance) => format!(
            "{name}: {} of {} values differ, at most by {:.1e} of the largest in {} ({} the \
             tolerance of {tolerance:.1e})",
            by.different,
            by.values,
            by.largest,
            by.column,
            if found.good() { "within" } else { "beyond" },
        ),
        Found::Other(why) => format!("{name}: {why}"),
    };
    let elsewhere = replay.elsewhere && !matches!(found, Found::Same);
    if context.json {
        let values = match found {
            Found::Values(by, tolerance) => json!({
                "values": by.values, "different": by.different, "column": by.column,
                "largest": puncta_engine::documents::number::to_value(by.largest),
                "tolerance": tolerance,
            }),
            _ => Value::Null,
        };
        let differences = replay
            .differences
            .iter()
            .map(|one| exit::json(&one.failure));
        return context.output.json(&json!({
            "file": file.display().to_string(),
            "same": matches!(found, Found::Same),
            "good": found.good(),
            "compared": values,
            "differences": differences.collect::<Vec<Value>>(),
            "elsewhere": replay.elsewhere,
        }));
    }
    context.output.text(&format!("{text}\n"))?;
    if elsewhere {
        let was = &replay.provenance.platform;
        let features = was.features.join(", ");
        let system = &was.system;
        context.output.text(&format!(
            "It was computed on another kind of machine: {system} ({features})\n"
        ))?;
    }
    Ok(())
}
