//! The writers as operations.

use crate::array::{Source, batch, sources};
use crate::fields;
use arrow_ipc::writer::{FileWriter, IpcWriteOptions, StreamWriter};
use arrow_ipc::{CompressionType, MetadataVersion};
use arrow_schema::{ArrowError, DataType, Schema};
use parquet::arrow::ArrowSchemaConverter;
use parquet::arrow::add_encoded_arrow_schema_to_metadata;
use parquet::arrow::arrow_writer::{ArrowRowGroupWriterFactory, compute_leaves};
use parquet::basic::{Compression, ZstdLevel};
use parquet::errors::ParquetError;
use parquet::file::metadata::KeyValue;
use parquet::file::properties::{EnabledStatistics, WriterProperties};
use parquet::file::writer::SerializedFileWriter;
use parquet::schema::types::ColumnPath;
use puncta_sdk::documents::call::Read;
use puncta_sdk::prelude::*;
use puncta_sdk::run;
use puncta_sdk::serde_json::json;
use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};

/// Rows of an IPC batch, and rows that a Parquet column takes at a time.
const ROWS: usize = 64 << 10;
/// Rows of a Parquet row group, whose encoded columns stay in memory.
const GROUP: usize = 1 << 20;

/// Writes a table as an Arrow IPC file or stream.
#[derive(Debug, Params)]
pub struct WriteIpc {
    /// How batches are compressed.
    #[param(default = IpcCompression::None)]
    compression: IpcCompression,
}

/// How batches are compressed.
#[derive(Choice, Clone, Copy, Debug, PartialEq, Eq)]
pub enum IpcCompression {
    /// Not at all; other programs can map the file.
    None,
    /// LZ4.
    Lz4,
    /// Zstandard.
    Zstd,
}

/// Writes a table as a Parquet file.
#[derive(Debug, Params)]
pub struct WriteParquet {
    /// How columns are compressed.
    #[param(default = ParquetCompression::Zstd)]
    compression: ParquetCompression,
}

/// How columns are compressed.
#[derive(Choice, Clone, Copy, Debug, PartialEq, Eq)]
pub enum ParquetCompression {
    /// Not at all.
    None,
    /// Snappy, which every program reads.
    Snappy,
    /// LZ4.
    Lz4,
    /// Zstandard.
    Zstd,
}

fn prepare(request: &Request, memory: u64) -> Result<Plan, Failure> {
    let input = request.inputs.first();
    let input = input.ok_or_else(|| Failure::bad_input("there is no table to write"))?;
    let columns = input.header.parts.first().map(|part| part.columns.iter());
    let columns: Vec<String> = columns
        .into_iter()
        .flatten()
        .map(|c| c.name.clone())
        .collect();
    if columns.is_empty() {
        return Err(Failure::bad_input(
            "a table without columns cannot be written",
        ));
    }
    fields::schema(&input.header)?;
    let mut plan = Plan {
        interruptible: true,
        memory,
        ..Plan::default()
    };
    plan.read.push(Read {
        input: 0,
        part: 0,
        columns,
    });
    Ok(plan)
}

fn create(path: &Path) -> Result<BufWriter<File>, Failure> {
    let file = File::create(path).map_err(|error| Failure::io("write", path, &error))?;
    Ok(BufWriter::with_capacity(1 << 20, file))
}

fn arrow_failure(error: ArrowError, path: &Path) -> Failure {
    match error {
        ArrowError::IoError(_, error) => Failure::io("write", path, &error),
        other => Failure::internal(format!("cannot write {}: {other}", path.display())),
    }
}

fn parquet_failure(error: ParquetError, path: &Path) -> Failure {
    match error {
        ParquetError::External(inner) => match inner.downcast::<io::Error>() {
            Ok(error) => Failure::io("write", path, &error),
            Err(other) => Failure::internal(format!("cannot write {}: {other}", path.display())),
        },
        other => Failure::internal(format!("cannot write {}: {other}", path.display())),
    }
}

