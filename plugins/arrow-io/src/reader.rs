//! The readers as operations.

use crate::ipc::Ipc;
use crate::parquet_file::{BATCH, Column, Parquet};
use crate::place::{Gathered, numbers};
use crate::schema::{self, How, Plan as Columns, Planned};
use arrow_array::{Array, RecordBatch};
use puncta_sdk::output::{ColumnMut, OutputObject};
use puncta_sdk::prelude::*;
use puncta_sdk::run;
use puncta_sdk::serde_json::json;
use puncta_shared_import::MappingParams;
use puncta_shared_records::{damaged, open, split::front};
use std::collections::BTreeSet;
use std::sync::{Mutex, MutexGuard, PoisonError};

const PORT: &str = "localisations";
/// A batch beyond this many bytes may take longer than 50 ms.
const QUICK_BATCH: u64 = 8 << 20;
/// Rows of a Parquet file between two looks at cancel.
const STAGE: u64 = 4 * BATCH as u64;
/// Working memory: batches that are decoded at a time, and row groups' pages.
const MEMORY: u64 = 256 << 20;

const EXAMPLE_IPC: &[u8] = include_bytes!("../data/example.arrow");
const EXAMPLE_PARQUET: &[u8] = include_bytes!("../data/example.parquet");

/// Reads a table from an Arrow IPC file or stream.
#[derive(Debug, Params)]
pub struct ReadIpc {
    /// The explicit mapping of columns and units.
    #[param(flatten)]
    mapping: MappingParams,
}

/// Reads a table from a Parquet file.
#[derive(Debug, Params)]
pub struct ReadParquet {
    /// The explicit mapping of columns and units.
    #[param(flatten)]
    mapping: MappingParams,
}

fn plan_of(columns: &Columns, rows: u64, format: &str) -> Plan {
    let mut plan = Plan {
        interruptible: true,
        memory: MEMORY,
        notes: columns.notes.clone(),
        ..Plan::default()
    };
    plan.outputs.push(Output {
        output: PORT.into(),
        form: OutputForm::Object,
        of: None,
        header: columns.header(rows, |_| (rows.saturating_mul(64), rows)),
    });
    plan.probe = Some(Probe {
        format: format.into(),
        confidence: 1.0,
    });
    plan
}

fn is_text(planned: &Planned) -> bool {
    matches!(planned.how, How::Text | How::Dictionary)
}

/// Begins the output; texts have been gathered and are written at once.
fn begin<'j>(
    job: &'j Job,
    columns: &Columns,
    rows: u64,
    gathered: &[Gathered],
) -> Result<OutputObject<'j>, Failure> {
    let header = columns.header(rows, |place| {
        let texts = gathered.get(place).map(|one| &one.texts);
        texts.map_or((0, 0), |texts| {
            (texts.bytes.len() as u64, texts.ends.len() as u64)
        })
    });
    let mut out = job.begin(PORT, header)?;
    if columns.columns.iter().any(is_text) {
        out.commit(0, rows)?;
    }
    for (place, column) in out.columns_mut(0)?.into_iter().enumerate() {
        let Some(gathered) = gathered.get(place) else {
            continue;
        };
        match column {
            ColumnMut::Utf8(room) => gathered.texts.write(room)?,
            ColumnMut::Dictionary(codes, room) => {
                gathered.texts.write(room)?;
                let codes = codes.get_mut(..gathered.codes.len());
                let codes = codes.ok_or_else(|| Failure::internal("codes without room"))?;
                codes.copy_from_slice(&gathered.codes);
            }
            _ => {}
        }
    }
    let missing: u64 = gathered.iter().map(|one| one.missing).sum();
    if missing > 0 {
        job.warn(&format!("{missing} missing texts became empty."));
    }
    Ok(out)
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl ReadIpc {
    fn open(&self, request: &Request) -> Result<(Ipc, Columns), Failure> {
        let mapping = self.mapping.mapping()?;
        let opened = open(request, 64)?;
        let ipc = Ipc::open(&opened.name, opened.file, opened.length, &opened.head)?;
        let missing = |field: usize| ipc.missing.get(field).is_none_or(|count| *count > 0);
        let columns = schema::plan(&opened.name, &ipc.schema, &missing, &mapping)?;
        Ok((ipc, columns))
    }
}

