//! The reader as an operation.

use crate::manifest::{self, Manifest};
use puncta_sdk::output::ColumnMut;
use puncta_sdk::prelude::*;
use puncta_sdk::serde_json::json;
use puncta_shared_import::{Mapping, MappingParams};
use puncta_shared_records::archive::{Archive, Member};
use puncta_shared_records::split::front;
use puncta_shared_records::{Opened, Pass, Source, damaged, fill, not_mine, open, unsupported};

const PORT: &str = "localisations";
const EXAMPLE: &[u8] = include_bytes!("../data/example.smlm");
/// Bytes of a manifest.
const MOST_MANIFEST: u64 = 16 << 20;

/// Reads localisations from a .smlm container.
#[derive(Debug, Params)]
pub struct ReadSmlm {
    /// The explicit mapping of columns and units.
    #[param(flatten)]
    mapping: MappingParams,
}

/// An archive with its manifest and the members of its tables.
struct Found {
    opened: Opened,
    archive: Archive,
    manifest: Manifest,
    members: Vec<Member>,
}

fn find(request: &Request) -> Result<Found, Failure> {
    let opened = open(request, 8)?;
    let name = &opened.name;
    if !opened.head.starts_with(b"PK") {
        return Err(not_mine(name, "SMLM container"));
    }
    let mut archive = Archive::open(name, &opened.file)?;
    let member = archive.find("manifest.json").cloned();
    let member = member.ok_or_else(|| not_mine(name, "SMLM container, but another zip archive"))?;
    let bytes = archive.bytes(&member, MOST_MANIFEST)?;
    let manifest = manifest::parse(name, &bytes)?;
    let mut members = Vec::new();
    for file in &manifest.files {
        let inner = &file.name;
        let member = archive.find(inner).cloned();
        let member = member.ok_or_else(|| damaged(format!("{name} lacks its table {inner}")))?;
        let needed = file.rows.checked_mul(manifest.format.record as u64);
        if needed.is_none_or(|needed| needed > member.size) {
            let rows = file.rows;
            let message =
                format!("{inner} in {name} ends before the {rows} rows that it announces");
            return Err(damaged(message));
        }
        members.push(member);
    }
    Ok(Found {
        opened,
        archive,
        manifest,
        members,
    })
}

impl Found {
    fn rows(&self) -> u64 {
        self.manifest
            .files
            .iter()
            .fold(0, |rows, file| rows.saturating_add(file.rows))
    }

    /// The header; with several tables, a column says of which each row is.
    fn header(&self, mapping: &Mapping) -> Result<(Header, Vec<String>), Failure> {
        let first = &self.manifest.files[0];
        let (fields, notes) = self.manifest.fields(&self.opened.name, first, mapping)?;
        let mut infos: Vec<ColumnInfo> = fields.into_iter().map(|field| field.info).collect();
        let several = self.manifest.files.len() > 1;
        if several {
            let taken = infos.iter().any(|info| info.name == "probe");
            let name = if taken { "table" } else { "probe" };
            let channel = ColumnInfo::new(name, Element::U16, "1").source("channel");
            infos.push(channel.description("Channel, from 0 in the order of the file"));
        }
        let mut header = Header::table(PORT, self.rows(), infos);
        header.metadata.insert("format".into(), "smlm".into());
        if several {
            let channels: Vec<&str> = self
                .manifest
                .files
                .iter()
                .map(|file| file.channel.as_str())
                .collect();
            header.metadata.insert("channels".into(), json!(channels));
        }
        header
            .metadata
            .insert("smlm".into(), self.manifest.rest.clone());
        Ok((header, notes))
    }
}

impl Operation for ReadSmlm {
    const ID: &'static str = "puncta.smlm.read/1";

    fn info() -> Info {
        Info::reader("SMLM containers", &[".smlm"])
            .description(
                "Reads localisations from the .smlm containers of ShareLoc.\nTables of the same \
                 columns become one, with a column for the channel. Units are those that the \
                 manifest states; others stay unknown.",
            )
            .formats(&[], &["smlm"])
            .output(Ports::table(PORT).description("One row a localisation."))
            .cite("10.1038/s41592-022-01659-0")
            .example(json!({ "units": "nm" }))
            .example_bytes("example.smlm", EXAMPLE)
    }

    fn prepare(&self, request: &Request) -> Result<Plan, Failure> {
        let found = find(request)?;
        let (header, notes) = found.header(&self.mapping.mapping()?)?;
        let mut plan = Plan {
            interruptible: true,
            memory: 48 << 20,
            notes: found.manifest.notes.clone(),
            ..Plan::default()
        };
        plan.notes.extend(notes);
        plan.outputs.push(Output {
            output: PORT.into(),
            form: OutputForm::Object,
            of: None,
            header,
        });
        plan.probe = Some(Probe {
            format: "smlm".into(),
            confidence: 1.0,
        });
        Ok(plan)
    }

    fn run(&self, job: &Job) -> Result<(), Failure> {
        let mut found = find(job.request())?;
        if found.manifest.files.len() > usize::from(u16::MAX) {
            let message = format!("{} holds more than 65535 tables", found.opened.name);
            return Err(unsupported(message, "split it"));
        }
        let mapping = self.mapping.mapping()?;
        let (header, _) = found.header(&mapping)?;
        let several = found.manifest.files.len() > 1;
        let mut out = job.begin(PORT, header)?;
        let committer = out.committer();
        let mut targets = out.columns_mut(0)?;
        let channels = several.then(|| targets.pop()).flatten();
        let mut channels = channels;
        for (number, file) in found.manifest.files.iter().enumerate() {
            let (fields, _) = found.manifest.fields(&found.opened.name, file, &mapping)?;
            let rows = usize::try_from(file.rows).unwrap_or(usize::MAX);
            let mut part: Vec<ColumnMut<'_>> = targets
                .iter_mut()
                .zip(&fields)
                .map(|(target, field)| front(target, rows * field.info.type_.width as usize))
                .collect();
            let pass = Pass {
                name: &found.opened.name,
                rows: file.rows,
                record: found.manifest.format.record,
                fields: &fields,
                select: None,
            };
            let mut commit = |rows| committer.commit(0, rows);
            let member = &found.members[number];
            if let Some(at) = member.stored_at {
                let source = Source::File(&found.opened.file, at);
                fill(source, &pass, &mut part, &mut commit, job)?;
            } else {
                let mut stream = found.archive.stream(member)?;
                fill(
                    Source::Stream(&mut stream),
                    &pass,
                    &mut part,
                    &mut commit,
                    job,
                )?;
            }
            if let Some(ColumnMut::U16(codes)) = channels.as_mut().map(|all| front(all, rows)) {
                codes.fill(u16::try_from(number).unwrap_or(u16::MAX));
            }
        }
        drop(targets);
        out.finish()
    }
}
