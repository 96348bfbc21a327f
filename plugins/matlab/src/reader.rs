//! The reader as an operation.

use crate::container::{Variable, variables};
use crate::find::{Options, Table, Values, find};
use crate::matrix::Data;
use crate::unpack::stream;
use puncta_sdk::output::ColumnMut;
use puncta_sdk::prelude::*;
use puncta_sdk::run::Serial;
use puncta_sdk::serde_json::json;
use puncta_shared_import::MappingParams;
use puncta_shared_records::names::Placed;
use puncta_shared_records::{Field, Opened, Pass, Pick, Source, fill, minflux, open};
use std::io::{self, Read};

const PORT: &str = "localisations";
const EXAMPLE: &[u8] = include_bytes!("../data/example.mat");
const HEAD: usize = 128;

/// Reads localisations or tracks from a MATLAB file of version 5 to 7.
#[derive(Debug, Params)]
pub struct ReadMat {
    /// Keep rows of MINFLUX files that are not valid final localisations.
    #[param(default = false)]
    all_rows: bool,
    /// The explicit mapping of columns and units.
    #[param(flatten)]
    mapping: MappingParams,
}

impl ReadMat {
    fn look(
        &self,
        request: &Request,
        run: &dyn Run,
    ) -> Result<(Opened, Vec<Variable>, Table), Failure> {
        let opened = open(request, HEAD)?;
        let (name, file) = (&opened.name, &opened.file);
        let variables = variables(name, file, opened.length, &opened.head, run)?;
        let mapping = self.mapping.mapping()?;
        let options = Options {
            mapping: &mapping,
            all: self.all_rows,
        };
        let table = find(name, file, &variables, &options)?;
        Ok((opened, variables, table))
    }
}

fn header(table: &Table) -> Header {
    let infos = table.placed.iter().map(|placed| placed.info.clone());
    let mut header = Header::table(PORT, table.rows as u64, infos.collect());
    if table.tracks {
        header.shape = Some("tracks".into());
    }
    header.metadata.insert("format".into(), table.format.into());
    if !table.metadata.is_empty() {
        header
            .metadata
            .insert("matlab".into(), table.metadata.clone().into());
    }
    header
}

impl Operation for ReadMat {
    const ID: &'static str = "puncta.matlab.read/1";

    fn info() -> Info {
        Info::reader("MATLAB files", &[".mat"])
            .description(
                "Reads localisations of SMAP and MINFLUX, tracks of Spot-On and u-track, and any \
                 vectors of equal length from MATLAB files of version 5 to 7.\nSparse matrices, \
                 objects and functions are passed over. Units that the file does not state stay \
                 unknown.",
            )
            .formats(
                &[b"MATLAB 5.0"],
                &[
                    "SMAP mat",
                    "MINFLUX mat",
                    "Spot-On mat",
                    "u-track mat",
                    "MATLAB vectors",
                ],
            )
            .output(Ports::table(PORT).description("One row a localisation."))
            .example(json!({ "units": "nm" }))
            .example_bytes("example.mat", EXAMPLE)
    }

    fn prepare(&self, request: &Request) -> Result<Plan, Failure> {
        let (_, _, table) = self.look(request, &Serial)?;
        let mut plan = Plan {
            interruptible: true,
            memory: 64 << 20,
            notes: table.notes.clone(),
            ..Plan::default()
        };
        plan.outputs.push(Output {
            output: PORT.into(),
            form: OutputForm::Object,
            of: None,
            header: header(&table),
        });
        plan.probe = Some(Probe {
            format: table.format.into(),
            confidence: table.confidence,
        });
        Ok(plan)
    }

    fn run(&self, job: &Job) -> Result<(), Failure> {
        let (opened, variables, table) = self.look(job.request(), job)?;
        let mut out = job.begin(PORT, header(&table))?;
        let committer = out.committer();
        let kept = match table.valid.len() {
            0 => table.rows,
            _ => table.valid.iter().filter(|valid| **valid).count(),
        };
        committer.commit(0, kept as u64)?;
        let mut stored = Vec::new();
        for (target, placed) in out.columns_mut(0)?.into_iter().zip(&table.placed) {
            let column = table.columns.get(placed.place);
            let column = column.ok_or_else(|| Failure::internal("a column without values"))?;
            match &column.values {
                Values::Gathered(values) => gathered(target, values.iter().copied(), placed),
                #[allow(clippy::cast_precision_loss, clippy::cast_possible_truncation)]
                Values::Whole(values) => match target {
                    ColumnMut::I64(to) => {
                        let minus = placed.minus as i64;
                        to.iter_mut()
                            .zip(values)
                            .for_each(|(to, v)| *to = v.wrapping_sub(minus));
                    }
                    target => gathered(target, values.iter().map(|v| *v as f64), placed),
                },
                values => stored.push((values.place(), values, placed, target)),
            }
        }
        // In the order of the file, so that what is compressed is decompressed once.
        stored.sort_by_key(|(place, ..)| *place);
        let mut unpacked = Unpacked::default();
        for (_, values, placed, target) in stored {
            let field = place(values, placed)?;
            let array = (values, &field);
            read(
                &opened,
                &variables,
                &table,
                array,
                target,
                &mut unpacked,
                job,
            )?;
        }
        if let Some(sentence) = minflux::dropped(kept as u64, table.rows as u64) {
            job.warn(&sentence);
        }
        out.finish_rows(&[kept as u64])
    }
}

