//! Flags from parameter schemas: of operations, and of the options of readers and writers.

use crate::output::plain;
use crate::page;
use clap::{Arg, ArgAction, ArgMatches, Command};
use puncta_engine::documents::{Failure, Map, Operation, Parameter, ParameterKind};
use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

/// What flags belong to. It begins their ids, so that no two of them are the same.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Owner {
    /// The operation that runs.
    Operation,
    /// The reader or the writer, whichever has it.
    Either,
    /// The reader.
    Reader,
    /// The writer.
    Writer,
}

impl Owner {
    fn id(self, name: &str) -> String {
        format!("{self:?} {name}")
    }

    fn long(self, name: &str) -> String {
        match self {
            Owner::Operation | Owner::Either => name.to_owned(),
            Owner::Reader => format!("in-{name}"),
            Owner::Writer => format!("out-{name}"),
        }
    }
}

/// A command to which flags are added.
#[derive(Debug)]
pub struct Grammar {
    pub command: Command,
    /// Flags that are spoken for.
    taken: BTreeSet<String>,
    /// Flags that need no value.
    switches: BTreeSet<String>,
}

impl Grammar {
    /// Knows the flags that a command and `others` have already.
    pub fn new<'a>(command: Command, others: impl Iterator<Item = &'a Arg>) -> Grammar {
        let mut taken: BTreeSet<String> = ["help", "version"].map(str::to_owned).into();
        taken.extend(others.filter_map(Arg::get_long).map(str::to_owned));
        taken.extend(
            command
                .get_arguments()
                .filter_map(Arg::get_long)
                .map(str::to_owned),
        );
        Grammar {
            command,
            taken,
            switches: BTreeSet::new(),
        }
    }

    /// Adds a flag for each parameter; a name that is taken gets none.
    pub fn add(mut self, parameters: &[Parameter], owner: Owner, heading: &str) -> Grammar {
        for parameter in parameters {
            let long = owner.long(&parameter.name);
            let dashed = long.replace('_', "-");
            let usable = |c: char| c.is_ascii_alphanumeric() || c == '_' || c == '-';
            let named = parameter
                .name
                .starts_with(|c: char| c.is_ascii_alphabetic());
            if !named || !long.chars().all(usable) || self.taken.contains(&long) {
                continue;
            }
            let mut arg = flag(parameter, owner.id(&parameter.name), long.clone());
            arg = match owner {
                Owner::Operation if parameter.advanced => arg.help_heading("Advanced parameters"),
                Owner::Reader | Owner::Writer => arg.hide(true),
                _ => arg.help_heading(heading.to_owned()),
            };
            self.taken.insert(long.clone());
            let mut names = vec![long];
            if self.taken.insert(dashed.clone()) {
                arg = arg.alias(dashed.clone());
                names.push(dashed);
            }
            if parameter.kind == ParameterKind::Bool {
                self.switches.extend(names);
            }
            self.command = self.command.arg(arg);
        }
        self
    }

    /// The command, and the flags that need no value.
    pub fn finish(self) -> (Command, BTreeSet<String>) {
        (self.command, self.switches)
    }
}

fn flag(parameter: &Parameter, id: String, long: String) -> Arg {
    use ParameterKind as Kind;
    let help = format!(
        "{} [{}]",
        parameter.help.trim_end_matches('.'),
        page::facts(parameter)
    );
    let arg = Arg::new(id).long(long).help(plain(help.trim_start()));
    match parameter.kind {
        Kind::Bool => arg
            .num_args(0..=1)
            .require_equals(true)
            .default_missing_value("true")
            .value_name("true|false"),
        Kind::Integer | Kind::Number | Kind::Seed => {
            arg.allow_hyphen_values(true).value_name("NUMBER")
        }
        Kind::Numbers => arg
            .allow_hyphen_values(true)
            .value_name("NUMBER,...")
            .action(ArgAction::Append),
        Kind::Columns => arg.value_name("COLUMN,...").action(ArgAction::Append),
        Kind::Ranges => arg
            .value_name("COLUMN=LOW..HIGH,...")
            .action(ArgAction::Append),
        Kind::Mapping => arg.value_name("NAME=TEXT,...").action(ArgAction::Append),
        Kind::Column => arg.value_name("COLUMN"),
        Kind::Choice => arg.value_name("CHOICE"),
        Kind::Text | Kind::Other(_) => arg.value_name("TEXT"),
    }
}

