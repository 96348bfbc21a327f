//! Tells formats apart by what the file holds, never by its name.

use std::path::Path;

use puncta_sdk::Failure;
use puncta_shared_import::Mapping;

use crate::error::not_mine;
use crate::info::{FORMATS, FileInfo};
use crate::mapped;
use crate::open::{self, Opened};
use crate::{decode, minflux, named_records, picasso, pyme, smap, storm_analysis};

/// Lists the tables, columns, units and metadata of a file. Reads headers and metadata only. The
/// person's mapping wins over what the file and its `.yaml` say.
///
/// # Errors
/// One sentence for a file that is no HDF5, is damaged, announces more rows than it can hold, or
/// is of a format that this crate does not read (it names what was found).
pub(crate) fn inspect(path: &Path, mapping: &Mapping) -> Result<FileInfo, Failure> {
    let opened = open::open(path)?;
    let members = open::members(&opened.file, &opened.name)?;
    let mut info = by_content(path, &opened, &members, mapping.pixel_size)?;
    mapped::apply(&mut info, mapping, &opened.name)?;
    Ok(info)
}

fn by_content(
    path: &Path,
    opened: &Opened,
    members: &[String],
    pixel_size: Option<f64>,
) -> Result<FileInfo, Failure> {
    let has = |name: &str| members.iter().any(|member| member == name);
    if has("locs") {
        if opened.file.dataset(picasso::DATASET).is_err() && opened.file.group("locs").is_ok() {
            return Err(refuse(opened, "a pandas table in the group /locs"));
        }
        return picasso::inspect(path, opened, members, pixel_size);
    }
    if pyme::matches(opened, members) {
        return pyme::inspect(opened, members);
    }
    if smap::matches(opened) {
        return smap::inspect(opened);
    }
    if decode::matches(opened) {
        return decode::inspect(opened, pixel_size);
    }
    if storm_analysis::matches(opened, members) {
        return storm_analysis::inspect(opened, members);
    }
    if minflux::is_pmx(opened) {
        return minflux::inspect_pmx(opened);
    }
    if minflux::is_mat(opened) {
        return minflux::inspect_mat(opened);
    }
    if named_records::is_spt_analyser(opened) {
        return named_records::inspect_spt_analyser(opened);
    }
    if named_records::is_pyme(opened, members) {
        return named_records::inspect_pyme(opened, members);
    }
    let records = |name: &str| opened.file.dataset(name).is_ok();
    if records("clusters") || records("groups") {
        return picasso::inspect(path, opened, members, pixel_size);
    }
    Err(refuse(opened, &found(opened, members)))
}

fn refuse(opened: &Opened, what: &str) -> Failure {
    let formats: Vec<&str> = FORMATS.iter().map(|format| format.name()).collect();
    let message = format!(
        "{} is HDF5 but holds {what}; read are {}",
        opened.name,
        formats.join(", ")
    );
    not_mine(message, "export it as one of these or as CSV")
}

/// What a file of another format holds, in words.
fn found(opened: &Opened, members: &[String]) -> String {
    let has = |name: &str| members.iter().any(|member| member == name);
    let attribute = |name: &str| opened.file.attr(name).is_ok();
    if has("ImageData") || has("PZFImageData") {
        "a PYME image stack (dataset ImageData)".into()
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