impl Operation for ReadIpc {
    const ID: &'static str = "puncta.arrow-io.ipc.read/1";

    fn info() -> Info {
        Info::reader(
            "Arrow IPC tables",
            &[".arrow", ".feather", ".arrows", ".ipc"],
        )
        .description(
            "Reads a table from an Arrow IPC file (Feather 2) or stream, plain or compressed \
                 with LZ4 or Zstandard.\nUnits come from the fields' metadata (unit) or names \
                 such as `x [nm]`; a unit that the file does not state stays unknown.",
        )
        .formats(&[b"ARROW1", b"FEA1"], &["Arrow IPC"])
        .output(Ports::table(PORT).description("One row a row of the file."))
        .example(json!({}))
        .example_bytes("example.arrow", EXAMPLE_IPC)
    }

    fn prepare(&self, request: &Request) -> Result<Plan, Failure> {
        let (ipc, columns) = self.open(request)?;
        let mut plan = plan_of(&columns, ipc.rows, "Arrow IPC");
        // The file's batches, and as much again decompressed.
        plan.memory = plan.memory.saturating_add(ipc.largest().saturating_mul(3));
        plan.interruptible = ipc.largest() <= QUICK_BATCH;
        Ok(plan)
    }

    fn run(&self, job: &Job) -> Result<(), Failure> {
        let (ipc, columns) = self.open(job.request())?;
        let mut gathered: Vec<Gathered> = Vec::new();
        gathered.resize_with(columns.columns.len(), Gathered::default);
        let chosen = |text: bool| -> Vec<usize> {
            let all = (0..columns.columns.len()).filter(|i| is_text(&columns.columns[*i]) == text);
            all.collect()
        };
        let (texts, rest) = (chosen(true), chosen(false));
        // Each field once, in the order of the file; two columns may come from one.
        let fields = |places: &[usize]| -> Vec<usize> {
            let fields = places.iter().map(|place| columns.columns[*place].field);
            fields.collect::<BTreeSet<usize>>().into_iter().collect()
        };
        let (text_fields, rest_fields) = (fields(&texts), fields(&rest));
        let array = |batch: &RecordBatch, fields: &[usize], place: usize| {
            let field = columns.columns[place].field;
            let at = fields.iter().position(|known| *known == field)?;
            batch.columns().get(at).cloned()
        };
        let short = || Failure::internal("a batch has too few columns");
        if !texts.is_empty() {
            ipc.batches(&text_fields, job, &mut |batch| {
                for place in &texts {
                    let array = array(batch, &text_fields, *place).ok_or_else(short)?;
                    gathered[*place].add(&columns.columns[*place], array.as_ref())?;
                }
                Ok(())
            })?;
        }
        let mut out = begin(job, &columns, ipc.rows, &gathered)?;
        drop(gathered);
        if rest.is_empty() {
            return out.finish();
        }
        let ahead = texts.is_empty().then(|| out.committer());
        let mut targets: Vec<ColumnMut<'_>> = Vec::new();
        for (column, planned) in out.columns_mut(0)?.into_iter().zip(&columns.columns) {
            if !is_text(planned) {
                targets.push(column);
            }
        }
        ipc.batches(&rest_fields, job, &mut |batch| {
            let rows = batch.num_rows();
            if let Some(committer) = &ahead {
                committer.commit(0, rows as u64)?;
            }
            let parts = targets.iter_mut().zip(&rest).map(|(target, place)| {
                let width = columns.columns[*place].info.type_.width as usize;
                Mutex::new(Some(front(target, rows * width)))
            });
            let parts: Vec<_> = parts.collect();
            let copied = run::map(job, parts.len(), &|i| {
                let planned = &columns.columns[rest[i]];
                let array = array(batch, &rest_fields, rest[i]).ok_or_else(short)?;
                let part = lock(&parts[i]).take();
                numbers(planned, &array, part.ok_or_else(short)?)
            });
            copied.into_iter().collect()
        })?;
        drop(targets);
        out.finish()
    }
}

