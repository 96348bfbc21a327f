//! Marks of the calls that run in this process, so that a session which ends inside a plugin is
//! told of at the next start.
//!
//! Each engine that calls a plugin in its own process has a small file in the state folder, mapped
//! into memory: a call takes a slot and leaves it, which costs no call of the system, and what is
//! in the map stays when the process dies. The file is locked as long as its process lives, so that
//! a later session knows whose files are left over; a number of a process may be given again, and
//! means nothing to another machine that shares the folder.
#![allow(unsafe_code)]

use rustix::mm::{MapFlags, ProtFlags, mmap, munmap};
use std::collections::HashMap;
use std::fs::File;
use std::io::{Read, Write};
use std::path::Path;
use std::ptr::NonNull;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{SystemTime, UNIX_EPOCH};

/// First bytes of the file.
const MAGIC: &[u8; 16] = b"puncta.running/1";
/// Beginning of the file's name.
pub const PREFIX: &str = "running-";
/// Calls that are marked at once; more than there are threads, and each is one call.
const SLOTS: usize = 127;
/// Bytes of a slot: number of a label (0: free) and the time in ms since 1970.
const SLOT: usize = 16;
/// Labels of a file; calls of further operations are not marked.
const LABELS: usize = 255;
/// Bytes of a label: plugin, hash, operation, each ended by a line feed and cut to fit.
const LABEL: usize = 512;
const FIRST_SLOT: usize = 16;
const FIRST_LABEL: usize = 4096;
const BYTES: usize = FIRST_LABEL + LABELS * LABEL;

/// The map of a file, and the file while it is there.
pub struct Sentinel {
    base: NonNull<u8>,
    /// Removed when dropped; locked until then.
    _file: tempfile::NamedTempFile,
    labels: Mutex<HashMap<String, Option<u64>>>,
}

// SAFETY: slots are atomic numbers; labels are written under the lock, before their number is used.
unsafe impl Send for Sentinel {}
// SAFETY: as above.
unsafe impl Sync for Sentinel {}

/// A plugin whose calls are marked.
#[derive(Clone)]
pub struct Marker {
    /// Where.
    pub sentinel: Arc<Sentinel>,
    /// Id of the plugin.
    pub plugin: String,
    /// BLAKE3 of its library.
    pub hash: String,
}

/// What a call is marked with.
#[derive(Clone)]
pub struct Label {
    sentinel: Arc<Sentinel>,
    number: u64,
}

/// A running call; the mark is removed when it is dropped.
pub struct Running<'a> {
    slot: Option<&'a AtomicU64>,
}

impl Drop for Running<'_> {
    fn drop(&mut self) {
        if let Some(slot) = self.slot {
            slot.store(0, Ordering::Release);
        }
    }
}

impl Marker {
    /// The label of an operation; none when the file has no more room.
    #[must_use]
    pub fn label(&self, operation: &str) -> Option<Label> {
        let number = self.sentinel.label(&self.plugin, &self.hash, operation)?;
        Some(Label {
            sentinel: Arc::clone(&self.sentinel),
            number,
        })
    }
}

impl Label {
    /// Marks a call as running.
    #[must_use]
    pub fn enter(&self) -> Running<'_> {
        let now = SystemTime::now().duration_since(UNIX_EPOCH);
        let now = now.map_or(0, |since| since.as_millis() as u64);
        for place in 0..SLOTS {
            let slot = self.sentinel.number(FIRST_SLOT + place * SLOT);
            let free = slot.load(Ordering::Relaxed) == 0
                && slot
                    .compare_exchange(0, self.number, Ordering::AcqRel, Ordering::Relaxed)
                    .is_ok();
            if free {
                let time = self.sentinel.number(FIRST_SLOT + place * SLOT + 8);
                time.store(now, Ordering::Relaxed);
                return Running { slot: Some(slot) };
            }
        }
        Running { slot: None }
    }
}

