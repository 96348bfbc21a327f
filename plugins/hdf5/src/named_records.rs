//! Tables of records whose names say what they are: PYME's saved tables and SPTAnalyser's tracks.

use puncta_sdk::{Failure, Header};
use puncta_shared_import::names;
use serde_json::{Map, Value, json};

use crate::attributes::attribute;
use crate::columns::{self, Meaning, Records};
use crate::error::unsupported;
use crate::info::{FileInfo, Format, TableInfo};
use crate::open::Opened;
use crate::pyme::{EVENTS, METADATA, camera, events, tree};
use crate::record::Leaf;
use crate::write_pyme::HEADER;

const TRACKS: [&str; 2] = ["/trc/trcHmm", "/trc/trcType"];

/// Whether the file is SPTAnalyser's.
pub(crate) fn is_spt_analyser(opened: &Opened) -> bool {
    TRACKS.iter().any(|at| opened.file.dataset(at).is_ok())
}

/// Lists the tracks of an SPTAnalyser file.
///
/// # Errors
/// A damaged table.
pub(crate) fn inspect_spt_analyser(opened: &Opened) -> Result<FileInfo, Failure> {
    let mut tables = Vec::new();
    for at in TRACKS {
        if opened.file.dataset(at).is_err() {
            continue;
        }
        let port = if tables.is_empty() {
            "localisations"
        } else {
            "tables"
        };
        let name = if tables.is_empty() {
            port
        } else {
            at.trim_start_matches("/trc/")
        };
        let mut table = columns::records(opened, at)?.table(port, name, None, track);
        table.tracks = true;
        tables.push(table);
    }
    Ok(FileInfo {
        format: Format::SptAnalyser,
        tables,
        metadata: json!({ "source_format": "SPTAnalyser" }),
        notes: vec!["Only the tracks are read, not their analysis.".to_owned()],
        pixel: None,
        frame_base: 0,
    })
}

fn track(leaf: &Leaf) -> Vec<Meaning> {
    let (stem, _) = names::split_unit(&leaf.name);
    let um = |to: &str| {
        Meaning::plain(to, "nm")
            .scaled(1000.0)
            .role("position")
            .described("from um")
    };
    vec![match stem {
        "track id" => Meaning::plain("track", "1").role("group"),
        "frame" => Meaning::plain("t", "frame").role("time"),
        "x position" => um("x"),
        "y position" => um("y"),
        "intensity" => Meaning::plain("nPhotons", "photon"),
        _ => Meaning::plain(&names::identifier(stem).unwrap_or_default(), "unknown"),
    }]
}

/// Whether the file is PYME's or another that PyTables wrote: tables of records at its root.
pub(crate) fn is_pyme(opened: &Opened, members: &[String]) -> bool {
    let tables = opened.file.attr("PYTABLES_FORMAT_VERSION").is_ok();
    (tables || members.iter().any(|m| m == "MetaData")) && !tables_of(opened, members).is_empty()
}

/// The tables of records at the root, without the events.
fn tables_of(opened: &Opened, members: &[String]) -> Vec<Records> {
    let own = |m: &&String| **m != EVENTS.trim_start_matches('/');
    let table = |m: &String| {
        opened.file.dataset(m).ok()?;
        columns::records(opened, &format!("/{m}")).ok()
    };
    members.iter().filter(own).filter_map(table).collect()
}

