//! Pages of text on operations: the list, and one in full.

use crate::cli::NAME;
use crate::output::{number as shown, plain, table, wrap};
use puncta_engine::documents::{
    Example, Kind, Operation, OperationKind, OutputForm, Parameter, ParameterKind, Port, number,
};
use puncta_engine::plugins::Installed;
use serde_json::Value;

/// Characters of a line of running text.
const WIDTH: usize = 100;

/// Name of a kind of operation.
pub fn kind(kind: OperationKind) -> &'static str {
    match kind {
        OperationKind::Operation => "operation",
        OperationKind::Reader => "reader",
        OperationKind::Writer => "writer",
    }
}

/// One line for each operation: id, kind, title, plugin.
pub fn list<'a>(all: impl Iterator<Item = (&'a Installed, &'a Operation)>) -> String {
    let row = |(plugin, operation): (&Installed, &Operation)| {
        let plugin = &plugin.packed.manifest;
        let cells = [
            &operation.id,
            kind(operation.kind),
            &operation.title,
            &plugin.id,
        ];
        cells.map(plain).to_vec()
    };
    table(&all.map(row).collect::<Vec<_>>(), &[], 0)
}

/// Everything that a person needs to use an operation.
///
/// `suffix` gives the suffix of files for a kind of object, for the example.
pub fn full(plugin: &Installed, operation: &Operation, suffix: &dyn Fn(Kind) -> String) -> String {
    let manifest = &plugin.packed.manifest;
    let mut out = format!("{} - {}\n", plain(&operation.id), plain(&operation.title));
    let what = kind(operation.kind);
    out.push_str(&format!(
        "{what} of {} {}\n",
        plain(&manifest.id),
        plain(&manifest.version)
    ));
    if !operation.description.is_empty() {
        out.push('\n');
    }
    for line in operation.description.lines() {
        out.push_str(&wrap(&plain(line), WIDTH));
    }
    section(&mut out, "Files", &files(operation));
    out.push_str(&ports(operation));
    let parameters: Vec<_> = operation.parameters.iter().flat_map(parameter).collect();
    section(&mut out, "Parameters", &parameters);
    out.push_str(&format!("\nExample\n  {}\n", command(operation, suffix)));
    let citations = operation.citations.iter().map(|one| vec![plain(one)]);
    section(&mut out, "Sources", &citations.collect::<Vec<_>>());
    out
}

/// Inputs and outputs.
pub fn ports(operation: &Operation) -> String {
    let mut out = String::new();
    let inputs: Vec<_> = operation.inputs.iter().map(input).collect();
    section(&mut out, "Inputs", &inputs);
    let outputs: Vec<_> = operation.outputs.iter().map(output).collect();
    section(&mut out, "Outputs", &outputs);
    out
}

fn section(out: &mut String, title: &str, rows: &[Vec<String>]) {
    if !rows.is_empty() {
        out.push_str(&format!("\n{title}\n{}", table(rows, &[], 2)));
    }
}

fn files(operation: &Operation) -> Vec<Vec<String>> {
    let Some(rule) = &operation.file else {
        return Vec::new();
    };
    let mut rows = Vec::new();
    if !rule.suffixes.is_empty() {
        rows.push(vec!["suffixes".into(), plain(&rule.suffixes.join(" "))]);
    }
    if !rule.formats.is_empty() {
        rows.push(vec!["formats".into(), plain(&rule.formats.join(", "))]);
    }
    rows
}

fn port(port: &Port, mut facts: Vec<String>) -> Vec<String> {
    if port.many {
        facts.push("several".into());
    }
    if port.optional {
        facts.push("optional".into());
    }
    let facts = if facts.is_empty() {
        String::new()
    } else {
        format!(": {}", facts.join("; "))
    };
    let kind = format!("{}{facts}", port.kind);
    [port.name.as_str(), &kind, &port.description]
        .map(plain)
        .to_vec()
}

fn input(one: &Port) -> Vec<String> {
    let column = |need: &puncta_engine::documents::ColumnNeed| {
        let name = match need.name.strip_prefix('$') {
            Some(parameter) => format!("the column {parameter}"),
            None => need.name.clone(),
        };
        match &need.unit {
            Some(unit) => format!("{name} ({unit})"),
            None => name,
        }
    };
    let columns: Vec<String> = one.columns.iter().map(column).collect();
    let facts = if columns.is_empty() {
        Vec::new()
    } else {
        vec![columns.join(", ")]
    };
    port(one, facts)
}

fn output(one: &Port) -> Vec<String> {
    let of = one.of.as_deref().unwrap_or("the input");
    let facts = match one.form {
        OutputForm::Object => Vec::new(),
        OutputForm::Columns => vec![format!("{of} with columns added")],
        OutputForm::Selection => vec![format!("rows of {of}")],
    };
    port(one, facts)
}

fn parameter(one: &Parameter) -> Vec<Vec<String>> {
    let help = match (&one.help, one.advanced) {
        (help, false) => help.clone(),
        (help, true) => format!("{help} (advanced)"),
    };
    let mut rows = vec![
        [format!("--{}", one.name), facts(one), help]
            .map(|c| plain(&c))
            .to_vec(),
    ];
    for choice in one.choices.iter().filter(|choice| !choice.help.is_empty()) {
        rows.push(vec![
            String::new(),
            plain(&format!("  {}", choice.value)),
            plain(&choice.help),
        ]);
    }
    rows
}

