//! storm-analysis: a group `fr_N` for each frame, with a dataset for each field. Lateral lengths are
//! camera pixels, z is um.

use hdf5::Group;
use puncta_sdk::Failure;
use serde_json::{Map, Value, json};

use crate::arrays;
use crate::attributes::attribute;
use crate::columns::Meaning;
use crate::error::unsupported;
use crate::info::{FileInfo, Format, Place, Segment};
use crate::open::{self, Opened};
use crate::record::Leaf;

/// Whether root members are those of storm-analysis.
pub(crate) fn matches(opened: &Opened, members: &[String]) -> bool {
    let frame = members.iter().any(|m| frame_of(m).is_some());
    frame || opened.file.attr("movie_hash_value").is_ok()
}

fn frame_of(member: &str) -> Option<u64> {
    member.strip_prefix("fr_")?.parse().ok()
}

/// Lists the table of a file whose root holds `members`.
///
/// # Errors
/// No localisations, or a damaged dataset.
pub(crate) fn inspect(opened: &Opened, members: &[String]) -> Result<FileInfo, Failure> {
    let mut frames: Vec<(u64, &String)> = members
        .iter()
        .filter_map(|member| Some((frame_of(member)?, member)))
        .collect();
    frames.sort_unstable();
    let mut segments = Vec::new();
    let mut numbers = Vec::new();
    let mut shifts: [Vec<f64>; 3] = Default::default();
    let mut first: Option<Group> = None;
    for (frame, member) in frames {
        let Ok(group) = opened.file.group(member) else {
            continue;
        };
        let number = |name: &str| attribute(&group, name).ok().and_then(|(v, _)| v.as_f64());
        let rows = match number("n_locs") {
            Some(rows) if rows >= 1.0 => {
                arrays::array(opened, &format!("/{member}/x"))?.map_or(0, |array| array.rows(0))
            }
            _ => continue,
        };
        segments.push(Segment {
            group: format!("/{member}/"),
            rows,
        });
        numbers.push(frame as f64);
        for (shift, name) in shifts.iter_mut().zip(["dx", "dy", "dz"]) {
            shift.push(number(name).unwrap_or(0.0));
        }
        first.get_or_insert(group);
    }
    let Some(first) = first else {
        let message = format!("{} holds no frame with localisations", opened.name);
        return Err(unsupported(message, "analyse the movie again"));
    };
    let mut notes = Vec::new();
    let mut fields = fields(opened, &first, &mut notes)?;
    fields.push((arrays::numbers("frame"), Place::Numbers(numbers)));
    for (shift, name) in shifts.into_iter().zip(["driftx", "drifty", "driftz"]) {
        if shift.iter().any(|v| *v != 0.0) {
            fields.push((arrays::numbers(name), Place::Numbers(shift)));
        }
    }
    if members.iter().any(|m| m == "tracks") {
        notes.push("Not read from this file: tracks.".into());
    }
    let table = arrays::table("localisations", "localisations", segments, fields, |leaf| {
        vec![meaning(leaf)]
    });
    let (pixel, camera) = camera(opened);
    Ok(FileInfo {
        format: Format::StormAnalysis,
        tables: vec![table],
        metadata: json!({ "source_format": "storm-analysis", "camera": camera }),
        notes,
        pixel,
        frame_base: 0,
    })
}

/// The pixel size in nm, and what the file says of the camera.
fn camera(opened: &Opened) -> (Option<f64>, Map<String, Value>) {
    let root = |name: &str| attribute(&opened.file, name).ok().map(|(value, _)| value);
    let pixel = root("pixel_size")
        .and_then(|v| v.as_f64())
        .filter(|v| *v > 0.0);
    let mut camera = Map::new();
    let size = pixel.map(Value::from);
    for (key, value) in [
        ("pixel_size_nm", size),
        ("width_px", root("movie_x")),
        ("height_px", root("movie_y")),
        ("frames", root("movie_l")),
    ] {
        if let Some(value) = value {
            camera.insert(key.to_owned(), value);
        }
    }
    (pixel, camera)
}

/// The fields of the first frame that has localisations.
fn fields(
    opened: &Opened,
    group: &Group,
    notes: &mut Vec<String>,
) -> Result<Vec<(Leaf, Place)>, Failure> {
    let mut fields = Vec::new();
    for name in open::members(group, &opened.name)? {
        let at = format!("{}/{name}", group.name());
        let array = arrays::array(opened, &at)?.filter(|a| a.shape.len() == 1);
        let Some(array) = array else {
            notes.push(format!("Not read from this file: {at}."));
            continue;
        };
        fields.push((array.leaf(&name, 0), Place::list(&name, 0)));
    }
    Ok(fields)
}

fn meaning(leaf: &Leaf) -> Meaning {
    let name = leaf.name.as_str();
    let px = |to: &str| Meaning::plain(to, "px").scaled(1.0);
    match name {
        "frame" => Meaning::plain("t", "frame").scaled(1.0).role("time"),
        "x" | "y" => px(name).role("position").described("position"),
        "z" => Meaning::plain("z", "nm")
            .scaled(1000.0)
            .role("position")
            .described("from um"),
        "driftz" => Meaning::plain(name, "nm")
            .scaled(1000.0)
            .described("drift of the frame, from um"),
        "driftx" | "drifty" => px(name).described("drift of the frame"),
        "xsigma" => px("sigx").described("standard deviation of the spot"),
        "ysigma" => px("sigy").described("standard deviation of the spot"),
        "sum" => Meaning::plain("nPhotons", "photon").described("photons of the spot"),
        "track_id" | "category" => Meaning::plain(name, "1"),
        _ => Meaning::plain(name, "unknown"),
    }
}