/// Lists the tables of a `.hdf` file: the first with a column `x`, otherwise the last, holds the
/// localisations.
///
/// # Errors
/// No table.
pub(crate) fn inspect_pyme(opened: &Opened, members: &[String]) -> Result<FileInfo, Failure> {
    let mut notes = Vec::new();
    let records = tables_of(opened, members);
    let with_x = records.iter().position(|r| r.number("x").is_some());
    let main = with_x.or(records.len().checked_sub(1));
    let Some(main) = main else {
        return Err(unsupported(
            format!("{} holds no table", opened.name),
            "export it again",
        ));
    };
    let mut metadata = Map::new();
    let mut read: Vec<String> = vec![EVENTS.into(), METADATA.into()];
    let mut tables = Vec::new();
    for (place, one) in records.into_iter().enumerate() {
        one.note_skipped(&mut notes);
        let at = one.dataset.clone();
        let own = one.number("t").is_some();
        let sort_by = one.number("tIndex").cloned();
        let name = at.trim_start_matches('/').to_owned();
        read.push(at);
        let meanings = |leaf: &Leaf| saved(leaf, own);
        if place == main {
            let (table, own) = main_table(opened, one, sort_by, meanings);
            metadata = own;
            tables.insert(0, table);
        } else {
            tables.push(one.table("tables", &name, sort_by, meanings));
        }
    }
    if members.iter().any(|m| m == EVENTS.trim_start_matches('/')) {
        match events(opened) {
            Ok(table) => tables.push(table),
            Err(failure) => notes.push(format!("Events are left out: {failure}.")),
        }
    }
    let read: Vec<&str> = read.iter().map(String::as_str).collect();
    columns::note_unread(members, &read, &mut notes);
    let tree = match members
        .iter()
        .any(|m| m == METADATA.trim_start_matches('/'))
    {
        true => tree(opened, &mut notes),
        false => Value::Object(Map::new()),
    };
    let metadata = match metadata.is_empty() {
        true => json!({ "source_format": "PYME hdf", "camera": camera(&tree), "pyme": tree }),
        false => Value::Object(metadata),
    };
    Ok(FileInfo {
        format: Format::PymeHdf,
        tables,
        metadata,
        notes,
        pixel: None,
        frame_base: 0,
    })
}

/// The table with the localisations, and the metadata of one that this plugin wrote.
fn main_table(
    opened: &Opened,
    records: Records,
    sort_by: Option<Leaf>,
    meanings: impl Fn(&Leaf) -> Vec<Meaning>,
) -> (TableInfo, Map<String, Value>) {
    let name = "localisations";
    let Some(own) = own_header(opened, &records.dataset) else {
        return (records.table(name, name, sort_by, meanings), Map::new());
    };
    let plain = |leaf: &Leaf| vec![Meaning::plain(&leaf.name, "unknown")];
    let mut table = records.table(name, name, None, plain);
    restore(&mut table, &own);
    (table, own.metadata)
}

/// The header of a table that this plugin wrote.
fn own_header(opened: &Opened, at: &str) -> Option<Header> {
    let dataset = opened.file.dataset(at).ok()?;
    let (value, _) = attribute(&dataset, HEADER).ok()?;
    serde_json::from_str(value.as_str()?).ok()
}

/// Units, roles and the rest as they were written.
fn restore(table: &mut TableInfo, own: &Header) {
    let infos = own.parts.first().map_or(&[][..], |part| &part.columns);
    for column in &mut table.columns {
        let Some(info) = infos.iter().find(|info| info.name == column.name) else {
            continue;
        };
        column.unit.clone_from(&info.unit);
        column.role.clone_from(&info.role);
        column.source = info.source.clone().unwrap_or_default();
        column.description = info.description.clone().unwrap_or_default();
    }
    table.tracks = own.shape.as_deref() == Some("tracks");
}

/// A saved column keeps its name; `tIndex` stands in for `t` where there is none.
fn saved(leaf: &Leaf, has_t: bool) -> Vec<Meaning> {
    let name = leaf.name.as_str();
    let unit = match names::pyme_unit(name).map(|unit| unit.name).as_deref() {
        Some("nm") => "nm",
        Some("frame") => "frame",
        Some("photon") => "photon",
        _ => "unknown",
    };
    let own = Meaning::plain(name, unit);
    let own = match name {
        "x" | "y" | "z" => own.scaled(1.0).role("position"),
        "error_x" | "error_y" | "error_z" => own.scaled(1.0).role("error"),
        "t" => own.role("time"),
        _ => own,
    };
    let time = (name == "tIndex" && !has_t).then(|| Meaning::plain("t", "frame").role("time"));
    std::iter::once(own).chain(time).collect()
}