/// Writes `--switch true` as `--switch=true`, so that `--switch FILE` means a file.
pub fn join_switches(
    arguments: Vec<std::ffi::OsString>,
    switches: &BTreeSet<String>,
) -> Vec<std::ffi::OsString> {
    let mut out: Vec<std::ffi::OsString> = Vec::with_capacity(arguments.len());
    for argument in arguments {
        let value = argument == "true" || argument == "false";
        let name = out
            .last()
            .and_then(|last| last.to_str()?.strip_prefix("--"));
        if value && name.is_some_and(|name| switches.contains(name)) {
            if let Some(last) = out.last_mut() {
                last.push("=");
                last.push(argument);
            }
        } else {
            out.push(argument);
        }
    }
    out
}

/// The values that were given for parameters.
pub fn given(matches: &ArgMatches, parameters: &[Parameter], owner: Owner) -> Map {
    let mut out = Map::new();
    for parameter in parameters {
        let values = matches.try_get_many::<String>(&owner.id(&parameter.name));
        if let Ok(Some(values)) = values {
            let texts: Vec<&str> = values.map(String::as_str).collect();
            out.insert(parameter.name.clone(), value(parameter, &texts.join(",")));
        }
    }
    out
}

/// The value that a text on the command line stands for; the schema brings it to its final form.
pub fn value(parameter: &Parameter, text: &str) -> Value {
    use ParameterKind as Kind;
    let trimmed = text.trim();
    let list = matches!(
        parameter.kind,
        Kind::Numbers | Kind::Columns | Kind::Ranges | Kind::Mapping
    );
    if list
        && trimmed.starts_with(['[', '{'])
        && let Ok(value) = serde_json::from_str(trimmed)
    {
        return value;
    }
    if parameter.optional && parameter.kind != Kind::Text && trimmed == "none" {
        return Value::Null;
    }
    text.into()
}

/// Values of the form `NAME=VALUE` for an operation.
pub fn assigned(operation: &Operation, texts: &[String], into: &mut Map) -> Result<(), Failure> {
    for text in texts {
        let (name, value_text) = text.split_once('=').ok_or_else(|| {
            Failure::bad_parameter("set", format!("--set {text} has no ="))
                .remedy("write --set NAME=VALUE")
        })?;
        let same = |parameter: &&Parameter| parameter.name == name;
        let given = match operation.parameters.iter().find(same) {
            Some(parameter) => value(parameter, value_text),
            // The check of all parameters names those that there are.
            None => value_text.into(),
        };
        into.insert(name.to_owned(), given);
    }
    Ok(())
}

/// The parameters of several operations by name; of one name, the first.
pub fn union<'a>(operations: impl Iterator<Item = &'a Operation>) -> Vec<Parameter> {
    let mut all: BTreeMap<&str, &Parameter> = BTreeMap::new();
    for parameter in operations.flat_map(|operation| &operation.parameters) {
        all.entry(&parameter.name).or_insert(parameter);
    }
    all.into_values().cloned().collect()
}

