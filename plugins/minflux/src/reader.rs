//! The reader of .npy files as an operation.

use crate::npy::{self, Array, Columns};
use puncta_sdk::prelude::*;
use puncta_sdk::serde_json::json;
use puncta_shared_import::MappingParams;
use puncta_shared_records::archive::{Archive, Member};
use puncta_shared_records::{
    Opened, Pass, Source, damaged, fill, minflux, not_mine, open, unsupported,
};
use std::io::{Read, Seek, SeekFrom};

/// The output.
pub const PORT: &str = "localisations";
const EXAMPLE: &[u8] = include_bytes!("../data/example.npy");

/// Reads localisations from a .npy file, also from one in a zip archive.
#[derive(Debug, Params)]
pub struct ReadNpy {
    /// Keep rows that are not valid final localisations.
    #[param(default = false)]
    all_rows: bool,
    /// The explicit mapping of columns and units.
    #[param(flatten)]
    mapping: MappingParams,
}

/// The array of a file, and where it is.
struct Found {
    opened: Opened,
    archive: Option<(Archive, Member)>,
    array: Array,
}

fn find(request: &Request) -> Result<Found, Failure> {
    let mut opened = open(request, 8)?;
    let fault = |error: std::io::Error, opened: &Opened| Failure::io("read", &opened.path, &error);
    if !opened.head.starts_with(b"PK") {
        opened
            .file
            .seek(SeekFrom::Start(0))
            .map_err(|error| fault(error, &opened))?;
        let array = npy::head(&opened.name, &mut opened.file)?;
        check(&opened.name, &array, opened.length)?;
        return Ok(Found {
            opened,
            archive: None,
            array,
        });
    }
    let mut archive = Archive::open(&opened.name, &opened.file)?;
    let arrays: Vec<&Member> = archive
        .members
        .iter()
        .filter(|member| member.name.ends_with(".npy") && !member.name.starts_with("__MACOSX/"))
        .collect();
    let member = match arrays.as_slice() {
        [] => return Err(not_mine(&opened.name, "archive with a NumPy array")),
        [one] => (*one).clone(),
        _ => {
            let message = format!("{} holds {} arrays", opened.name, arrays.len());
            return Err(unsupported(message, "unpack it and open one of them"));
        }
    };
    let array = npy::head(&opened.name, &mut archive.stream(&member)?)?;
    check(&opened.name, &array, member.size)?;
    Ok(Found {
        opened,
        archive: Some((archive, member)),
        array,
    })
}

fn check(name: &str, array: &Array, bytes: u64) -> Result<(), Failure> {
    let needed = array.rows.checked_mul(array.record as u64);
    let needed = needed.and_then(|needed| needed.checked_add(array.begin));
    if needed.is_none_or(|needed| needed > bytes) {
        let rows = array.rows;
        return Err(damaged(format!(
            "{name} ends before the {rows} rows that it announces"
        )));
    }
    Ok(())
}

fn header(found: &Found, columns: &Columns) -> Header {
    let infos = columns.fields.iter().map(|field| field.info.clone());
    let mut header = Header::table(PORT, found.array.rows, infos.collect());
    let format = columns.layout.name();
    header.metadata.insert("format".into(), format.into());
    header
}

impl ReadNpy {
    fn columns(&self, found: &Found) -> Result<Columns, Failure> {
        let columns = npy::columns(
            &found.opened.name,
            &found.array,
            self.all_rows,
            &self.mapping.mapping()?,
        )?;
        if columns.fields.is_empty() {
            let message = format!("{} has no fields of numbers", found.opened.name);
            return Err(unsupported(message, "save it with columns of numbers"));
        }
        Ok(columns)
    }
}

impl Operation for ReadNpy {
    const ID: &'static str = "puncta.minflux.npy.read/1";

    fn info() -> Info {
        Info::reader("NumPy records, MINFLUX", &[".npy", ".npy.zip"])
            .description(
                "Reads MINFLUX localisations from .npy files of either layout, and other lists of \
                 records or numbers.\nLengths become nm. Of each localisation the last iteration \
                 is taken, and rows that are not valid are left out and counted. Arrays of Python \
                 objects are refused.",
            )
            .formats(
                &[b"\x93NUMPY"],
                &[
                    "MINFLUX npy",
                    "MINFLUX npy (2024 and later)",
                    "NumPy records",
                    "NumPy numbers",
                ],
            )
            .output(Ports::table(PORT).description("One row a localisation."))
            .example(json!({}))
            .example_bytes("example.npy", EXAMPLE)
    }

    fn prepare(&self, request: &Request) -> Result<Plan, Failure> {
        let found = find(request)?;
        let columns = self.columns(&found)?;
        let mut plan = Plan {
            interruptible: true,
            memory: 32 << 20,
            ..Plan::default()
        };
        let header = header(&found, &columns);
        plan.notes.clone_from(&columns.notes);
        plan.outputs.push(Output {
            output: PORT.into(),
            form: OutputForm::Object,
            of: None,
            header,
        });
        plan.probe = Some(Probe {
            format: columns.layout.name().into(),
            confidence: columns.layout.confidence(),
        });
        Ok(plan)
    }

    fn run(&self, job: &Job) -> Result<(), Failure> {
        let mut found = find(job.request())?;
        let columns = self.columns(&found)?;
        let mut out = job.begin(PORT, header(&found, &columns))?;
        let committer = out.committer();
        let select = columns.choice.select(found.array.record);
        let pass = Pass {
            name: &found.opened.name,
            rows: found.array.rows,
            record: found.array.record,
            fields: &columns.fields,
            select: columns.choice.of(&select),
        };
        let mut commit = |rows| committer.commit(0, rows);
        let mut targets = out.columns_mut(0)?;
        let begin = found.array.begin;
        let kept = match &mut found.archive {
            None => {
                let source = Source::File(&found.opened.file, begin);
                fill(source, &pass, &mut targets, &mut commit, job)?
            }
            Some((archive, member)) => {
                let mut stream = archive.stream(member)?;
                let mut head = stream.by_ref().take(begin);
                std::io::copy(&mut head, &mut std::io::sink())
                    .map_err(|_| damaged("the archive is damaged"))?;
                fill(
                    Source::Stream(&mut stream),
                    &pass,
                    &mut targets,
                    &mut commit,
                    job,
                )?
            }
        };
        drop(targets);
        if let Some(sentence) = minflux::dropped(kept, pass.rows) {
            job.warn(&sentence);
        }
        out.finish_rows(&[kept])
    }
}
