//! `puncta plugins list | trust | enable | disable | mode | pack | check | new | update-sdk`.

use crate::cli::{Plugins, Where};
use crate::context::Context;
use crate::exit::Ended;
use crate::output::{count, plain, table};
use puncta_engine::documents::Failure;
use puncta_engine::plugins::crashes::Crash;
use puncta_engine::plugins::library_file::{Facts, short};
use puncta_engine::plugins::{Held, Installed, Why, catalogue};
use puncta_engine::settings::{Choice, Mode};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};

pub fn run(context: &Context, plugins: &Plugins) -> Result<Ended, Failure> {
    match plugins {
        Plugins::List => list(context),
        Plugins::Trust { what } => trust(context, what),
        Plugins::Enable { id } => chosen(context, id, context.engine.enable(id, true)?),
        Plugins::Disable { id } => chosen(context, id, context.engine.enable(id, false)?),
        Plugins::Mode { id, mode } => {
            let mode = match mode {
                Where::Worker => Mode::Worker,
                Where::InProcess => Mode::InProcess,
                Where::Default => Mode::Default,
            };
            chosen(context, id, context.engine.set_mode(id, mode)?)
        }
        Plugins::Pack { libraries } => pack(context, libraries),
        Plugins::Check(order) => super::check::run(context, order),
        Plugins::New(order) => super::project::new(context, order),
        Plugins::UpdateSdk { project } => super::project::update(context, project),
    }
}

fn list(context: &Context) -> Result<Ended, Failure> {
    let found = context.engine.catalogue();
    let disabled = found.held().iter().filter_map(|held| match &held.why {
        Why::Disabled(plugin) => Some(&**plugin),
        _ => None,
    });
    let used = found.plugins().iter().map(|plugin| (&**plugin, true));
    let mut plugins: Vec<(&Installed, bool)> =
        used.chain(disabled.map(|plugin| (plugin, false))).collect();
    plugins.sort_by_key(|(plugin, _)| &plugin.packed.manifest.id);
    let waiting: Vec<&Held> = found.held().iter().filter(|held| held.waits()).collect();
    if context.json {
        let refused = found.refused().iter();
        let refused = refused.map(|one| json!({ "path": one.path, "why": one.why }));
        let plugins = plugins.iter().map(|(one, used)| entry(context, one, *used));
        context.output.json(&json!({
            "plugins": plugins.collect::<Vec<_>>(),
            "waiting": waiting.into_iter().map(waits).collect::<Vec<_>>(),
            "refused": refused.collect::<Vec<_>>(),
            "crashes": context.engine.crashes().map(crash).collect::<Vec<_>>(),
        }))?;
        return Ok(Ended::Done);
    }
    let rows: Vec<Vec<String>> = plugins
        .iter()
        .map(|(one, used)| row(context, one, *used))
        .collect();
    let mut text = table(&rows, &[], 0);
    for crash in context.engine.crashes() {
        text.push_str(&format!("note     {}\n", plain(&crash.sentence())));
    }
    for held in waiting {
        text.push_str(&format!(
            "waiting  {}\n",
            plain(&held.failure().to_string())
        ));
        if let Some(facts) = &held.facts {
            text.push_str(&format!(
                "         {}\n",
                plain(&described(&held.library, facts))
            ));
        }
    }
    for one in found.refused() {
        let path = one.path.display().to_string();
        text.push_str(&format!("refused  {}: {}\n", plain(&path), plain(&one.why)));
    }
    context.output.text(&text)?;
    Ok(Ended::Done)
}

fn operations(count: usize) -> String {
    match count {
        1 => "1 operation".to_owned(),
        count => format!("{count} operations"),
    }
}

/// Where calls of a plugin run.
fn place(context: &Context, plugin: &Installed, used: bool) -> &'static str {
    match (used, context.engine.in_process(plugin)) {
        (false, _) => "disabled",
        (true, true) => "in process",
        (true, false) => "worker",
    }
}

