//! Checks of what a plugin says of itself.

use crate::check::Check;
use crate::child::{Found, Ground, Verdict};
use puncta_engine::documents::manifest::Step;
use puncta_engine::documents::{
    Manifest, Operation, OperationKind, OutputForm, Parameter, ParameterKind, Unit, schema,
};
use std::collections::HashSet;

pub fn find(check: Check, ground: &Ground) -> Option<Found> {
    let asked: fn(&Manifest) -> Result<(), String> = match check {
        Check::Needs => needs,
        Check::PluginId => plugin_id,
        Check::Version => version,
        Check::Isolation => isolation,
        Check::Sorted => sorted,
        Check::Titles => titles,
        Check::OperationIds => |manifest| each(manifest, |one| operation_id(manifest, one)),
        Check::Help => |manifest| each_parameter(manifest, help),
        Check::PortNames => |manifest| each(manifest, port_names),
        Check::PortsOfKind => |manifest| each(manifest, ports_of_kind),
        Check::Units => |manifest| each(manifest, units),
        Check::ParameterNames => |manifest| each(manifest, parameter_names),
        Check::Limits => |manifest| each_parameter(manifest, limits),
        Check::Defaults => |manifest| each_parameter(manifest, default),
        Check::ColumnNeeds => |manifest| each(manifest, column_needs),
        Check::FileRules => |manifest| each(manifest, file_rule),
        Check::Examples => |manifest| each(manifest, example),
        _ => return None,
    };
    Some(
        ground
            .manifest()
            .and_then(|manifest| asked(&manifest))
            .map(|()| Verdict::Passed),
    )
}

fn each(
    manifest: &Manifest,
    mut one: impl FnMut(&Operation) -> Result<(), String>,
) -> Result<(), String> {
    manifest
        .operations
        .iter()
        .try_for_each(|operation| one(operation).map_err(|why| format!("{}: {why}", operation.id)))
}

fn each_parameter(
    manifest: &Manifest,
    one: fn(&Parameter) -> Result<(), String>,
) -> Result<(), String> {
    each(manifest, |operation| {
        operation.parameters.iter().try_for_each(|parameter| {
            one(parameter).map_err(|why| format!("parameter {}: {why}", parameter.name))
        })
    })
}

/// Tables that this host gives.
const GIVEN: [&str; 2] = [puncta_abi::DATA_1, puncta_abi::JOB_1];

fn needs(manifest: &Manifest) -> Result<(), String> {
    let unknown = manifest
        .needs
        .iter()
        .find(|need| !GIVEN.contains(&need.as_str()));
    match unknown {
        Some(need) => Err(format!("it needs {need}, which this host does not have")),
        None => Ok(()),
    }
}

/// Whether a text is words of these letters, with `separator` between them.
fn words(text: &str, separator: char, more: &str) -> bool {
    text.split(separator).all(|word| {
        word.starts_with(|first: char| first.is_ascii_lowercase())
            && word
                .chars()
                .all(|c| c.is_ascii_lowercase() || c.is_ascii_digit() || more.contains(c))
    })
}

fn plugin_id(manifest: &Manifest) -> Result<(), String> {
    let id = &manifest.id;
    if words(id, '.', "-_") && id.contains('.') && id.len() <= 100 {
        return Ok(());
    }
    Err(format!(
        "{id:?} is not lower-case words with dots between them, such as lab.nearest"
    ))
}

fn operation_id(manifest: &Manifest, operation: &Operation) -> Result<(), String> {
    let Some((stem, revision)) = operation.id.split_once('/') else {
        return Err("it has no revision, such as /1".into());
    };
    if !words(stem, '.', "-_") {
        return Err("it is not lower-case words with dots between them".into());
    }
    if revision.parse::<u32>().map_or(true, |number| number == 0) || revision.starts_with('0') {
        return Err(format!("{revision:?} is no revision"));
    }
    let prefix = format!("{}.", manifest.id);
    if stem != manifest.id && !stem.starts_with(&prefix) {
        return Err(format!("it does not begin with {prefix}"));
    }
    Ok(())
}

