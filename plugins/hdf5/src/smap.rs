//! SMAP: `_sml.mat` as MATLAB 7.3 writes it, one dataset of 1 x N numbers for each field below
//! `/saveloc/loc`.

use puncta_sdk::Failure;
use serde_json::json;

use crate::arrays;
use crate::columns::Meaning;
use crate::error::unsupported;
use crate::info::{FileInfo, Format, Place, Segment};
use crate::open::{self, Opened};
use crate::record::Leaf;

const GROUP: &str = "/saveloc/loc";

/// Whether the file holds SMAP's localisations.
pub(crate) fn matches(opened: &Opened) -> bool {
    opened.file.group(GROUP).is_ok()
}

/// Lists the table.
///
/// # Errors
/// No field of N numbers, or fields that differ in their number.
pub(crate) fn inspect(opened: &Opened) -> Result<FileInfo, Failure> {
    let group = opened.file.group(GROUP).map_err(|e| {
        let why = crate::error::hdf5_reason(&e);
        crate::error::damaged(format!("{} is damaged at {GROUP} ({why})", opened.name))
    })?;
    let mut fields = Vec::new();
    let mut skipped = Vec::new();
    let mut rows = None;
    for name in open::members(&group, &opened.name)? {
        let array = match opened.file.dataset(&format!("{GROUP}/{name}")) {
            Ok(_) => arrays::array(opened, &format!("{GROUP}/{name}"))?,
            Err(_) => None,
        };
        let list = array.and_then(|array| Some((array.list_axis()?, array)));
        let Some((axis, array)) = list else {
            skipped.push(name);
            continue;
        };
        let count = array.rows(axis);
        if *rows.get_or_insert(count) != count {
            skipped.push(name);
            continue;
        }
        fields.push((array.leaf(&name, 0), Place::list(&name, axis)));
    }
    let there = |name: &str| fields.iter().any(|(leaf, _)| leaf.name == name);
    if !there("xnm") && !there("x") || !there("frame") {
        let message = format!(
            "{}, group {GROUP}: there is no xnm or no frame",
            opened.name
        );
        return Err(unsupported(
            message,
            "save the localisations from SMAP again",
        ));
    }
    let precision = there("locprecnm");
    let unread = format!("Not read from {GROUP}: {}.", skipped.join(", "));
    let notes = (!skipped.is_empty())
        .then_some(unread)
        .into_iter()
        .collect();
    let segment = Segment {
        group: format!("{GROUP}/"),
        rows: rows.unwrap_or(0),
    };
    let meanings = |leaf: &Leaf| meanings(leaf, precision);
    let table = arrays::table(
        "localisations",
        "localisations",
        vec![segment],
        fields,
        meanings,
    );
    Ok(FileInfo {
        format: Format::Smap,
        tables: vec![table],
        metadata: json!({ "source_format": "SMAP" }),
        notes,
        pixel: None,
        frame_base: 1,
    })
}

fn meanings(leaf: &Leaf, precision: bool) -> Vec<Meaning> {
    let name = leaf.name.as_str();
    let nm = |to: &str| Meaning::plain(to, "nm").scaled(1.0);
    let error = |to: &str| nm(to).role("error").described("localisation precision");
    let position = |to: &str| nm(to).role("position").described("position");
    vec![match name {
        "xnm" => position("x"),
        "ynm" => position("y"),
        "znm" => position("z"),
        "frame" => Meaning::plain("t", "frame").role("time"),
        "phot" => Meaning::plain("nPhotons", "photon").described("photons of the spot"),
        "bg" => Meaning::plain("background", "photon").described("photons per camera pixel"),
        "locprecnm" => return vec![error("error_x"), error("error_y")],
        "locprecznm" => error("error_z"),
        "xnmerr" | "xerrnm" if !precision => error("error_x"),
        "ynmerr" | "yerrnm" if !precision => error("error_y"),
        "PSFxnm" => Meaning::plain("sigx", "nm").described("standard deviation of the spot"),
        "PSFynm" => Meaning::plain("sigy", "nm").described("standard deviation of the spot"),
        "channel" | "filenumber" | "iterations" | "numberInGroup" => Meaning::plain(name, "1"),
        "groupindex" => Meaning::plain(name, "1").role("group"),
        _ if name.ends_with("nmerr") || name.ends_with("errnm") => Meaning::plain(name, "nm"),
        _ if name.contains("pix") => Meaning::plain(name, "px"),
        "photerr" => Meaning::plain(name, "photon"),
        _ => Meaning::plain(name, "unknown"),
    }]
}
