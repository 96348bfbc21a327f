//! Memory that another process can map.
//!
//! A segment is a sparse, anonymous file in memory (`memfd_create`): room costs nothing until it is
//! written, addresses never move, and the descriptor can be sent to a worker. It is written by one
//! call and immutable from then on: sealing trims it, forbids resizing, and write-protects the mapping.
#![allow(unsafe_code)]

use puncta_documents::{Failure, FailureCode};
use rustix::fs::{FallocateFlags, MemfdFlags, SealFlags};
use rustix::mm::{Advice, MapFlags, MprotectFlags, ProtFlags};
use std::ops::Range;
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::ptr::NonNull;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// Largest segment: room for far more than any machine has, but an address space bears it.
pub const MAX_BYTES: u64 = 1 << 42;
const PAGE: u64 = 4096;
/// Smaller commits are not worth a look at the machine's memory.
const CAREFUL: u64 = 1 << 24;

/// Bytes that the machine can give without taking them from others, less a reserve of a sixteenth.
#[must_use]
pub fn available() -> Option<u64> {
    let text = std::fs::read_to_string("/proc/meminfo").ok()?;
    let field = |name: &str| -> Option<u64> {
        let line = text.lines().find_map(|line| line.strip_prefix(name))?;
        line.split_whitespace()
            .next()?
            .parse::<u64>()
            .ok()?
            .checked_mul(1024)
    };
    Some(field("MemAvailable:")?.saturating_sub(field("MemTotal:")? / 16))
}

/// A piece of shared memory.
#[derive(Debug)]
pub struct Segment {
    id: u64,
    file: OwnedFd,
    /// Where it is mapped; null for an empty segment.
    base: Option<NonNull<u8>>,
    bytes: u64,
}

// SAFETY: the mapping is plain memory. Before sealing, one call writes it through pointers that the
// ABI gives it; afterwards nobody can.
unsafe impl Send for Segment {}
// SAFETY: as above.
unsafe impl Sync for Segment {}

static NEXT_ID: AtomicU64 = AtomicU64::new(1);

fn refuse(what: &str, bytes: u64, error: rustix::io::Errno) -> Failure {
    let mega = bytes.div_ceil(1 << 20);
    let message = format!("cannot {what} {mega} MB of shared memory: {error}");
    Failure::new(FailureCode::Resources, message).remedy("close other data or use a smaller part")
}

impl Segment {
    /// A writable segment with room for `bytes` bytes, all zero.
    ///
    /// # Errors
    /// When the system refuses.
    pub fn create(bytes: u64) -> Result<Segment, Failure> {
        let bytes = bytes.next_multiple_of(PAGE);
        if bytes > MAX_BYTES {
            return Err(refuse("reserve", bytes, rustix::io::Errno::NOMEM));
        }
        let flags = MemfdFlags::CLOEXEC | MemfdFlags::ALLOW_SEALING;
        let file = rustix::fs::memfd_create("puncta", flags)
            .map_err(|error| refuse("create", bytes, error))?;
        rustix::fs::ftruncate(&file, bytes).map_err(|error| refuse("reserve", bytes, error))?;
        Segment::map(file, bytes, ProtFlags::READ | ProtFlags::WRITE)
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
        Segment::map(file, bytes, ProtFlags::READ)
    }

    fn map(file: OwnedFd, bytes: u64, protection: ProtFlags) -> Result<Segment, Failure> {
        let id = NEXT_ID.fetch_add(1, Ordering::Relaxed);
        if bytes == 0 {
            return Ok(Segment {
                id,
                file,
                base: None,
                bytes,
            });
        }
        let length = usize::try_from(bytes)
            .map_err(|_| refuse("map", bytes, rustix::io::Errno::OVERFLOW))?;
        let flags = MapFlags::SHARED | MapFlags::NORESERVE;
        // SAFETY: a fresh mapping of a whole file that nothing truncates while it is mapped: our
        // own are trimmed only past their used part, others' are sealed against shrinking.
        let base =
            unsafe { rustix::mm::mmap(std::ptr::null_mut(), length, protection, flags, &file, 0) }
                .map_err(|error| refuse("map", bytes, error))?;
        Ok(Segment {
            id,
            file,
            base: NonNull::new(base.cast()),
            bytes,
        })
    }

    /// Number that no other segment of this process has.
    #[must_use]
    pub fn id(&self) -> u64 {
        self.id
    }