/// Whether the files of an operation have a suffix of this path.
pub fn fits(operation: &Operation, path: &Path) -> bool {
    let name = path
        .file_name()
        .unwrap_or_default()
        .to_string_lossy()
        .to_lowercase();
    let rule = operation.file.as_ref();
    rule.is_some_and(|rule| {
        rule.suffixes
            .iter()
            .any(|suffix| name.ends_with(suffix.as_str()))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn parameter(name: &str, kind: ParameterKind) -> Parameter {
        Parameter::new(name, kind)
    }

    fn parse(parameters: &[Parameter], line: &str) -> Result<Map, String> {
        let fixed = Arg::new("overwrite")
            .long("overwrite")
            .action(ArgAction::SetTrue);
        let command = Command::new("op")
            .arg(fixed)
            .arg(Arg::new("inputs").num_args(0..));
        let grammar = Grammar::new(command, std::iter::empty());
        let (command, switches) = grammar
            .add(parameters, Owner::Operation, "Parameters")
            .finish();
        let words = std::iter::once("op").chain(line.split_whitespace());
        let words = join_switches(words.map(Into::into).collect(), &switches);
        let matches = command
            .try_get_matches_from(words)
            .map_err(|error| error.to_string())?;
        let mut out = given(&matches, parameters, Owner::Operation);
        let inputs = matches.get_many::<String>("inputs").into_iter().flatten();
        out.insert("inputs".into(), inputs.cloned().collect::<Vec<_>>().into());
        Ok(out)
    }

    #[test]
    fn both_spellings_and_all_kinds() {
        let mut optional = parameter("x_min", ParameterKind::Number);
        optional.optional = true;
        let all = [
            parameter("pixel_size", ParameterKind::Number),
            parameter("ranges", ParameterKind::Ranges),
            parameter("origin", ParameterKind::Numbers),
            parameter("inside", ParameterKind::Bool),
            parameter("title", ParameterKind::Text),
            optional,
        ];
        let line = "--pixel-size 5nm --ranges a=0..1 --ranges b=2.. --origin -1,-2 --inside f.csv";
        assert_eq!(
            Value::Object(parse(&all, line).unwrap()),
            json!({"pixel_size": "5nm", "ranges": "a=0..1,b=2..", "origin": "-1,-2",
                   "inside": "true", "inputs": ["f.csv"]})
        );
        let line = r#"--inside false --origin [1,2] --title [x] --x_min none --pixel_size=-3"#;
        assert_eq!(
            Value::Object(parse(&all, line).unwrap()),
            json!({"inside": "false", "origin": [1, 2], "title": "[x]", "x_min": null,
                   "pixel_size": "-3", "inputs": []})
        );
        assert!(parse(&all, "--pixel_size 1 --pixel_size 2").is_err());
        assert!(parse(&all, "--pixelsize 1").is_err());
    }

    #[test]
    fn names_that_are_taken_or_strange_get_no_flag() {
        let all = [
            parameter("overwrite", ParameterKind::Text),
            parameter("help", ParameterKind::Bool),
            parameter("", ParameterKind::Text),
            parameter("a b", ParameterKind::Text),
            parameter("-x", ParameterKind::Text),
            parameter("a_b", ParameterKind::Text),
            parameter("a-b", ParameterKind::Text),
        ];
        assert_eq!(
            Value::Object(parse(&all, "--a_b 1 --a-b 2").unwrap_or_default()),
            json!({}),
            "a-b is another spelling of a_b"
        );
        assert_eq!(parse(&all, "--a-b 2").unwrap()["a_b"], json!("2"));
    }

    #[test]
    fn assigned_values_know_their_kind() {
        let mut operation: Operation =
            serde_json::from_value(json!({"id": "a.b/1", "kind": "operation", "title": "B"}))
                .unwrap();
        operation.parameters = vec![parameter("overwrite", ParameterKind::Numbers)];
        let mut map = Map::new();
        assigned(
            &operation,
            &["overwrite=[1]".into(), "x=[1]".into()],
            &mut map,
        )
        .unwrap();
        assert_eq!(Value::Object(map), json!({"overwrite": [1], "x": "[1]"}));
        let failure = assigned(&operation, &["x".into()], &mut Map::new()).unwrap_err();
        assert!(failure.to_string().contains("--set NAME=VALUE"));
    }
}
