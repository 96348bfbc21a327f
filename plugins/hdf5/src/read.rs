//! Fills the caller's columns from the stored records.

use std::path::Path;
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};

use puncta_sdk::{Failure, Run};

use crate::arrays;
use crate::column::{ColumnMut, Part, PartRows, TextColumn};
use crate::error::unsupported;
use crate::info::{ColumnInfo, FieldOfView, TableInfo};
use crate::open::{self, Opened};
use crate::raw;
use crate::record::{Leaf, LeafType};
use crate::source::{Buffers, Source};
use crate::split::{Block, fill, fill_f64, fill_keys};
use crate::storage::{self, Shape};

/// Bytes of records that are split at a time, so that they stay in the first-level cache.
const TILE_BYTES: usize = 32 << 10;

/// A column of a table and the memory that it fills.
#[derive(Debug)]
pub(crate) struct Sink<'a> {
    /// Canonical name, as in [`TableInfo::columns`].
    pub(crate) column: &'a str,
    /// Exactly [`TableInfo::rows`] elements of the column's kind; an empty text column.
    pub(crate) data: ColumnMut<'a>,
}

/// What was seen while reading.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(crate) struct ReadReport {
    /// Localisations whose position is not finite or outside the camera's field, where known.
    pub(crate) outside_field: u64,
    /// The rows were not in order of time and have been sorted.
    pub(crate) sorted: bool,
}

/// Fills `sinks` with columns of `table`, which [`inspect`](crate::inspect) gave for this file.
///
/// The result does not depend on the number of threads. Memory beyond the sinks: about 3 MB a
/// thread, and 20 bytes a row while rows are sorted.
///
/// # Errors
/// Cancel, a sink that does not fit its column, a damaged file, or one that changed since it was
/// inspected.
pub(crate) fn read(
    path: &Path,
    table: &TableInfo,
    sinks: &mut [Sink<'_>],
    run: &dyn Run,
) -> Result<ReadReport, Failure> {
    let opened = open::open(path)?;
    let columns = matched(table, sinks, &opened.name)?;
    if !table.segments.is_empty() {
        arrays::read(&opened, table, &columns, sinks, run)?;
        return Ok(ReadReport::default());
    }
    let source = source(path, &opened, table)?;
    let rows = usize::try_from(table.rows).unwrap_or(usize::MAX);
    let mut keys = vec![0_i64; if table.sort_by.is_some() { rows } else { 0 }];
    let outside = AtomicU64::new(0);
    let pass = Pass {
        table,
        columns: &columns,
        outside: &outside,
    };
    fill_blocks(&source, &pass, sinks, &mut keys, run)?;
    let sorted = !keys.is_sorted();
    if sorted {
        sort_rows(&keys, sinks, run)?;
    }
    run.progress(1.0, "reading")?;
    Ok(ReadReport {
        outside_field: outside.into_inner(),
        sorted,
    })
}

fn source(path: &Path, opened: &Opened, table: &TableInfo) -> Result<Source, Failure> {
    let dataset = open::dataset(opened, &table.dataset)?;
    let shape = dataset.shape();
    let size = raw::stored_type(&dataset).map_or(0, |(_, size)| size);
    let rows = usize::try_from(table.rows).unwrap_or(usize::MAX);
    if shape != [rows] || size != table.record {
        let message = format!("{} was changed while it was read", opened.name);
        return Err(Failure::bad_file(message).remedy("open it again"));
    }
    let shape = Shape {
        file: &opened.name,
        dataset: &table.dataset,
        length: opened.length,
        rows: table.rows,
        record: table.record,
    };
    let storage = storage::plan(&dataset, &shape)?;
    let place = format!("{}, dataset {},", opened.name, table.dataset);
    Source::new(path, dataset, storage, place, rows, table.record)
}

/// The column of each sink.
fn matched<'t>(
    table: &'t TableInfo,
    sinks: &[Sink<'_>],
    file: &str,
) -> Result<Vec<&'t ColumnInfo>, Failure> {
    let find = |sink: &Sink<'_>| {
        let name = sink.column;
        let column = table.column(name).ok_or_else(|| {
            let known: Vec<_> = table.columns.iter().map(|c| c.name.as_str()).collect();
            Failure::internal(format!(
                "{file} has no column {name} among {}",
                known.join(", ")
            ))
        })?;
        let rows_fit = sink
            .data
            .rows()
            .is_none_or(|rows| rows as u64 == table.rows);
        let empty = !matches!(&sink.data, ColumnMut::Utf8(texts) if !texts.is_empty());
        if sink.data.element() == column.element && rows_fit && empty {
            return Ok(column);
        }
        Err(Failure::internal(format!(
            "{file}, column {name}: memory for {} rows of {} is needed",
            table.rows,
            column.element.name()
        )))
    };
    sinks.iter().map(find).collect()
}

