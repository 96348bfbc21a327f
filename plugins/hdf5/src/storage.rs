//! How a dataset's records lie in the file, checked against the file's length before anything is
//! allocated.
//!
//! Plain records, and chunks that are only shuffled and deflated, are read straight from the
//! file, on all threads; everything else goes through libhdf5, whose calls are serialised.

use hdf5::Dataset;
use hdf5::filters::Filter;
use hdf5::plist::dataset_create::Layout;

use puncta_sdk::Failure;

use crate::error::{damaged, hdf5_reason, unsupported};

/// Deflate cannot expand beyond 1032 to 1 (two bits a 258-byte match).
const DEFLATE_EXPANSION: u64 = 1032;
/// Bound for LZF (at most 264 bytes from three) and Blosc's LZ4 and BloscLZ.
const LZ_EXPANSION: u64 = 300;
/// Zstandard stores 128 KiB of one byte in four bytes; frame headers keep it below this.
const ZSTD_EXPANSION: u64 = 33_000;
/// A chunk is decoded as a whole, so its size is bounded.
const MAX_CHUNK_BYTES: u64 = 512 << 20;
/// Bytes that one task reads.
pub(crate) const BLOCK_BYTES: usize = 1 << 20;

/// Where the records are.
#[derive(Debug)]
pub(crate) enum Storage {
    /// One run of records from this byte on.
    Contiguous { offset: u64 },
    /// Chunks in row order, decoded here.
    Chunks {
        rows: usize,
        chunks: Vec<Chunk>,
        steps: Vec<Step>,
    },
    /// Decoded by libhdf5, best in blocks of this many rows.
    Library { rows: usize },
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Chunk {
    pub address: u64,
    pub bytes: u64,
    /// Bit `i` set: step `i` was left out for this chunk.
    pub skipped: u32,
}

/// A filter in the order in which the writer applied it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Step {
    Shuffle,
    Deflate,
}

impl Storage {
    /// Bytes of records that are loaded at a time.
    pub(crate) fn block_bytes(&self, record: usize) -> usize {
        match self {
            Self::Contiguous { .. } => BLOCK_BYTES.max(record),
            Self::Chunks { rows, .. } | Self::Library { rows } => {
                BLOCK_BYTES.max(rows.saturating_mul(record))
            }
        }
    }
}

/// What is known of a dataset before its storage is looked at.
pub(crate) struct Shape<'a> {
    pub file: &'a str,
    pub dataset: &'a str,
    pub length: u64,
    pub rows: u64,
    pub record: usize,
}

impl Shape<'_> {
    fn refuse(&self, why: &str, remedy: &str) -> Failure {
        unsupported(
            format!("{}, dataset {}: {why}", self.file, self.dataset),
            remedy,
        )
    }

    fn damaged(&self, why: &str) -> Failure {
        damaged(format!(
            "{}, dataset {}, is damaged: {why}",
            self.file, self.dataset
        ))
    }

    fn library(&self, error: &hdf5::Error) -> Failure {
        self.damaged(&hdf5_reason(error))
    }
}

/// Finds and checks the storage of a one-dimensional dataset of records.
///
/// # Errors
/// More rows than the file can hold, rows that were never written, external or virtual storage,
/// and compression that cannot be undone here.
pub(crate) fn plan(dataset: &Dataset, shape: &Shape<'_>) -> Result<Storage, Failure> {
    let create = dataset.create_plist().map_err(|e| shape.library(&e))?;
    let layout = create.get_layout().map_err(|e| shape.library(&e))?;
    let filters = create.get_filters().map_err(|_| {
        shape.refuse(
            "compression with unknown settings",
            "save the file again with gzip",
        )
    })?;
    let bytes = shape.rows.checked_mul(shape.record as u64);
    let bound = expansion(&filters).saturating_mul(shape.length);
    if bytes.is_none_or(|bytes| bytes > bound) {
        let why = format!(
            "{} rows of {} bytes are announced, but the file has {} bytes",
            shape.rows, shape.record, shape.length
        );
        return Err(shape.damaged(&why));
    }
    if shape.rows == 0 || shape.record == 0 {
        return Ok(Storage::Library { rows: 1 });
    }
    let external = create.get_external().map_err(|e| shape.library(&e))?;
    if layout == Layout::Virtual || !external.is_empty() {
        return Err(shape.refuse("its rows are kept in other files", "save it as one file"));
    }
    match layout {
        Layout::Contiguous => contiguous(dataset, shape),
        Layout::Chunked => chunked(
            dataset,
            shape,
            &create.chunk().unwrap_or_default(),
            &filters,
        ),
        _ => Ok(Storage::Library {
            rows: (BLOCK_BYTES / shape.record).max(1),
        }),
    }
}

