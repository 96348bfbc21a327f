//! The reader as an operation.

use std::path::Path;

use puncta_sdk::output::{self, TextsMut};
use puncta_sdk::prelude::*;
use puncta_shared_import::MappingParams;
use serde_json::{Value, json};

use crate::column::{ColumnMut, TextColumn};
use crate::info::{ColumnInfo as Stored, FORMATS, FileInfo, TableInfo};
use crate::read::{ReadReport, Sink, read};
use crate::recognise::inspect;
use crate::record::LeafType;

/// First bytes of an HDF5 file without a user block.
const MAGIC: &[u8] = b"\x89HDF\r\n\x1a\n";
/// Four localisations as Picasso writes them, without a `.yaml`.
const EXAMPLE: &[u8] = include_bytes!("../data/example_locs.hdf5");
/// Blocks in memory at once: three for each of eight threads.
const BLOCKS: u64 = 24;
/// Blocks beyond this many bytes may take longer than 50 ms to load.
const QUICK_BLOCK: usize = 8 << 20;
/// Working memory a row while rows are sorted: keys, order, and the columns that move.
const SORTED_ROW: u64 = 28;

/// Reads localisations, events and fiducials from Picasso `.hdf5` and PYME `.h5r` files.
#[derive(Debug, Params)]
pub struct ReadHdf5 {
    #[param(flatten)]
    mapping: MappingParams,
}

impl Operation for ReadHdf5 {
    const ID: &'static str = "puncta.hdf5.read/1";

    fn info() -> Info {
        let formats: Vec<&str> = FORMATS.iter().map(|format| format.name()).collect();
        Info::reader("HDF5 localisations", &[".hdf5", ".h5r", ".h5", ".hdf", ".mat", ".pmx"])
            .description(
                "Reads localisations from HDF5 files of Picasso, PYME, DECODE, storm-analysis, SMAP, \
                 pyMINFLUX, SPTAnalyser, and MINFLUX exports of MATLAB 7.3.\n\
                 Picasso's camera pixels become nm by the Pixelsize of the .yaml of the same name. \
                 PYME's nested names are joined with underscores, the fitted position becomes x and \
                 y, rows are put in order of time, columns that come from events are computed, and \
                 pickled metadata are decoded without being executed. Columns keep their stored \
                 type, except positions, errors and converted values, which are f64.",
            )
            .formats(&[MAGIC], &formats)
            .output(Ports::table("localisations").description("One row a localisation."))
            .output(
                Ports::table("events")
                    .optional()
                    .description("PYME's acquisition events."),
            )
            .output(
                Ports::table("fiducials")
                    .optional()
                    .description("PYME's fits of fiducials."),
            )
            .output(
                Ports::table("tables")
                    .optional()
                    .many()
                    .description("Other tables of the file, such as picks."),
            )
            .cite("10.1038/nprot.2017.024")
            .cite("10.1038/s41592-021-01165-9")
            .example(json!({ "pixel_size": 130 }))
            .example_bytes("example_locs.hdf5", EXAMPLE)
    }

    fn prepare(&self, request: &Request) -> Result<Plan, Failure> {
        let file = request.file.as_ref();
        let file = file.ok_or_else(|| Failure::internal("the call has no file"))?;
        let info = inspect(Path::new(&file.path), &self.mapping.mapping()?)?;
        let mut plan = Plan {
            interruptible: true,
            ..Plan::default()
        };
        for table in &info.tables {
            plan.interruptible &= table.block <= QUICK_BLOCK;
            plan.memory = plan.memory.max(BLOCKS.saturating_mul(table.block as u64));
            if table.sort_by.is_some() {
                plan.memory += table.rows.saturating_mul(SORTED_ROW);
            }
            plan.outputs.push(Output {
                output: table.port.into(),
                form: OutputForm::Object,
                of: None,
                header: header(table, &info),
            });
        }
        plan.probe = Some(Probe {
            format: info.format.name().into(),
            confidence: 1.0,
        });
        plan.notes = info.notes;
        Ok(plan)
    }

    fn run(&self, job: &Job) -> Result<(), Failure> {
        let path = Path::new(&job.file()?.path);
        let info = inspect(path, &self.mapping.mapping()?)?;
        for table in &info.tables {
            let report = fill(job, path, table, &info)?;
            tell(job, table, &report);
        }
        Ok(())
    }
}

