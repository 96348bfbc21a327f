//! Results on disk, by key: a recipe that is run again in another process computes only what is new.
//!
//! A file has the wire form of the call's finished outputs and their memory, and ends with the BLAKE3
//! of all that is before. It is written to a temporary name and renamed; one that is damaged, or of
//! another version of the host, is as good as none. Writing is the work of a thread of its own, so
//! that no step waits for the disk.

use crate::plugins::Finished;
use crate::recipe::Key;
use crate::store::{Region, Segment};
use crate::worker::wire::{Sent, WireFinished};
use puncta_documents::Failure;
use serde::{Deserialize, Serialize};
use std::collections::HashMap;
use std::fs::{self, File};
use std::io::{self, BufWriter, Read, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread::JoinHandle;
use std::time::{Duration, SystemTime};

const MAGIC: &[u8; 16] = b"PUNCTA RESULT 1\n";
const HASH: usize = blake3::OUT_LEN;
/// Results that are computed faster than they are read from a disk are not kept.
const BYTES_A_SECOND: f64 = 300e6;
/// Results that take less are not kept: looking for them would take as long.
const WORTH: Duration = Duration::from_millis(20);
/// Largest description of outputs that is read.
const MOST_JSON: u64 = 64 << 20;
/// Results that wait to be written; more are left out.
const QUEUE: usize = 4;
/// What is left when the budget was exceeded, as a share of it.
const LEFT: f64 = 0.9;

/// Results on disk.
#[derive(Debug)]
pub struct ResultCache {
    folder: PathBuf,
    budget: u64,
    writer: Option<(SyncSender<Job>, JoinHandle<()>)>,
}

/// A result to write.
struct Job {
    key: Key,
    finished: Vec<Finished>,
}

/// The description of a result.
#[derive(Serialize, Deserialize)]
struct Description {
    host: String,
    finished: Vec<WireFinished>,
    /// Number and bytes of each segment, in the order in which they follow.
    segments: Vec<(u64, u64)>,
}

impl ResultCache {
    /// Results in a folder, of so many bytes together; none are kept if that is 0.
    #[must_use]
    pub fn new(folder: PathBuf, budget: u64) -> ResultCache {
        ResultCache {
            folder,
            budget,
            writer: None,
        }
        .started()
    }

    fn started(mut self) -> ResultCache {
        if self.budget == 0 {
            return self;
        }
        let (send, receive) = sync_channel(QUEUE);
        let (folder, budget) = (self.folder.clone(), self.budget);
        let thread = std::thread::Builder::new().name("puncta results".into());
        // Without the thread nothing is kept, and everything works.
        if let Ok(handle) = thread.spawn(move || write_all(&receive, &folder, budget)) {
            self.writer = Some((send, handle));
        }
        self
    }

    /// The outputs of the call with this key, if they were kept.
    #[must_use]
    pub fn get(&self, key: &Key) -> Option<Vec<Finished>> {
        if self.budget == 0 {
            return None;
        }
        let path = place(&self.folder, key);
        let file = File::open(&path).ok()?;
        let found = read(&file);
        if found.is_err() {
            let _ = fs::remove_file(&path);
        } else {
            // What is used stays longest.
            let _ = file.set_modified(SystemTime::now());
        }
        found.ok()
    }

    /// Keeps the outputs of a call that took so long, if that is worth it.
    pub fn put(&self, key: &Key, finished: &[Finished], took: Duration) {
        let Some((send, _)) = &self.writer else {
            return;
        };
        let bytes: u64 = finished.iter().map(|one| one.object.bytes()).sum();
        let reading = bytes as f64 / BYTES_A_SECOND;
        if took < WORTH || took.as_secs_f64() < reading || bytes > self.budget / 2 {
            return;
        }
        // A full queue means that the disk is slower than the work.
        let _ = send.try_send(Job {
            key: *key,
            finished: finished.to_vec(),
        });
    }
}

impl Drop for ResultCache {
    fn drop(&mut self) {
        if let Some((send, handle)) = self.writer.take() {
            drop(send);
            let _ = handle.join();
        }
    }
}

fn place(folder: &Path, key: &Key) -> PathBuf {
    let name = key.to_string();
    folder.join(name.get(..2).unwrap_or("00")).join(name)
}

fn write_all(receive: &Receiver<Job>, folder: &Path, budget: u64) {
    let mut used = entries(folder).iter().map(|entry| entry.bytes).sum::<u64>();
    for job in receive {
        // A disk that is full, or a folder that cannot be written, only costs time later.
        used += write(&place(folder, &job.key), &job.finished).unwrap_or(0);
        if used > budget {
            used = trim(folder, budget);
        }
    }
}

/// Passes bytes on and hashes them.
struct Hashing<W> {
    hasher: blake3::Hasher,
    into: W,
    bytes: u64,
}

impl<W: Write> Write for Hashing<W> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let count = self.into.write(bytes)?;
        self.hasher.update(bytes.get(..count).unwrap_or_default());
        self.bytes += count as u64;
        Ok(count)
    }
    fn flush(&mut self) -> io::Result<()> {
        self.into.flush()
    }
}