impl WriteIpc {
    fn options(&self) -> Result<IpcWriteOptions, ArrowError> {
        let codec = match self.compression {
            IpcCompression::None => None,
            IpcCompression::Lz4 => Some(CompressionType::LZ4_FRAME),
            IpcCompression::Zstd => Some(CompressionType::ZSTD),
        };
        IpcWriteOptions::try_new(64, false, MetadataVersion::V5)?.try_with_compression(codec)
    }
}

impl Operation for WriteIpc {
    const ID: &'static str = "puncta.arrow-io.ipc.write/1";

    fn info() -> Info {
        Info::writer(
            "Arrow IPC tables",
            &[".arrow", ".feather", ".arrows", ".ipc"],
        )
        .description(
            "Writes all columns of a table as an Arrow IPC file (Feather 2), or as a stream \
                 where the name ends in .arrows.\nUnits, roles and metadata stay in the fields' \
                 and the schema's metadata.",
        )
        .input(Ports::table("table").description("All columns are written."))
        .example(json!({}))
        .example_input("table", "puncta.synthetic.membrane/1", json!({}))
    }

    fn prepare(&self, request: &Request) -> Result<Plan, Failure> {
        prepare(request, 64 << 20)
    }

    fn run(&self, job: &Job) -> Result<(), Failure> {
        let file = job.file()?;
        let path = Path::new(&file.path);
        let failed = |error| arrow_failure(error, path);
        let input = job.input("table")?;
        let schema = Arc::new(fields::schema(input.header())?);
        let sources = sources(&input, &schema)?;
        let options = self.options().map_err(failed)?;
        let mut out = create(path)?;
        let each = |write: &mut dyn FnMut(&arrow_array::RecordBatch) -> Result<(), ArrowError>| {
            let total = input.rows();
            let mut first = 0;
            while first < total || (first == 0 && total == 0) {
                let rows = first..(first + ROWS).min(total);
                first = rows.end.max(1);
                write(&batch(&schema, &sources, rows)?).map_err(failed)?;
                job.progress(first as f64 / total.max(1) as f64, "writing")?;
            }
            Ok::<(), Failure>(())
        };
        if file.name.to_lowercase().ends_with(".arrows") {
            let stream = StreamWriter::try_new_with_options(&mut out, &schema, options);
            let mut stream = stream.map_err(failed)?;
            each(&mut |batch| stream.write(batch))?;
            stream.finish().map_err(failed)?;
        } else {
            let whole = FileWriter::try_new_with_options(&mut out, &schema, options);
            let mut whole = whole.map_err(failed)?;
            each(&mut |batch| whole.write(batch))?;
            whole.finish().map_err(failed)?;
        }
        out.flush()
            .map_err(|error| Failure::io("write", path, &error))
    }
}

impl WriteParquet {
    fn properties(&self, schema: &Schema) -> WriterProperties {
        let compression = match self.compression {
            ParquetCompression::None => Compression::UNCOMPRESSED,
            ParquetCompression::Snappy => Compression::SNAPPY,
            ParquetCompression::Lz4 => Compression::LZ4_RAW,
            ParquetCompression::Zstd => {
                ZstdLevel::try_new(1).map_or(Compression::SNAPPY, Compression::ZSTD)
            }
        };
        let mut builder = WriterProperties::builder()
            .set_compression(compression)
            .set_created_by(concat!("puncta ", env!("CARGO_PKG_VERSION")).into())
            .set_statistics_enabled(EnabledStatistics::Chunk);
        for field in schema.fields() {
            // Measured values hardly repeat: a dictionary would only cost time.
            let path = match field.data_type() {
                DataType::Float32 | DataType::Float64 => vec![field.name().clone()],
                DataType::FixedSizeList(..) => {
                    vec![field.name().clone(), "list".into(), "item".into()]
                }
                _ => continue,
            };
            builder = builder.set_column_dictionary_enabled(ColumnPath::new(path), false);
        }
        builder.build()
    }
}