/// What each block needs besides its memory.
struct Pass<'a> {
    table: &'a TableInfo,
    columns: &'a [&'a ColumnInfo],
    outside: &'a AtomicU64,
}

/// Memory that one block fills.
struct BlockMemory<'a> {
    parts: Vec<Part<'a>>,
    keys: &'a mut [i64],
}

fn fill_blocks(
    source: &Source,
    pass: &Pass<'_>,
    sinks: &mut [Sink<'_>],
    keys: &mut [i64],
    run: &dyn Run,
) -> Result<(), Failure> {
    let (rows, count) = (source.block_rows().max(1), source.blocks());
    let blocks = block_memory(sinks, keys, rows, count);
    let pool: Mutex<Vec<Buffers>> = Mutex::new(Vec::new());
    let failed: Mutex<Option<(usize, Failure)>> = Mutex::new(None);
    let done = AtomicUsize::new(0);
    let step = (count / 200).max(1);
    run.parallel(count, &|index| {
        if run.cancelled() || lock(&failed).is_some() {
            return;
        }
        let Some(block) = blocks.get(index) else {
            return;
        };
        let mut buffers = lock(&pool).pop().unwrap_or_default();
        let memory = &mut *lock(block);
        let loaded = source.load(index, &mut buffers, &mut |first, rows, stored| {
            pass.split(memory, first, rows, stored);
        });
        lock(&pool).push(buffers);
        let before = done.fetch_add(1, Ordering::Relaxed);
        let told = match (before + 1) % step {
            0 => run.progress((before + 1) as f64 / count as f64, "reading"),
            _ => Ok(()),
        };
        if let Err(error) = loaded.and(told.map_err(Failure::from)) {
            let mut first = lock(&failed);
            if first.as_ref().is_none_or(|(at, _)| *at > index) {
                *first = Some((index, error));
            }
        }
    });
    if run.cancelled() {
        return Err(Failure::cancelled());
    }
    if let Some((_, error)) = failed.into_inner().unwrap_or_else(PoisonError::into_inner) {
        return Err(error);
    }
    let parts = blocks.into_iter().map(|block| {
        block
            .into_inner()
            .unwrap_or_else(PoisonError::into_inner)
            .parts
    });
    let texts = collect_texts(parts);
    for (sink, text) in sinks.iter_mut().zip(texts) {
        if let ColumnMut::Utf8(target) = &mut sink.data {
            target.append(&text);
        }
    }
    Ok(())
}

/// Cuts all columns into the memory of each block.
fn block_memory<'a>(
    sinks: &'a mut [Sink<'_>],
    keys: &'a mut [i64],
    rows: usize,
    count: usize,
) -> Vec<Mutex<BlockMemory<'a>>> {
    let mut keys = keys.chunks_mut(rows);
    let mut blocks: Vec<_> = (0..count)
        .map(|_| BlockMemory {
            parts: Vec::new(),
            keys: keys.next().unwrap_or_default(),
        })
        .collect();
    for sink in sinks {
        for (block, part) in blocks.iter_mut().zip(sink.data.parts(rows, count)) {
            block.parts.push(part);
        }
    }
    blocks.into_iter().map(Mutex::new).collect()
}