/// Checks a dataset of numbers of any number of dimensions, `shape.rows` in all. Gives the number
/// of elements along `axis` that are decoded together.
///
/// # Errors
/// As [`plan`].
pub(crate) fn check_array(
    dataset: &Dataset,
    shape: &Shape<'_>,
    axis: usize,
) -> Result<u64, Failure> {
    let create = dataset.create_plist().map_err(|e| shape.library(&e))?;
    let layout = create.get_layout().map_err(|e| shape.library(&e))?;
    let filters = create.get_filters().map_err(|_| {
        shape.refuse(
            "compression with unknown settings",
            "save the file again with gzip",
        )
    })?;
    let expansion = expansion(&filters);
    let bytes = shape.rows.checked_mul(shape.record as u64);
    if bytes.is_none_or(|bytes| bytes > expansion.saturating_mul(shape.length)) {
        let why = format!(
            "{} numbers are announced, but the file has {} bytes",
            shape.rows, shape.length
        );
        return Err(shape.damaged(&why));
    }
    let external = create.get_external().map_err(|e| shape.library(&e))?;
    if layout == Layout::Virtual || !external.is_empty() {
        return Err(shape.refuse("its rows are kept in other files", "save it as one file"));
    }
    if layout != Layout::Chunked {
        return Ok(1);
    }
    check_filters(shape, &filters)?;
    let chunk = create.chunk().unwrap_or_default();
    let elements = chunk
        .iter()
        .try_fold(1_u64, |n, c| n.checked_mul(*c as u64));
    let bytes = elements.and_then(|n| n.checked_mul(shape.record as u64));
    if bytes
        .is_none_or(|b| b == 0 || b > MAX_CHUNK_BYTES.min(expansion.saturating_mul(shape.length)))
    {
        return Err(shape.refuse(
            "chunks of a wrong size",
            "save it with chunks of about 1 MB",
        ));
    }
    Ok(chunk.get(axis).map_or(1, |c| *c as u64))
}

fn contiguous(dataset: &Dataset, shape: &Shape<'_>) -> Result<Storage, Failure> {
    let bytes = shape.rows * shape.record as u64;
    match dataset.offset() {
        Some(offset)
            if offset
                .checked_add(bytes)
                .is_some_and(|end| end <= shape.length) =>
        {
            Ok(Storage::Contiguous { offset })
        }
        Some(_) => Err(shape.damaged("its rows reach beyond the end of the file")),
        None => Err(shape.damaged("its rows were never written")),
    }
}

fn chunked(
    dataset: &Dataset,
    shape: &Shape<'_>,
    chunk: &[usize],
    filters: &[Filter],
) -> Result<Storage, Failure> {
    let rows = chunk.first().copied().unwrap_or(0) as u64;
    if rows == 0 || chunk.len() != 1 {
        return Err(shape.damaged("its chunks have no size"));
    }
    let chunk_bytes = rows.saturating_mul(shape.record as u64);
    if chunk_bytes > MAX_CHUNK_BYTES.min(expansion(filters).saturating_mul(shape.length)) {
        let why = format!("chunks of {chunk_bytes} bytes");
        return Err(shape.refuse(&why, "save the file again with chunks of about 1 MB"));
    }
    check_filters(shape, filters)?;
    let chunks = list_chunks(dataset, shape, rows, expansion(filters))?;
    let rows = usize::try_from(rows).map_err(|_| shape.damaged("its chunks are too large"))?;
    match own_steps(filters) {
        Some(steps) => Ok(Storage::Chunks {
            rows,
            chunks,
            steps,
        }),
        None => {
            let per_block = (BLOCK_BYTES / shape.record.saturating_mul(rows).max(1)).max(1);
            Ok(Storage::Library {
                rows: rows.saturating_mul(per_block),
            })
        }
    }
}

