//! Picasso: records in `/locs`, and a `.yaml` of the same name whose documents are the processing
//! steps. Positions, precisions and spot widths are stored in camera pixels.

use std::fs::File;
use std::io::Read;
use std::path::Path;

use puncta_sdk::Failure;
use serde_json::{Map, Value, json};

use crate::columns::{self, Meaning, Records};
use crate::error::{file_name, unsupported};
use crate::info::{FieldOfView, FileInfo, Format, TableInfo};
use crate::open::Opened;
use crate::record::Leaf;
use crate::yaml;

pub(crate) const DATASET: &str = "/locs";
/// Cluster centres of older versions, and the properties of picks.
pub(crate) const CLUSTERS: &str = "/clusters";
const PICKS: &str = "/groups";
const REQUIRED: [&str; 3] = ["frame", "x", "y"];

/// Lists the table of a Picasso file whose root holds `members`. `pixel_size` (nm) stands in for, and wins over, the one in
/// the `.yaml`.
///
/// # Errors
/// Missing columns, or records that cannot be read.
pub(crate) fn inspect(
    path: &Path,
    opened: &Opened,
    members: &[String],
    pixel_size: Option<f64>,
) -> Result<FileInfo, Failure> {
    let has = |dataset: &str| {
        members
            .iter()
            .any(|member| dataset.trim_start_matches('/') == member)
    };
    let at = [DATASET, CLUSTERS, PICKS].into_iter().find(|d| has(d));
    let at = at.unwrap_or(DATASET);
    let records = columns::records(opened, at)?;
    if at == DATASET {
        check_required(opened, &records)?;
    }
    let mut notes = Vec::new();
    let documents = sidecar(path, &mut notes);
    let pixel = choose_pixel_size(path, &documents, pixel_size, &mut notes);
    records.note_skipped(&mut notes);
    let (width, height) = (first(&documents, "Width"), first(&documents, "Height"));
    let frames = first(&documents, "Frames");
    let field = match (width, height, records.number("x"), records.number("y")) {
        (Some(width), Some(height), Some(x), Some(y)) => Some(FieldOfView {
            width,
            height,
            x: x.clone(),
            y: y.clone(),
        }),
        _ => None,
    };
    let mut table = records.table("localisations", "localisations", None, |leaf| {
        vec![meaning(leaf)]
    });
    table.field = field;
    let mut tables = vec![table];
    let (picks, unread) = picks(opened, members, at, &mut notes);
    tables.extend(picks);
    columns::note_unread(&unread, &[at], &mut notes);
    let metadata = metadata(pixel, width, height, frames, documents);
    Ok(FileInfo {
        format: Format::Picasso,
        tables,
        metadata,
        notes,
        pixel,
        frame_base: 0,
    })
}

/// The properties of picks or clusters beside localisations, and the members that stay unread.
fn picks(
    opened: &Opened,
    members: &[String],
    at: &str,
    notes: &mut Vec<String>,
) -> (Vec<TableInfo>, Vec<String>) {
    let mut tables = Vec::new();
    let mut unread = Vec::new();
    for member in members {
        let place = format!("/{member}");
        let known = [CLUSTERS, PICKS].contains(&place.as_str()) && place != at;
        match columns::records(opened, &place).ok().filter(|_| known) {
            Some(records) => {
                records.note_skipped(notes);
                tables.push(records.table("tables", member, None, |leaf| vec![meaning(leaf)]));
            }
            None => unread.push(member.clone()),
        }
    }
    (tables, unread)
}

fn check_required(opened: &Opened, records: &Records) -> Result<(), Failure> {
    let missing: Vec<_> = REQUIRED
        .into_iter()
        .filter(|name| records.number(name).is_none())
        .collect();
    if missing.is_empty() {
        return Ok(());
    }
    let found: Vec<_> = records
        .fields
        .leaves
        .iter()
        .map(|leaf| leaf.name.as_str())
        .collect();
    let message = format!(
        "{}, dataset {DATASET}: numeric column {} is missing among {}",
        opened.name,
        missing.join(", "),
        found.join(", ")
    );
    Err(unsupported(
        message,
        "export the localisations from Picasso again",
    ))
}

