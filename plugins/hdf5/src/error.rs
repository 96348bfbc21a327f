//! Failures as one sentence for the person at the screen: what, where, what to do.

use std::path::Path;

use puncta_sdk::{Failure, FailureCode};

const COPY_AGAIN: &str = "copy it again from its source";

/// The file says it is of a format read here, but its content is broken.
pub(crate) fn damaged(message: impl Into<String>) -> Failure {
    Failure::bad_file(message).remedy(COPY_AGAIN)
}

/// Sound, but of a kind that is not read here.
pub(crate) fn unsupported(message: impl Into<String>, remedy: &str) -> Failure {
    Failure::new(FailureCode::Unsupported, message).remedy(remedy)
}

/// Of another format.
pub(crate) fn not_mine(message: impl Into<String>, remedy: &str) -> Failure {
    Failure::new(FailureCode::NotMine, message).remedy(remedy)
}

/// The file's name without its folder, for sentences.
pub(crate) fn file_name(path: &Path) -> String {
    path.file_name()
        .unwrap_or(path.as_os_str())
        .to_string_lossy()
        .into_owned()
}

/// The innermost words of an HDF5 error, shortened and on one line.
pub(crate) fn hdf5_reason(error: &hdf5::Error) -> String {
    let text = error.to_string();
    let line = text
        .lines()
        .next()
        .unwrap_or_default()
        .trim()
        .trim_end_matches('.');
    line.chars().take(160).collect()
}
