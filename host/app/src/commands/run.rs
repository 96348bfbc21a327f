//! `puncta run RECIPE`.

mod watch;

use crate::cli::Run;
use crate::context::Context;
use crate::exit::{self, Ended, say, sentence};
use crate::flags;
use crate::output::{plain, table};
use crate::saved;
use puncta_engine::documents::{Failure, FailureCode};
use puncta_engine::engine::Steps;
use puncta_engine::headless::{Done, Saved, Sources, Task, single};
use puncta_engine::recipe::{
    self, Checked, CheckedInput, Problem, Recipe, RunReport, Session, StepReport, StepState,
};
use puncta_engine::{Engine, Object, Progress};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};

pub fn run(context: &Context, run: &Run) -> Result<Ended, Failure> {
    if run.watch {
        return watch::watch(context, run);
    }
    once(
        context,
        run,
        (&single(&context.engine), &mut Sources::default()),
    )
}

/// Runs the recipe as it is now.
fn once(
    context: &Context,
    run: &Run,
    session: (&Session<Steps>, &mut Sources),
) -> Result<Ended, Failure> {
    let (recipe, _) = load(&run.recipe)?;
    let engine = &session.0.runner().0;
    let recipe = set(engine, recipe, &run.set)?;
    let plan = engine.check_recipe(&recipe);
    refuse(&run.recipe, &plan.problems)?;
    let files = bind(&plan, &run.input)?;
    let task = Task {
        plan: &plan,
        files,
        out: &run.out,
        overwrite: run.overwrite,
    };
    let first = task.files.first().and_then(|(_, path)| path.file_stem());
    let targets = task.targets(&first.unwrap_or_default().to_string_lossy())?;
    let progress = context.progress();
    let done = task.run(session, &targets, &progress, &Steady(&context.watch))?;
    context.watch.end();
    print(context, &plan, &done)?;
    Ok(ended(&done.report, &done.written))
}

/// A file of the recipe: written, or why not.
type Outcome = (String, Result<Saved, Failure>);

/// The recipe in a file, and its text.
pub(super) fn load(path: &Path) -> Result<(Recipe, String), Failure> {
    use std::io::Read;
    let failed = |error: std::io::Error| Failure::io("read", path, &error);
    let file = std::fs::File::open(path).map_err(failed)?;
    let most = recipe::MAX_TEXT as u64;
    let mut bytes = Vec::new();
    file.take(most + 1)
        .read_to_end(&mut bytes)
        .map_err(failed)?;
    if bytes.len() as u64 > most {
        let (path, most) = (path.display(), most >> 20);
        let message = format!("{path} is no recipe, since it is larger than {most} MB");
        return Err(Failure::bad_file(message).remedy("name the recipe's file"));
    }
    let text = String::from_utf8(bytes).map_err(|error| {
        let before = error
            .as_bytes()
            .iter()
            .take(error.utf8_error().valid_up_to());
        let line = before.filter(|byte| **byte == b'\n').count() + 1;
        Failure::bad_file(format!(
            "{}, line {line}: this is no UTF-8 text",
            path.display()
        ))
        .remedy("save the recipe as UTF-8")
    })?;
    match recipe::parse(&text) {
        Ok(recipe) => Ok((recipe, text)),
        Err(problems) => {
            refuse(path, &problems)?;
            Err(Failure::internal(
                "a recipe without problems that is refused",
            ))
        }
    }
}

/// All problems are said; the last one is the failure.
pub(super) fn refuse(path: &Path, problems: &[Problem]) -> Result<(), Failure> {
    let placed = |problem: &Problem| {
        let place = problem.place;
        let place = format!(
            "{}, line {}, column {}",
            path.display(),
            place.line,
            place.column
        );
        let mut failure = problem.failure.clone().context(place);
        // The command line was right.
        if failure.code == FailureCode::BadParameter {
            failure.code = FailureCode::BadFile;
        }
        failure
    };
    let mut all: Vec<Failure> = problems.iter().map(placed).collect();
    let Some(mut last) = all.pop() else {
        return Ok(());
    };
    if !all.is_empty() {
        all.iter().for_each(|one| say(&sentence(one)));
        let others = all.iter().map(exit::json);
        last.rest.insert("others".into(), others.collect());
    }
    Err(last)
}

