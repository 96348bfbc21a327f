//! Memory that is used again: getting pages from the system, and giving them back, takes longer
//! than most calculations on them.

use super::segment::Mapping;
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Smaller pieces are not worth keeping.
const LEAST: u64 = 1 << 20;
/// Memory that nobody used again for so long is given back when the pool is next used.
const IDLE: Duration = Duration::from_secs(20);

/// Free memory of one engine.
#[derive(Debug)]
pub struct SegmentPool {
    budget: u64,
    free: Mutex<Vec<Free>>,
}

#[derive(Debug)]
struct Free {
    mapping: Mapping,
    /// Bytes that it holds.
    bytes: u64,
    since: Instant,
}

impl SegmentPool {
    /// A pool that keeps at most so many bytes.
    #[must_use]
    pub fn new(budget: u64) -> SegmentPool {
        SegmentPool {
            budget,
            free: Mutex::default(),
        }
    }

    fn with<T>(&self, use_it: impl FnOnce(&mut Vec<Free>) -> T) -> T {
        // What falls out is dropped after the lock is free again.
        let mut old: Vec<Free> = Vec::new();
        let mut free = self.free.lock().unwrap_or_else(PoisonError::into_inner);
        let (kept, gone) = free
            .drain(..)
            .partition(|one: &Free| one.since.elapsed() < IDLE);
        *free = kept;
        old.extend(gone);
        let result = use_it(&mut free);
        let mut held: u64 = free.iter().map(|one| one.bytes).sum();
        while held > self.budget && !free.is_empty() {
            let oldest = free.remove(0);
            held -= oldest.bytes;
            old.push(oldest);
        }
        drop(free);
        drop(old);
        result
    }

    /// Memory with exactly this room, if there is any.
    pub(super) fn take(&self, room: u64) -> Option<Mapping> {
        if room < LEAST {
            return None;
        }
        self.with(|free| {
            let place = free.iter().rposition(|one| one.mapping.room == room)?;
            Some(free.remove(place).mapping)
        })
    }

    /// Keeps memory that holds so many bytes.
    pub(super) fn keep(&self, mapping: Mapping, bytes: u64) {
        if (LEAST..=self.budget).contains(&bytes) {
            self.with(|free| {
                free.push(Free {
                    mapping,
                    bytes,
                    since: Instant::now(),
                })
            });
        }
    }

    /// Bytes that are kept.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        self.with(|free| free.iter().map(|one| one.bytes).sum())
    }
}

#[cfg(test)]
mod tests {
    use super::super::region::{Region, writable};
    use super::super::segment::Segment;
    use super::*;
    use std::sync::Arc;

    const ROOM: u64 = 4 << 20;

    fn segment(pool: &Arc<SegmentPool>) -> Arc<Segment> {
        let segment = Segment::create_in(pool, ROOM).unwrap();
        // SAFETY: a segment that nothing else uses.
        #[allow(unsafe_code)]
        let numbers = unsafe { writable::<u64>(segment.base(), 0, 1) };
        numbers[0] = 7;
        segment.seal(ROOM / 2).unwrap()
    }

    #[test]
    fn memory_is_used_again_unless_it_was_sent() {
        let pool = Arc::new(SegmentPool::new(3 << 20));
        drop(segment(&pool));
        assert_eq!(pool.bytes(), ROOM / 2);
        let again = segment(&pool);
        assert_eq!(pool.bytes(), 0);
        assert_eq!(Region::new(&again, 0, 8).unwrap().slice::<u64>(), [7]);
        assert!(again.file().is_ok());
        drop(again);
        assert_eq!(pool.bytes(), 0, "another process may still have it");
        let (one, two) = (segment(&pool), segment(&pool));
        drop((one, two));
        assert_eq!(pool.bytes(), ROOM / 2, "the budget is kept");
    }

    #[test]
    fn small_and_other_sizes_are_not_kept_or_given() {
        let pool = Arc::new(SegmentPool::new(1 << 30));
        drop(Segment::create_in(&pool, 1000).unwrap().seal(1000).unwrap());
        assert_eq!(pool.bytes(), 0);
        drop(segment(&pool));
        assert!(pool.take(ROOM * 2).is_none() && pool.take(ROOM).is_some());
    }
}
