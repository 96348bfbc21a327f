//! Room for calls that run at once: one waits until what the others may need leaves enough for it.

use crate::job::Progress;
use puncta_documents::{Failure, Plan};
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// A call that waits looks this often for cancel, and for memory that came free elsewhere.
const LOOK: Duration = Duration::from_millis(50);
/// Plans below this need not wait: many small calls are cheaper than the accounting.
const SMALL: u64 = 16 << 20;

/// Bytes that running calls may need together, by their plans.
#[derive(Debug)]
pub struct Room {
    total: u64,
    state: Mutex<State>,
    freed: Condvar,
}

#[derive(Debug, Default)]
struct State {
    bytes: u64,
    calls: usize,
}

/// What a running call has been given; given back when it is dropped.
#[derive(Debug)]
pub struct Share<'a> {
    room: &'a Room,
    bytes: u64,
}

impl Room {
    /// Room of so many bytes.
    #[must_use]
    pub fn new(total: u64) -> Room {
        Room {
            total,
            state: Mutex::default(),
            freed: Condvar::new(),
        }
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Waits until there is room for a call. One that runs alone always has it: whether it can get
    /// the memory is then decided when it asks for it.
    ///
    /// # Errors
    /// When the person stopped it.
    pub fn take(&self, bytes: u64, progress: &dyn Progress) -> Result<Share<'_>, Failure> {
        self.take_of(bytes, progress, &|| crate::store::available_memory())
    }

    fn take_of(
        &self,
        bytes: u64,
        progress: &dyn Progress,
        available: &dyn Fn() -> Option<u64>,
    ) -> Result<Share<'_>, Failure> {
        let mut state = self.state();
        loop {
            if progress.cancelled() {
                return Err(Failure::cancelled());
            }
            if state.calls == 0 || bytes < SMALL {
                break;
            }
            let total = available().map_or(self.total, |free| free.min(self.total));
            if state.bytes.saturating_add(bytes) <= total {
                break;
            }
            let waited = self.freed.wait_timeout(state, LOOK);
            state = waited.unwrap_or_else(PoisonError::into_inner).0;
        }
        // Small calls are not counted, or a few of them would keep a large one from running alone.
        if bytes >= SMALL {
            state.calls += 1;
            state.bytes = state.bytes.saturating_add(bytes);
        }
        Ok(Share { room: self, bytes })
    }
}

impl Drop for Share<'_> {
    fn drop(&mut self) {
        if self.bytes < SMALL {
            return;
        }
        let mut state = self.room.state();
        state.calls -= 1;
        state.bytes = state.bytes.saturating_sub(self.bytes);
        drop(state);
        self.room.freed.notify_all();
    }
}

/// Bytes that a call may need by its plan: working memory, and outputs of the most rows.
#[must_use]
pub fn needed(plan: &Plan) -> u64 {
    let outputs = plan.outputs.iter().map(|output| {
        let parts = output.header.parts.iter().map(|part| {
            let columns = part.columns.iter().map(|column| {
                let row = column.type_.row_bytes() as u64;
                part.rows.saturating_mul(row)
            });
            columns.fold(0, u64::saturating_add)
        });
        parts.fold(0, u64::saturating_add)
    });
    outputs.fold(plan.memory, u64::saturating_add)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::job::{Cancel, Unwatched};
    use std::sync::atomic::{AtomicUsize, Ordering};

    #[test]
    fn calls_wait_until_there_is_room() {
        let room = Room::new(100 << 20);
        let (most, now) = (AtomicUsize::new(0), AtomicUsize::new(0));
        std::thread::scope(|scope| {
            for _ in 0..12 {
                scope.spawn(|| {
                    let share = room.take_of(40 << 20, &Unwatched, &|| None).unwrap();
                    most.fetch_max(now.fetch_add(1, Ordering::SeqCst) + 1, Ordering::SeqCst);
                    std::thread::sleep(Duration::from_millis(2));
                    now.fetch_sub(1, Ordering::SeqCst);
                    drop(share);
                });
            }
        });
        assert_eq!(most.load(Ordering::SeqCst), 2);
    }

    #[test]
    fn what_the_machine_has_left_counts_too() {
        let room = Room::new(1 << 40);
        let _one = room.take_of(1 << 30, &Unwatched, &|| Some(0)).unwrap();
        let stop = Cancel::default();
        std::thread::scope(|scope| {
            let waits = scope.spawn(|| room.take_of(1 << 30, &stop, &|| Some(0)).map(|_| ()));
            std::thread::sleep(Duration::from_millis(20));
            assert!(!waits.is_finished());
            stop.cancel();
            assert!(waits.join().unwrap().unwrap_err().is_cancelled());
        });
    }

    #[test]
    fn one_alone_and_small_ones_never_wait() {
        let room = Room::new(10);
        let large = room.take(u64::MAX, &Unwatched).unwrap();
        let small = room.take(1000, &Unwatched).unwrap();
        drop(large);
        let _large = room.take(u64::MAX, &Unwatched).unwrap();
        drop(small);
    }
}
