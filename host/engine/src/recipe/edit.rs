//! Edits of a recipe's text. Every byte that an edit does not have to change stays: comments,
//! order, spelling and line ends.
//!
//! Each function returns the new text, or a sentence that says why the edit is not possible. The
//! text has to be a valid recipe before, and is one after.

use super::parse::{check_name, parse};
use super::splice::Splice;
use super::values::{quoted, to_toml, toml_key};
use super::{Problem, Recipe};
use puncta_documents::{Failure, Kind, Map};
use serde_json::Value;

/// Sets a parameter of a step. `null` removes it, so that the default holds.
///
/// # Errors
/// When there is no such step, or its layout leaves no place for the parameter.
pub fn set_parameter(
    text: &str,
    step: &str,
    parameter: &str,
    value: &Value,
) -> Result<String, Failure> {
    if value.is_null() {
        return remove_parameter(text, step, parameter);
    }
    let before = known_step(text, step)?;
    if before.step(step).and_then(|step| step.set.get(parameter)) == Some(value) {
        return Ok(text.to_owned());
    }
    let mut splice = Splice::new(text);
    splice.put(&["steps", step, "set", parameter], value);
    verify(splice, |after| {
        after.step(step).and_then(|step| step.set.get(parameter)) == Some(value)
    })
}

/// Removes a parameter of a step, so that its default holds.
///
/// # Errors
/// When there is no such step.
pub fn remove_parameter(text: &str, step: &str, parameter: &str) -> Result<String, Failure> {
    known_step(text, step)?;
    let mut splice = Splice::new(text);
    splice.remove(&["steps", step, "set", parameter]);
    verify(splice, |after| {
        after
            .step(step)
            .is_some_and(|step| !step.set.contains_key(parameter))
    })
}

/// Binds a port of a step to one reference, or to several. None at all unbinds it.
///
/// # Errors
/// When there is no such step.
pub fn rebind(text: &str, step: &str, port: &str, from: &[&str]) -> Result<String, Failure> {
    let before = known_step(text, step)?;
    let path = ["steps", step, "in", port];
    let mut splice = Splice::new(text);
    let bound = |recipe: &Recipe| {
        let step = recipe.step(step)?;
        let binding = step.inputs.iter().find(|binding| binding.port == port)?;
        Some(
            binding
                .from
                .iter()
                .map(ToString::to_string)
                .collect::<Vec<_>>(),
        )
    };
    if bound(&before).unwrap_or_default() == from {
        return Ok(text.to_owned());
    }
    match from {
        [] => splice.remove(&path),
        [one] if !splice.is_list(&path) => splice.put(&path, &Value::from(*one)),
        list => splice.put(&path, &Value::from(list.to_vec())),
    }
    verify(splice, |after| bound(after).unwrap_or_default() == from)
}

/// Adds a step after the last one.
///
/// # Errors
/// When the name is taken, or is no name.
pub fn add_step(
    text: &str,
    name: &str,
    op: &str,
    inputs: &[(&str, &[&str])],
    set: &Map,
) -> Result<String, Failure> {
    free_name(&read(text)?, "a step", name)?;
    let mut lines = vec![
        format!("[steps.{}]", toml_key(name)),
        format!("op = {}", quoted(op)),
    ];
    for (port, from) in inputs {
        let value = match from {
            [] => continue,
            [one] => quoted(one),
            list => to_toml(&Value::from(list.to_vec())).unwrap_or_default(),
        };
        lines.push(format!("in.{} = {value}", toml_key(port)));
    }
    for (parameter, value) in set {
        if let Some(value) = to_toml(value) {
            lines.push(format!("set.{} = {value}", toml_key(parameter)));
        }
    }
    let mut splice = Splice::new(text);
    splice.add_section(&lines, &["steps", "inputs"]);
    verify(splice, |after| {
        after.step(name).is_some_and(|step| step.op == op)
    })
}

/// Removes a step, with the comment that stands directly above it. What was bound to it stays as it
/// is, for the check to show.
///
/// # Errors
/// When there is no such step.
pub fn remove_step(text: &str, name: &str) -> Result<String, Failure> {
    known_step(text, name)?;
    let mut splice = Splice::new(text);
    splice.remove(&["steps", name]);
    verify(splice, |after| after.step(name).is_none())
}