impl Operation for WriteParquet {
    const ID: &'static str = "puncta.arrow-io.parquet.write/1";

    fn info() -> Info {
        Info::writer("Parquet tables", &[".parquet", ".pq"])
            .description(
                "Writes all columns of a table as a Parquet file.\nUnits, roles and metadata stay \
                 in the fields' and the schema's metadata.",
            )
            .input(Ports::table("table").description("All columns are written."))
            .example(json!({}))
            .example_input("table", "puncta.synthetic.membrane/1", json!({}))
    }

    fn prepare(&self, request: &Request) -> Result<Plan, Failure> {
        let header = request.inputs.first().map(|input| &input.header);
        let parts = header.and_then(|header| header.parts.first());
        let row: usize = parts
            .map_or(&[][..], |part| &part.columns)
            .iter()
            .map(|column| column.type_.row_bytes().max(8))
            .sum();
        prepare(request, 2 * (GROUP * row) as u64)
    }

    fn run(&self, job: &Job) -> Result<(), Failure> {
        let path = Path::new(&job.file()?.path);
        let failed = |error| parquet_failure(error, path);
        let input = job.input("table")?;
        let schema = Arc::new(fields::schema(input.header())?);
        let sources = sources(&input, &schema)?;
        let mut properties = self.properties(&schema);
        add_encoded_arrow_schema_to_metadata(&schema, &mut properties);
        let descriptor = ArrowSchemaConverter::new()
            .convert(&schema)
            .map_err(failed)?;
        let mut out = create(path)?;
        let root = descriptor.root_schema_ptr();
        let file = SerializedFileWriter::new(&mut out, root, Arc::new(properties));
        let mut file = file.map_err(failed)?;
        for (key, value) in schema.metadata() {
            file.append_key_value_metadata(KeyValue::new(key.clone(), value.clone()));
        }
        let factory = ArrowRowGroupWriterFactory::new(&file, Arc::clone(&schema));
        let total = input.rows();
        for (number, first) in (0..total).step_by(GROUP).enumerate() {
            let writers = factory.create_column_writers(number).map_err(failed)?;
            let writers: Vec<_> = writers
                .into_iter()
                .map(|writer| Mutex::new(Some(writer)))
                .collect();
            let rows = first..(first + GROUP).min(total);
            let chunks = run::map(job, writers.len(), &|i| {
                let mut writer = writers[i]
                    .lock()
                    .unwrap_or_else(PoisonError::into_inner)
                    .take();
                let writer = writer.take().zip(sources.get(i));
                let (mut writer, source) =
                    writer.ok_or_else(|| Failure::internal("a column without a writer"))?;
                for first in rows.clone().step_by(ROWS) {
                    if job.cancelled() {
                        return Err(Failure::cancelled());
                    }
                    let part = first..(first + ROWS).min(rows.end);
                    write_rows(&mut writer, source, &schema.fields()[i], part, path)?;
                }
                writer.close().map_err(failed)
            });
            let mut group = file.next_row_group().map_err(failed)?;
            for chunk in chunks {
                chunk?.append_to_row_group(&mut group).map_err(failed)?;
            }
            group.close().map_err(failed)?;
            job.progress(rows.end as f64 / total as f64, "writing")?;
        }
        file.close().map_err(failed)?;
        out.flush()
            .map_err(|error| Failure::io("write", path, &error))
    }
}

fn write_rows(
    writer: &mut parquet::arrow::arrow_writer::ArrowColumnWriter,
    source: &Source<'_>,
    field: &arrow_schema::Field,
    rows: std::ops::Range<usize>,
    path: &Path,
) -> Result<(), Failure> {
    let array = source.array(rows)?;
    let leaves = compute_leaves(field, &array).map_err(|error| parquet_failure(error, path))?;
    for leaf in &leaves {
        writer
            .write(leaf)
            .map_err(|error| parquet_failure(error, path))?;
    }
    Ok(())
}
