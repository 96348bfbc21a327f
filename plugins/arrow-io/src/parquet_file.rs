//! Columns of Parquet files, each read on its own so that all threads have work.

use crate::guard::decode;
use arrow_array::ArrayRef;
use arrow_schema::Schema;
use parquet::arrow::ProjectionMask;
use parquet::arrow::arrow_reader::{
    ArrowReaderMetadata, ArrowReaderOptions, ParquetRecordBatchReader,
    ParquetRecordBatchReaderBuilder,
};
use puncta_sdk::Failure;
use puncta_shared_records::{damaged, not_mine};
use std::fs::File;
use std::path::{Path, PathBuf};

/// Rows that a column's reader gives at a time.
pub const BATCH: usize = 32 << 10;
/// Bytes of columns for each byte of the file: a run of a million equal values takes a few bytes.
const MOST_EXPANSION: u64 = 100_000;
const ALWAYS: u64 = 256 << 20;

/// A file's metadata.
pub struct Parquet {
    name: String,
    path: PathBuf,
    length: u64,
    metadata: ArrowReaderMetadata,
    /// Rows of all row groups.
    pub rows: u64,
}

impl Parquet {
    /// Reads the metadata of a file of `length` bytes that begins with `head`.
    pub fn open(name: &str, path: &Path, length: u64, head: &[u8]) -> Result<Parquet, Failure> {
        if !head.starts_with(b"PAR1") {
            return Err(not_mine(name, "Parquet"));
        }
        let file = File::open(path).map_err(|error| Failure::io("read", path, &error))?;
        let options = ArrowReaderOptions::new();
        let metadata = decode(name, || ArrowReaderMetadata::load(&file, options))?;
        let groups = metadata.metadata().row_groups();
        let rows = groups.iter().try_fold(0_u64, |rows, group| {
            rows.checked_add(u64::try_from(group.num_rows()).ok()?)
        });
        let rows = rows.ok_or_else(|| damaged(format!("{name} announces impossible rows")))?;
        Ok(Parquet {
            name: name.into(),
            path: path.into(),
            length,
            metadata,
            rows,
        })
    }

    /// The fields.
    pub fn schema(&self) -> &Schema {
        self.metadata.schema()
    }

    /// Refuses rows that cannot be in so small a file.
    pub fn check(&self, row_bytes: u64) -> Result<(), Failure> {
        let most = self
            .length
            .saturating_mul(MOST_EXPANSION)
            .clamp(ALWAYS, 1 << 46);
        if self.rows.saturating_mul(row_bytes.max(1)) > most {
            let (name, rows) = (&self.name, self.rows);
            return Err(damaged(format!(
                "{name} announces {rows} rows, more than its {} bytes can hold",
                self.length
            )));
        }
        Ok(())
    }

    /// Whether a field may have missing values, as the row groups' statistics say.
    pub fn may_miss(&self, field: usize) -> bool {
        let descriptor = self.metadata.parquet_schema();
        let leaves: Vec<usize> = (0..descriptor.num_columns())
            .filter(|leaf| descriptor.get_column_root_idx(*leaf) == field)
            .collect();
        self.metadata.metadata().row_groups().iter().any(|group| {
            leaves.iter().any(|leaf| {
                let statistics = group
                    .columns()
                    .get(*leaf)
                    .and_then(|chunk| chunk.statistics());
                statistics.and_then(|known| known.null_count_opt()) != Some(0)
            })
        })
    }

    /// A reader of one field from the first row on.
    pub fn column(&self, field: usize) -> Result<Column, Failure> {
        let file =
            File::open(&self.path).map_err(|error| Failure::io("read", &self.path, &error))?;
        let builder =
            ParquetRecordBatchReaderBuilder::new_with_metadata(file, self.metadata.clone());
        let mask = ProjectionMask::roots(builder.parquet_schema(), [field]);
        let builder = builder.with_projection(mask).with_batch_size(BATCH);
        Ok(Column {
            name: self.name.clone(),
            reader: decode(&self.name, || builder.build())?,
        })
    }
}

/// A column that is being read.
pub struct Column {
    name: String,
    reader: ParquetRecordBatchReader,
}

impl Column {
    /// The next values: [`BATCH`] of them but at the end.
    ///
    /// # Errors
    /// When there are no more, or they are damaged.
    pub fn next(&mut self) -> Result<ArrayRef, Failure> {
        let name = &self.name;
        let batch = decode(name, || self.reader.next().transpose())?;
        let array = batch.and_then(|batch| batch.columns().first().cloned());
        array.ok_or_else(|| damaged(format!("{name} has fewer rows than it announces")))
    }
}
