//! Memory that another process can map.
//!
//! A segment is a sparse, anonymous file in memory (`memfd_create`): room costs nothing until it is
//! written, addresses never move, and the descriptor can be sent to a worker. It is written by one
//! call and immutable from then on: sealing write-protects the mapping, and sending trims the file
//! and forbids resizing. Memory that nobody else has seen goes back to its pool and is used again,
//! since getting pages from the system takes longer than most calculations on them.
#![allow(unsafe_code)]

use super::pool::SegmentPool;
use puncta_documents::{Failure, FailureCode};
use rustix::fs::{FallocateFlags, MemfdFlags, SealFlags};
use rustix::mm::{Advice, MapFlags, MprotectFlags, ProtFlags};
use std::ops::Range;
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::ptr::NonNull;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Weak};

/// Largest segment: room for far more than any machine has, but an address space bears it.
pub const MAX_BYTES: u64 = 1 << 42;
const PAGE: u64 = 4096;
/// Smaller commits are not worth a look at the machine's memory.
const CAREFUL: u64 = 1 << 24;

/// Bytes that the machine can give without taking them from others, less a reserve of a sixteenth.
#[must_use]
pub fn available() -> Option<u64> {
    let text = std::fs::read_to_string("/proc/meminfo").ok()?;
    Some(field(&text, "MemAvailable:")?.saturating_sub(field(&text, "MemTotal:")? / 16))
}

/// Bytes that the machine has.
#[must_use]
pub fn installed_memory() -> Option<u64> {
    field(&std::fs::read_to_string("/proc/meminfo").ok()?, "MemTotal:")
}

fn field(text: &str, name: &str) -> Option<u64> {
    let line = text.lines().find_map(|line| line.strip_prefix(name))?;
    let kilobytes: u64 = line.split_whitespace().next()?.parse().ok()?;
    kilobytes.checked_mul(1024)
}

/// A mapped file in memory.
#[derive(Debug)]
pub(super) struct Mapping {
    file: OwnedFd,
    /// Where it is mapped; null if there is no room.
    base: Option<NonNull<u8>>,
    /// Bytes that are mapped.
    pub(super) room: u64,
}

// SAFETY: the mapping is plain memory. Before sealing, one call writes it through pointers that the
// ABI gives it; afterwards nobody can.
unsafe impl Send for Mapping {}
// SAFETY: as above.
unsafe impl Sync for Mapping {}

/// A piece of shared memory.
#[derive(Debug)]
pub struct Segment {
    id: u64,
    /// There until the segment is dropped.
    mapping: Option<Mapping>,
    /// Room, or content once sealed.
    bytes: u64,
    /// Whether another process may have it.
    sent: AtomicBool,
    pool: Weak<SegmentPool>,
}

static NEXT_ID: AtomicU64 = AtomicU64::new(1);

fn refuse(what: &str, bytes: u64, error: rustix::io::Errno) -> Failure {
    let mega = bytes.div_ceil(1 << 20);
    let message = format!("cannot {what} {mega} MB of shared memory: {error}");
    Failure::new(FailureCode::Resources, message).remedy("close other data or use a smaller part")
}

impl Segment {
    /// A writable segment with room for `bytes` bytes. A fresh one is all zero.
    ///
    /// # Errors
    /// When the system refuses.
    pub fn create(bytes: u64) -> Result<Segment, Failure> {
        let room = bytes.next_multiple_of(PAGE);
        if room > MAX_BYTES {
            return Err(refuse("reserve", room, rustix::io::Errno::NOMEM));
        }
        let flags = MemfdFlags::CLOEXEC | MemfdFlags::ALLOW_SEALING;
        let file = rustix::fs::memfd_create("puncta", flags)
            .map_err(|error| refuse("create", room, error))?;
        rustix::fs::ftruncate(&file, room).map_err(|error| refuse("reserve", room, error))?;
        let mapping = Mapping::new(file, room, ProtFlags::READ | ProtFlags::WRITE)?;
        Ok(Segment::with(mapping, false, Weak::new()))
    }

    /// A sealed segment that `fill` writes.
    ///
    /// # Errors
    /// When there is no memory for it, or `fill` fails.
    pub fn filled(
        bytes: u64,
        fill: impl FnOnce(&mut [u8]) -> Result<(), Failure>,
    ) -> Result<Arc<Segment>, Failure> {
        let segment = Segment::create(bytes)?;
        segment.check_room(bytes)?;
        segment.commit(0..bytes)?;
        // SAFETY: a fresh segment with room for the bytes, and nothing else uses it.
        fill(unsafe { super::region::writable(segment.base(), 0, bytes as usize) })?;
        segment.seal(bytes)
    }