/// What a table will be.
fn header(table: &TableInfo, info: &FileInfo) -> Header {
    let columns = table
        .columns
        .iter()
        .map(|column| describe(column, table.rows))
        .collect();
    let mut header = Header::table(&table.name, table.rows, columns);
    if let Value::Object(tree) = &info.metadata {
        header.metadata.clone_from(tree);
    }
    if table.tracks {
        header.shape = Some("tracks".into());
    }
    header
}

fn describe(column: &Stored, rows: u64) -> ColumnInfo {
    let mut info = ColumnInfo::new(&column.name, column.element, &column.unit);
    if !column.source.is_empty() {
        info = info.source(&column.source);
    }
    if let Some(remedy) = &column.remedy {
        info.rest.insert("remedy".into(), remedy.clone().into());
    }
    info.role.clone_from(&column.role);
    if !column.description.is_empty() {
        info = info.description(&column.description);
    }
    match column.leaf.stored {
        // A byte that is not UTF-8 becomes U+FFFD, which has three.
        LeafType::Text { size } if column.compute.is_none() => {
            info.text_bytes(rows.saturating_mul(3 * size as u64))
        }
        _ => info,
    }
}

/// Reads a table into an output of its own.
fn fill(job: &Job, path: &Path, table: &TableInfo, info: &FileInfo) -> Result<ReadReport, Failure> {
    let mut out = job.begin(table.port, header(table, info))?;
    out.commit(0, table.rows)?;
    let mut texts = vec![TextColumn::default(); table.columns.len()];
    let mut rooms = Vec::new();
    let mut sinks = Vec::new();
    let places = out
        .columns_mut(0)?
        .into_iter()
        .zip(&table.columns)
        .zip(&mut texts);
    for (row, ((place, column), text)) in places.enumerate() {
        let data = match sink(place) {
            Ok(data) => data,
            Err(Some(room)) => {
                rooms.push((row, room));
                ColumnMut::Utf8(text)
            }
            Err(None) => return Err(Failure::internal("an output column of an unplanned type")),
        };
        sinks.push(Sink {
            column: &column.name,
            data,
        });
    }
    let report = read(path, table, &mut sinks, job)?;
    drop(sinks);
    for (place, room) in rooms {
        write_texts(texts.get(place), room)?;
    }
    out.finish()?;
    Ok(report)
}

/// The memory of a column of numbers, or the room of a column of texts.
fn sink(place: output::ColumnMut<'_>) -> Result<ColumnMut<'_>, Option<TextsMut<'_>>> {
    use output::ColumnMut as Out;
    Ok(match place {
        Out::U8(values) => ColumnMut::U8(values),
        Out::I8(values) => ColumnMut::I8(values),
        Out::U16(values) => ColumnMut::U16(values),
        Out::I16(values) => ColumnMut::I16(values),
        Out::U32(values) => ColumnMut::U32(values),
        Out::I32(values) => ColumnMut::I32(values),
        Out::U64(values) => ColumnMut::U64(values),
        Out::I64(values) => ColumnMut::I64(values),
        Out::F32(values) => ColumnMut::F32(values),
        Out::F64(values) => ColumnMut::F64(values),
        Out::Bool(values) => ColumnMut::Bool(values),
        Out::Utf8(room) => return Err(Some(room)),
        Out::Dictionary(..) => return Err(None),
    })
}

fn write_texts(texts: Option<&TextColumn>, room: TextsMut<'_>) -> Result<(), Failure> {
    let broken = || Failure::internal("texts do not fit the room that was planned");
    let texts = texts.ok_or_else(broken)?;
    let (first, ends) = room.offsets.split_first_mut().ok_or_else(broken)?;
    let bytes = room.bytes.get_mut(..texts.bytes.len()).ok_or_else(broken)?;
    if ends.len() != texts.ends.len() {
        return Err(broken());
    }
    *first = 0;
    ends.copy_from_slice(&texts.ends);
    bytes.copy_from_slice(&texts.bytes);
    Ok(())
}

/// Tells the person what was seen while reading.
fn tell(job: &Job, table: &TableInfo, report: &ReadReport) {
    if let Some(field) = table.field.as_ref().filter(|_| report.outside_field > 0) {
        job.warn(&format!(
            "{} of {} localisations lie outside the camera's field of {} x {} pixels or are not \
             finite; they are kept.",
            report.outside_field, table.rows, field.width, field.height
        ));
    }
    if report.sorted {
        job.log(&format!(
            "The rows of {} were put in order of time.",
            table.dataset
        ));
    }
}
