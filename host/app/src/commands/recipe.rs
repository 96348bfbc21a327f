//! `puncta recipe check | show | graph`.

use super::run::{load, refuse};
use crate::cli::Recipe as Arguments;
use crate::context::Context;
use crate::exit::Ended;
use crate::output::plain;
use puncta_engine::documents::Failure;
use puncta_engine::files::{check_target, write_whole};
use puncta_engine::recipe::graph::Graph;
use puncta_engine::recipe::{Checked, CheckedStep};
use serde_json::{Value, json};
use std::path::Path;

pub fn run(context: &Context, arguments: &Arguments) -> Result<Ended, Failure> {
    match arguments {
        Arguments::Check { recipe } => check(context, recipe),
        Arguments::Show { recipe } => show(context, recipe),
        Arguments::Graph {
            recipe,
            output,
            overwrite,
        } => graph(context, recipe, output.as_deref(), *overwrite),
    }
}

fn plan(context: &Context, path: &Path) -> Result<Checked, Failure> {
    let (recipe, _) = load(path)?;
    Ok(context.engine.check_recipe(&recipe))
}

/// Everything that is wrong is said; the exit code is 1 then.
fn check(context: &Context, path: &Path) -> Result<Ended, Failure> {
    let plan = plan(context, path)?;
    refuse(path, &plan.problems)?;
    let (inputs, steps, outputs) = (plan.inputs.len(), plan.steps.len(), plan.outputs.len());
    if context.json {
        let value = json!({"inputs": inputs, "steps": steps, "outputs": outputs});
        context.output.json(&value)?;
    } else {
        let name = plain(&path.display().to_string());
        context.output.text(&format!(
            "{name}: nothing is wrong; inputs: {inputs}, steps: {steps}, outputs: {outputs}\n"
        ))?;
    }
    Ok(Ended::Done)
}

/// What would run, in order, with all parameters.
fn show(context: &Context, path: &Path) -> Result<Ended, Failure> {
    let plan = plan(context, path)?;
    if context.json {
        let inputs = plan.inputs.iter().map(|input| {
            json!({
                "name": &*input.name, "kind": input.kind, "many": input.many,
                "reader": input.reader.as_ref().map(|reader| reader.id.clone()),
                "options": input.options, "object": input.object,
            })
        });
        let steps = plan.steps.iter().map(|step| {
            json!({
                "name": &*step.name, "operation": &*step.op, "inputs": bound(&plan, step),
                "parameters": &*step.parameters,
                "error": step.failure.as_ref().map(crate::exit::json),
            })
        });
        let outputs = plan.outputs.iter().map(|output| {
            json!({
                "file": output.file, "from": output.from, "parameters": output.parameters,
                "writer": output.writer.as_ref().map(|writer| writer.id.clone()),
                "error": output.failure.as_ref().map(crate::exit::json),
            })
        });
        context.output.json(&json!({
            "inputs": inputs.collect::<Vec<Value>>(),
            "steps": steps.collect::<Vec<Value>>(),
            "outputs": outputs.collect::<Vec<Value>>(),
        }))?;
        return Ok(Ended::Done);
    }
    let mut text = String::new();
    for input in &plan.inputs {
        let many = if input.many { "s" } else { "" };
        text.push_str(&format!("input {}: {}{many}\n", input.name, input.kind));
    }
    for step in &plan.steps {
        text.push_str(&said(&plan, step));
    }
    for output in &plan.outputs {
        let writer = output
            .writer
            .as_ref()
            .map(|writer| format!(" by {}", writer.id));
        let writer = writer.unwrap_or_default();
        text.push_str(&format!(
            "output {}: {}{writer}\n",
            output.file, output.from
        ));
    }
    context.output.text(&plain_lines(&text))?;
    Ok(Ended::Done)
}

fn said(plan: &Checked, step: &CheckedStep) -> String {
    let title = step
        .operation
        .as_ref()
        .map(|operation| format!(" ({})", operation.title));
    let mut text = format!(
        "step {}: {}{}\n",
        step.name,
        step.op,
        title.unwrap_or_default()
    );
    if let Some(failure) = &step.failure {
        text.push_str(&format!("    cannot run: {failure}\n"));
    }
    for (port, from) in bound(plan, step) {
        text.push_str(&format!("    {port} <- {}\n", from.join(", ")));
    }
    for (name, value) in step.parameters.iter() {
        text.push_str(&format!("    {name} = {value}\n"));
    }
    text
}

/// What is bound to each port.
fn bound(plan: &Checked, step: &CheckedStep) -> Vec<(String, Vec<String>)> {
    let inputs = step.operation.as_ref().map_or(&[][..], |one| &one.inputs);
    let ports = step.ports.iter().filter_map(|bound| {
        let from = bound
            .sources
            .iter()
            .filter_map(|source| plan.name_of(*source));
        Some((inputs.get(bound.port)?.name.clone(), from.collect()))
    });
    ports.collect()
}

fn graph(
    context: &Context,
    path: &Path,
    output: Option<&Path>,
    overwrite: bool,
) -> Result<Ended, Failure> {
    let graph = Graph::of(&plan(context, path)?);
    match output {
        Some(output) => {
            check_target(output, overwrite)?;
            if output.extension().is_none_or(|suffix| suffix != "svg") {
                let message = format!("cannot write {}: a graph is an SVG", output.display());
                return Err(
                    Failure::bad_parameter("output", message).remedy("let the name end with .svg")
                );
            }
            write_whole(output, graph.svg().as_bytes())?;
        }
        None if context.json => {
            let nodes = graph.nodes.iter().map(|node| {
                json!({
                    "kind": format!("{:?}", node.kind).to_lowercase(), "name": node.name,
                    "what": node.what, "column": node.column, "place": node.place,
                    "problem": node.problem,
                })
            });
            let arrows = graph.arrows.iter().map(|arrow| {
                json!({
                    "from": arrow.from, "output": arrow.output, "to": arrow.to,
                    "port": arrow.port,
                })
            });
            context.output.json(&json!({
                "nodes": nodes.collect::<Vec<Value>>(),
                "arrows": arrows.collect::<Vec<Value>>(),
            }))?;
        }
        None => context.output.text(&plain_lines(&graph.text()))?,
    }
    Ok(Ended::Done)
}

fn plain_lines(text: &str) -> String {
    text.lines()
        .map(|line| format!("{}\n", plain(line)))
        .collect()
}