/// Renames a step, and every reference to it.
///
/// # Errors
/// When there is no such step, or the new name is taken or no name.
pub fn rename_step(text: &str, name: &str, new: &str) -> Result<String, Failure> {
    let before = known_step(text, name)?;
    if name == new {
        return Ok(text.to_owned());
    }
    free_name(&before, "a step", new)?;
    let mut splice = Splice::new(text);
    splice.rename("steps", name, new);
    let left = |recipe: &Recipe| {
        let bound = recipe.steps.iter().flat_map(|step| &step.inputs);
        let bound = bound.flat_map(|binding| &binding.from);
        let written = recipe.outputs.iter().map(|output| &output.from);
        bound
            .chain(written)
            .any(|reference| reference.source == name)
    };
    verify(splice, |after| {
        after.step(new).is_some() && after.step(name).is_none() && !left(after)
    })
}

/// Adds an input after the last one.
///
/// # Errors
/// When the name is taken, or is no name.
pub fn add_input(text: &str, name: &str, kind: Kind) -> Result<String, Failure> {
    free_name(&read(text)?, "an input", name)?;
    let mut splice = Splice::new(text);
    let lines = [
        format!("[inputs.{}]", toml_key(name)),
        format!("kind = \"{kind}\""),
    ];
    splice.add_section(&lines, &["inputs", ""]);
    verify(splice, |after| after.input(name).is_some())
}

/// Sets an option of an input's reader; `null` removes it.
///
/// # Errors
/// When there is no such input.
pub fn set_option(text: &str, input: &str, option: &str, value: &Value) -> Result<String, Failure> {
    let before = read(text)?;
    let Some(found) = before.input(input) else {
        return Err(Failure::bad_input(format!("there is no input {input}")));
    };
    if found.options.get(option).unwrap_or(&Value::Null) == value {
        return Ok(text.to_owned());
    }
    let mut splice = Splice::new(text);
    let path = ["inputs", input, "options", option];
    if value.is_null() {
        splice.remove(&path);
    } else {
        splice.put(&path, value);
    }
    verify(splice, |after| {
        let options = after.input(input).map(|input| &input.options);
        options
            .and_then(|options| options.get(option))
            .unwrap_or(&Value::Null)
            == value
    })
}

/// Writes a reference to a file, in place of what the file holds now. `None` writes it no more.
///
/// # Errors
/// When the name of the file is none below the output folder.
pub fn set_output(text: &str, file: &str, from: Option<&str>) -> Result<String, Failure> {
    let before = read(text)?;
    let written = |recipe: &Recipe| {
        let output = recipe.outputs.iter().find(|output| output.file == file)?;
        Some(output.from.to_string())
    };
    if written(&before).as_deref() == from {
        return Ok(text.to_owned());
    }
    let mut splice = Splice::new(text);
    let path = ["outputs", file];
    match from {
        None => splice.remove(&path),
        Some(from) if splice.has(&["outputs", file, "from"]) => {
            splice.put(&["outputs", file, "from"], &from.into());
        }
        Some(from) => {
            super::files::check_file(file)?;
            splice.put(&path, &from.into());
        }
    }
    verify(splice, |after| written(after).as_deref() == from)
}

fn read(text: &str) -> Result<Recipe, Failure> {
    parse(text).map_err(|problems| {
        let first = problems
            .first()
            .map_or_else(String::new, Problem::to_string);
        Failure::bad_file(format!(
            "the recipe has an error that has to go first: {first}"
        ))
    })
}

fn known_step(text: &str, name: &str) -> Result<Recipe, Failure> {
    let recipe = read(text)?;
    if recipe.step(name).is_none() {
        let near = super::closest::closest(name, recipe.steps.iter().map(|step| &*step.name));
        let failure = Failure::bad_input(format!("there is no step {name}"));
        return Err(match near {
            Some(near) => failure.remedy(format!("did you mean {near}?")),
            None => failure,
        });
    }
    Ok(recipe)
}

fn free_name(recipe: &Recipe, what: &str, name: &str) -> Result<(), Failure> {
    check_name(what, name)?;
    if recipe.step(name).is_some() || recipe.input(name).is_some() {
        return Err(
            Failure::bad_input(format!("the name {name} is taken")).remedy("choose another name")
        );
    }
    Ok(())
}

/// Lets an edit pass only if the new text is a recipe that says what was meant.
fn verify(splice: Splice, meant: impl Fn(&Recipe) -> bool) -> Result<String, Failure> {
    let text = splice.finish();
    let failure = || {
        Failure::bad_file("the layout of this recipe leaves no place for the edit")
            .remedy("edit its text instead")
    };
    match parse(&text) {
        Ok(recipe) if meant(&recipe) => Ok(text),
        _ => Err(failure()),
    }
}

#[cfg(test)]
#[path = "edit_tests.rs"]
mod tests;