impl Sentinel {
    /// Makes the file in the state folder, which must be there. Others must not look for left-over
    /// files meanwhile.
    ///
    /// # Errors
    /// When the system refuses; calls are then not marked.
    pub fn create(state: &Path) -> std::io::Result<Sentinel> {
        let mut file = tempfile::Builder::new().prefix(PREFIX).tempfile_in(state)?;
        file.as_file().try_lock()?;
        // Written, not only reserved: a map of pages that the disk has no room for ends the process.
        let mut bytes = vec![0; BYTES];
        bytes[..MAGIC.len()].copy_from_slice(MAGIC);
        file.write_all(&bytes)?;
        let (protection, flags) = (ProtFlags::READ | ProtFlags::WRITE, MapFlags::SHARED);
        // SAFETY: a fresh mapping of a whole file that this process just made, that is locked, and
        // that nobody makes shorter: other sessions read and remove such files, and no more.
        let base = unsafe { mmap(std::ptr::null_mut(), BYTES, protection, flags, &file, 0) }?;
        let base = NonNull::new(base.cast()).ok_or(std::io::ErrorKind::OutOfMemory)?;
        Ok(Sentinel {
            base,
            _file: file,
            labels: Mutex::default(),
        })
    }

    /// The number at an offset that is a multiple of 8 below `FIRST_LABEL`.
    fn number(&self, offset: usize) -> &AtomicU64 {
        debug_assert!(offset.is_multiple_of(8) && offset + 8 <= FIRST_LABEL);
        // SAFETY: inside the mapping, which lives as long as `self`; maps begin on a page, so that
        // the number is aligned; it is only ever used as an atomic.
        unsafe { self.base.add(offset).cast::<AtomicU64>().as_ref() }
    }

    fn label(&self, plugin: &str, hash: &str, operation: &str) -> Option<u64> {
        let mut labels = self.labels.lock().unwrap_or_else(PoisonError::into_inner);
        // An operation belongs to one plugin; opening libraries has no operation.
        let key = if operation.is_empty() {
            hash
        } else {
            operation
        };
        if let Some(known) = labels.get(key) {
            return *known;
        }
        let place = labels.len();
        let number = (place < LABELS).then_some(place as u64 + 1);
        labels.insert(key.to_owned(), number);
        let number = number?;
        let text = format!(
            "{}\n{}\n{}\n",
            cut(plugin, 200),
            cut(hash, 64),
            cut(operation, 200)
        );
        // SAFETY: the label lies inside the mapping, and the lock keeps it from others; nobody in
        // this process reads it.
        unsafe {
            let at = self.base.add(FIRST_LABEL + place * LABEL);
            std::ptr::copy_nonoverlapping(text.as_ptr(), at.as_ptr(), text.len().min(LABEL));
        }
        Some(number)
    }
}

impl Drop for Sentinel {
    fn drop(&mut self) {
        // SAFETY: exactly our own mapping; labels and running calls hold the sentinel alive.
        let _ = unsafe { munmap(self.base.as_ptr().cast(), BYTES) };
    }
}

/// At most `most` bytes of one line.
fn cut(text: &str, most: usize) -> &str {
    let line = text.lines().next().unwrap_or_default();
    line.get(..line.floor_char_boundary(most))
        .unwrap_or_default()
}

/// A call that was running when its process ended.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Left {
    /// Id of the plugin.
    pub plugin: String,
    /// BLAKE3 of its library.
    pub hash: String,
    /// Operation; empty while the library was opened.
    pub operation: String,
    /// When it began.
    pub since: SystemTime,
}

