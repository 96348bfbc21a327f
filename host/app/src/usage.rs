//! What is wrong with a command line, as one sentence.

use clap::error::{ContextKind, ContextValue, Error, ErrorKind};
use puncta_engine::documents::{Failure, FailureCode};

/// Help or version to be printed, or what is wrong.
pub fn refused(error: &Error) -> Result<String, Failure> {
    if matches!(
        error.kind(),
        ErrorKind::DisplayHelp | ErrorKind::DisplayVersion
    ) {
        return Ok(error.render().to_string());
    }
    let text = |kind: ContextKind| match error.get(kind) {
        Some(ContextValue::String(text)) => Some(text.clone()),
        Some(ContextValue::Strings(list)) if !list.is_empty() => Some(list.join(", ")),
        _ => None,
    };
    let argument = text(ContextKind::InvalidArg).unwrap_or_default();
    let bare = argument.split(' ').next().unwrap_or(&argument).to_owned();
    let near = text(ContextKind::SuggestedArg).or_else(|| text(ContextKind::SuggestedSubcommand));
    let near = near.or_else(|| text(ContextKind::SuggestedValue));
    let message = match error.kind() {
        ErrorKind::UnknownArgument if argument.starts_with('-') => {
            format!("there is no option {argument}")
        }
        ErrorKind::UnknownArgument => format!("the argument {argument} is one too many"),
        ErrorKind::InvalidSubcommand => {
            let command = text(ContextKind::InvalidSubcommand).unwrap_or_default();
            format!("there is no command {command}")
        }
        ErrorKind::MissingRequiredArgument => format!("{argument} is missing"),
        ErrorKind::MissingSubcommand | ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand => {
            "the command is not complete".into()
        }
        ErrorKind::ArgumentConflict => match text(ContextKind::PriorArg) {
            Some(prior) if prior != argument => format!("{bare} and {prior} exclude each other"),
            _ => format!("{bare} is given twice"),
        },
        ErrorKind::InvalidValue
        | ErrorKind::ValueValidation
        | ErrorKind::NoEquals
        | ErrorKind::TooFewValues => {
            match text(ContextKind::InvalidValue).filter(|value| !value.is_empty()) {
                Some(value) => format!("{bare} cannot be {value:?}"),
                None => format!("{bare} needs a value"),
            }
        }
        _ => first_line(error),
    };
    let usage = text(ContextKind::Usage);
    Err(
        Failure::new(FailureCode::BadParameter, message).remedy(match near {
            Some(near) => format!("did you mean {near}?"),
            None => usage.unwrap_or_else(|| "add --help to see what there is".into()),
        }),
    )
}

/// Clap's own first line.
fn first_line(error: &Error) -> String {
    let text = error.render().to_string();
    let line = text.lines().next().unwrap_or_default();
    line.strip_prefix("error: ").unwrap_or(line).to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cli::Cli;
    use clap::Parser;

    fn sentence(line: &str) -> String {
        let words = std::iter::once("puncta").chain(line.split_whitespace());
        let error = Cli::try_parse_from(words).unwrap_err();
        refused(&error).unwrap_err().to_string()
    }

    #[test]
    fn one_sentence_for_each_mistake() {
        for (line, expected) in [
            ("inf", "there is no command inf; did you mean info?"),
            (
                "info --reeder x f",
                "there is no option --reeder; did you mean --reader?",
            ),
            ("info", "<FILE> is missing; add --help to see what there is"),
            (
                "info a b",
                "the argument b is one too many; add --help to see what there is",
            ),
            (
                "info f --reader",
                "--reader needs a value; add --help to see what there is",
            ),
            (
                "info f --threads x",
                "--threads cannot be \"x\"; add --help to see what there is",
            ),
            (
                "info f --reader a --reader b",
                "--reader is given twice; add --help to see what there is",
            ),
            (
                "info f --isolated --in-process",
                "--isolated and --in-process exclude each other; add --help to see what there is",
            ),
            (
                "plugins",
                "the command is not complete; add --help to see what there is",
            ),
        ] {
            assert_eq!(sentence(line), expected, "{line}");
        }
    }

    #[test]
    fn help_is_no_mistake() {
        let error = Cli::try_parse_from(["puncta", "info", "--help"]).unwrap_err();
        assert!(refused(&error).unwrap().contains("Usage: puncta info"));
    }
}
