//! Tells formats apart by what the file holds, never by its name.

use std::path::Path;

use puncta_sdk::Failure;

use crate::error::not_mine;
use crate::info::FileInfo;
use crate::open::{self, Opened};
use crate::{picasso, pyme};

/// Lists the tables, columns, units and metadata of a file. Reads headers and metadata only.
/// `pixel_size` is the camera pixel in nm for Picasso files; it wins over the `.yaml`.
///
/// # Errors
/// One sentence for a file that is no HDF5, is damaged, announces more rows than it can hold, or
/// is of a format that this crate does not read (it names what was found).
pub(crate) fn inspect(path: &Path, pixel_size: Option<f64>) -> Result<FileInfo, Failure> {
    let opened = open::open(path)?;
    let members = open::members(&opened.file, &opened.name)?;
    let has = |name: &str| members.iter().any(|member| member == name);
    if has("locs") {
        if opened.file.dataset(picasso::DATASET).is_err() && opened.file.group("locs").is_ok() {
            return Err(refuse(&opened, "a pandas table in the group /locs"));
        }
        return picasso::inspect(path, &opened, &members, pixel_size);
    }
    if pyme::matches(&opened, &members) {
        return pyme::inspect(&opened, &members);
    }
    Err(refuse(&opened, &found(&opened, &members)))
}

fn refuse(opened: &Opened, what: &str) -> Failure {
    let message = format!(
        "{} is HDF5 but holds {what}, and only Picasso files (dataset /locs) and PYME fit results \
         (.h5r, table /FitResults) are read here",
        opened.name
    );
    not_mine(message, "export it as one of these or as CSV")
}

/// What a file of another format holds, in words.
fn found(opened: &Opened, members: &[String]) -> String {
    let has = |name: &str| members.iter().any(|member| member == name);
    let attribute = |name: &str| opened.file.attr(name).is_ok();
    if has("saveloc") {
        "SMAP localisations (MATLAB 7.3, group saveloc)".into()
    } else if has("data") && opened.file.dataset("/data/xyz").is_ok() {
        "DECODE localisations (dataset /data/xyz)".into()
    } else if has("fr_0") || attribute("movie_hash_value") {
        "storm-analysis localisations (groups fr_0, fr_1, ...)".into()
    } else if has("ImageData") || has("PZFImageData") {
        "a PYME image stack (dataset ImageData)".into()
    } else if has("groups") || has("clusters") {
        "Picasso pick or cluster properties without localisations".into()
    } else if attribute("PYTABLES_FORMAT_VERSION") {
        format!("PYME or other PyTables tables ({})", names(members))
    } else if opened.file.userblock() >= 512 {
        format!(
            "MATLAB 7.3 or other data behind a user block ({})",
            names(members)
        )
    } else if members.is_empty() {
        "nothing".into()
    } else {
        names(members)
    }
}

fn names(members: &[String]) -> String {
    let shown: Vec<_> = members
        .iter()
        .take(6)
        .map(|name| format!("/{name}"))
        .collect();
    let more = if members.len() > 6 { ", ..." } else { "" };
    format!("{}{more}", shown.join(", "))
}