/// The documents of the `.yaml`; without one there are none, and a note says so.
fn sidecar(path: &Path, notes: &mut Vec<String>) -> Vec<Value> {
    let path = path.with_extension("yaml");
    let name = file_name(&path);
    let mut bytes = Vec::new();
    let read =
        File::open(&path).and_then(|file| file.take(yaml::MAX_INPUT + 1).read_to_end(&mut bytes));
    if let Err(error) = read {
        notes.push(match error.kind() {
            std::io::ErrorKind::NotFound => format!("{name} is not beside the file."),
            _ => format!("{name} cannot be read ({error})."),
        });
        return Vec::new();
    }
    if bytes.len() as u64 > yaml::MAX_INPUT {
        notes.push(format!("{name} is larger than 16 MB and was not read."));
        return Vec::new();
    }
    match yaml::documents(&String::from_utf8_lossy(&bytes)) {
        Ok(documents) => documents,
        Err(why) => {
            notes.push(format!(
                "{name} is not sound YAML ({why}) and was not used."
            ));
            Vec::new()
        }
    }
}

/// A number of a document, also where it was written as text.
fn number(document: &Value, key: &str) -> Option<f64> {
    let value = document.get(key)?;
    value
        .as_f64()
        .or_else(|| value.as_str()?.trim().parse().ok())
}

fn positive(document: &Value, key: &str) -> Option<f64> {
    number(document, key).filter(|&value| value.is_finite() && value > 0.0)
}

fn first(documents: &[Value], key: &str) -> Option<f64> {
    documents
        .iter()
        .find_map(|document| positive(document, key))
}

/// The pixel size in nm: the option, else the last step's `Pixelsize`, as Picasso itself does.
fn choose_pixel_size(
    path: &Path,
    documents: &[Value],
    option: Option<f64>,
    notes: &mut Vec<String>,
) -> Option<f64> {
    let sizes: Vec<f64> = documents
        .iter()
        .filter_map(|d| positive(d, "Pixelsize"))
        .collect();
    let camera = documents.iter().find_map(|d| {
        positive(d, "Camera.Pixelsize").or_else(|| positive(d.get("Camera")?, "Pixelsize"))
    });
    let chosen = option.or(sizes.last().copied());
    let yaml = file_name(&path.with_extension("yaml"));
    match (option, chosen) {
        (_, None) => notes.push(format!(
            "{yaml} gives no Pixelsize, so lengths stay in camera pixels without a unit; \
             set pixel_size to the camera's pixel in nm to convert them."
        )),
        (Some(given), _) if sizes.last().is_some_and(|&size| size != given) => {
            let size = sizes.last().copied().unwrap_or_default();
            notes.push(format!(
                "The given pixel size of {given} nm is used, {yaml} says {size} nm."
            ));
        }
        (None, Some(size)) if sizes.iter().any(|&other| other != size) => {
            let all: Vec<_> = sizes.iter().map(f64::to_string).collect();
            let all = all.join(", ");
            notes.push(format!(
                "Steps of {yaml} disagree on Pixelsize ({all} nm); {size} nm is used."
            ));
        }
        (None, Some(size)) if camera.is_some_and(|camera| camera != size) => {
            let camera = camera.unwrap_or_default();
            notes.push(format!(
                "{yaml} has Pixelsize {size} nm but Camera.Pixelsize {camera} nm; \
                 {size} nm is used, as in Picasso."
            ));
        }
        _ => {}
    }
    chosen
}

fn metadata(
    pixel: Option<f64>,
    width: Option<f64>,
    height: Option<f64>,
    frames: Option<f64>,
    documents: Vec<Value>,
) -> Value {
    let mut camera = Map::new();
    let entries = [
        ("pixel_size_nm", pixel),
        ("width_px", width),
        ("height_px", height),
        ("frames", frames),
    ];
    for (key, value) in entries {
        if let Some(value) = value {
            camera.insert(key.into(), whole(value));
        }
    }
    json!({ "source_format": "Picasso", "camera": camera, "picasso": documents })
}

