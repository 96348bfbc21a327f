//! The reader as an operation.

use crate::parse::{Column, Kind, Parsed, parse};
use puncta_sdk::output::ColumnMut;
use puncta_sdk::prelude::*;
use puncta_sdk::run::Serial;
use puncta_sdk::serde_json::{Value, json};
use puncta_shared_import::MappingParams;
use puncta_shared_records::minflux::identifier;
use puncta_shared_records::names::{self, Placed, Raw};
use puncta_shared_records::{Opened, not_mine, open};
use std::io::{BufReader, Seek, SeekFrom};

const PORT: &str = "localisations";
/// The shortest row that there can be.
const SHORTEST: u64 = 12;
const EXAMPLE: &str = concat!(
    "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n",
    "<Tracks nTracks=\"1\" spaceUnits=\"micron\" frameInterval=\"0.02\" timeUnits=\"sec\">\n",
    "  <particle nSpots=\"2\">\n",
    "    <detection t=\"0\" x=\"1.25\" y=\"0.5\" z=\"0.0\" />\n",
    "    <detection t=\"1\" x=\"1.5\" y=\"0.75\" z=\"0.0\" />\n",
    "  </particle>\n</Tracks>\n",
);

/// Reads spots and tracks from TrackMate's XML.
#[derive(Debug, Params)]
pub struct ReadTrackMate {
    /// The explicit mapping of columns and units.
    #[param(flatten)]
    mapping: MappingParams,
}

/// The name of an attribute as the host has it, and its dimension.
fn meaning<'a>(simple: bool, lower: &'a str, whole: bool, stated: &'a str) -> (&'a str, &'a str) {
    match lower {
        "position_x" => ("x", "POSITION"),
        "position_y" => ("y", "POSITION"),
        "position_z" => ("z", "POSITION"),
        "position_t" => ("time", "TIME"),
        "x" | "y" | "z" if simple => (lower, "POSITION"),
        "t" if simple => ("t", "FRAME"),
        "frame" => ("t", "FRAME"),
        "id" => ("id", "NUMBER"),
        _ if whole => (lower, "NUMBER"),
        _ => (lower, stated),
    }
}

fn raw(parsed: &Parsed, column: &Column) -> Raw {
    let source = column.name.as_str();
    let feature = parsed.features.get(source).cloned().unwrap_or_default();
    let lower = source.to_lowercase();
    let simple = parsed.kind == Kind::Simple;
    let (name, dimension) = meaning(simple, &lower, feature.whole, &feature.dimension);
    let unit = match dimension {
        "POSITION" | "LENGTH" => parsed.space.as_str(),
        "TIME" => parsed.time.as_str(),
        "FRAME" => "frame",
        "NUMBER" => "1",
        _ => "",
    };
    let whole = matches!(dimension, "FRAME" | "NUMBER")
        && column
            .values
            .iter()
            .all(|value| value.fract() == 0.0 && value.abs() < 9e15);
    let element = if whole { Element::I64 } else { Element::F64 };
    Raw::new(source, &identifier(name), unit, element).described(&feature.label)
}

impl ReadTrackMate {
    fn header(
        &self,
        file: &str,
        parsed: &Parsed,
        rows: u64,
    ) -> Result<(Header, Vec<Placed>, Vec<String>), Failure> {
        let all: Vec<Raw> = parsed
            .columns
            .iter()
            .map(|column| raw(parsed, column))
            .collect();
        let (mut placed, notes) = names::place(file, &self.mapping.mapping()?, &all)?;
        for one in &mut placed {
            if one.converts() {
                one.info.type_.element = Element::F64;
            }
        }
        let mut infos: Vec<ColumnInfo> = placed.iter().map(|one| one.info.clone()).collect();
        let taken = infos.iter().any(|info| info.name == "track");
        let name = if taken { "track_of_file" } else { "track" };
        let track = ColumnInfo::new(name, Element::I64, "1").role("group");
        infos.push(track.description("Number of the track; -1 for a spot without one"));
        let mut header = Header::table(PORT, rows, infos);
        header.shape = Some("tracks".into());
        header
            .metadata
            .insert("format".into(), format(parsed.kind).into());
        let root = parsed
            .root
            .iter()
            .map(|(key, value)| (key.clone(), Value::from(value.as_str())));
        header
            .metadata
            .insert("trackmate".into(), Value::Object(root.collect()));
        Ok((header, placed, notes))
    }
}

