//! `puncta batch RECIPE FILE...`.

use super::run::{Steady, bind_others, load, refuse, set};
use crate::cli::Batch as Arguments;
use crate::context::Context;
use crate::exit::{Ended, say};
use crate::output::plain;
use puncta_engine::Progress;
use puncta_engine::batch::{Batch, BatchRecord, Entry, Observer, PAGE, RECORD, State};
use puncta_engine::documents::Failure;
use puncta_engine::recipe::{self, Checked, CheckedInput};
use serde_json::json;
use std::path::PathBuf;
use std::sync::atomic::{AtomicUsize, Ordering};

pub fn run(context: &Context, arguments: &Arguments) -> Result<Ended, Failure> {
    let (recipe, text) = load(&arguments.recipe)?;
    let recipe = set(&context.engine, recipe, &arguments.set)?;
    let plan = context.engine.check_recipe(&recipe);
    refuse(&arguments.recipe, &plan.problems)?;
    let others = bind_others(&plan, &arguments.input)?;
    let each = each(&plan, &others, arguments.each.as_deref())?;
    let files = files(&arguments.files)?;
    let batch = Batch {
        plan: &plan,
        recipe: key(&text, arguments, &others)?,
        each,
        others,
        collect: collect(&plan, &arguments.collect)?,
        out: &arguments.out,
        jobs: usize::from(arguments.jobs),
        resume: arguments.resume,
        overwrite: arguments.overwrite,
        files,
    };
    let observer = Told {
        watch: &context.watch,
        all: batch.files.len(),
        ended: AtomicUsize::new(0),
    };
    let record = batch.run(&context.engine, &context.progress(), &observer)?;
    context.watch.end();
    print(context, arguments, &record)?;
    Ok(ended(&record))
}

/// The input that each file is bound to: the one that is named, or the only one that is left.
fn each<'a>(
    plan: &'a Checked,
    others: &[(&CheckedInput, PathBuf)],
    named: Option<&str>,
) -> Result<&'a CheckedInput, Failure> {
    let bad = |message: String| Failure::bad_parameter("each", message);
    let bound = |input: &CheckedInput| others.iter().any(|(other, _)| other.name == input.name);
    let free: Vec<&CheckedInput> = plan.inputs.iter().filter(|one| !bound(one)).collect();
    let names: Vec<&str> = free.iter().map(|input| &*input.name).collect();
    if let Some(named) = named {
        let found = free.iter().find(|input| &*input.name == named);
        let input = *found.ok_or_else(|| {
            bad(format!("the recipe has no free input {named}"))
                .remedy(format!("its inputs are {}", names.join(", ")))
        })?;
        let missing = names.iter().find(|name| **name != named);
        return missing.map_or(Ok(input), |name| {
            Err(bad(format!("no file is given for the input {name}"))
                .remedy(format!("add --input {name}=FILE")))
        });
    }
    match free.as_slice() {
        [one] => Ok(one),
        [] => Err(bad("every input of the recipe has its file".into())
            .remedy("leave out the --input of the one that the files are for")),
        _ => Err(
            bad(format!("the files could be for {}", names.join(" or ")))
                .remedy("say --each NAME, and --input NAME=FILE for the others"),
        ),
    }
}

/// The files, each once, in order; folders are not looked into.
fn files(paths: &[PathBuf]) -> Result<Vec<PathBuf>, Failure> {
    let mut seen = std::collections::HashSet::new();
    for path in paths {
        if path.is_dir() {
            let message = format!("{} is a folder", path.display());
            return Err(Failure::bad_parameter("files", message)
                .remedy(format!("name its files, such as {}/*.csv", path.display())));
        }
    }
    let once = |path: &&PathBuf| seen.insert(std::path::absolute(path).unwrap_or_default());
    Ok(paths.iter().filter(once).cloned().collect())
}

