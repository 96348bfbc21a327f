//! What a fault in a row means for the person, or for the plan.

use crate::dialect::Dialect;
use crate::rows::{Fault, Problem};
use crate::schema::{Change, Plan};
use crate::wording::{count, quoted};
use puncta_sdk::Failure;

/// A change of plan, or the end.
#[derive(Debug, Clone, PartialEq)]
pub enum Verdict {
    /// The read starts again with another plan.
    Change(Change),
    /// The read cannot go on.
    Failure(Failure),
}

/// What a fault means; `line` is the number of the first line of its piece.
pub fn verdict(fault: &Fault, line: u64, plan: &Plan, dialect: &Dialect) -> Verdict {
    let line = line + fault.lines;
    let feeds = |c: &crate::schema::ColumnPlan| c.field == fault.field && c.copy_of.is_none();
    let column = plan.columns.iter().position(feeds).unwrap_or(0);
    let file = &dialect.file;
    let name = match dialect.names.get(fault.field) {
        Some(name) if !name.is_empty() => quoted(name.as_bytes()),
        _ => (fault.field + 1).to_string(),
    };
    let (message, remedy) = match &fault.problem {
        Problem::Needs(kind) => {
            return Verdict::Change(Change::Kind {
                column,
                kind: *kind,
            });
        }
        Problem::FrameZero => return Verdict::Change(Change::FramesFromZero { column }),
        Problem::OpenQuote => return Verdict::Failure(open_quote(file, line)),
        Problem::NotNumber(text) => (
            format!(
                "{file} has {} in column {name} where a number belongs",
                quoted(text)
            ),
            format!("correct the line, or read the column as words with text = {name}"),
        ),
        Problem::Count(found) => (
            format!(
                "{file} has a row of {} where the table has {}",
                count(*found, "value"),
                count(plan.fields, "column")
            ),
            "correct or remove the line".to_owned(),
        ),
        Problem::Misfit(text) => (
            format!(
                "{file} has {} in column {name}, which its type cannot hold",
                quoted(text)
            ),
            "correct the line, or remove the line with the types".to_owned(),
        ),
        Problem::BehindQuote => (
            format!("{file} has letters behind a closing quote in column {name}"),
            "write a quote inside a value twice".to_owned(),
        ),
    };
    Verdict::Failure(Failure::bad_file(message).row(line).remedy(remedy))
}

/// A quote that no quote closes.
pub fn open_quote(file: &str, line: u64) -> Failure {
    Failure::bad_file(format!("{file} opens a quote that is never closed"))
        .row(line)
        .remedy("close the quote, or remove it")
}