/// What the person chose for a plugin.
fn mode(mode: Mode) -> &'static str {
    match mode {
        Mode::Default => "default",
        Mode::Worker => "worker",
        Mode::InProcess => "in-process",
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

/// Who vouches for a plugin.
fn trusted(plugin: &Installed) -> String {
    match &plugin.trusted {
        Some(date) => format!("trusted {}", puncta_engine::date::day(date)),
        None => "bundle".into(),
    }
}

fn row(context: &Context, plugin: &Installed, used: bool) -> Vec<String> {
    let manifest = &plugin.packed.manifest;
    let chosen = match context.engine.settings().choice(&manifest.id).mode {
        Mode::Default if context.engine.demoted(plugin) => " (since it crashed)",
        Mode::Default => "",
        _ => " (chosen)",
    };
    vec![
        plain(&manifest.id),
        plain(&manifest.version),
        operations(manifest.operations.len()),
        format!("{}{chosen}", place(context, plugin, used)),
        trusted(plugin),
        door(plugin).into(),
        plain(&plugin.library.display().to_string()),
    ]
}

fn entry(context: &Context, plugin: &Installed, used: bool) -> Value {
    let manifest = &plugin.packed.manifest;
    let by = match &plugin.trusted {
        Some(date) => json!({ "by": "person", "date": date }),
        None => json!({ "by": "bundle" }),
    };
    json!({
        "id": manifest.id,
        "version": manifest.version,
        "title": manifest.title,
        "operations": manifest.operations.iter().map(|one| &one.id).collect::<Vec<_>>(),
        "library": plugin.library,
        "hash": plugin.packed.hash,
        "bundled": plugin.bundled,
        "trusted": by,
        "enabled": used,
        "isolation": manifest.isolation,
        "mode": mode(context.engine.settings().choice(&manifest.id).mode),
        "runs": place(context, plugin, used),
        "door": door(plugin),
    })
}

fn waits(held: &Held) -> Value {
    let facts = held.facts.as_ref();
    json!({
        "id": held.id(),
        "library": held.library,
        "hash": facts.map(|facts| &facts.hash),
        "bytes": facts.map(|facts| facts.size),
        "modified": facts.and_then(|facts| facts.modified.as_ref()),
        "folder": held.library.parent(),
        "origin": facts.and_then(|facts| facts.origin.as_ref()),
        "why": held.failure().to_string(),
    })
}

fn crash(crash: &Crash) -> Value {
    json!({
        "id": crash.plugin,
        "operation": crash.operation,
        "date": crash.date,
        "sessions": crash.count,
        "why": crash.sentence(),
    })
}

/// What is known of a library without running it.
fn described(library: &Path, facts: &Facts) -> String {
    let folder = library.parent().unwrap_or(library).display();
    let modified = facts.modified.as_deref().unwrap_or("at an unknown time");
    let origin = match &facts.origin {
        Some(origin) => format!("downloaded from {origin}"),
        None => format!("in {folder}"),
    };
    let size = count(facts.size);
    format!(
        "hash {}, {size} bytes, changed {modified}, {origin}",
        facts.short()
    )
}

fn trust(context: &Context, what: &str) -> Result<Ended, Failure> {
    context.watch.begin(&format!("describing {what}"));
    let trusted = context.engine.trust(what);
    context.watch.end();
    let trusted = trusted?;
    let manifest = &trusted.packed.manifest;
    if context.json {
        context.output.json(&json!({ "trusted": {
            "id": manifest.id,
            "version": manifest.version,
            "library": trusted.library,
            "hash": trusted.facts.hash,
            "bytes": trusted.facts.size,
            "origin": trusted.facts.origin,
            "operations": manifest.operations.iter().map(|one| &one.id).collect::<Vec<_>>(),
            "bundled": trusted.bundled,
            "installed": trusted.installed,
        }}))?;
        return Ok(Ended::Done);
    }
    let by = if trusted.bundled {
        "the bundle lists it"
    } else {
        "trusted"
    };
    let text = format!(
        "{} {}: {}, {by}, hash {}",
        manifest.id,
        manifest.version,
        operations(manifest.operations.len()),
        short(&trusted.facts.hash)
    );
    context.output.text(&format!("{}\n", plain(&text)))?;
    if !trusted.installed {
        let library = trusted.library.display();
        let note = format!("no plugins are looked for in the folder of {library}; add --plugins");
        context.watch.note(&note);
    }
    Ok(Ended::Done)
}

fn chosen(context: &Context, id: &str, choice: Choice) -> Result<Ended, Failure> {
    if context.json {
        let enabled = choice.enabled;
        let choice = json!({ "id": id, "enabled": enabled, "mode": mode(choice.mode) });
        context.output.json(&json!({ "plugin": choice }))?;
        return Ok(Ended::Done);
    }
    let state = if choice.enabled {
        "enabled"
    } else {
        "disabled"
    };
    let text = format!("{}: {state}, mode {}\n", plain(id), mode(choice.mode));
    context.output.text(&text)?;
    Ok(Ended::Done)
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