/// Kind, unit, range, choices and default of a parameter.
pub fn facts(one: &Parameter) -> String {
    let mut facts = Vec::new();
    match &one.kind {
        ParameterKind::Choice => {
            let values: Vec<&str> = one
                .choices
                .iter()
                .map(|choice| choice.value.as_str())
                .collect();
            facts.push(values.join("|"));
        }
        ParameterKind::Other(kind) => facts.push(format!("a {kind}, unknown to this version")),
        kind => facts.push(kind_name(kind).into()),
    }
    if let Some(unit) = one.unit.as_deref().filter(|unit| *unit != "1") {
        facts.push(unit.to_owned());
    }
    match (one.min, one.max) {
        (Some(min), Some(max)) => facts.push(format!("{} to {}", shown(min), shown(max))),
        (Some(min), None) => facts.push(format!("from {}", shown(min))),
        (None, Some(max)) => facts.push(format!("to {}", shown(max))),
        (None, None) => {}
    }
    match &one.default {
        Some(Value::Null) | None if one.optional => facts.push("optional".into()),
        None => facts.push("required".into()),
        Some(default) => {
            let text = argument(default);
            let text = if text.is_empty() { "none" } else { &text };
            facts.push(format!("default {text}"));
        }
    }
    facts.join(", ")
}

fn kind_name(kind: &ParameterKind) -> &'static str {
    match kind {
        ParameterKind::Bool => "true|false",
        ParameterKind::Integer => "whole number",
        ParameterKind::Number => "number",
        ParameterKind::Text => "text",
        ParameterKind::Choice => "choice",
        ParameterKind::Column => "column",
        ParameterKind::Columns => "columns",
        ParameterKind::Ranges => "limits by column",
        ParameterKind::Numbers => "numbers",
        ParameterKind::Mapping => "texts by name",
        ParameterKind::Seed => "seed",
        ParameterKind::Other(_) => "unknown",
    }
}

/// A value as it is written on the command line.
fn argument(value: &Value) -> String {
    let text = |value: &Value| match (value, number::from_value(value)) {
        (Value::String(text), None) => text.clone(),
        (_, Some(number)) if number.is_finite() => value.to_string(),
        (Value::String(text), _) => text.clone(),
        (other, _) => other.to_string(),
    };
    let limit = |value: &Value| match number::from_value(value) {
        Some(number) if number.is_infinite() => String::new(),
        _ => text(value),
    };
    match value {
        Value::Array(list) => list.iter().map(text).collect::<Vec<_>>().join(","),
        Value::Object(map) => {
            let term = |(name, value): (&String, &Value)| match value.as_array().map(Vec::as_slice)
            {
                Some([low, high]) => format!("{name}={}..{}", limit(low), limit(high)),
                _ => format!("{name}={}", text(value)),
            };
            map.iter().map(term).collect::<Vec<_>>().join(",")
        }
        other => text(other),
    }
}

/// How a command line with an operation is made up.
pub fn usage(operation: &Operation) -> String {
    let plain = operation.inputs.len() == 1;
    let input = |port: &Port| {
        let name = if plain {
            String::new()
        } else {
            format!("{}=", port.name)
        };
        let more = if port.many { "..." } else { "" };
        match port.optional {
            true => format!(" [{name}FILE]{more}"),
            false => format!(" {name}FILE{more}"),
        }
    };
    let inputs: String = operation.inputs.iter().map(input).collect();
    self::plain(&format!(
        "{NAME} op {}{inputs} [OPTIONS] [-o OUT]...",
        operation.stem()
    ))
}

/// A command line with the operation's example parameters.
pub fn command(operation: &Operation, suffix: &dyn Fn(Kind) -> String) -> String {
    let example = operation.example.clone().unwrap_or_default();
    let own = operation
        .file
        .as_ref()
        .and_then(|rule| rule.suffixes.first());
    let own = own.map_or("", String::as_str);
    let line = match operation.kind {
        OperationKind::Reader => format!("{NAME} info FILE{own}{}", options(&example)),
        OperationKind::Writer => {
            let from = operation
                .inputs
                .first()
                .map(|port| suffix(port.kind))
                .unwrap_or_default();
            format!("{NAME} convert IN{from} OUT{own}{}", options(&example))
        }
        OperationKind::Operation => {
            let mut line = format!("{NAME} op {}", operation.stem());
            let plain = operation.inputs.len() == 1;
            for port in operation.inputs.iter().filter(|port| !port.optional) {
                let name = if plain {
                    String::new()
                } else {
                    format!("{}=", port.name)
                };
                line.push_str(&format!(" {name}{}{}", port.name, suffix(port.kind)));
            }
            line.push_str(&options(&example));
            if let Some(port) = operation.outputs.first() {
                line.push_str(&format!(" -o out{}", suffix(port.kind)));
            }
            line
        }
    };
    plain(&line)
}

fn options(example: &Example) -> String {
    let option = |(name, value): (&String, &Value)| {
        let text = argument(value);
        let safe = |c: char| c.is_alphanumeric() || "_-+.,=/:%@".contains(c);
        match text.chars().all(safe) && !text.is_empty() {
            true => format!(" --{name} {text}"),
            false => format!(" --{name} '{}'", text.replace('\'', r"'\''")),
        }
    };
    example.parameters.iter().map(option).collect()
}

#[cfg(test)]
#[path = "page_tests.rs"]
mod tests;
