//! PYME fit results, `.h5r`: nested records in `/FitResults`, events in `/Events`, fiducial fits
//! in `/DriftResults`, and acquisition metadata as attributes of groups below `/MetaData`.

use puncta_sdk::Failure;
use serde_json::{Map, Value, json};

use crate::attributes;
use crate::columns::{self, Meaning};
use crate::derived;
use crate::error::{hdf5_reason, unsupported};
use crate::info::{FileInfo, Format, TableInfo};
use crate::open::{self, Opened};
use crate::record::Leaf;

const FITS: &str = "/FitResults";
const FIDUCIALS: &str = "/DriftResults";
pub(crate) const EVENTS: &str = "/Events";
pub(crate) const METADATA: &str = "/MetaData";

/// Lists the tables of an `.h5r` file whose root holds `members`.
///
/// # Errors
/// Fit results that are damaged or cannot be read.
pub(crate) fn inspect(opened: &Opened, members: &[String]) -> Result<FileInfo, Failure> {
    let has = |dataset: &str| {
        members
            .iter()
            .any(|member| member == dataset.trim_start_matches('/'))
    };
    let mut notes = Vec::new();
    let mut tables = Vec::new();
    if has(FITS) {
        tables.push(fits(opened, FITS, "localisations", &mut notes)?);
    }
    if has(FIDUCIALS) {
        let name = if has(FITS) {
            "fiducials"
        } else {
            "localisations"
        };
        tables.push(fits(opened, FIDUCIALS, name, &mut notes)?);
        if !has(FITS) {
            notes.push(format!(
                "There is no {FITS}; {FIDUCIALS} is read in its place."
            ));
        }
    }
    if has(EVENTS) {
        match events(opened) {
            Ok(table) => tables.push(table),
            Err(failure) => notes.push(format!("Events are left out: {failure}.")),
        }
    }
    columns::note_unread(members, &[FITS, FIDUCIALS, EVENTS, METADATA], &mut notes);
    let tree = if has(METADATA) {
        tree(opened, &mut notes)
    } else {
        json!({})
    };
    if let Some(table) = tables.first_mut().filter(|_| has(FITS) || has(FIDUCIALS)) {
        derived::add(opened, table, &tree, has(EVENTS), &mut notes);
    }
    let metadata = json!({ "source_format": "PYME h5r", "camera": camera(&tree), "pyme": tree });
    Ok(FileInfo {
        format: Format::PymeH5r,
        tables,
        metadata,
        notes,
        pixel: None,
        frame_base: 0,
    })
}

pub(crate) fn tree(opened: &Opened, notes: &mut Vec<String>) -> Value {
    match opened.file.group(METADATA) {
        Ok(group) => attributes::tree(&group, notes),
        Err(error) => {
            let why = hdf5_reason(&error);
            notes.push(format!("{METADATA} cannot be read ({why})."));
            json!({})
        }
    }
}

/// The entries that operations look for, in plain units.
pub(crate) fn camera(tree: &Value) -> Value {
    let number = |path: &str| tree.pointer(path).and_then(Value::as_f64);
    let mut camera = Map::new();
    let mut put = |key: &str, value: Option<Value>| {
        if let Some(value) = value {
            camera.insert(key.to_owned(), value);
        }
    };
    // The voxel size is in micrometres.
    let pixel = number("/voxelsize/x").filter(|size| *size > 0.0);
    put(
        "pixel_size_nm",
        pixel.map(|size| Value::from(size * 1000.0)),
    );
    put("width_px", tree.pointer("/Camera/ROIWidth").cloned());
    put("height_px", tree.pointer("/Camera/ROIHeight").cloned());
    put("cycle_time_s", tree.pointer("/Camera/CycleTime").cloned());
    Value::Object(camera)
}

fn fits(
    opened: &Opened,
    dataset: &str,
    name: &'static str,
    notes: &mut Vec<String>,
) -> Result<TableInfo, Failure> {
    let records = columns::records(opened, dataset)?;
    records.note_skipped(notes);
    if records.number("fitResults_x0").is_none() || records.number("fitResults_y0").is_none() {
        notes.push(format!(
            "{dataset} has no fitted positions (fitResults x0, y0)."
        ));
    }
    let sort_by = records.number("tIndex").cloned();
    Ok(records.table(name, name, sort_by, meanings))
}

pub(crate) fn events(opened: &Opened) -> Result<TableInfo, Failure> {
    let records = columns::records(opened, EVENTS)?;
    let has = |name: &str| records.fields.leaves.iter().any(|leaf| leaf.name == name);
    if !has("EventName") || !has("Time") {
        let message = format!(
            "{}, dataset {EVENTS}: EventName or Time is missing",
            opened.name
        );
        return Err(unsupported(message, "export the file from PYME again"));
    }
    Ok(records.table("events", "events", None, |leaf| {
        let name = leaf.name.as_str();
        vec![match name {
            "Time" => Meaning::plain(name, "s").described("seconds since 1970, UTC"),
            "EventName" => Meaning::plain(name, "unknown").described("kind of event"),
            "EventDescr" => {
                Meaning::plain(name, "unknown").described("its values, separated by commas")
            }
            _ => Meaning::plain(name, "unknown"),
        }]
    }))
}

/// The field under its own name, and under the canonical one where it has one.
fn meanings(leaf: &Leaf) -> Vec<Meaning> {
    let own = Meaning::plain(&leaf.name, unit(&leaf.name));
    std::iter::once(own).chain(canonical(&leaf.name)).collect()
}

/// What the fit modules' columns are called here.
fn canonical(name: &str) -> Option<Meaning> {
    let position = |to: &str| {
        Meaning::plain(to, "nm")
            .scaled(1.0)
            .role("position")
            .described("fitted position from the corner of the camera's region")
    };
    let error = |to: &str| {
        Meaning::plain(to, "nm")
            .scaled(1.0)
            .role("error")
            .described("estimated error of the fit; -5000 where it failed")
    };
    Some(match name {
        "tIndex" => Meaning::plain("t", "frame")
            .role("time")
            .described("camera frame"),
        "fitResults_x0" => position("x"),
        "fitResults_y0" => position("y"),
        "fitError_x0" => error("error_x"),
        "fitError_y0" => error("error_y"),
        "fitError_z0" => error("error_z"),
        "fitResults_A" => Meaning::plain("A", "ADU").described("fitted amplitude in camera counts"),
        "fitResults_sigma" => {
            Meaning::plain("sig", "nm").described("fitted standard deviation of the spot")
        }
        _ => return None,
    })
}

fn unit(name: &str) -> &'static str {
    let fitted = name
        .strip_prefix("fitResults_")
        .or_else(|| name.strip_prefix("fitError_"))
        .or_else(|| name.strip_prefix("startParams_"));
    match fitted {
        Some("A") => "ADU",
        Some("x0" | "y0" | "z0" | "sigma" | "sigmax" | "sigmay" | "dx" | "dy") => "nm",
        Some(_) => "unknown",
        None if name.starts_with("slicesUsed_") => "1",
        None if matches!(name, "resultCode" | "nFit" | "nchi2") => "1",
        None if name == "tIndex" => "frame",
        None => "unknown",
    }
}

/// Whether root members are those of an `.h5r` file.
pub(crate) fn matches(opened: &Opened, members: &[String]) -> bool {
    let has = |name: &str| members.iter().any(|member| member == name);
    has("FitResults") || has("DriftResults") && open::dataset(opened, FIDUCIALS).is_ok()
}