/// Writes a result, and says how many bytes it has.
fn write(path: &Path, finished: &[Finished]) -> Result<u64, Failure> {
    let failed = |error: io::Error| Failure::io("write", path, &error);
    let folder = crate::files::folder_of(path);
    fs::create_dir_all(folder).map_err(failed)?;
    let mut sent = Sent::default();
    let wired: Result<_, Failure> = finished.iter().map(|one| sent.finished(one)).collect();
    let segments = sent.segments();
    let description = Description {
        host: env!("CARGO_PKG_VERSION").into(),
        finished: wired?,
        segments: segments.iter().map(|one| (one.id(), one.bytes())).collect(),
    };
    let json = serde_json::to_vec(&description)
        .map_err(|error| Failure::internal(format!("a result is no JSON: {error}")))?;
    let mut file = tempfile::NamedTempFile::new_in(folder).map_err(failed)?;
    let mut out = Hashing {
        hasher: blake3::Hasher::new(),
        into: BufWriter::new(&mut file),
        bytes: 0,
    };
    let mut put = |bytes: &[u8]| out.write_all(bytes).map_err(failed);
    put(MAGIC)?;
    put(&(json.len() as u64).to_le_bytes())?;
    put(&json)?;
    for segment in segments {
        put(whole(segment)?.slice::<u8>())?;
    }
    let hash = *out.hasher.finalize().as_bytes();
    out.write_all(&hash).map_err(failed)?;
    out.flush().map_err(failed)?;
    let bytes = out.bytes;
    drop(out);
    file.persist(path).map_err(|error| failed(error.error))?;
    Ok(bytes)
}

fn whole(segment: &Arc<Segment>) -> Result<Region, Failure> {
    Region::new(segment, 0, segment.bytes())
}

fn read(mut file: &File) -> Result<Vec<Finished>, Failure> {
    let damaged = || Failure::bad_file("a kept result is damaged");
    let failed = |_: io::Error| damaged();
    let total = file.metadata().map_err(failed)?.len();
    let mut hasher = blake3::Hasher::new();
    let mut head = [0; MAGIC.len() + 8];
    file.read_exact(&mut head).map_err(failed)?;
    hasher.update(&head);
    let (magic, length) = head.split_at(MAGIC.len());
    let length = u64::from_le_bytes(length.try_into().map_err(|_| damaged())?);
    if magic != MAGIC || length > MOST_JSON.min(total) {
        return Err(damaged());
    }
    let mut json = vec![0; usize::try_from(length).map_err(|_| damaged())?];
    file.read_exact(&mut json).map_err(failed)?;
    hasher.update(&json);
    let description: Description = serde_json::from_slice(&json).map_err(|_| damaged())?;
    let wanted = description.segments.iter().map(|(_, bytes)| *bytes);
    let wanted = wanted.fold((head.len() + HASH) as u64 + length, u64::saturating_add);
    if wanted != total || description.host != env!("CARGO_PKG_VERSION") {
        return Err(damaged());
    }
    let mut known = HashMap::new();
    for (number, bytes) in description.segments {
        let segment = Segment::filled(bytes, |room| file.read_exact(room).map_err(failed))?;
        hasher.update(whole(&segment)?.slice::<u8>());
        known.insert(number, segment);
    }
    let mut hash = [0; HASH];
    file.read_exact(&mut hash).map_err(failed)?;
    if hasher.finalize() != blake3::Hash::from_bytes(hash) {
        return Err(damaged());
    }
    let finished = description.finished.into_iter();
    finished.map(|one| one.unwire(&known)).collect()
}

struct Entry {
    path: PathBuf,
    bytes: u64,
    used: SystemTime,
}

/// The results of a folder, the one that was used longest ago first.
fn entries(folder: &Path) -> Vec<Entry> {
    let folders = fs::read_dir(folder).into_iter().flatten().flatten();
    let files = folders.flat_map(|one| fs::read_dir(one.path()).into_iter().flatten().flatten());
    let mut all: Vec<Entry> = files
        .filter_map(|file| {
            let metadata = file.metadata().ok()?;
            Some(Entry {
                path: file.path(),
                bytes: metadata.len(),
                used: metadata.modified().ok()?,
            })
        })
        .collect();
    all.sort_by(|a, b| (a.used, &a.path).cmp(&(b.used, &b.path)));
    all
}

