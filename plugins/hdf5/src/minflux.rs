//! MINFLUX in HDF5: pyMINFLUX's `.pmx` and Abberior's export as MATLAB 7.3.

use puncta_sdk::Failure;
use serde_json::{Map, Value, json};

use crate::arrays::{self, Array};
use crate::attributes::attribute;
use crate::columns::Meaning;
use crate::error::unsupported;
use crate::info::{FileInfo, Format, Place, Segment, TableInfo};
use crate::open::{self, Opened};
use crate::record::Leaf;

const FRAME: &str = "/paraview/dataframe";
const RAW: &str = "/raw/df";
const LOC: &str = "/itr/loc";

/// Whether the file is pyMINFLUX's.
pub(crate) fn is_pmx(opened: &Opened) -> bool {
    opened.file.dataset(FRAME).is_ok()
}

/// Whether the file is Abberior's, with the iterations in the group `itr`.
pub(crate) fn is_mat(opened: &Opened) -> bool {
    opened.file.dataset(LOC).is_ok() && opened.file.dataset("/tid").is_ok()
}

/// Lists the tables of a `.pmx` file: the filtered localisations, and from version 3 on all of
/// them as `raw`.
///
/// # Errors
/// A table without names, or a damaged one.
pub(crate) fn inspect_pmx(opened: &Opened) -> Result<FileInfo, Failure> {
    let mut notes = Vec::new();
    let mut tables = vec![frame(opened, FRAME, "localisations", "nm")?];
    if opened.file.dataset(RAW).is_ok() {
        // The instrument's own rows: metres.
        tables.push(frame(opened, RAW, "raw", "m")?);
    } else if opened.file.dataset("/raw/npy").is_ok() {
        notes.push("Not read from this file: /raw/npy, the unfiltered rows.".into());
    }
    let mut parameters = Map::new();
    if let Ok(group) = opened.file.group("/parameters") {
        for name in group.member_names().unwrap_or_default() {
            let value = group.dataset(&name).and_then(|d| {
                d.as_reader()
                    .conversion(hdf5::Conversion::Soft)
                    .read_scalar::<f64>()
            });
            if let Ok(value) = value {
                parameters.insert(name, Value::from(value));
            }
        }
    }
    let version = attribute(&opened.file, "file_version").ok().map(|(v, _)| v);
    let metadata = json!({
        "source_format": "pyMINFLUX",
        "pyminflux": { "file_version": version, "parameters": parameters },
    });
    Ok(FileInfo {
        format: Format::Pmx,
        tables,
        metadata,
        notes,
        pixel: None,
        frame_base: 0,
    })
}

/// A matrix of numbers with the names of its columns in an attribute.
fn frame(
    opened: &Opened,
    at: &str,
    name: &str,
    length: &'static str,
) -> Result<TableInfo, Failure> {
    let wrong = |what: &str| {
        let message = format!("{}, dataset {at}: {what}", opened.name);
        unsupported(message, "save the file from pyMINFLUX again")
    };
    let array = arrays::array(opened, at)?.ok_or_else(|| wrong("it holds no numbers"))?;
    let dataset = open::dataset(opened, at)?;
    let names = attribute(&dataset, "column_names")
        .map_err(|why| wrong(&why))?
        .0;
    let names: Vec<&str> = names
        .as_array()
        .into_iter()
        .flatten()
        .filter_map(Value::as_str)
        .collect();
    let [rows, width] = array.shape.as_slice() else {
        return Err(wrong("it is no matrix"));
    };
    if *width != names.len() as u64 {
        let what = format!("{} names are given for {width} columns", names.len());
        return Err(wrong(&what));
    }
    let place = || Place::Dataset {
        name: at.to_owned(),
        axis: 0,
        lead: Vec::new(),
        width: *width,
    };
    let fields = names.iter().enumerate();
    let fields = fields
        .map(|(k, name)| (array.leaf(name, k), place()))
        .collect();
    let segment = Segment {
        group: String::new(),
        rows: *rows,
    };
    let port = if name == "raw" {
        "tables"
    } else {
        "localisations"
    };
    Ok(arrays::table(port, name, vec![segment], fields, |leaf| {
        vec![meaning(&leaf.name, length)]
    }))
}

