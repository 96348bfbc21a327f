//! `puncta plugins check`, and the process of one check.

use crate::cli;
use crate::context::Context;
use crate::exit::Ended;
use crate::output::{plain, table};
use puncta_check::{Check, Order, Orders, Status};
use puncta_engine::documents::{Failure, FailureCode};
use puncta_engine::engine::Options;
use serde_json::json;
use std::path::{Path, PathBuf};

/// Does one check in this process.
pub fn one(order: &cli::CheckOne, options: Options) -> Result<Ended, Failure> {
    puncta_check::child(Orders {
        check: named(&order.check)?,
        library: order.library.clone(),
        folder: order.folder.clone(),
        strictness: order.strictness,
        answer: order.answer.clone(),
        options,
    })?;
    Ok(Ended::Done)
}

fn named(id: &str) -> Result<Check, Failure> {
    Check::of(id).ok_or_else(|| {
        Failure::bad_parameter("only", format!("there is no check {id}"))
            .remedy("puncta plugins check --list shows those that there are")
    })
}

pub fn run(context: &Context, order: &cli::Check) -> Result<Ended, Failure> {
    if order.list {
        return list(context);
    }
    let path = order.path.clone().unwrap_or_default();
    let checked = Order {
        library: library(&path)?,
        strictness: order.strictness,
        only: order
            .only
            .iter()
            .map(|id| named(id))
            .collect::<Result<_, _>>()?,
        options: context.engine.options().clone(),
    };
    context.watch.begin(&format!("checking {}", path.display()));
    let report = puncta_check::check(&checked, &*context.watch);
    context.watch.end();
    let report = report?;
    let ended = if report.passed() {
        Ended::Done
    } else {
        Ended::Failed
    };
    if context.json {
        let mut value = serde_json::to_value(&report).unwrap_or_default();
        value["passed"] = report.passed().into();
        context.output.json(&value)?;
        return Ok(ended);
    }
    context.output.text(&shown(&report))?;
    Ok(ended)
}

/// A library, or the only one in a folder.
fn library(path: &Path) -> Result<PathBuf, Failure> {
    if !path.is_dir() {
        return Ok(path.to_path_buf());
    }
    let entries = std::fs::read_dir(path).map_err(|error| Failure::io("read", path, &error))?;
    let files = entries.flatten().map(|entry| entry.path());
    let found: Vec<PathBuf> = files
        .filter(|file| {
            let name = file.file_name().unwrap_or_default().to_string_lossy();
            name.ends_with(std::env::consts::DLL_SUFFIX)
        })
        .collect();
    match found.as_slice() {
        [one] => Ok(one.clone()),
        several => {
            let message = format!("{} holds {} libraries", path.display(), several.len());
            Err(Failure::new(FailureCode::BadParameter, message).remedy("name the library"))
        }
    }
}

fn word(status: Status) -> &'static str {
    match status {
        Status::Passed => "passed",
        Status::Failed => "FAILED",
        Status::Crashed => "CRASHED",
        Status::Warning => "warning",
        Status::Skipped => "skipped",
    }
}

fn shown(report: &puncta_check::Report) -> String {
    let mut rows = Vec::new();
    let mut text = String::new();
    for outcome in &report.checks {
        rows.push(vec![
            word(outcome.status).into(),
            outcome.check.clone(),
            format!("{:.2} s", outcome.seconds),
            plain(&outcome.sentence),
        ]);
    }
    text.push_str(&table(&rows, &[false, false, true], 0));
    let failed = report.checks.iter().filter(|outcome| {
        matches!(
            outcome.status,
            Status::Failed | Status::Crashed | Status::Warning
        )
    });
    for outcome in failed {
        let asked = Check::of(&outcome.check).map_or("", Check::sentence);
        text.push_str(&format!("\n{}: {asked}\n", outcome.check));
        text.push_str(&format!("  {}\n", plain(&outcome.sentence)));
    }
    let count = |status| report.count(status);
    text.push_str(&format!(
        "\n{} passed, {} failed, {} crashed, {} warnings, {} skipped at strictness {}, in {:.1} s\n",
        count(Status::Passed),
        count(Status::Failed),
        count(Status::Crashed),
        count(Status::Warning),
        count(Status::Skipped),
        report.strictness,
        report.seconds
    ));
    text
}

fn list(context: &Context) -> Result<Ended, Failure> {
    if context.json {
        let all = Check::ALL.iter().map(|check| {
            json!({
                "check": check.id(),
                "strictness": check.level(),
                "sentence": check.sentence(),
                "needs": check.needs().iter().map(|need| need.id()).collect::<Vec<_>>(),
            })
        });
        let all: Vec<_> = all.collect();
        context.output.json(&json!({ "checks": all }))?;
        return Ok(Ended::Done);
    }
    let rows = Check::ALL.iter().map(|check| {
        vec![
            check.level().to_string(),
            check.id().into(),
            check.sentence().into(),
        ]
    });
    let rows: Vec<Vec<String>> = rows.collect();
    context.output.text(&table(&rows, &[true], 0))?;
    Ok(Ended::Done)
}