/// The recipe with parameters of the command line.
pub(super) fn set(
    engine: &Engine,
    mut recipe: Recipe,
    texts: &[String],
) -> Result<Recipe, Failure> {
    for text in texts {
        let bad = |message: String| Failure::bad_parameter("set", message);
        let form =
            || bad(format!("--set {text} has another form")).remedy("write STEP.PARAM=VALUE");
        let (target, value) = text.split_once('=').ok_or_else(form)?;
        let (name, parameter) = target.split_once('.').ok_or_else(form)?;
        let names: Vec<String> = recipe.steps.iter().map(|step| step.name.clone()).collect();
        let step = recipe
            .steps
            .iter_mut()
            .find(|step| step.name == name)
            .ok_or_else(|| {
                bad(format!("the recipe has no step {name}"))
                    .remedy(format!("its steps are {}", names.join(", ")))
            })?;
        let mut value: Value = value.into();
        if let Ok((_, operation)) = engine.operation(&step.op) {
            let known = operation
                .parameters
                .iter()
                .find(|known| known.name == parameter);
            let Some(known) = known else {
                let names = operation.parameters.iter().map(|known| known.name.as_str());
                let names = names.collect::<Vec<_>>().join(", ");
                let message = format!("the step {name} has no parameter {parameter}");
                return Err(bad(message).remedy(format!("it has {names}")));
            };
            value = flags::value(known, value.as_str().unwrap_or_default());
            known.canonical(&value)?;
        }
        step.set.insert(parameter.to_owned(), value);
    }
    Ok(recipe)
}

/// Files of a recipe's inputs.
pub(super) type Bound<'a> = Vec<(&'a CheckedInput, PathBuf)>;

fn bad_input(message: String) -> Failure {
    Failure::bad_parameter("input", message)
}

/// Which files belong to which input; every input has one.
fn bind<'a>(plan: &'a Checked, texts: &[String]) -> Result<Bound<'a>, Failure> {
    let bound = bind_others(plan, texts)?;
    for input in &plan.inputs {
        if bound.iter().all(|(other, _)| other.name != input.name) {
            let message = format!("no file is given for the input {}", input.name);
            return Err(bad_input(message).remedy(format!("add --input {}=FILE", input.name)));
        }
    }
    Ok(bound)
}

/// Which files belong to which input, as far as they are given.
pub(super) fn bind_others<'a>(plan: &'a Checked, texts: &[String]) -> Result<Bound<'a>, Failure> {
    let names: Vec<&str> = plan.inputs.iter().map(|input| &*input.name).collect();
    let known = || match names.as_slice() {
        [] => "the recipe has no inputs".to_owned(),
        names => format!("its inputs are {}", names.join(", ")),
    };
    let mut bound: Vec<(&CheckedInput, PathBuf)> = Vec::new();
    for text in texts {
        let (name, file) = text.split_once('=').ok_or_else(|| {
            bad_input(format!("--input {text} does not name the input"))
                .remedy(format!("write NAME=FILE; {}", known()))
        })?;
        let input = plan.inputs.iter().find(|input| &*input.name == name);
        let input = input
            .ok_or_else(|| bad_input(format!("the recipe has no input {name}")).remedy(known()))?;
        if !input.many && bound.iter().any(|(other, _)| other.name == input.name) {
            let message = format!("the input {name} takes one file");
            let remedy = format!("say many = true in [inputs.{name}]");
            return Err(bad_input(message).remedy(remedy));
        }
        bound.push((input, file.into()));
    }
    // In the order of the recipe, whatever the order of the arguments.
    bound.sort_by_key(|(input, _)| names.iter().position(|name| *name == &*input.name));
    Ok(bound)
}

