//! How the program ends: exit codes, and the one place that prints errors.

use crate::cli::NAME;
use crate::output::{self, Output};
use puncta_engine::documents::{Failure, FailureCode, Map};
use serde_json::Value;
use std::io::Write;

/// How a command ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ended {
    /// Everything was done.
    Done,
    /// Some of it was done; what failed was said.
    Partly,
    /// It was stopped; what is left was said.
    Stopped,
    /// Nothing was done; what failed was said.
    Failed,
}

/// The exit codes, as docs/command-line.md promises them.
impl Ended {
    pub fn code(self) -> u8 {
        match self {
            Ended::Done => 0,
            Ended::Failed => 1,
            Ended::Partly => 3,
            Ended::Stopped => 130,
        }
    }
}

fn code(failure: &Failure) -> u8 {
    match failure.code {
        FailureCode::BadParameter => 2,
        FailureCode::Cancelled => 130,
        _ => 1,
    }
}

/// Prints why a command failed, and gives the exit code.
pub fn report(failure: &Failure, as_json: bool, output: &Output) -> u8 {
    say(&sentence(failure));
    if as_json {
        let mut map = Map::new();
        map.insert("error".into(), json(failure));
        // The exit code already tells of a failure.
        let _ = output.json(&map.into());
    }
    code(failure)
}

/// A failure as JSON.
pub fn json(failure: &Failure) -> Value {
    let mut value = serde_json::to_value(failure).unwrap_or_default();
    if let Some(members) = value.as_object_mut() {
        members.remove("format");
    }
    value
}

/// The sentence for a failure.
pub fn sentence(failure: &Failure) -> String {
    output::plain(&failure.to_string())
}

/// A line on standard error.
pub fn say(text: &str) {
    // Without standard error there is nobody to tell.
    let _ = writeln!(std::io::stderr().lock(), "{NAME}: {text}");
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_kind_of_failure_has_its_code() {
        assert_eq!(code(&Failure::cancelled()), 130);
        assert_eq!(code(&Failure::bad_parameter("x", "no")), 2);
        assert_eq!(code(&Failure::bad_file("no")), 1);
        assert_eq!(code(&Failure::internal("no")), 1);
    }

    #[test]
    fn a_sentence_stays_one_line() {
        let failure = Failure::bad_file("a\nb\u{1b}[31m is bad").remedy("try again");
        assert_eq!(sentence(&failure), "a\\nb\\u{1b}[31m is bad; try again");
    }
}