fn meaning(name: &str, length: &'static str) -> Meaning {
    let scale = if length == "m" { 1e9 } else { 1.0 };
    let position = |to: &str| Meaning::plain(to, "nm").scaled(scale).role("position");
    match name {
        "x" | "y" | "z" => position(name).described("position"),
        "lncx" | "lncy" | "lncz" => Meaning::plain(name, "nm").scaled(scale),
        "tid" => Meaning::plain("clumpIndex", "1")
            .role("group")
            .described("trace"),
        "tim" => Meaning::plain("time", "s").described("time since the start"),
        "dwell" => Meaning::plain(name, "s").scaled(1e-3).described("from ms"),
        "fluo" => Meaning::plain("probe", "1").described("number of the fluorophore"),
        "eco" => Meaning::plain("nPhotons", "photon").described("effective counts"),
        "iid" | "vld" | "fnl" | "bot" | "eot" | "sta" | "itr" | "sqi" | "gri" | "thi" => {
            Meaning::plain(name, "1")
        }
        _ => Meaning::plain(name, "unknown"),
    }
}

/// The fields of the last iteration, and those of a localisation as a whole.
fn mat_fields(
    opened: &Opened,
    positions: &Array,
    last: u64,
    (iterations, rows): (u64, u64),
) -> Vec<(Leaf, Place)> {
    let mut fields = Vec::new();
    for (axis, name) in ["x", "y", "z"].into_iter().enumerate() {
        let place = Place::at(LOC, 2, vec![axis as u64, last]);
        fields.push((positions.leaf(name, 0), place));
    }
    for name in ["efo", "cfr", "eco", "dcr", "ecc", "efc"] {
        let at = format!("/itr/{name}");
        let found = arrays::array(opened, &at).ok().flatten();
        if let Some(array) = found.filter(|array| array.shape == [iterations, rows]) {
            fields.push((array.leaf(name, 0), Place::at(&at, 1, vec![last])));
        }
    }
    for name in ["tid", "tim", "vld", "act", "dos", "gri", "sqi", "sky"] {
        let at = format!("/{name}");
        let Some(array) = arrays::array(opened, &at).ok().flatten() else {
            continue;
        };
        if let Some(axis) = array.list_axis().filter(|axis| array.rows(*axis) == rows) {
            fields.push((array.leaf(name, 0), Place::list(&at, axis)));
        }
    }
    fields
}

/// Lists the table of Abberior's export: the last iteration of each localisation.
///
/// # Errors
/// Positions that are not 3 x iterations x N, or a damaged dataset.
pub(crate) fn inspect_mat(opened: &Opened) -> Result<FileInfo, Failure> {
    let array = arrays::array(opened, LOC)?;
    let shape = array.as_ref().map(|a| a.shape.clone()).unwrap_or_default();
    let (Some(array), [3, iterations, rows]) = (array, shape.as_slice()) else {
        let message = format!(
            "{}, dataset {LOC}: 3 x iterations x N numbers are expected, not {shape:?}",
            opened.name
        );
        return Err(unsupported(message, "export it again from Imspector"));
    };
    let Some(last) = iterations.checked_sub(1) else {
        let message = format!("{}, dataset {LOC}: there is no iteration", opened.name);
        return Err(unsupported(message, "export it again from Imspector"));
    };
    let fields = mat_fields(opened, &array, last, (*iterations, *rows));
    let segment = Segment {
        group: String::new(),
        rows: *rows,
    };
    let meanings = |leaf: &Leaf| vec![meaning(&leaf.name, "m")];
    let table = arrays::table(
        "localisations",
        "localisations",
        vec![segment],
        fields,
        meanings,
    );
    let notes = vec!["All rows are kept; those with vld 0 are no valid localisations.".to_owned()];
    Ok(FileInfo {
        format: Format::MinfluxMat,
        tables: vec![table],
        metadata: json!({ "source_format": "MINFLUX", "iterations": iterations }),
        notes,
        pixel: None,
        frame_base: 0,
    })
}
