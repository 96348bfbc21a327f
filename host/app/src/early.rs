//! A first look at the arguments: which plugins and which operation the rest depends on.

use std::ffi::OsString;
use std::path::PathBuf;

/// Options that take a value and may stand before the name of an operation.
const WITH_VALUE: &[&str] = &[
    "--threads",
    "-o",
    "--output",
    "--set",
    "--reader",
    "--writer",
];

/// What has to be known before the arguments can be read.
#[derive(Debug, Default, PartialEq, Eq)]
pub struct Early {
    /// Plugin folders.
    pub plugins: Vec<PathBuf>,
    /// Name of the command.
    pub command: Option<String>,
    /// First argument of the command `op`.
    pub operation: Option<String>,
    /// Whether the answer is to be JSON, errors too.
    pub json: bool,
}

/// Looks at the arguments without the program's name. Nothing is refused here.
pub fn look(arguments: &[OsString]) -> Early {
    let mut early = Early::default();
    let mut rest = arguments.iter();
    while let Some(argument) = rest.next() {
        let Some(text) = argument.to_str() else {
            continue;
        };
        if text == "--" {
            break;
        }
        if text == "--plugins" {
            early.plugins.extend(rest.next().map(PathBuf::from));
        } else if let Some(folder) = text.strip_prefix("--plugins=") {
            early.plugins.push(folder.into());
        } else if text == "--json" {
            early.json = true;
        } else if WITH_VALUE.contains(&text) {
            rest.next();
        } else if !text.starts_with('-') {
            if early.command.is_none() {
                early.command = Some(text.into());
            } else if early.command.as_deref() == Some("op") && early.operation.is_none() {
                early.operation = Some(text.into());
            }
        }
    }
    early
}

#[cfg(test)]
mod tests {
    use super::*;

    fn early(text: &str) -> Early {
        look(
            &text
                .split_whitespace()
                .map(OsString::from)
                .collect::<Vec<_>>(),
        )
    }

    #[test]
    fn what_the_rest_depends_on_is_found() {
        let found = early("--threads 2 --plugins a op b.c --x 5 f.csv --json --plugins=d");
        assert_eq!(found.plugins, [PathBuf::from("a"), PathBuf::from("d")]);
        assert_eq!(found.command.as_deref(), Some("op"));
        assert_eq!(found.operation.as_deref(), Some("b.c"));
        assert!(found.json);
        let found = early("op -o x.csv b.c f.csv");
        assert_eq!(found.operation.as_deref(), Some("b.c"));
        let found = early("info f.csv -- --json --plugins x");
        assert!(!found.json && found.plugins.is_empty() && found.operation.is_none());
        assert_eq!(early("--plugins"), Early::default());
    }
}