impl ReadParquet {
    fn open(&self, request: &Request) -> Result<(Parquet, Columns), Failure> {
        let mapping = self.mapping.mapping()?;
        let opened = open(request, 64)?;
        let file = Parquet::open(&opened.name, &opened.path, opened.length, &opened.head)?;
        let missing = |field: usize| file.may_miss(field);
        let columns = schema::plan(&opened.name, file.schema(), &missing, &mapping)?;
        let bytes = columns
            .columns
            .iter()
            .map(|one| one.info.type_.row_bytes().max(8) as u64);
        file.check(bytes.sum())?;
        Ok((file, columns))
    }
}

/// A column of numbers that is being filled.
struct Filling<'a> {
    planned: &'a Planned,
    column: Column,
    target: ColumnMut<'a>,
    done: u64,
}

impl Filling<'_> {
    fn reach(&mut self, goal: u64, job: &Job) -> Result<(), Failure> {
        while self.done < goal {
            if job.cancelled() {
                return Err(Failure::cancelled());
            }
            let array = self.column.next()?;
            if array.is_empty() {
                return Err(Failure::internal("an empty batch"));
            }
            let width = self.planned.info.type_.width as usize;
            let part = front(&mut self.target, array.len() * width);
            numbers(self.planned, &array, part)?;
            self.done += array.len() as u64;
        }
        Ok(())
    }
}

fn gather(file: &Parquet, planned: &Planned, job: &Job) -> Result<Gathered, Failure> {
    let mut gathered = Gathered::default();
    if !is_text(planned) || file.rows == 0 {
        return Ok(gathered);
    }
    let mut column = file.column(planned.field)?;
    let mut done = 0;
    while done < file.rows {
        if job.cancelled() {
            return Err(Failure::cancelled());
        }
        let array = column.next()?;
        gathered.add(planned, array.as_ref())?;
        done += array.len() as u64;
    }
    if done != file.rows {
        return Err(damaged("the file has more rows than it announces"));
    }
    Ok(gathered)
}

impl Operation for ReadParquet {
    const ID: &'static str = "puncta.arrow-io.parquet.read/1";

    fn info() -> Info {
        Info::reader("Parquet tables", &[".parquet", ".pq"])
            .description(
                "Reads a table from a Parquet file, plain or compressed with Snappy, Zstandard, \
                 LZ4 or gzip.\nUnits come from the fields' metadata (unit) or names such as \
                 `x [nm]`; a unit that the file does not state stays unknown.",
            )
            .formats(&[b"PAR1"], &["Parquet"])
            .output(Ports::table(PORT).description("One row a row of the file."))
            .example(json!({}))
            .example_bytes("example.parquet", EXAMPLE_PARQUET)
    }

    fn prepare(&self, request: &Request) -> Result<Plan, Failure> {
        let (file, columns) = self.open(request)?;
        Ok(plan_of(&columns, file.rows, "Parquet"))
    }

    fn run(&self, job: &Job) -> Result<(), Failure> {
        let (file, columns) = self.open(job.request())?;
        let count = columns.columns.len();
        let gathered = run::map(job, count, &|i| gather(&file, &columns.columns[i], job));
        let gathered = gathered.into_iter().collect::<Result<Vec<_>, _>>()?;
        let mut out = begin(job, &columns, file.rows, &gathered)?;
        drop(gathered);
        let committed = columns.columns.iter().any(is_text);
        let committer = out.committer();
        let mut filling = Vec::new();
        for (target, planned) in out.columns_mut(0)?.into_iter().zip(&columns.columns) {
            if !is_text(planned) && file.rows > 0 {
                let column = file.column(planned.field)?;
                filling.push(Mutex::new(Filling {
                    planned,
                    column,
                    target,
                    done: 0,
                }));
            }
        }
        let (mut goal, mut room) = (0, if committed { file.rows } else { 0 });
        while goal < file.rows && !filling.is_empty() {
            goal = (goal + STAGE).min(file.rows);
            // A column may be a batch ahead of the others.
            let wanted = (goal + BATCH as u64).min(file.rows);
            committer.commit(0, wanted.saturating_sub(room))?;
            room = room.max(wanted);
            let reached = run::map(job, filling.len(), &|i| lock(&filling[i]).reach(goal, job));
            reached.into_iter().collect::<Result<(), _>>()?;
            job.progress(goal as f64 / file.rows as f64, "reading")?;
        }
        drop(filling);
        out.finish()
    }
}
