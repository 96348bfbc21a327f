//! DECODE: datasets below `/data`, N or N x 3 numbers; what was all NaN is a dataset without a
//! dataspace. `/meta` says the unit of x and y and the camera pixel along both.

use puncta_sdk::Failure;
use serde_json::{Value, json};

use crate::arrays::{self, Array};
use crate::attributes::attribute;
use crate::columns::Meaning;
use crate::error::unsupported;
use crate::info::{FileInfo, Format, Place, Segment};
use crate::open::{self, Opened};
use crate::record::Leaf;

const GROUP: &str = "/data";
const AXES: [&str; 3] = ["x", "y", "z"];

/// Whether the file holds DECODE's emitters.
pub(crate) fn matches(opened: &Opened) -> bool {
    opened.file.dataset("/data/xyz").is_ok() && opened.file.dataset("/data/frame_ix").is_ok()
}

/// Lists the table. `given` is the person's pixel size, which wins.
///
/// # Errors
/// Positions that are not N x 3, or a damaged dataset.
pub(crate) fn inspect(opened: &Opened, given: Option<f64>) -> Result<FileInfo, Failure> {
    let (rows, fields, empty) = fields(opened)?;
    let (unit, size) = lateral(opened);
    let sizes = size.filter(|_| given.is_none());
    let pixels = unit.as_deref() == Some("px");
    let mut notes = Vec::new();
    if unit.is_none() {
        notes.push(format!("{} does not say the unit of x and y.", opened.name));
    }
    if !empty.is_empty() {
        notes.push(format!(
            "Without values, so left out: {}.",
            empty.join(", ")
        ));
    }
    let lateral = |axis: usize| match (unit.as_deref(), sizes) {
        (Some("px"), Some(sizes)) => ("nm", sizes.get(axis).copied().unwrap_or(1.0)),
        (Some("px"), None) => ("px", 1.0),
        (Some("nm"), _) => ("nm", 1.0),
        _ => ("unknown", 1.0),
    };
    let meanings = |leaf: &Leaf| vec![meaning(leaf, &lateral)];
    let segment = Segment {
        group: format!("{GROUP}/"),
        rows,
    };
    let table = arrays::table(
        "localisations",
        "localisations",
        vec![segment],
        fields,
        meanings,
    );
    let meta = json!({ "xy_unit": unit, "px_size": size });
    Ok(FileInfo {
        format: Format::Decode,
        tables: vec![table],
        metadata: json!({ "source_format": "DECODE", "decode": meta }),
        notes,
        pixel: given.filter(|_| pixels),
        frame_base: 0,
    })
}

/// The number of rows, the fields, and the datasets without values.
#[allow(clippy::type_complexity, reason = "three lists of one look")]
fn fields(opened: &Opened) -> Result<(u64, Vec<(Leaf, Place)>, Vec<String>), Failure> {
    let group = opened.file.group(GROUP);
    let group = group
        .map_err(|_| unsupported(format!("{} has no {GROUP}", opened.name), "export it again"))?;
    let positions = arrays::array(opened, "/data/xyz")?;
    let rows = match positions.as_ref().map(|p| p.shape.as_slice()) {
        Some([rows, 3]) => *rows,
        Some([0]) => 0,
        _ => {
            let message = format!(
                "{}, dataset /data/xyz: N x 3 numbers are expected",
                opened.name
            );
            return Err(unsupported(message, "save the emitters from DECODE again"));
        }
    };
    let mut fields = Vec::new();
    let mut empty = Vec::new();
    for name in open::members(&group, &opened.name)? {
        let Some(array) = arrays::array(opened, &format!("{GROUP}/{name}"))? else {
            continue;
        };
        match columns(&name, &array, rows) {
            Some(columns) => fields.extend(columns),
            None => empty.push(name),
        }
    }
    Ok((rows, fields, empty))
}

/// The columns of a dataset of N numbers or N x 3; `None` where it has other rows.
fn columns(name: &str, array: &Array, rows: u64) -> Option<Vec<(Leaf, Place)>> {
    let place = |width: u64| Place::Dataset {
        name: name.to_owned(),
        axis: 0,
        lead: Vec::new(),
        width,
    };
    match array.shape.as_slice() {
        [count] if *count == rows && (rows > 0 || !name.starts_with("xyz")) => {
            Some(vec![(array.leaf(name, 0), place(1))])
        }
        [count, 3] if *count == rows => {
            let suffix = name.strip_prefix("xyz").unwrap_or(name);
            let axes = AXES.iter().enumerate();
            let one =
                |(k, axis): (usize, &&str)| (array.leaf(&format!("{axis}{suffix}"), k), place(3));
            Some(axes.map(one).collect())
        }
        _ => None,
    }
}

/// The unit of x and y, and the camera pixel along both in nm.
fn lateral(opened: &Opened) -> (Option<String>, Option<[f64; 2]>) {
    let Ok(meta) = opened.file.group("/meta") else {
        return (None, None);
    };
    let value = |name: &str| attribute(&meta, name).ok().map(|(value, _)| value);
    let unit = value("xy_unit").and_then(|v| v.as_str().map(str::to_owned));
    let size = value("px_size").and_then(|v| {
        let at = |k: usize| v.get(k).and_then(Value::as_f64).filter(|s| *s > 0.0);
        Some([at(0)?, at(1)?])
    });
    (unit, size)
}

fn meaning(leaf: &Leaf, lateral: &dyn Fn(usize) -> (&'static str, f64)) -> Meaning {
    let name = leaf.name.as_str();
    let along = |to: &str, axis: usize, what: &str| {
        let (unit, factor) = lateral(axis);
        let what = match factor == 1.0 {
            true => what.to_owned(),
            false => format!("{what}; from camera pixels of {factor} nm"),
        };
        Meaning::plain(to, unit).scaled(factor).described(what)
    };
    let (position, error) = ("position", "localisation precision");
    match name {
        "x" => along("x", 0, position).role("position"),
        "y" => along("y", 1, position).role("position"),
        "z" => Meaning::plain("z", "nm")
            .scaled(1.0)
            .role("position")
            .described(position),
        "x_sig" => along("error_x", 0, error).role("error"),
        "y_sig" => along("error_y", 1, error).role("error"),
        "z_sig" => Meaning::plain("error_z", "nm")
            .scaled(1.0)
            .role("error")
            .described(error),
        "frame_ix" => Meaning::plain("t", "frame")
            .role("time")
            .described("camera frame"),
        "phot" => Meaning::plain("nPhotons", "photon").described("photons of the spot"),
        "phot_sig" => Meaning::plain("error_nPhotons", "photon"),
        "bg" => Meaning::plain("background", "photon").described("photons per camera pixel"),
        "id" => Meaning::plain(name, "1"),
        "prob" => Meaning::plain("probability", "1").described("that this is an emitter"),
        _ => Meaning::plain(name, "unknown"),
    }
}