/// The variable that is being decompressed, and how far.
#[derive(Default)]
struct Unpacked<'f> {
    current: Option<(usize, u64, Box<dyn Read + 'f>)>,
}

impl<'f> Unpacked<'f> {
    /// The bytes of a variable from a place on.
    fn at(
        &mut self,
        opened: &'f Opened,
        variables: &[Variable],
        number: usize,
        at: u64,
        bytes: u64,
    ) -> Result<&mut (dyn Read + 'f), Failure> {
        let ahead = |(known, done, mut from): (usize, u64, Box<dyn Read + 'f>)| {
            let skip = at.checked_sub(done).filter(|_| known == number)?;
            let skipped = io::copy(&mut from.by_ref().take(skip), &mut io::sink()).ok()?;
            (skipped == skip).then_some(from)
        };
        let from = match self.current.take().and_then(ahead) {
            Some(from) => from,
            None => stream(&opened.name, &opened.file, &variables[number], at)?,
        };
        let (_, _, from) = self.current.insert((number, at + bytes, from));
        Ok(&mut **from)
    }
}

fn gathered(target: ColumnMut<'_>, values: impl Iterator<Item = f64>, placed: &Placed) {
    if let ColumnMut::F64(to) = target {
        for (to, value) in to.iter_mut().zip(values) {
            *to = value * placed.factor - placed.minus;
        }
    }
}

/// How the numbers of an array are read into the column that they become.
fn place(values: &Values, placed: &Placed) -> Result<Field, Failure> {
    let Values::Stored { field, .. } = values else {
        return Err(Failure::internal("a column without an array"));
    };
    let mut field = Field::clone(field);
    (field.factor, field.shift) = (placed.factor, -placed.minus);
    field.info = placed.info.clone();
    Ok(field)
}

/// Reads a column from its array.
fn read<'f>(
    opened: &'f Opened,
    variables: &[Variable],
    table: &Table,
    (values, field): (&Values, &Field),
    target: ColumnMut<'_>,
    unpacked: &mut Unpacked<'f>,
    job: &Job,
) -> Result<(), Failure> {
    let Values::Stored {
        variable,
        array,
        first,
        ..
    } = values
    else {
        return Err(Failure::internal("a column without an array"));
    };
    let size = field.stored.number.bytes();
    let select = |first: u64, _: &[u8], rows: usize, picks: &mut Vec<Pick>| {
        let first = usize::try_from(first).unwrap_or(usize::MAX);
        for row in 0..rows {
            if table
                .valid
                .get(first.saturating_add(row))
                .copied()
                .unwrap_or(false)
            {
                let at = u32::try_from(row * size).unwrap_or(u32::MAX);
                picks.push(Pick {
                    record: at,
                    sub: at,
                });
            }
        }
    };
    let pass = Pass {
        name: &opened.name,
        rows: table.rows as u64,
        record: size,
        fields: std::slice::from_ref(field),
        select: if table.valid.is_empty() {
            None
        } else {
            Some(&select)
        },
    };
    let known = variables.get(*variable);
    let known = known.ok_or_else(|| Failure::internal("a column without a variable"))?;
    let mut targets = [target];
    let begin = (first * size) as u64;
    match &array.data {
        Data::Kept(bytes) => {
            let mut bytes = bytes.get(first * size..).unwrap_or(&[]);
            fill(
                Source::Stream(&mut bytes),
                &pass,
                &mut targets,
                &mut |_| Ok(()),
                job,
            )?;
        }
        Data::At(at) if known.packed.is_none() => {
            let source = Source::File(&opened.file, at + begin);
            fill(source, &pass, &mut targets, &mut |_| Ok(()), job)?;
        }
        Data::At(at) => {
            let bytes = pass.rows * size as u64;
            let stream = unpacked.at(opened, variables, *variable, at + begin, bytes)?;
            let mut stream = stream.take(bytes);
            fill(
                Source::Stream(&mut stream),
                &pass,
                &mut targets,
                &mut |_| Ok(()),
                job,
            )?;
        }
    }
    Ok(())
}