fn sorted(manifest: &Manifest) -> Result<(), String> {
    let ids: Vec<&String> = manifest.operations.iter().map(|one| &one.id).collect();
    match ids.windows(2).find(|pair| pair[0] >= pair[1]) {
        Some(pair) => Err(format!("{} stands before {}", pair[0], pair[1])),
        None => Ok(()),
    }
}

fn titles(manifest: &Manifest) -> Result<(), String> {
    let said = |title: &str, description: &str| {
        if title.trim().is_empty() || title.contains('\n') {
            return Err("it has no title of one line".to_owned());
        }
        match description.trim().is_empty() {
            true => Err("it has no description".to_owned()),
            false => Ok(()),
        }
    };
    said(&manifest.title, &manifest.description)?;
    each(manifest, |one| said(&one.title, &one.description))
}

fn help(parameter: &Parameter) -> Result<(), String> {
    let line = |text: &str| !text.trim().is_empty() && !text.trim().contains('\n');
    if !line(&parameter.help) {
        return Err("it has no help of one line".into());
    }
    match parameter.choices.iter().find(|one| !line(&one.help)) {
        Some(one) => Err(format!("its value {} has no help of one line", one.value)),
        None => Ok(()),
    }
}

fn version(manifest: &Manifest) -> Result<(), String> {
    let core = manifest.version.split(['-', '+']).next().unwrap_or("");
    let numbers: Vec<Option<u32>> = core.split('.').map(|part| part.parse().ok()).collect();
    if numbers.len() != 3 || numbers.contains(&None) {
        let version = &manifest.version;
        return Err(format!("{version:?} is not three numbers, as 1.0.0"));
    }
    match manifest.license.as_deref().map(str::trim) {
        None | Some("") => Err("it has no licence".into()),
        Some(_) => Ok(()),
    }
}

fn isolation(manifest: &Manifest) -> Result<(), String> {
    match manifest.isolation.as_str() {
        "none" | "worker" => Ok(()),
        other => Err(format!("{other:?} is neither none nor worker")),
    }
}

fn port_names(operation: &Operation) -> Result<(), String> {
    for ports in [&operation.inputs, &operation.outputs] {
        let mut names = HashSet::new();
        for port in ports {
            if !words(&port.name, '_', "-") {
                return Err(format!("port {:?} is not in lower case", port.name));
            }
            if !names.insert(&port.name) {
                return Err(format!("two ports are named {}", port.name));
            }
        }
    }
    for port in &operation.outputs {
        let known = |name: &String| operation.inputs.iter().any(|input| &input.name == name);
        match (&port.form, &port.of) {
            (OutputForm::Object, _) => {}
            (_, Some(of)) if known(of) => {}
            _ => {
                let name = &port.name;
                return Err(format!(
                    "output {name} belongs to an input that there is not"
                ));
            }
        }
    }
    Ok(())
}

fn ports_of_kind(operation: &Operation) -> Result<(), String> {
    let (inputs, outputs) = (operation.inputs.len(), operation.outputs.len());
    match operation.kind {
        OperationKind::Reader if inputs > 0 => Err("a reader has no inputs".into()),
        OperationKind::Reader | OperationKind::Operation if outputs == 0 => {
            Err("it has no output".into())
        }
        OperationKind::Writer if outputs > 0 => Err("a writer has no outputs".into()),
        OperationKind::Writer if inputs != 1 => Err("a writer has one input".into()),
        _ => Ok(()),
    }
}

fn units(operation: &Operation) -> Result<(), String> {
    let known = |unit: &str| Unit::parse(unit).is_some();
    let ports = operation.inputs.iter().flat_map(|port| &port.columns);
    let columns = ports.filter_map(|column| column.unit.as_deref());
    let parameters = operation
        .parameters
        .iter()
        .filter_map(|one| one.unit.as_deref());
    match columns.chain(parameters).find(|unit| !known(unit)) {
        Some(unit) => Err(format!("the host does not know the unit {unit:?}")),
        None => Ok(()),
    }
}