/// Joins the texts of all blocks, column by column; numeric columns give empty ones.
fn collect_texts<'a>(blocks: impl Iterator<Item = Vec<Part<'a>>>) -> Vec<TextColumn> {
    let mut columns = Vec::new();
    for parts in blocks {
        columns.resize_with(parts.len(), TextColumn::default);
        for (column, part) in columns.iter_mut().zip(parts) {
            if let Part::Utf8(texts) = part {
                column.append(&texts);
            }
        }
    }
    columns
}

fn lock<T>(mutex: &Mutex<T>) -> std::sync::MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Pass<'_> {
    /// Splits rows `first..first + rows` of a block; `stored` begins with row `first`.
    fn split(&self, memory: &mut BlockMemory<'_>, first: usize, rows: usize, stored: Block<'_>) {
        match stored {
            Block::Planes { .. } => self.split_tile(memory, first, rows, stored),
            Block::Records { bytes, record } => {
                let tile = (TILE_BYTES / record.max(1)).max(1);
                for (at, bytes) in bytes.chunks(tile * record.max(1)).enumerate() {
                    let start = at * tile;
                    let count = tile.min(rows.saturating_sub(start));
                    let part = Block::Records { bytes, record };
                    self.split_tile(memory, first + start, count, part);
                }
            }
        }
    }

    fn split_tile(&self, memory: &mut BlockMemory<'_>, first: usize, rows: usize, tile: Block<'_>) {
        for (part, column) in memory.parts.iter_mut().zip(self.columns) {
            match &column.compute {
                Some(compute) => compute.fill(tile, rows, part.rows_mut(first, rows)),
                None => fill(
                    tile,
                    &column.leaf,
                    column.factor,
                    part.rows_mut(first, rows),
                ),
            }
            subtract(column.base, part.rows_mut(first, rows));
        }
        if let (Some(leaf), Some(keys)) = (&self.table.sort_by, memory.keys.get_mut(first..)) {
            let count = rows.min(keys.len());
            fill_keys(tile, leaf, &mut keys[..count]);
        }
        if let Some(field) = &self.table.field {
            self.outside
                .fetch_add(count_outside(tile, rows, field), Ordering::Relaxed);
        }
    }
}

/// Takes the number of the first frame off.
pub(crate) fn subtract(base: u8, rows: PartRows<'_>) {
    if base > 0
        && let PartRows::F64(values) = rows
    {
        for value in values {
            *value -= f64::from(base);
        }
    }
}

/// Rows whose position is not inside 0..=width, 0..=height pixels.
fn count_outside(tile: Block<'_>, rows: usize, field: &FieldOfView) -> u64 {
    let position = |leaf: &Leaf| {
        let mut values = vec![0.0; rows];
        if let LeafType::Number { number, big_endian } = leaf.stored {
            fill_f64(tile, leaf.offset, number, big_endian, 1.0, &mut values);
        }
        values
    };
    let inside = |v: f64, size: f64| (0.0..=size).contains(&v);
    let (x, y) = (position(&field.x), position(&field.y));
    let outside = x
        .iter()
        .zip(&y)
        .filter(|&(&x, &y)| !(inside(x, field.width) & inside(y, field.height)));
    outside.count() as u64
}

/// Sorts all columns by `keys`; rows with equal keys keep their order.
fn sort_rows(keys: &[i64], sinks: &mut [Sink<'_>], run: &dyn Run) -> Result<(), Failure> {
    let rows = u32::try_from(keys.len()).map_err(|_| {
        unsupported(
            "more than 4,294,967,295 rows cannot be sorted",
            "split the file",
        )
    })?;
    run.progress(1.0, "sorting rows")?;
    let mut order: Vec<u32> = (0..rows).collect();
    order.sort_by_key(|&row| keys.get(row as usize).copied().unwrap_or_default());
    let sinks: Vec<_> = sinks.iter_mut().map(Mutex::new).collect();
    run.parallel(sinks.len(), &|index| {
        if let Some(sink) = sinks.get(index).filter(|_| !run.cancelled()) {
            lock(sink).data.permute(&order);
        }
    });
    if run.cancelled() {
        Err(Failure::cancelled())
    } else {
        Ok(())
    }
}
