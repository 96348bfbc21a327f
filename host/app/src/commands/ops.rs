//! `puncta ops [NAME]`.

use super::operation;
use crate::cli::Ops;
use crate::context::Context;
use crate::exit::Ended;
use crate::{grammar, page};
use puncta_engine::documents::{Failure, Operation};
use puncta_engine::plugins::Installed;
use serde_json::{Value, json};

pub fn run(context: &Context, ops: &Ops) -> Result<Ended, Failure> {
    let catalogue = context.engine.catalogue();
    let Some(name) = &ops.name else {
        if context.json {
            let all: Vec<Value> = catalogue.operations().map(|(p, o)| entry(p, o)).collect();
            context.output.json(&json!({ "operations": all }))?;
        } else {
            let all = catalogue
                .operations()
                .map(|(plugin, operation)| (&**plugin, operation));
            context.output.text(&page::list(all))?;
        }
        return Ok(Ended::Done);
    };
    let found = operation(&context.engine, name)?;
    let (plugin, found) = context.engine.operation(&found.id)?;
    if context.json {
        context
            .output
            .json(&json!({ "operation": found, "plugin": plugin_of(plugin) }))?;
    } else {
        let suffix = |kind| grammar::suffix(catalogue, kind);
        context.output.text(&page::full(plugin, found, &suffix))?;
    }
    Ok(Ended::Done)
}

fn entry(plugin: &Installed, operation: &Operation) -> Value {
    json!({
        "id": operation.id,
        "kind": operation.kind,
        "title": operation.title,
        "plugin": plugin.packed.manifest.id,
    })
}

fn plugin_of(plugin: &Installed) -> Value {
    let manifest = &plugin.packed.manifest;
    json!({ "id": manifest.id, "version": manifest.version })
}