    /// As [`Segment::create`], with memory of the pool where it has any that fits: it then holds
    /// what was in it before.
    ///
    /// # Errors
    /// When the system refuses.
    pub fn create_in(pool: &Arc<SegmentPool>, bytes: u64) -> Result<Segment, Failure> {
        let room = bytes.next_multiple_of(PAGE);
        let home = Arc::downgrade(pool);
        if let Some(mapping) = pool.take(room)
            && mapping
                .protect(MprotectFlags::READ | MprotectFlags::WRITE)
                .is_ok()
        {
            return Ok(Segment::with(mapping, false, home));
        }
        let mut segment = Segment::create(bytes)?;
        segment.pool = home;
        Ok(segment)
    }

    /// A sealed segment that another process made, at least `bytes` long.
    ///
    /// # Errors
    /// When it is shorter, could still shrink, or the system refuses.
    pub fn open(file: OwnedFd, bytes: u64) -> Result<Segment, Failure> {
        let broken = |why: &str| Failure::internal(format!("a worker sent memory that {why}"));
        let stat = rustix::fs::fstat(&file).map_err(|_| broken("cannot be looked at"))?;
        let seals = rustix::fs::fcntl_get_seals(&file).map_err(|_| broken("has no seals"))?;
        if !seals.contains(SealFlags::SHRINK) {
            return Err(broken("could still shrink"));
        }
        if u64::try_from(stat.st_size).unwrap_or(0) < bytes {
            return Err(broken("is too short"));
        }
        let mapping = Mapping::new(file, bytes, ProtFlags::READ)?;
        Ok(Segment::with(mapping, true, Weak::new()))
    }

    fn with(mapping: Mapping, sent: bool, pool: Weak<SegmentPool>) -> Segment {
        Segment {
            id: NEXT_ID.fetch_add(1, Ordering::Relaxed),
            bytes: mapping.room,
            mapping: Some(mapping),
            sent: AtomicBool::new(sent),
            pool,
        }
    }

    fn mapping(&self) -> Result<&Mapping, Failure> {
        self.mapping
            .as_ref()
            .ok_or_else(|| Failure::internal("memory was used after its end"))
    }

    /// Number that no other segment of this process has.
    #[must_use]
    pub fn id(&self) -> u64 {
        self.id
    }

    /// The descriptor, to be sent to another process: from now on the file has its final length.
    ///
    /// # Errors
    /// When the system refuses.
    pub fn file(&self) -> Result<BorrowedFd<'_>, Failure> {
        let mapping = self.mapping()?;
        if !self.sent.swap(true, Ordering::Relaxed) {
            let protect = |error| refuse("protect", self.bytes, error);
            rustix::fs::ftruncate(&mapping.file, self.bytes).map_err(protect)?;
            // Nobody maps it to write from now on; our own mapping is write-protected.
            let seals = SealFlags::SHRINK | SealFlags::GROW;
            rustix::fs::fcntl_add_seals(&mapping.file, seals | SealFlags::FUTURE_WRITE)
                // Kernels before 5.1 do not know the last one.
                .or_else(|_| rustix::fs::fcntl_add_seals(&mapping.file, seals))
                .map_err(protect)?;
        }
        Ok(mapping.file.as_fd())
    }

    /// Bytes of room, or of content once sealed.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        self.bytes
    }

    /// First byte.
    #[must_use]
    pub fn base(&self) -> *mut u8 {
        let base = self.mapping.as_ref().and_then(|mapping| mapping.base);
        base.map_or(std::ptr::null_mut(), NonNull::as_ptr)
    }

    /// Refuses what the machine does not have: the system would hand out its last page and then end
    /// processes.
    ///
    /// # Errors
    /// When there is less memory than `bytes`.
    pub fn check_room(&self, bytes: u64) -> Result<(), Failure> {
        if bytes > CAREFUL && available().is_some_and(|free| bytes > free) {
            return Err(refuse("get", bytes, rustix::io::Errno::NOMEM));
        }
        Ok(())
    }

    /// Makes memory for a range certain: a machine without room says so here, not by a crash.
    ///
    /// # Errors
    /// When there is no room.
    pub fn commit(&self, range: Range<u64>) -> Result<(), Failure> {
        let begin = range.start / PAGE * PAGE;
        let end = range.end.min(self.bytes);
        if end <= begin {
            return Ok(());
        }
        self.check_room(end - begin)?;
        self.populate(begin..end)
            .map_err(|error| refuse("get", end - begin, error))
    }

    /// Gets and maps the pages of a range at once, which costs less than a fault for each of them.
    fn populate(&self, range: Range<u64>) -> rustix::io::Result<()> {
        let Some(mapping) = &self.mapping else {
            return Ok(());
        };
        let bytes = range.end - range.start;
        if let (Some(base), Ok(offset), Ok(length)) = (
            mapping.base,
            usize::try_from(range.start),
            usize::try_from(bytes),
        ) {
            // SAFETY: the range lies in our own writable mapping; populating changes no content.
            let done = unsafe {
                let address = base.as_ptr().add(offset).cast();
                rustix::mm::madvise(address, length, Advice::LinuxPopulateWrite)
            };
            // Kernels before 5.14 do not know it.
            if done != Err(rustix::io::Errno::INVAL) {
                return done;
            }
        }
        rustix::fs::fallocate(&mapping.file, FallocateFlags::KEEP_SIZE, range.start, bytes)
    }

    /// Gives back the memory of a range, except of pages that it does not cover wholly.
    pub fn release(&self, range: Range<u64>) {
        let Some(mapping) = &self.mapping else { return };
        let begin = range.start.next_multiple_of(PAGE);
        let end = if range.end >= mapping.room {
            mapping.room
        } else {
            range.end / PAGE * PAGE
        };
        if end > begin {
            let flags = FallocateFlags::KEEP_SIZE | FallocateFlags::PUNCH_HOLE;
            // Memory that cannot be given back is only wasted.
            let _ = rustix::fs::fallocate(&mapping.file, flags, begin, end - begin);
        }
    }

    /// Ends writing: the first `bytes` bytes are the content, the rest is given back, and the
    /// mapping is write-protected.
    ///
    /// # Errors
    /// When the system refuses.
    pub fn seal(mut self, bytes: u64) -> Result<Arc<Segment>, Failure> {
        let used = bytes.next_multiple_of(PAGE).min(self.bytes);
        self.release(used..self.bytes);
        let protect = |error| refuse("protect", used, error);
        self.mapping()?
            .protect(MprotectFlags::READ)
            .map_err(protect)?;
        self.bytes = used;
        Ok(Arc::new(self))
    }
}

