//! Loads blocks of stored rows from the file.

use std::fs::File as PlainFile;
use std::io;
use std::path::Path;

use flate2::{Decompress, FlushDecompress, Status};
use hdf5::Dataset;

use puncta_sdk::{Failure, FailureCode};

use crate::error::{damaged, hdf5_reason};
use crate::raw;
use crate::split::Block;
use crate::storage::{BLOCK_BYTES, Chunk, Step, Storage};

/// Rows of one dataset, in blocks that may be loaded in any order and on any thread.
pub(crate) struct Source {
    file: PlainFile,
    dataset: Dataset,
    storage: Storage,
    place: String,
    rows: usize,
    record: usize,
}

/// Memory of one thread, reused from block to block.
#[derive(Default)]
pub(crate) struct Buffers {
    stored: Vec<u8>,
    plain: Vec<u8>,
    /// A block put together from several chunks.
    joined: Vec<u8>,
}

/// One piece of a block: its rows start at `first` within the block.
pub(crate) type Visit<'a> = &'a mut dyn FnMut(usize, usize, Block<'_>);

impl Source {
    /// `place` names file and dataset in sentences.
    pub(crate) fn new(
        path: &Path,
        dataset: Dataset,
        storage: Storage,
        place: String,
        rows: usize,
        record: usize,
    ) -> Result<Self, Failure> {
        let file = PlainFile::open(path).map_err(|error| Failure::io("read", path, &error))?;
        Ok(Self {
            file,
            dataset,
            storage,
            place,
            rows,
            record,
        })
    }

    /// Rows of each block but the last.
    pub(crate) fn block_rows(&self) -> usize {
        match &self.storage {
            Storage::Contiguous { .. } => (BLOCK_BYTES / self.record.max(1)).max(1),
            Storage::Chunks { rows, .. } => rows * self.chunks_per_block(),
            Storage::Library { rows } => *rows,
        }
    }

    pub(crate) fn blocks(&self) -> usize {
        self.rows.div_ceil(self.block_rows().max(1))
    }

    fn chunks_per_block(&self) -> usize {
        match &self.storage {
            Storage::Chunks { rows, .. } => {
                (BLOCK_BYTES / rows.saturating_mul(self.record).max(1)).max(1)
            }
            _ => 1,
        }
    }

    /// Loads block `index` and hands over its pieces in row order.
    ///
    /// # Errors
    /// A file that cannot be read or chunks that cannot be decoded.
    pub(crate) fn load(
        &self,
        index: usize,
        buffers: &mut Buffers,
        visit: Visit<'_>,
    ) -> Result<(), Failure> {
        let first = index * self.block_rows();
        let count = self.block_rows().min(self.rows.saturating_sub(first));
        match &self.storage {
            Storage::Contiguous { offset } => {
                let start = offset + first as u64 * self.record as u64;
                resize(&mut buffers.stored, count * self.record);
                self.read_at(&mut buffers.stored, start)?;
                visit(
                    0,
                    count,
                    Block::Records {
                        bytes: &buffers.stored,
                        record: self.record,
                    },
                );
            }
            Storage::Chunks {
                rows,
                chunks,
                steps,
            } => {
                let per_block = self.chunks_per_block();
                let own = chunks.iter().skip(index * per_block).take(per_block);
                for (place, chunk) in own.enumerate() {
                    let block = self.decode(chunk, *rows, steps, buffers)?;
                    let start = place * rows;
                    visit(start, (*rows).min(count.saturating_sub(start)), block);
                }
            }
            Storage::Library { .. } => {
                resize(&mut buffers.joined, count * self.record);
                raw::read_records(&self.dataset, first as u64, count, &mut buffers.joined)
                    .map_err(|error| self.damaged(first, &hdf5_reason(&error)))?;
                visit(
                    0,
                    count,
                    Block::Records {
                        bytes: &buffers.joined,
                        record: self.record,
                    },
                );
            }
        }
        Ok(())
    }

    fn damaged(&self, row: usize, why: &str) -> Failure {
        damaged(format!(
            "{} is damaged from row {row} on ({why})",
            self.place
        ))
    }

    fn read_at(&self, buffer: &mut [u8], at: u64) -> Result<(), Failure> {
        read_exact_at(&self.file, buffer, at).map_err(|error| {
            let message = format!("{} cannot be read at byte {at} ({error})", self.place);
            Failure::new(FailureCode::Io, message).remedy("check the disk or the connection to it")
        })
    }

    /// Reads one chunk and undoes its filters; a shuffled chunk stays in byte planes.
    fn decode<'b>(
        &self,
        chunk: &Chunk,
        rows: usize,
        steps: &[Step],
        buffers: &'b mut Buffers,
    ) -> Result<Block<'b>, Failure> {
        let size = rows * self.record;
        let done = |step| {
            let at = steps.iter().position(|&s| s == step);
            at.is_some_and(|at| chunk.skipped & (1 << at) == 0)
        };
        let stored = usize::try_from(chunk.bytes).unwrap_or(usize::MAX);
        resize(&mut buffers.stored, stored);
        self.read_at(&mut buffers.stored, chunk.address)?;
        let bytes = if done(Step::Deflate) {
            resize(&mut buffers.plain, size);
            inflate(&buffers.stored, &mut buffers.plain)
                .map_err(|why| self.damaged_chunk(chunk, why))?;
            &buffers.plain
        } else if stored == size {
            &buffers.stored
        } else {
            return Err(self.damaged_chunk(chunk, "wrong length"));
        };
        Ok(if done(Step::Shuffle) {
            Block::Planes { bytes, rows }
        } else {
            Block::Records {
                bytes,
                record: self.record,
            }
        })
    }

    fn damaged_chunk(&self, chunk: &Chunk, why: &str) -> Failure {
        damaged(format!(
            "{} is damaged in the chunk at byte {} ({why})",
            self.place, chunk.address
        ))
    }
}