/// BLAKE3 of all that the results depend on beside the files.
fn key(
    text: &str,
    arguments: &Arguments,
    others: &[(&CheckedInput, PathBuf)],
) -> Result<String, Failure> {
    let mut hasher = blake3::Hasher::new_derive_key("puncta.batch 2026 recipe/1");
    let mut add = |part: &[u8]| {
        hasher.update(&(part.len() as u64).to_le_bytes());
        hasher.update(part);
    };
    add(text.as_bytes());
    arguments.set.iter().for_each(|set| add(set.as_bytes()));
    for (input, path) in others {
        add(input.name.as_bytes());
        let bytes = std::fs::File::open(path).and_then(|file| {
            let mut content = blake3::Hasher::new();
            content.update_reader(file)?;
            Ok(*content.finalize().as_bytes())
        });
        add(&bytes.map_err(|error| Failure::io("read", path, &error))?);
    }
    Ok(hasher.finalize().to_string())
}

/// Which output goes into which table.
fn collect(plan: &Checked, texts: &[String]) -> Result<Vec<(String, String)>, Failure> {
    let names: Vec<&str> = plan.outputs.iter().map(|output| &*output.file).collect();
    let pair = |text: &String| {
        let bad = |message: String| Failure::bad_parameter("collect", message);
        let (file, output) = text.split_once('=').ok_or_else(|| {
            bad(format!("--collect {text} has another form")).remedy("write FILE=OUTPUT")
        })?;
        if !names.contains(&output) {
            return Err(bad(format!("the recipe writes no file {output}"))
                .remedy(format!("it writes {}", names.join(", "))));
        }
        Ok((file.to_owned(), output.to_owned()))
    };
    texts.iter().map(pair).collect()
}

/// A line for each file that ends.
struct Told<'a> {
    watch: &'a crate::watch::Watch,
    all: usize,
    ended: AtomicUsize,
}

impl recipe::Watch for Told<'_> {
    fn message(&self, step: &str, level: u32, text: &str) {
        Steady(self.watch).message(step, level, text);
    }
    fn cancelled(&self) -> bool {
        self.watch.cancelled()
    }
}

impl Observer for Told<'_> {
    fn ended(&self, entry: &Entry, before: bool) {
        let ended = self.ended.fetch_add(1, Ordering::Relaxed) + 1;
        let path = plain(&entry.path);
        let state = match before {
            true => "done before",
            false => entry.state.word(),
        };
        let errors = entry.errors.iter().map(|error| plain(error));
        let errors = errors.collect::<Vec<_>>().join("; ");
        let gap = if errors.is_empty() { "" } else { ": " };
        if !self.watch.quiet() || !errors.is_empty() {
            say(&format!(
                "{ended}/{} {path}: {state}{gap}{errors}",
                self.all
            ));
        }
    }
}

fn print(context: &Context, arguments: &Arguments, record: &BatchRecord) -> Result<(), Failure> {
    let count = |state| record.count(state);
    if context.json {
        let mut value = serde_json::to_value(record).unwrap_or_default();
        value["counts"] = json!({
            "done": count(State::Done), "partly": count(State::Partly),
            "failed": count(State::Failed), "stopped": count(State::Stopped),
            "waiting": count(State::Waiting),
        });
        return context.output.json(&value);
    }
    let mut parts = vec![format!("{} files", record.files.len())];
    for state in [
        State::Done,
        State::Partly,
        State::Failed,
        State::Stopped,
        State::Waiting,
    ] {
        if count(state) > 0 {
            parts.push(format!("{} {}", count(state), state.word()));
        }
    }
    let out = plain(&arguments.out.display().to_string());
    context.output.text(&format!(
        "{}\n{out}/{RECORD} and {out}/{PAGE} tell of each file\n",
        parts.join(", ")
    ))
}

fn ended(record: &BatchRecord) -> Ended {
    let count = |state| record.count(state);
    let done = count(State::Done);
    if count(State::Stopped) + count(State::Waiting) + count(State::Running) > 0 {
        Ended::Stopped
    } else if done == record.files.len() {
        Ended::Done
    } else if done + count(State::Partly) > 0 {
        Ended::Partly
    } else {
        Ended::Failed
    }
}