    /// The descriptor, to be sent to a worker.
    #[must_use]
    pub fn file(&self) -> BorrowedFd<'_> {
        self.file.as_fd()
    }

    /// Bytes of room, or of content once sealed.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        self.bytes
    }

    /// First byte.
    #[must_use]
    pub fn base(&self) -> *mut u8 {
        self.base.map_or(std::ptr::null_mut(), NonNull::as_ptr)
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
        let bytes = range.end - range.start;
        if let (Some(base), Ok(offset), Ok(length)) = (
            self.base,
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
        rustix::fs::fallocate(&self.file, FallocateFlags::KEEP_SIZE, range.start, bytes)
    }

    /// Gives back the memory of a range, except of pages that it does not cover wholly.
    pub fn release(&self, range: Range<u64>) {
        let begin = range.start.next_multiple_of(PAGE);
        let end = if range.end >= self.bytes {
            self.bytes
        } else {
            range.end / PAGE * PAGE
        };
        if end > begin {
            let flags = FallocateFlags::KEEP_SIZE | FallocateFlags::PUNCH_HOLE;
            // Memory that cannot be given back is only wasted.
            let _ = rustix::fs::fallocate(&self.file, flags, begin, end - begin);
        }
    }

    /// Ends writing: trims to `bytes`, forbids resizing and write-protects the mapping.
    ///
    /// # Errors
    /// When the system refuses.
    pub fn seal(mut self, bytes: u64) -> Result<Arc<Segment>, Failure> {
        let used = bytes.next_multiple_of(PAGE).min(self.bytes);
        let protect = |error| refuse("protect", used, error);
        if used < self.bytes {
            rustix::fs::ftruncate(&self.file, used).map_err(protect)?;
            self.unmap_tail(used);
        }
        if let (Some(base), Ok(length)) = (self.base, usize::try_from(self.bytes)) {
            // SAFETY: exactly our own mapping.
            unsafe { rustix::mm::mprotect(base.as_ptr().cast(), length, MprotectFlags::READ) }
                .map_err(protect)?;
        }
        rustix::fs::fcntl_add_seals(&self.file, SealFlags::SHRINK | SealFlags::GROW)
            .map_err(protect)?;
        Ok(Arc::new(self))
    }

    fn unmap_tail(&mut self, used: u64) {
        let (Some(base), Ok(keep), Ok(all)) = (
            self.base,
            usize::try_from(used),
            usize::try_from(self.bytes),
        ) else {
            return;
        };
        // SAFETY: the tail of our own mapping, which nothing points into: the writer's pointers end
        // with `finish`.
        let _ = unsafe { rustix::mm::munmap(base.as_ptr().add(keep).cast(), all - keep) };
        self.bytes = used;
        if keep == 0 {
            self.base = None;
        }
    }
}

impl Drop for Segment {
    fn drop(&mut self) {
        if let (Some(base), Ok(length)) = (self.base, usize::try_from(self.bytes)) {
            // SAFETY: exactly our own mapping, and regions hold the segment alive.
            let _ = unsafe { rustix::mm::munmap(base.as_ptr().cast(), length) };
        }
    }
}

/// A range of a sealed segment.
#[derive(Clone, Debug)]
pub struct Region {
    segment: Arc<Segment>,
    offset: u64,
    bytes: u64,
}

impl Region {
    /// A range of a segment.
    ///
    /// # Errors
    /// When it does not lie inside.
    pub fn new(segment: &Arc<Segment>, offset: u64, bytes: u64) -> Result<Region, Failure> {
        match offset.checked_add(bytes) {
            Some(end) if end <= segment.bytes => Ok(Region {
                segment: Arc::clone(segment),
                offset,
                bytes,
            }),
            _ => Err(Failure::internal("a column lies outside its memory")),
        }
    }

    /// The segment.
    #[must_use]
    pub fn segment(&self) -> &Arc<Segment> {
        &self.segment
    }

    /// First byte within the segment.
    #[must_use]
    pub fn offset(&self) -> u64 {
        self.offset
    }

    /// Number of bytes.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        self.bytes
    }

    /// Address of the first byte.
    #[must_use]
    pub fn pointer(&self) -> *mut u8 {
        // Inside the mapping, as `new` checked; an empty region may dangle but is never read.
        self.segment.base().wrapping_add(self.offset as usize)
    }

    /// The bytes as numbers.
    #[must_use]
    pub fn slice<T: Number>(&self) -> &[T] {
        let count = self.bytes as usize / size_of::<T>();
        let pointer = self.pointer().cast::<T>();
        if count == 0 || !pointer.is_aligned() {
            return &[];
        }
        // SAFETY: inside the mapping, aligned, sealed, and alive as long as `self`; every bit
        // pattern is a value of a `Number`.
        unsafe { std::slice::from_raw_parts(pointer, count) }
    }
}

/// Types for which every bit pattern is a value.
///
/// # Safety
/// That must be so.
pub unsafe trait Number: Copy + Send + Sync + 'static {}
macro_rules! numbers {
    ($($type:ty),*) => {
        $(
            // SAFETY: every bit pattern is a value.
            unsafe impl Number for $type {}
        )*
    };
}
numbers!(u8, i8, u16, i16, u32, i32, u64, i64, f32, f64);

/// The bytes of a writable segment as numbers.
///
/// # Safety
/// The range must lie in the segment, and nothing else may use it during `'a`.
#[must_use]
pub unsafe fn writable<'a, T: Number>(base: *mut u8, offset: u64, count: usize) -> &'a mut [T] {
    let pointer = base.wrapping_add(offset as usize).cast::<T>();
    if count == 0 || base.is_null() || !pointer.is_aligned() {
        return &mut [];
    }
    // SAFETY: the caller's promise; aligned as checked.
    unsafe { std::slice::from_raw_parts_mut(pointer, count) }
}

#[cfg(test)]
mod tests {
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
        let copy = sealed.file().try_clone_to_owned().unwrap();
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
