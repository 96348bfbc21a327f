//! Opening a file, with sentences for what is not a whole HDF5 file.

use std::fs::File as PlainFile;
use std::io::Read;
use std::path::Path;

use hdf5::{Dataset, File, Group};
use puncta_sdk::Failure;

use crate::error::{damaged, file_name, hdf5_reason, not_mine, unsupported};

const SIGNATURE: [u8; 8] = *b"\x89HDF\r\n\x1a\n";

/// An open file: the library's handle and its length in bytes.
pub(crate) struct Opened {
    pub(crate) file: File,
    pub(crate) length: u64,
    pub(crate) name: String,
}

/// Opens a file for reading.
///
/// # Errors
/// A missing, unreadable, foreign, truncated or locked file.
pub(crate) fn open(path: &Path) -> Result<Opened, Failure> {
    let name = file_name(path);
    let io = |error| Failure::io("read", path, &error);
    let mut plain = PlainFile::open(path).map_err(io)?;
    let length = plain.metadata().map_err(io)?.len();
    let head = head(&mut plain).map_err(io)?;
    check_signature(&head, &name)?;
    // Locks are tried, but a file system without locks is no reason to refuse.
    let file = File::with_options()
        .with_fapl(|access| access.file_locking(true))
        .open(path)
        .map_err(|error| refused(&name, length, &error))?;
    Ok(Opened { file, length, name })
}

fn refused(name: &str, length: u64, error: &hdf5::Error) -> Failure {
    let text = error.to_string();
    if text.contains("truncated file") {
        return damaged(format!(
            "{name} is cut short: its HDF5 header announces more than the {length} bytes that are there"
        ));
    }
    if text.contains("unable to lock file") {
        let remedy = "close it there, or wait until it is written";
        return unsupported(format!("{name} is locked by another program"), remedy);
    }
    damaged(format!(
        "{name} is damaged at its HDF5 header ({})",
        hdf5_reason(error)
    ))
}

/// The first 64 KiB, where the signature must stand.
fn head(file: &mut PlainFile) -> std::io::Result<Vec<u8>> {
    let mut head = Vec::new();
    file.take(8 + (1 << 16)).read_to_end(&mut head)?;
    Ok(head)
}

/// The signature stands at 0, or after a user block at 512, 1024, 2048, ...
fn check_signature(head: &[u8], name: &str) -> Result<(), Failure> {
    let places = std::iter::once(0).chain((9..=16).map(|k| 1_usize << k));
    for place in places {
        if head.get(place..place + SIGNATURE.len()) == Some(&SIGNATURE) {
            return Ok(());
        }
    }
    let seen = match head {
        [] => return Err(damaged(format!("{name} is empty"))),
        [b'P', b'K', ..] => " (it is a zip archive)",
        head if SIGNATURE.starts_with(head) => {
            return Err(damaged(format!(
                "{name} is cut short after {} bytes",
                head.len()
            )));
        }
        head if head
            .iter()
            .take(256)
            .all(|b| b.is_ascii_graphic() || b.is_ascii_whitespace()) =>
        {
            " (it is text)"
        }
        _ => "",
    };
    let remedy = "choose the reader for its real format, or export it again";
    Err(not_mine(
        format!("{name} is not an HDF5 file{seen}"),
        remedy,
    ))
}

/// Names directly below a group.
///
/// # Errors
/// A damaged group.
pub(crate) fn members(group: &Group, name: &str) -> Result<Vec<String>, Failure> {
    group.member_names().map_err(|error| {
        damaged(format!(
            "{name} is damaged at {} ({})",
            group.name(),
            hdf5_reason(&error)
        ))
    })
}

/// Opens a dataset of this file.
///
/// # Errors
/// A damaged dataset, or a link to one in another file.
pub(crate) fn dataset(opened: &Opened, at: &str) -> Result<Dataset, Failure> {
    let dataset = opened.file.dataset(at).map_err(|error| {
        damaged(format!(
            "{} is damaged at dataset {at} ({})",
            opened.name,
            hdf5_reason(&error)
        ))
    })?;
    if dataset.filename() != opened.file.filename() {
        let message = format!("{}: {at} is a link to another file", opened.name);
        return Err(unsupported(message, "open that file instead"));
    }
    Ok(dataset)
}
