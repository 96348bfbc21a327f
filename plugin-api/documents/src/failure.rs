//! Why a call failed, for the person at the screen.

use crate::Map;
use serde::{Deserialize, Serialize};
use std::fmt;

/// What kind of thing went wrong.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum FailureCode {
    /// The person or the host stopped the call.
    Cancelled,
    /// A parameter's value cannot be used.
    BadParameter,
    /// An input object cannot be used: a column is missing, a unit is wrong, it is empty.
    BadInput,
    /// A file's content is damaged or not as its format says.
    BadFile,
    /// Known, but not supported.
    Unsupported,
    /// The file is of another format.
    NotMine,
    /// The operating system refused to read or write.
    Io,
    /// An iteration did not converge.
    NoConvergence,
    /// Memory, disk or time would not suffice.
    Resources,
    /// An instrument failed.
    Device,
    /// The plugin panicked or ended its process.
    Crashed,
    /// A defect of the program.
    #[serde(other)]
    Internal,
}

/// One sentence that says what failed and where, with what to do about it. Format `puncta.failure/1`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Failure {
    /// Kind of failure.
    pub code: FailureCode,
    /// What and where, without a final full stop.
    pub message: String,
    /// What to do, without a final full stop.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub remedy: Option<String>,
    /// Parameter that is to blame.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub parameter: Option<String>,
    /// Row of the file or table, counted from 1 as an editor shows it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub row: Option<u64>,
    /// Members that this version does not know.
    #[serde(flatten)]
    pub rest: Map,
}

/// Format of [`Failure`].
pub const FAILURE: &str = "puncta.failure/1";

impl Failure {
    /// A failure with a message.
    pub fn new(code: FailureCode, message: impl Into<String>) -> Failure {
        Failure {
            code,
            message: message.into(),
            remedy: None,
            parameter: None,
            row: None,
            rest: Map::new(),
        }
    }

    /// Adds what to do.
    #[must_use]
    pub fn remedy(mut self, remedy: impl Into<String>) -> Failure {
        self.remedy = Some(remedy.into());
        self
    }

    /// Names the parameter that is to blame.
    #[must_use]
    pub fn parameter(mut self, name: impl Into<String>) -> Failure {
        self.parameter = Some(name.into());
        self
    }

    /// Names the row, counted from 1.
    #[must_use]
    pub fn row(mut self, row: u64) -> Failure {
        self.row = Some(row);
        self
    }

    /// The call was stopped.
    #[must_use]
    pub fn cancelled() -> Failure {
        Failure::new(FailureCode::Cancelled, "stopped before it was finished")
    }

    /// A parameter cannot be used.
    pub fn bad_parameter(name: &str, message: impl Into<String>) -> Failure {
        Failure::new(FailureCode::BadParameter, message).parameter(name)
    }

    /// An input cannot be used.
    pub fn bad_input(message: impl Into<String>) -> Failure {
        Failure::new(FailureCode::BadInput, message)
    }

    /// A file's content cannot be used.
    pub fn bad_file(message: impl Into<String>) -> Failure {
        Failure::new(FailureCode::BadFile, message)
    }

    /// The operating system refused.
    pub fn io(what: &str, path: &std::path::Path, error: &std::io::Error) -> Failure {
        Failure::new(
            FailureCode::Io,
            format!("cannot {what} {}: {}", path.display(), plain_io(error)),
        )
    }

    /// A defect of the program.
    pub fn internal(message: impl Into<String>) -> Failure {
        Failure::new(FailureCode::Internal, message)
    }

    /// Whether the call was stopped rather than failed.
    #[must_use]
    pub fn is_cancelled(&self) -> bool {
        self.code == FailureCode::Cancelled
    }

    /// Puts `context` and a colon before the message.
    #[must_use]
    pub fn context(mut self, context: impl fmt::Display) -> Failure {
        self.message = format!("{context}: {}", self.message);
        self
    }
}

fn plain_io(error: &std::io::Error) -> String {
    use std::io::ErrorKind;
    match error.kind() {
        ErrorKind::NotFound => "there is no such file or folder".into(),
        ErrorKind::PermissionDenied => "permission denied".into(),
        ErrorKind::StorageFull => "the disk is full".into(),
        ErrorKind::IsADirectory => "it is a folder".into(),
        ErrorKind::UnexpectedEof => "it ends too early".into(),
        _ => {
            // The operating system's text, without the "(os error N)" that helps nobody.
            let text = error.to_string();
            text.split(" (os error")
                .next()
                .unwrap_or(&text)
                .to_lowercase()
        }
    }
}

impl fmt::Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.message)?;
        if let Some(row) = self.row {
            write!(f, " (row {row})")?;
        }
        if let Some(remedy) = &self.remedy {
            write!(f, "; {remedy}")?;
        }
        Ok(())
    }
}

impl std::error::Error for Failure {}
