//! The reader as an operation.

use crate::parse::{Column, Kind, Parsed, parse};
use puncta_sdk::output::ColumnMut;
use puncta_sdk::prelude::*;
use puncta_sdk::run::Serial;
use puncta_sdk::serde_json::{Value, json};
use puncta_shared_records::{Opened, names, not_mine, open};
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
    /// Camera pixel, for files whose lengths are in pixels.
    #[param(min = 0.001, max = 1e6, unit = "nm")]
    pixel_size: Option<f64>,
    /// Unit of lengths where the file does not state one, such as nm or um.
    #[param(default = "")]
    unit: String,
}

/// A column of the host: its description, the factor, and whether it holds whole numbers.
struct Planned {
    info: ColumnInfo,
    factor: f64,
}

impl ReadTrackMate {
    /// The unit of lengths, and what to multiply them with.
    fn space(&self, stated: &str) -> (String, f64, Option<String>) {
        let pixels = matches!(stated.to_lowercase().as_str(), "pixel" | "pixels" | "px");
        match self.pixel_size {
            Some(size) if pixels => ("nm".into(), size, None),
            _ if stated.is_empty() && !self.unit.is_empty() => names::unit(&self.unit),
            _ => names::unit(stated),
        }
    }

    fn planned(&self, parsed: &Parsed, column: &Column) -> Planned {
        let source = column.name.as_str();
        let feature = parsed.features.get(source).cloned().unwrap_or_default();
        let simple = parsed.kind == Kind::Simple;
        let lower = source.to_lowercase();
        let (name, dimension) = match lower.as_str() {
            "position_x" => ("x", "POSITION"),
            "position_y" => ("y", "POSITION"),
            "position_z" => ("z", "POSITION"),
            "position_t" => ("time", "TIME"),
            "x" | "y" | "z" if simple => (lower.as_str(), "POSITION"),
            "t" if simple => ("t", "FRAME"),
            "frame" => ("t", "FRAME"),
            "id" => ("id", "NUMBER"),
            _ if feature.whole => (lower.as_str(), "NUMBER"),
            _ => (lower.as_str(), feature.dimension.as_str()),
        };
        let (unit, factor, words) = match dimension {
            "POSITION" | "LENGTH" => self.space(&parsed.space),
            "TIME" => names::unit(&parsed.time),
            "FRAME" => ("frame".into(), 1.0, None),
            "NUMBER" => ("1".into(), 1.0, None),
            _ => (names::UNKNOWN.into(), 1.0, None),
        };
        let whole = matches!(dimension, "FRAME" | "NUMBER")
            && column
                .values
                .iter()
                .all(|value| value.fract() == 0.0 && value.abs() < 9e15);
        let element = if whole { Element::I64 } else { Element::F64 };
        let mut info = ColumnInfo::new(names::identifier(name), element, unit).source(source);
        info.role = names::role(name).map(str::to_owned);
        if let Some(words) = words {
            info = info.description(format!("In {words}"));
        } else if !feature.label.is_empty() {
            info = info.description(feature.label);
        }
        Planned { info, factor }
    }

    fn header(&self, parsed: &Parsed, rows: u64) -> (Header, Vec<Planned>) {
        let planned: Vec<Planned> = parsed
            .columns
            .iter()
            .map(|column| self.planned(parsed, column))
            .collect();
        let mut infos: Vec<ColumnInfo> = planned.iter().map(|one| one.info.clone()).collect();
        let track = ColumnInfo::new("track", Element::I64, "1").role("group");
        infos.push(track.description("Number of the track; -1 for a spot without one"));
        names::unique(infos.iter_mut());
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
        (header, planned)
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
        let (header, _) = self.header(&parsed, opened.length / SHORTEST);
        let mut plan = Plan {
            interruptible: true,
            memory: opened.length.saturating_mul(2),
            ..Plan::default()
        };
        let infos = header.parts.first().map(|part| part.columns.iter());
        let remedy = if parsed.space.is_empty() {
            "unit, such as nm or um"
        } else {
            "pixel_size"
        };
        plan.notes.extend(names::unit_note(
            &opened.name,
            infos.into_iter().flatten(),
            remedy,
        ));
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
        let (header, planned) = self.header(&parsed, rows);
        let mut out = job.begin(PORT, header)?;
        out.commit(0, rows)?;
        let mut targets = out.columns_mut(0)?;
        if let Some(ColumnMut::I64(to)) = targets.pop() {
            to.iter_mut()
                .zip(&parsed.tracks)
                .for_each(|(to, track)| *to = *track);
        }
        for ((target, column), planned) in targets.into_iter().zip(&parsed.columns).zip(&planned) {
            let values = column.values.iter();
            match target {
                #[allow(clippy::cast_possible_truncation)]
                ColumnMut::I64(to) => to
                    .iter_mut()
                    .zip(values)
                    .for_each(|(to, v)| *to = *v as i64),
                ColumnMut::F64(to) => {
                    to.iter_mut()
                        .zip(values)
                        .for_each(|(to, v)| *to = v * planned.factor);
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