fn format(kind: Kind) -> &'static str {
    match kind {
        Kind::Model => "TrackMate model xml",
        Kind::Simple => "TrackMate tracks xml",
    }
}

fn begin(request: &Request) -> Result<(Opened, BufReader<std::fs::File>), Failure> {
    let mut opened = open(request, 16)?;
    let head = opened.head.trim_ascii_start();
    let head = head.strip_prefix(b"\xef\xbb\xbf").unwrap_or(head);
    if !head.starts_with(b"<") {
        return Err(not_mine(&opened.name, "TrackMate file"));
    }
    let fault = |error| Failure::io("read", &opened.path, &error);
    opened.file.seek(SeekFrom::Start(0)).map_err(fault)?;
    let file = opened.file.try_clone().map_err(fault)?;
    Ok((opened, BufReader::with_capacity(1 << 18, file)))
}

impl Operation for ReadTrackMate {
    const ID: &'static str = "puncta.trackmate.read/1";

    fn info() -> Info {
        Info::reader("TrackMate files", &[".xml"])
            .description(
                "Reads spots with all their features and their tracks from TrackMate's XML, whole \
                 models and simple tracks.\nLengths become nm where the file states their unit; \
                 pixels need pixel_size. Files with a document type are refused.",
            )
            .formats(&[], &["TrackMate model xml", "TrackMate tracks xml"])
            .output(Ports::table(PORT).description("One row a spot."))
            .cite("10.1016/j.ymeth.2016.09.016")
            .example(json!({}))
            .example_text("tracks.xml", EXAMPLE)
    }

    fn prepare(&self, request: &Request) -> Result<Plan, Failure> {
        let (opened, read) = begin(request)?;
        let parsed = parse(&opened.name, read, Some(1), &Serial)?;
        let rows = opened.length / SHORTEST;
        let (header, _, notes) = self.header(&opened.name, &parsed, rows)?;
        let mut plan = Plan {
            interruptible: true,
            memory: opened.length.saturating_mul(2),
            notes,
            ..Plan::default()
        };
        plan.outputs.push(Output {
            output: PORT.into(),
            form: OutputForm::Object,
            of: None,
            header,
        });
        plan.probe = Some(Probe {
            format: format(parsed.kind).into(),
            confidence: 1.0,
        });
        Ok(plan)
    }

    fn run(&self, job: &Job) -> Result<(), Failure> {
        let (opened, read) = begin(job.request())?;
        let parsed = parse(&opened.name, read, None, job)?;
        let rows = parsed.rows as u64;
        let (header, placed, _) = self.header(&opened.name, &parsed, rows)?;
        let mut out = job.begin(PORT, header)?;
        out.commit(0, rows)?;
        let mut targets = out.columns_mut(0)?;
        if let Some(ColumnMut::I64(to)) = targets.pop() {
            to.iter_mut()
                .zip(&parsed.tracks)
                .for_each(|(to, track)| *to = *track);
        }
        for (target, placed) in targets.into_iter().zip(&placed) {
            let column = parsed.columns.get(placed.place);
            let values = column.map_or(&[][..], |column| &column.values).iter();
            match target {
                #[allow(clippy::cast_possible_truncation)]
                ColumnMut::I64(to) => {
                    to.iter_mut()
                        .zip(values)
                        .for_each(|(to, v)| *to = (v - placed.minus) as i64);
                }
                ColumnMut::F64(to) => {
                    let change = |v: &f64| v * placed.factor - placed.minus;
                    to.iter_mut()
                        .zip(values)
                        .for_each(|(to, v)| *to = change(v));
                }
                _ => return Err(Failure::internal("a column of another type")),
            }
        }
        if parsed.odd > 0 {
            job.warn(&format!(
                "{} values are no numbers and became NaN.",
                parsed.odd
            ));
        }
        out.finish()
    }
}