impl Mapping {
    fn new(file: OwnedFd, room: u64, protection: ProtFlags) -> Result<Mapping, Failure> {
        if room == 0 {
            return Ok(Mapping {
                file,
                base: None,
                room,
            });
        }
        let length =
            usize::try_from(room).map_err(|_| refuse("map", room, rustix::io::Errno::OVERFLOW))?;
        let flags = MapFlags::SHARED | MapFlags::NORESERVE;
        // SAFETY: a fresh mapping of a whole file. Our own files are trimmed only behind their
        // content, which nothing points to, others' are sealed against shrinking.
        let base =
            unsafe { rustix::mm::mmap(std::ptr::null_mut(), length, protection, flags, &file, 0) }
                .map_err(|error| refuse("map", room, error))?;
        Ok(Mapping {
            file,
            base: NonNull::new(base.cast()),
            room,
        })
    }

    fn protect(&self, protection: MprotectFlags) -> rustix::io::Result<()> {
        match (self.base, usize::try_from(self.room)) {
            // SAFETY: exactly our own mapping.
            (Some(base), Ok(length)) => unsafe {
                rustix::mm::mprotect(base.as_ptr().cast(), length, protection)
            },
            _ => Ok(()),
        }
    }
}

impl Drop for Mapping {
    fn drop(&mut self) {
        if let (Some(base), Ok(length)) = (self.base, usize::try_from(self.room)) {
            // SAFETY: exactly our own mapping, and regions hold its segment alive.
            let _ = unsafe { rustix::mm::munmap(base.as_ptr().cast(), length) };
        }
    }
}

impl Drop for Segment {
    fn drop(&mut self) {
        if !*self.sent.get_mut()
            && let (Some(mapping), Some(pool)) = (self.mapping.take(), self.pool.upgrade())
        {
            pool.keep(mapping, self.bytes);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::region::{Region, writable};
    use super::*;

    #[test]
    fn content_survives_sealing_and_sending() {
        let segment = Segment::create(1 << 30).unwrap();
        // SAFETY: a fresh segment.
        let values = unsafe { writable::<f64>(segment.base(), 0, 1000) };
        values
            .iter_mut()
            .enumerate()
            .for_each(|(i, value)| *value = i as f64);
        let sealed = segment.seal(8000).unwrap();
        assert_eq!(sealed.bytes(), 8192);
        let region = Region::new(&sealed, 0, 8000).unwrap();
        assert_eq!(region.slice::<f64>()[999], 999.0);
        let copy = sealed.file().unwrap().try_clone_to_owned().unwrap();
        let other = Arc::new(Segment::open(copy, 8000).unwrap());
        let region = Region::new(&other, 8, 8).unwrap();
        assert_eq!(region.slice::<f64>(), [1.0]);
    }

    #[test]
    fn impossible_sizes_are_refused() {
        assert!(Segment::create(MAX_BYTES + 1).is_err());
        let segment = Segment::create(100).unwrap().seal(100).unwrap();
        assert!(Region::new(&segment, 4000, 200).is_err());
        assert!(Region::new(&segment, u64::MAX, 2).is_err());
        let unsealed = rustix::fs::memfd_create("x", MemfdFlags::ALLOW_SEALING).unwrap();
        assert!(
            Segment::open(unsealed, 0)
                .unwrap_err()
                .message
                .contains("shrink")
        );
    }

    #[test]
    fn memory_that_the_machine_lacks_is_an_error() {
        let segment = Segment::create(1 << 41).unwrap();
        assert!(segment.commit(0..1 << 41).is_err());
    }
}