/// Steps on the one line that there is for progress.
pub(super) struct Steady<'a>(pub &'a crate::watch::Watch);

impl recipe::Watch for Steady<'_> {
    fn started(&self, step: &str) {
        self.0.begin(step);
    }
    fn progress(&self, _step: &str, fraction: f64, phase: &str) {
        self.0.progress(fraction, phase);
    }
    fn message(&self, step: &str, level: u32, text: &str) {
        self.0.message(level, &format!("{step}: {text}"));
    }
    fn cancelled(&self) -> bool {
        self.0.cancelled()
    }
}

fn state(step: &StepReport) -> &'static str {
    match &step.state {
        StepState::Computed => "done",
        StepState::Cached => "kept",
        StepState::Failed(_) => "failed",
        StepState::Skipped { .. } => "skipped",
        StepState::Cancelled => "stopped",
    }
}

fn print(context: &Context, plan: &Checked, done: &Done) -> Result<(), Failure> {
    let (report, written) = (&done.report, &done.written);
    for step in &report.steps {
        if let StepState::Failed(failure) = &step.state {
            say(&format!("step {}: {}", step.name, sentence(failure)));
        }
    }
    for failure in written.iter().filter_map(|(_, saved)| saved.as_ref().err()) {
        say(&sentence(failure));
    }
    let done = written.iter().filter_map(|(_, saved)| saved.as_ref().ok());
    if context.json {
        let failed = written.iter().filter_map(|(file, saved)| {
            saved
                .as_ref()
                .err()
                .map(|error| json!({ "file": file, "error": exit::json(error) }))
        });
        let steps = report.steps.iter().map(|step| entry(plan, step));
        return context.output.json(&json!({
            "steps": steps.collect::<Vec<Value>>(),
            "written": done.map(saved::json).collect::<Vec<Value>>(),
            "failed": failed.collect::<Vec<Value>>(),
            "cancelled": report.cancelled,
        }));
    }
    let rows: Vec<Vec<String>> = report.steps.iter().map(row).collect();
    context
        .output
        .text(&table(&rows, &[false, false, true], 0))?;
    done.map(saved::text)
        .try_for_each(|text| context.output.text(&text))
}

fn row(step: &StepReport) -> Vec<String> {
    let seconds = step.duration.as_secs_f64();
    let time = match step.state {
        StepState::Computed | StepState::Failed(_) => format!("{seconds:.3} s"),
        _ => String::new(),
    };
    let why = match &step.state {
        StepState::Skipped { because } => format!("needs {because}"),
        _ => String::new(),
    };
    vec![plain(&step.name), state(step).into(), time, plain(&why)]
}

fn entry(plan: &Checked, step: &StepReport) -> Value {
    let mut out = json!({
        "name": &*step.name,
        "operation": plan.step(&step.name).map(|(_, step)| step.op.to_string()),
        "state": state(step),
        "seconds": step.duration.as_secs_f64(),
        "parameters": step.record.as_ref().map(|record| &*record.parameters),
    });
    match &step.state {
        StepState::Failed(failure) => {
            out["error"] = exit::json(failure);
        }
        StepState::Skipped { because } => out["because"] = (&**because).into(),
        _ => {}
    }
    out
}

fn ended(report: &RunReport<Object>, written: &[Outcome]) -> Ended {
    let good = |step: &StepReport| matches!(step.state, StepState::Computed | StepState::Cached);
    let stopped = |(_, saved): &Outcome| saved.as_ref().is_err_and(Failure::is_cancelled);
    if report.cancelled || written.iter().any(stopped) {
        return Ended::Stopped;
    }
    let saved = written.iter().filter(|(_, saved)| saved.is_ok()).count();
    let all = saved == written.len() && report.steps.iter().all(good);
    match (
        all,
        saved > 0 || (written.is_empty() && report.steps.iter().any(good)),
    ) {
        (true, _) => Ended::Done,
        (false, true) => Ended::Partly,
        (false, false) => Ended::Failed,
    }
}

#[cfg(test)]
#[path = "run_tests.rs"]
mod tests;