/// Removes what was used longest ago. Says how many bytes are left.
fn trim(folder: &Path, budget: u64) -> u64 {
    let all = entries(folder);
    let mut left: u64 = all.iter().map(|entry| entry.bytes).sum();
    for entry in all {
        if left as f64 <= budget as f64 * LEFT {
            break;
        }
        // Another program may have been faster.
        let _ = fs::remove_file(&entry.path);
        left = left.saturating_sub(entry.bytes);
    }
    left
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::store::gather::numbers;
    use crate::store::{Object, Stored};
    use puncta_documents::{ColumnInfo, Element, Header, Kind, OutputForm};

    const LONG: Duration = Duration::from_secs(60);

    fn key(number: u8) -> Key {
        Key::from_bytes([number; 32])
    }

    fn outputs(values: &[f64]) -> Vec<Finished> {
        let info = ColumnInfo::new("x", Element::F64, "nm");
        let header = Header::table("t", values.len() as u64, vec![info]);
        let table = Object::new(header, vec![vec![Stored::whole(numbers(values))]]).unwrap();
        let report = Object::document(Kind::Report, "r", serde_json::json!({"a": 0.1}));
        let one = |output: &str, object| Finished {
            output: output.into(),
            form: OutputForm::Object,
            of: None,
            object,
        };
        vec![one("table", table), one("report", report)]
    }

    fn values(found: &[Finished]) -> Vec<f64> {
        let column = found[0].object.column(0, "x").unwrap();
        column.data.unwrap().slice::<f64>().to_vec()
    }

    /// Everything is on disk when a cache is dropped.
    fn filled(folder: &Path, budget: u64, results: &[(u8, &[f64])]) {
        for (number, values) in results {
            let cache = ResultCache::new(folder.into(), budget);
            cache.put(&key(*number), &outputs(values), LONG);
            drop(cache);
            std::thread::sleep(Duration::from_millis(5));
        }
    }

    #[test]
    fn results_come_back_in_another_session() {
        let folder = tempfile::tempdir().unwrap();
        filled(folder.path(), 1 << 20, &[(1, &[1.0, f64::NAN, -0.0])]);
        let cache = ResultCache::new(folder.path().into(), 1 << 20);
        let found = cache.get(&key(1)).unwrap();
        let bits: Vec<u64> = values(&found).iter().map(|value| value.to_bits()).collect();
        assert_eq!(bits, [1.0, f64::NAN, -0.0].map(f64::to_bits));
        assert_eq!(
            found[0].object.header(),
            outputs(&[1.0; 3])[0].object.header()
        );
        assert_eq!(
            found[1].object.header().document.as_ref().unwrap()["a"],
            0.1
        );
        assert!(cache.get(&key(2)).is_none());
        assert!(
            ResultCache::new(folder.path().into(), 0)
                .get(&key(1))
                .is_none()
        );
    }

    #[test]
    fn what_is_quick_or_too_large_is_not_kept() {
        let folder = tempfile::tempdir().unwrap();
        let cache = ResultCache::new(folder.path().into(), 1 << 20);
        cache.put(&key(1), &outputs(&[1.0]), Duration::from_millis(1));
        cache.put(&key(2), &outputs(&[1.0; 100_000]), LONG);
        drop(cache);
        assert!(entries(folder.path()).is_empty());
    }

    #[test]
    fn damaged_files_are_as_good_as_none() {
        let folder = tempfile::tempdir().unwrap();
        let whole = || {
            filled(folder.path(), 1 << 20, &[(1, &[1.0, 2.0])]);
            place(folder.path(), &key(1))
        };
        let path = whole();
        let bytes = fs::read(&path).unwrap();
        let cache = ResultCache::new(folder.path().into(), 1 << 20);
        for place in (0..bytes.len()).step_by(7) {
            let mut other = bytes.clone();
            other[place] ^= 0x10;
            fs::write(&path, &other).unwrap();
            assert!(cache.get(&key(1)).is_none(), "byte {place}");
            assert!(!path.exists());
            fs::write(&path, &bytes[..place]).unwrap();
            assert!(cache.get(&key(1)).is_none(), "cut at {place}");
        }
        fs::write(&path, &bytes).unwrap();
        assert!(cache.get(&key(1)).is_some());
    }

    #[test]
    fn what_was_used_longest_ago_goes_first() {
        let folder = tempfile::tempdir().unwrap();
        let some = [0.5; 1000];
        filled(
            folder.path(),
            1 << 30,
            &[(1, &some), (2, &some), (3, &some)],
        );
        let one = entries(folder.path())[0].bytes;
        let cache = ResultCache::new(folder.path().into(), 1 << 30);
        assert!(cache.get(&key(1)).is_some());
        assert_eq!(trim(folder.path(), one * 5 / 2), 2 * one);
        let there = [1, 2, 3].map(|number| cache.get(&key(number)).is_some());
        assert_eq!(there, [true, false, true]);
    }
}
