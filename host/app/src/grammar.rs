//! The whole command line: the fixed part, and the flags of what is installed.

use crate::cli::Cli;
use crate::context;
use crate::early::Early;
use crate::flags::{Grammar, Owner, union};
use crate::page;
use clap::{Arg, Command, CommandFactory};
use puncta_engine::Engine;
use puncta_engine::documents::{Failure, Kind, Operation, OperationKind, Parameter};
use puncta_engine::plugins::Catalogue;
use std::collections::BTreeSet;

/// A command line that can be parsed.
pub struct Complete {
    pub command: Command,
    /// Flags that need no value.
    pub switches: BTreeSet<String>,
}

const FILES: &str = "Options of readers are given as --in-NAME, of writers as --out-NAME; \
    `puncta ops` ID describes them.";

/// The command line for what the early look has found.
pub fn grammar(early: &Early) -> Result<Complete, Failure> {
    let command = Cli::command();
    let fixed = |command| {
        Ok(Complete {
            command,
            switches: BTreeSet::new(),
        })
    };
    let name = match early.command.as_deref() {
        Some(name @ ("info" | "convert")) => name,
        Some(name @ "op") if early.operation.is_some() => name,
        _ => return fixed(command),
    };
    let global = crate::cli::Global {
        plugins: early.plugins.clone(),
        ..Default::default()
    };
    let options = context::options(&global)?;
    let catalogue = options.catalogue()?;
    let operation = match &early.operation {
        None => None,
        Some(id) => match find(&catalogue, id)? {
            Some(operation) => Some(operation),
            // The engine has the sentence for it.
            None => {
                return Err(Engine::open(options)?
                    .operation(id)
                    .err()
                    .unwrap_or_else(none));
            }
        },
    };
    Ok(complete(command, name, &catalogue, operation))
}

fn none() -> Failure {
    Failure::internal("an operation that is there was not found")
}

/// An installed operation by its id, or by the end of its id if that is the only one.
pub fn find<'a>(catalogue: &'a Catalogue, id: &str) -> Result<Option<&'a Operation>, Failure> {
    if let Some((_, operation)) = catalogue.find(id) {
        return Ok(Some(operation));
    }
    let end = format!(".{id}");
    let all = catalogue.operations().map(|(_, operation)| operation);
    let mut stems: Vec<&str> = all
        .map(Operation::stem)
        .filter(|one| one.ends_with(&end))
        .collect();
    stems.dedup();
    match stems.as_slice() {
        [] => Ok(None),
        [stem] => Ok(catalogue.find(stem).map(|(_, operation)| operation)),
        several => Err(
            Failure::bad_parameter("name", format!("{id} is the end of several ids"))
                .remedy(format!("write {}", several.join(" or "))),
        ),
    }
}

fn complete(
    command: Command,
    name: &str,
    catalogue: &Catalogue,
    operation: Option<&Operation>,
) -> Complete {
    let of = |kind: OperationKind| {
        let all = catalogue.operations().map(|(_, operation)| operation);
        all.filter(move |operation| operation.kind == kind)
    };
    let readers = union(of(OperationKind::Reader));
    let writers = union(of(OperationKind::Writer));
    let others: Vec<Arg> = command.get_arguments().cloned().collect();
    let mut switches = BTreeSet::new();
    let command = command.mut_subcommand(name, |command| {
        let grammar = Grammar::new(command, others.iter());
        let grammar = match (name, operation) {
            ("info", _) => grammar.add(&readers, Owner::Operation, "Options of readers"),
            ("op", Some(operation)) => operation_flags(grammar, operation, catalogue),
            _ => grammar.add(
                &either(&readers, &writers),
                Owner::Either,
                "Options of readers and writers",
            ),
        };
        let grammar = match name {
            "info" => grammar,
            _ => grammar
                .add(&readers, Owner::Reader, "")
                .add(&writers, Owner::Writer, ""),
        };
        let (command, found) = grammar.finish();
        switches = found;
        command
    });
    Complete { command, switches }
}

/// Options of readers, then those that only writers have.
pub fn either(readers: &[Parameter], writers: &[Parameter]) -> Vec<Parameter> {
    let new = |one: &&Parameter| readers.iter().all(|known| known.name != one.name);
    readers
        .iter()
        .chain(writers.iter().filter(new))
        .cloned()
        .collect()
}

fn operation_flags(grammar: Grammar, operation: &Operation, catalogue: &Catalogue) -> Grammar {
    let mut grammar = grammar.add(&operation.parameters, Owner::Operation, "Parameters");
    let suffix = |kind: Kind| suffix(catalogue, kind);
    let after = format!(
        "{}\nExample:\n  {}\n\n{FILES}",
        page::ports(operation),
        page::command(operation, &suffix)
    );
    let usage = page::usage(operation);
    grammar.command = grammar
        .command
        .about(format!(
            "{} ({})\n\n{}",
            operation.title, operation.id, operation.description
        ))
        .override_usage(usage)
        .mut_arg("name", |arg| arg.hide(true))
        .mut_arg("inputs", |arg| arg.hide(operation.inputs.is_empty()))
        .after_help(after);
    grammar
}

/// The first suffix of files that an installed writer writes for a kind of object.
pub fn suffix(catalogue: &Catalogue, kind: Kind) -> String {
    let mut writers = catalogue
        .operations()
        .map(|(_, operation)| operation)
        .filter(|operation| {
            operation.kind == OperationKind::Writer
                && operation.inputs.iter().any(|port| port.kind == kind)
        });
    let rule = writers.find_map(|operation| operation.file.as_ref()?.suffixes.first());
    match (rule, kind) {
        (Some(suffix), _) => suffix.clone(),
        (None, Kind::Figure | Kind::Report) => ".json".into(),
        (None, _) => String::new(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_command_line_is_sound() {
        Cli::command().debug_assert();
    }

    #[test]
    fn nothing_is_scanned_for_fixed_commands() {
        let early = Early {
            command: Some("ops".into()),
            ..Early::default()
        };
        assert!(grammar(&early).unwrap().switches.is_empty());
    }

    #[test]
    fn without_plugins_every_option_is_unknown() {
        let complete = complete(Cli::command(), "info", &Catalogue::default(), None);
        let words = ["puncta", "info", "a", "--pixel_size", "1"];
        let error = complete.command.try_get_matches_from(words).unwrap_err();
        let failure = crate::usage::refused(&error).unwrap_err();
        assert!(
            failure
                .to_string()
                .starts_with("there is no option --pixel_size")
        );
    }
}
