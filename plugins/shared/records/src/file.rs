//! The file of a call, and failures that all readers word alike.

use puncta_sdk::{Failure, FailureCode, Request};
use std::fs::File;
use std::io::Read;
use std::path::PathBuf;

/// The file to read, opened.
#[derive(Debug)]
pub struct Opened {
    /// The file.
    pub file: File,
    /// Where it is.
    pub path: PathBuf,
    /// The name the person knows it by.
    pub name: String,
    /// Bytes.
    pub length: u64,
    /// The first bytes, as many as were wanted or there are.
    pub head: Vec<u8>,
}

/// Opens the file of a request and reads its first `look` bytes.
///
/// # Errors
/// When there is none, or it cannot be read.
pub fn open(request: &Request, look: usize) -> Result<Opened, Failure> {
    let reference = request.file.as_ref();
    let reference = reference.ok_or_else(|| Failure::internal("the call has no file"))?;
    let path = PathBuf::from(&reference.path);
    let fault = |error: std::io::Error| Failure::io("read", &path, &error);
    let mut file = File::open(&path).map_err(fault)?;
    let length = file.metadata().map_err(fault)?.len();
    let mut head = Vec::new();
    let wanted = (&mut file).take(look as u64);
    let mut wanted = wanted;
    wanted.read_to_end(&mut head).map_err(fault)?;
    Ok(Opened {
        file,
        name: reference.name.clone(),
        length,
        head,
        path,
    })
}

/// The file is of another format.
#[must_use]
pub fn not_mine(name: &str, what: &str) -> Failure {
    Failure::new(FailureCode::NotMine, format!("{name} is no {what}"))
}

/// The file says it is of this format, but its content is broken.
#[must_use]
pub fn damaged(message: impl Into<String>) -> Failure {
    Failure::bad_file(message).remedy("copy it again from its source")
}

/// Sound, but of a kind that is not read.
#[must_use]
pub fn unsupported(message: impl Into<String>, remedy: &str) -> Failure {
    Failure::new(FailureCode::Unsupported, message).remedy(remedy)
}