fn resize(buffer: &mut Vec<u8>, size: usize) {
    buffer.resize(size, 0);
}

/// Inflates a zlib stream that must fill `out` exactly.
fn inflate(stored: &[u8], out: &mut [u8]) -> Result<(), &'static str> {
    let mut zlib = Decompress::new(true);
    match zlib.decompress(stored, out, FlushDecompress::Finish) {
        Ok(Status::StreamEnd) if zlib.total_out() == out.len() as u64 => Ok(()),
        Ok(_) => Err("wrong length after decompression"),
        Err(_) => Err("its compressed bytes are wrong"),
    }
}

#[cfg(unix)]
fn read_exact_at(file: &PlainFile, buffer: &mut [u8], at: u64) -> io::Result<()> {
    std::os::unix::fs::FileExt::read_exact_at(file, buffer, at)
}

#[cfg(windows)]
fn read_exact_at(file: &PlainFile, mut buffer: &mut [u8], mut at: u64) -> io::Result<()> {
    use std::os::windows::fs::FileExt;
    while !buffer.is_empty() {
        match file.seek_read(buffer, at)? {
            0 => return Err(io::ErrorKind::UnexpectedEof.into()),
            read => {
                buffer = &mut buffer[read..];
                at += read as u64;
            }
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn inflate_wants_the_exact_length() {
        let mut stored = vec![0; 64];
        let mut zlib = flate2::Compress::new(flate2::Compression::default(), true);
        let _ = zlib.compress(&[7; 100], &mut stored, flate2::FlushCompress::Finish);
        stored.truncate(zlib.total_out() as usize);
        let mut out = [0; 100];
        assert_eq!(inflate(&stored, &mut out), Ok(()));
        assert_eq!(out, [7; 100]);
        assert!(inflate(&stored, &mut [0; 99]).is_err());
        assert!(inflate(&stored, &mut [0; 101]).is_err());
        stored[5] ^= 0xff;
        assert!(inflate(&stored, &mut out).is_err());
    }
}
