//! Records of a file or a stream into columns, a few megabytes at a time, on all threads.

use crate::file::damaged;
use crate::split::{Field, Pick, Tile, front, split};
use puncta_sdk::output::ColumnMut;
use puncta_sdk::{Failure, Run};
use std::fs::File;
use std::io::{self, ErrorKind, Read};
use std::sync::{Mutex, MutexGuard, PoisonError};

/// Bytes of a tile: with its columns it stays in the second-level cache.
const TILE: usize = 128 << 10;
/// Tiles that a thread has at a time.
const TILES: usize = 8;

/// Where records come from.
pub enum Source<'s> {
    /// A file, from this byte on; tiles are read by all threads.
    File(&'s File, u64),
    /// Bytes that come one after the other, such as those that are decompressed.
    Stream(&'s mut dyn Read),
}

/// Chooses rows of a tile: the number of its first row, its bytes, its number of rows, and the
/// picks to write.
pub type Select<'p> = dyn Fn(u64, &[u8], usize, &mut Vec<Pick>) + Sync + 'p;

/// What is read.
pub struct Pass<'p> {
    /// The file's name, for sentences.
    pub name: &'p str,
    /// Records there are.
    pub rows: u64,
    /// Bytes of a record.
    pub record: usize,
    /// Columns, in the order of the memory that is given.
    pub fields: &'p [Field],
    /// Which rows are kept; all if there is none.
    pub select: Option<&'p Select<'p>>,
}

#[derive(Default)]
struct Buffer {
    bytes: Vec<u8>,
    first: u64,
    rows: usize,
    picks: Vec<Pick>,
    error: Option<io::Error>,
}

impl Buffer {
    fn kept(&self, pass: &Pass<'_>) -> usize {
        if pass.select.is_some() {
            self.picks.len()
        } else {
            self.rows
        }
    }

    fn select(&mut self, pass: &Pass<'_>) {
        if let Some(select) = pass.select {
            self.picks.clear();
            select(self.first, &self.bytes, self.rows, &mut self.picks);
        }
    }
}

/// Reads all records of `pass` into `columns` and returns how many rows were kept. Before rows are
/// written, `commit` gets their number. Memory: 1 MB a thread, and the largest record.
///
/// # Errors
/// When the source ends early or cannot be read, `commit` says no, or the person cancelled.
pub fn fill(
    mut source: Source<'_>,
    pass: &Pass<'_>,
    columns: &mut [ColumnMut<'_>],
    commit: &mut dyn FnMut(u64) -> Result<(), Failure>,
    run: &dyn Run,
) -> Result<u64, Failure> {
    let record = pass.record.max(1);
    let tile_rows = (TILE / record).max(1);
    let buffers: Vec<Mutex<Buffer>> = (0..run.threads().max(1) * TILES)
        .map(|_| Mutex::default())
        .collect();
    let (mut done, mut kept) = (0_u64, 0_u64);
    while done < pass.rows {
        if run.cancelled() {
            return Err(Failure::cancelled());
        }
        let mut tiles = 0;
        while tiles < buffers.len() && done < pass.rows {
            let left = usize::try_from(pass.rows - done).unwrap_or(usize::MAX);
            let mut tile = lock(&buffers[tiles]);
            (tile.first, tile.rows) = (done, tile_rows.min(left));
            drop(tile);
            done += tile_rows.min(left) as u64;
            tiles += 1;
        }
        let tiles = &buffers[..tiles];
        load(&mut source, pass, tiles, run);
        if run.cancelled() {
            return Err(Failure::cancelled());
        }
        let mut count = 0;
        for tile in tiles {
            let mut tile = lock(tile);
            if let Some(error) = tile.error.take() {
                return Err(early(&error, pass));
            }
            count += tile.kept(pass) as u64;
        }
        commit(count)?;
        scatter(pass, tiles, columns, run);
        kept += count;
        run.progress(done as f64 / pass.rows.max(1) as f64, "reading")?;
    }
    Ok(kept)
}

fn load(source: &mut Source<'_>, pass: &Pass<'_>, tiles: &[Mutex<Buffer>], run: &dyn Run) {
    let record = pass.record;
    match source {
        Source::File(file, start) => run.parallel(tiles.len(), &|i| {
            let mut tile = lock(&tiles[i]);
            let tile = &mut *tile;
            let place = tile
                .first
                .checked_mul(record as u64)
                .and_then(|bytes| bytes.checked_add(*start));
            tile.bytes.resize(tile.rows * record, 0);
            let read = match place {
                Some(place) => read_at(file, place, &mut tile.bytes),
                None => Err(ErrorKind::UnexpectedEof.into()),
            };
            tile.error = read.err();
            tile.select(pass);
        }),
        Source::Stream(stream) => {
            for tile in tiles {
                let tile = &mut *lock(tile);
                tile.bytes.resize(tile.rows * record, 0);
                tile.error = stream.read_exact(&mut tile.bytes).err();
                if tile.error.is_some() || run.cancelled() {
                    return;
                }
            }
            run.parallel(tiles.len(), &|i| lock(&tiles[i]).select(pass));
        }
    }
}

fn scatter(pass: &Pass<'_>, tiles: &[Mutex<Buffer>], columns: &mut [ColumnMut<'_>], run: &dyn Run) {
    let targets: Vec<Mutex<Vec<ColumnMut<'_>>>> = tiles
        .iter()
        .map(|tile| {
            let kept = lock(tile).kept(pass);
            let cut = |(column, field): (&mut _, &Field)| {
                front(column, kept * field.info.type_.width as usize)
            };
            Mutex::new(columns.iter_mut().zip(pass.fields).map(cut).collect())
        })
        .collect();
    run.parallel(tiles.len(), &|i| {
        let tile = lock(&tiles[i]);
        let rows = Tile {
            bytes: &tile.bytes,
            record: pass.record,
            picks: pass.select.map(|_| tile.picks.as_slice()),
        };
        for (field, column) in pass.fields.iter().zip(lock(&targets[i]).iter_mut()) {
            split(rows, field, column);
        }
    });
}

fn early(error: &io::Error, pass: &Pass<'_>) -> Failure {
    let name = pass.name;
    match error.kind() {
        ErrorKind::UnexpectedEof => damaged(format!(
            "{name} ends before the {} rows that it announces",
            pass.rows
        )),
        _ => damaged(format!("{name} cannot be read on: {error}")),
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Reads from a place, whatever other threads read.
///
/// # Errors
/// As the operating system says, or when the file ends early.
#[cfg(unix)]
pub fn read_at(file: &File, place: u64, bytes: &mut [u8]) -> io::Result<()> {
    std::os::unix::fs::FileExt::read_exact_at(file, bytes, place)
}

/// Reads from a place, whatever other threads read.
///
/// # Errors
/// As the operating system says, or when the file ends early.
#[cfg(windows)]
pub fn read_at(file: &File, mut place: u64, mut bytes: &mut [u8]) -> io::Result<()> {
    while !bytes.is_empty() {
        match std::os::windows::fs::FileExt::seek_read(file, bytes, place)? {
            0 => return Err(ErrorKind::UnexpectedEof.into()),
            read => {
                place += read as u64;
                bytes = &mut bytes[read..];
            }
        }
    }
    Ok(())
}
