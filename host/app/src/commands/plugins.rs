//! `puncta plugins list | pack`.

use crate::cli::Plugins;
use crate::context::Context;
use crate::exit::Ended;
use crate::output::{plain, table};
use puncta_engine::documents::Failure;
use puncta_engine::plugins::{Installed, catalogue};
use serde_json::{Value, json};
use std::path::PathBuf;

pub fn run(context: &Context, plugins: &Plugins) -> Result<Ended, Failure> {
    match plugins {
        Plugins::List => list(context),
        Plugins::Pack { libraries } => pack(context, libraries),
    }
}

fn list(context: &Context) -> Result<Ended, Failure> {
    let found = context.engine.catalogue();
    if context.json {
        let all: Vec<Value> = found
            .plugins()
            .iter()
            .map(|one| entry(context, one))
            .collect();
        let refused = found.refused().iter();
        let refused: Vec<Value> = refused
            .map(|one| json!({ "path": one.path, "why": one.why }))
            .collect();
        context
            .output
            .json(&json!({ "plugins": all, "refused": refused }))?;
        return Ok(Ended::Done);
    }
    let rows: Vec<Vec<String>> = found
        .plugins()
        .iter()
        .map(|one| row(context, one))
        .collect();
    context.output.text(&table(&rows, &[], 0))?;
    for one in found.refused() {
        let path = one.path.display().to_string();
        context
            .output
            .text(&format!("refused  {}: {}\n", plain(&path), plain(&one.why)))?;
    }
    Ok(Ended::Done)
}

fn operations(count: usize) -> String {
    match count {
        1 => "1 operation".to_owned(),
        count => format!("{count} operations"),
    }
}

/// Where calls of a plugin run.
fn place(context: &Context, plugin: &Installed) -> &'static str {
    if context.engine.in_process(plugin) {
        "in process"
    } else {
        "worker"
    }
}

/// Whether the tables of both builds are compared when the plugin is opened.
fn door(plugin: &Installed) -> &'static str {
    if plugin.packed.door {
        "checked"
    } else {
        "unchecked"
    }
}

fn row(context: &Context, plugin: &Installed) -> Vec<String> {
    let manifest = &plugin.packed.manifest;
    vec![
        plain(&manifest.id),
        plain(&manifest.version),
        operations(manifest.operations.len()),
        place(context, plugin).into(),
        door(plugin).into(),
        plain(&plugin.library.display().to_string()),
    ]
}

fn entry(context: &Context, plugin: &Installed) -> Value {
    let manifest = &plugin.packed.manifest;
    json!({
        "id": manifest.id,
        "version": manifest.version,
        "title": manifest.title,
        "operations": manifest.operations.iter().map(|one| &one.id).collect::<Vec<_>>(),
        "library": plugin.library,
        "hash": plugin.packed.hash,
        "bundled": plugin.bundled,
        "isolation": manifest.isolation,
        "runs": place(context, plugin),
        "door": door(plugin),
    })
}

fn pack(context: &Context, libraries: &[PathBuf]) -> Result<Ended, Failure> {
    let mut packed = Vec::new();
    for library in libraries {
        context
            .watch
            .begin(&format!("describing {}", library.display()));
        let (path, one) = catalogue::pack(library, context.engine.workers())?;
        context.watch.end();
        let manifest = &one.manifest;
        let count = manifest.operations.len();
        if !context.json {
            let path = path.display();
            let count = operations(count);
            let text = format!("{} {}: {count}, {path}", manifest.id, manifest.version);
            context.output.text(&format!("{}\n", plain(&text)))?;
        }
        packed.push(json!({
            "id": manifest.id,
            "version": manifest.version,
            "operations": count,
            "file": path,
            "hash": one.hash,
        }));
    }
    if context.json {
        context.output.json(&json!({ "packed": packed }))?;
    }
    Ok(Ended::Done)
}