/// The calls that were running when the process of a left-over file ended; nothing if the process
/// lives, or the file is none of ours.
#[must_use]
pub fn left_over(path: &Path) -> Option<Vec<Left>> {
    let file = File::options().read(true).write(true).open(path).ok()?;
    // Its owner holds the lock.
    file.try_lock().ok()?;
    let mut bytes = Vec::new();
    (&file)
        .take(BYTES as u64 + 1)
        .read_to_end(&mut bytes)
        .ok()?;
    if bytes.len() != BYTES || !bytes.starts_with(MAGIC) {
        return Some(Vec::new());
    }
    let number = |at: usize| {
        let bytes = bytes
            .get(at..at + 8)
            .and_then(|bytes| bytes.try_into().ok());
        bytes.map_or(0, u64::from_le_bytes)
    };
    let slots = (0..SLOTS).map(|place| FIRST_SLOT + place * SLOT);
    let found = slots.filter_map(|at| {
        let place = usize::try_from(number(at)).ok()?.checked_sub(1)?;
        let begin = FIRST_LABEL + place.checked_mul(LABEL)?;
        let text = String::from_utf8_lossy(bytes.get(begin..begin + LABEL)?).into_owned();
        let mut lines = text.lines().map(str::to_owned);
        Some(Left {
            plugin: lines.next()?,
            hash: lines.next()?,
            operation: lines.next()?,
            since: UNIX_EPOCH.checked_add(std::time::Duration::from_millis(number(at + 8)))?,
        })
    });
    Some(found.collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn files(folder: &Path) -> Vec<std::path::PathBuf> {
        let entries = std::fs::read_dir(folder).unwrap().flatten();
        entries.map(|entry| entry.path()).collect()
    }

    #[test]
    fn running_calls_are_found_when_the_process_is_gone() {
        let folder = tempfile::tempdir().unwrap();
        let sentinel = Arc::new(Sentinel::create(folder.path()).unwrap());
        let marker = Marker {
            sentinel: Arc::clone(&sentinel),
            plugin: "lab.blobs".into(),
            hash: "ab".repeat(32),
        };
        let path = files(folder.path()).remove(0);
        assert_eq!(left_over(&path), None, "its owner lives");
        let (open, count) = (
            marker.label("").unwrap(),
            marker.label("lab.count/1").unwrap(),
        );
        assert_eq!(marker.label("lab.count/1").unwrap().number, count.number);
        drop(open.enter());
        let _first = count.enter();
        let _second = open.enter();
        // A copy is what a process that ended leaves behind: the same bytes, without the lock.
        let copy = folder.path().join("copy");
        std::fs::copy(&path, &copy).unwrap();
        let left = left_over(&copy).unwrap();
        assert_eq!(left.len(), 2);
        assert_eq!(
            (left[0].plugin.as_str(), left[0].operation.as_str()),
            ("lab.blobs", "lab.count/1")
        );
        assert_eq!((left[1].hash.len(), left[1].operation.as_str()), (64, ""));
        assert!(left[0].since.elapsed().unwrap().as_secs() < 60);
        std::fs::write(&copy, "something else").unwrap();
        assert_eq!(left_over(&copy), Some(Vec::new()));
    }

    #[test]
    fn a_session_that_ends_properly_leaves_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let sentinel = Sentinel::create(folder.path()).unwrap();
        assert_eq!(files(folder.path()).len(), 1);
        drop(sentinel);
        assert!(files(folder.path()).is_empty());
    }

    #[test]
    fn too_many_calls_and_operations_are_not_marked() {
        let folder = tempfile::tempdir().unwrap();
        let marker = Marker {
            sentinel: Arc::new(Sentinel::create(folder.path()).unwrap()),
            plugin: "p".repeat(1000),
            hash: "h".repeat(64),
        };
        let labels: Vec<_> = (0..300).map(|i| marker.label(&format!("o{i}"))).collect();
        assert_eq!(labels.iter().flatten().count(), LABELS);
        let label = labels[254].as_ref().unwrap();
        let running: Vec<_> = (0..200).map(|_| label.enter()).collect();
        let marked = || running.iter().filter(|one| one.slot.is_some()).count();
        assert_eq!(marked(), SLOTS);
        drop(running);
        assert!(label.enter().slot.is_some());
    }
}