/// The chunks in row order; each row must be stored once and lie inside the file.
fn list_chunks(
    dataset: &Dataset,
    shape: &Shape<'_>,
    rows: u64,
    expansion: u64,
) -> Result<Vec<Chunk>, Failure> {
    let expected = shape.rows.div_ceil(rows);
    let chunk_bytes = rows.saturating_mul(shape.record as u64);
    let (mut found, mut total, mut sound) = (Vec::new(), 0_u64, true);
    let visited = dataset.chunks_visit(|info| {
        let index = info.offset.first().map(|row| row / rows);
        let Some(index) = index.filter(|&index| index < expected) else {
            return 0;
        };
        let chunk = Chunk {
            address: info.addr,
            bytes: info.size,
            skipped: info.filter_mask,
        };
        total = total.saturating_add(chunk.bytes);
        sound &= chunk
            .address
            .checked_add(chunk.bytes)
            .is_some_and(|end| end <= shape.length)
            && total <= shape.length
            && chunk_bytes <= chunk.bytes.saturating_mul(expansion)
            && (found.len() as u64) < expected;
        found.push((index, chunk));
        i32::from(!sound)
    });
    visited.map_err(|e| shape.library(&e))?;
    found.sort_unstable_by_key(|&(index, _)| index);
    let whole = found
        .iter()
        .zip(0..)
        .all(|(&(index, _), place)| index == place);
    if !sound || !whole || found.len() as u64 != expected {
        let why = format!(
            "{} of {expected} chunks of rows are stored soundly",
            found.len()
        );
        return Err(shape.damaged(if sound {
            &why
        } else {
            "a chunk of rows has a wrong size"
        }));
    }
    Ok(found.into_iter().map(|(_, chunk)| chunk).collect())
}

/// The pipeline, when it is one that this crate undoes by itself.
fn own_steps(filters: &[Filter]) -> Option<Vec<Step>> {
    let steps: Option<Vec<_>> = filters
        .iter()
        .map(|filter| match filter {
            Filter::Shuffle => Some(Step::Shuffle),
            Filter::Deflate(_) => Some(Step::Deflate),
            _ => None,
        })
        .collect();
    let known: [&[Step]; 4] = [
        &[],
        &[Step::Shuffle],
        &[Step::Deflate],
        &[Step::Shuffle, Step::Deflate],
    ];
    steps.filter(|steps| known.contains(&steps.as_slice()))
}

/// How many bytes one stored byte can become.
fn expansion(filters: &[Filter]) -> u64 {
    let each = filters.iter().map(|filter| match filter {
        Filter::Shuffle | Filter::Fletcher32 => 1,
        Filter::Deflate(_) => DEFLATE_EXPANSION,
        Filter::LZF => LZ_EXPANSION,
        Filter::Blosc(hdf5::filters::Blosc::ZStd, ..) => ZSTD_EXPANSION,
        Filter::Blosc(hdf5::filters::Blosc::ZLib, ..) => DEFLATE_EXPANSION,
        Filter::Blosc(..) => LZ_EXPANSION,
        _ => DEFLATE_EXPANSION,
    });
    each.fold(1, u64::saturating_mul).min(ZSTD_EXPANSION)
}

fn check_filters(shape: &Shape<'_>, filters: &[Filter]) -> Result<(), Failure> {
    for filter in filters {
        let name = match filter {
            Filter::User(id, _) => filter_name(*id),
            Filter::SZip(..) => "SZIP (id 4)".to_owned(),
            known if known.is_available() => continue,
            known => filter_name(known.id()),
        };
        let remedy = "save it again with gzip compression or none";
        return Err(shape.refuse(
            &format!("compressed with {name}, which is not included"),
            remedy,
        ));
    }
    Ok(())
}

/// Names from the registry of HDF5 filters.
fn filter_name(id: i32) -> String {
    let name = match id {
        305 => "LZO",
        307 => "bzip2",
        32000 => "LZF",
        32001 => "Blosc",
        32004 => "LZ4",
        32008 => "bitshuffle",
        32013 => "ZFP",
        32015 => "Zstandard",
        32017 | 32024 => "SZ",
        32026 => "Blosc2",
        _ => return format!("filter {id}"),
    };
    format!("{name} (id {id})")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_plain_pipelines_are_undone_here() {
        use Filter::{Deflate, Fletcher32, Shuffle};
        assert_eq!(own_steps(&[]), Some(vec![]));
        assert_eq!(
            own_steps(&[Shuffle, Deflate(5)]),
            Some(vec![Step::Shuffle, Step::Deflate])
        );
        assert_eq!(own_steps(&[Deflate(5), Shuffle]), None);
        assert_eq!(own_steps(&[Shuffle, Deflate(5), Fletcher32]), None);
    }

    #[test]
    fn expansion_is_bounded_whatever_the_pipeline() {
        use Filter::{Deflate, Shuffle};
        assert_eq!(expansion(&[]), 1);
        assert_eq!(expansion(&[Shuffle, Deflate(9)]), 1032);
        assert_eq!(expansion(&vec![Deflate(9); 7]), ZSTD_EXPANSION);
    }

    #[test]
    fn filters_have_names() {
        assert_eq!(filter_name(307), "bzip2 (id 307)");
        assert_eq!(filter_name(4711), "filter 4711");
    }
}