fn parameter_names(operation: &Operation) -> Result<(), String> {
    let mut names = HashSet::new();
    for parameter in &operation.parameters {
        let name = &parameter.name;
        if !words(name, '\0', "_") {
            return Err(format!("parameter {name:?} is not in snake_case"));
        }
        if !names.insert(name) {
            return Err(format!("two parameters are named {name}"));
        }
    }
    Ok(())
}

fn limits(parameter: &Parameter) -> Result<(), String> {
    if let ParameterKind::Other(kind) = &parameter.kind {
        return Err(format!("the host does not know the kind {kind:?}"));
    }
    if let (Some(min), Some(max)) = (parameter.min, parameter.max)
        && (min > max || min.is_nan() || max.is_nan())
    {
        return Err(format!("its least value {min} is above its greatest {max}"));
    }
    let choice = parameter.kind == ParameterKind::Choice;
    if choice == parameter.choices.is_empty() {
        return Err("only a choice has values to choose from, and it needs them".into());
    }
    Ok(())
}

fn default(parameter: &Parameter) -> Result<(), String> {
    let Some(default) = &parameter.default else {
        return Ok(());
    };
    parameter
        .canonical(default)
        .map(|_| ())
        .map_err(|failure| format!("its default is not allowed: {failure}"))
}

fn column_needs(operation: &Operation) -> Result<(), String> {
    let needs = operation.inputs.iter().flat_map(|port| &port.columns);
    for name in needs.filter_map(|need| need.name.strip_prefix('$')) {
        let parameter = operation.parameters.iter().find(|one| one.name == name);
        let column = parameter.is_some_and(|one| matches!(one.kind, ParameterKind::Column));
        if !column {
            return Err(format!("there is no column parameter {name}"));
        }
    }
    Ok(())
}

fn file_rule(operation: &Operation) -> Result<(), String> {
    let rule = match (&operation.file, operation.kind) {
        (None, OperationKind::Operation) => return Ok(()),
        (Some(_), OperationKind::Operation) => return Err("an operation has no file".into()),
        (None, _) => return Err("it does not say which files it is for".into()),
        (Some(rule), _) => rule,
    };
    if rule.suffixes.is_empty() {
        return Err("it names no suffix".into());
    }
    let odd = rule
        .suffixes
        .iter()
        .find(|one| !one.starts_with('.') || one.len() < 2 || **one != one.to_lowercase());
    if let Some(suffix) = odd {
        return Err(format!(
            "{suffix:?} is not a suffix in lower case with its dot"
        ));
    }
    let hex = |text: &String| {
        text.len() >= 2
            && text.len().is_multiple_of(2)
            && text.bytes().all(|b| b.is_ascii_hexdigit())
    };
    match rule.magic.iter().find(|magic| !hex(magic)) {
        Some(magic) => Err(format!("{magic:?} is no hexadecimal text of whole bytes")),
        None => Ok(()),
    }
}

fn example(operation: &Operation) -> Result<(), String> {
    let Some(example) = &operation.example else {
        return Err("it declares no example".into());
    };
    schema::canonical(&operation.parameters, &example.parameters)
        .map_err(|failure| format!("its example is not allowed: {failure}"))?;
    for name in example.inputs.keys() {
        if !operation.inputs.iter().any(|port| &port.name == name) {
            return Err(format!("its example binds {name}, which is no input"));
        }
    }
    if let Some(step) = example.inputs.values().find(|step| !named(step)) {
        return Err(format!(
            "its example calls {:?}, which is no operation's id",
            step.op
        ));
    }
    let file = example.file.as_ref();
    let content = file.is_some_and(|file| file.text.is_some() || file.hex.is_some());
    match operation.kind {
        OperationKind::Reader if !content => Err("its example has no file".into()),
        _ => Ok(()),
    }
}

fn named(step: &Step) -> bool {
    let stem = step.op.split('/').next().unwrap_or("");
    words(stem, '.', "-_") && step.inputs.values().all(named)
}