/// Counts as integers.
fn whole(value: f64) -> Value {
    if value.fract() == 0.0 && value < 9e15 {
        Value::from(value as i64)
    } else {
        Value::from(value)
    }
}

/// What Picasso's columns mean. Means and deviations of picks have the unit of their column.
fn meaning(leaf: &Leaf) -> Meaning {
    let stored = leaf.name.as_str();
    let name = stored.to_lowercase();
    let length =
        |canonical: &str, what: &str| Meaning::plain(canonical, "px").scaled(1.0).described(what);
    match stored {
        "frame" => Meaning::plain("t", "frame")
            .role("time")
            .described("camera frame"),
        "x" => length("x", "position").role("position"),
        "y" => length("y", "position").role("position"),
        "z" => Meaning::plain("z", "nm")
            .scaled(1.0)
            .role("position")
            .described("position"),
        "lpx" => length("error_x", "localisation precision").role("error"),
        "lpy" => length("error_y", "localisation precision").role("error"),
        "lpz" => Meaning::plain("error_z", "nm")
            .scaled(1.0)
            .role("error")
            .described("localisation precision"),
        "sx" => length("sigx", "standard deviation of the spot"),
        "sy" => length("sigy", "standard deviation of the spot"),
        "photons" => Meaning::plain("nPhotons", "photon").described("photons of the spot"),
        "bg" => Meaning::plain("background", "photon").described("photons per camera pixel"),
        "std_x" | "std_y" => Meaning::plain(&name, "px"),
        "std_z" => Meaning::plain(&name, "nm"),
        "group" => Meaning::plain(&name, "1").role("group"),
        "len" | "std_frame" => Meaning::plain(&name, "frame"),
        "n" | "n_locs" | "n_events" | "iterations" | "ellipticity" => Meaning::plain(&name, "1"),
        "photon_rate" => Meaning::plain(&name, "photon/frame"),
        _ => {
            let stem = name
                .strip_suffix("_mean")
                .or_else(|| name.strip_suffix("_std"));
            let unit = match stem.unwrap_or_default() {
                "x" | "y" | "lpx" | "lpy" | "sx" | "sy" => "px",
                "z" | "lpz" => "nm",
                "frame" => "frame",
                "photons" | "bg" => "photon",
                _ => "unknown",
            };
            Meaning::plain(&name, unit)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn chosen(documents: &[Value], option: Option<f64>) -> (Option<f64>, Vec<String>) {
        let mut notes = Vec::new();
        let size = choose_pixel_size(Path::new("a.hdf5"), documents, option, &mut notes);
        (size, notes)
    }

    #[test]
    fn pixel_size_follows_pixelsize_and_says_so() {
        let (size, notes) = chosen(
            &[json!({"Camera.Pixelsize": 160}), json!({"Pixelsize": 130})],
            None,
        );
        assert_eq!(size, Some(130.0));
        assert!(
            notes[0].contains("160") && notes[0].contains("130"),
            "{notes:?}"
        );
        let (size, notes) = chosen(
            &[json!({"Pixelsize": 130}), json!({"Pixelsize": "107.5"})],
            None,
        );
        assert_eq!(size, Some(107.5));
        assert_eq!(notes.len(), 1);
        let (size, notes) = chosen(&[json!({"Pixelsize": 130})], Some(100.0));
        assert_eq!((size, notes.len()), (Some(100.0), 1));
        let (size, notes) = chosen(&[json!({"Pixelsize": -1})], None);
        assert_eq!(size, None);
        assert!(notes[0].contains("set pixel_size"), "{notes:?}");
        assert_eq!(
            chosen(&[json!({"Pixelsize": 130})], None),
            (Some(130.0), Vec::new())
        );
    }
}
