//! Threads, progress and cancel, as an algorithm sees them.

use std::sync::{Mutex, PoisonError};

/// The person stopped the call.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Cancelled;

impl From<Cancelled> for crate::Failure {
    fn from(_: Cancelled) -> Self {
        crate::Failure::cancelled()
    }
}

/// The host's thread pool, progress and cancel, as an algorithm sees them.
pub trait Run: Sync {
    /// Calls `task(i)` once for each i in `0..count`, on all threads of the pool; returns when all
    /// are done. A panic in a task is passed on after the others ended.
    fn parallel(&self, count: usize, task: &(dyn Fn(usize) + Sync));

    /// Number of threads of the pool.
    fn threads(&self) -> usize;

    /// Reports the finished fraction (0 to 1) and what is being done.
    ///
    /// # Errors
    /// When the person cancelled.
    fn progress(&self, fraction: f64, phase: &str) -> Result<(), Cancelled>;

    /// Whether the person cancelled. Cheap: poll it at least every 50 ms.
    fn cancelled(&self) -> bool;
}

/// Runs everything on the calling thread, for tests and for algorithms called from a task.
#[derive(Clone, Copy, Debug, Default)]
pub struct Serial;

impl Run for Serial {
    fn parallel(&self, count: usize, task: &(dyn Fn(usize) + Sync)) {
        (0..count).for_each(task);
    }

    fn threads(&self) -> usize {
        1
    }

    fn progress(&self, _fraction: f64, _phase: &str) -> Result<(), Cancelled> {
        Ok(())
    }

    fn cancelled(&self) -> bool {
        false
    }
}

/// Calls `task(i, chunk)` for the chunks of `size` items of `items`, in parallel. The last chunk
/// may be shorter.
pub fn chunks_mut<T: Send>(
    run: &dyn Run,
    items: &mut [T],
    size: usize,
    task: &(dyn Fn(usize, &mut [T]) + Sync),
) {
    let chunks: Vec<Mutex<&mut [T]>> = items.chunks_mut(size.max(1)).map(Mutex::new).collect();
    run.parallel(chunks.len(), &|i| {
        let mut chunk = chunks[i].lock().unwrap_or_else(PoisonError::into_inner);
        task(i, &mut chunk);
    });
}

/// Calls `task(i)` for each i in `0..count` in parallel and returns the results in order.
pub fn map<T: Send>(run: &dyn Run, count: usize, task: &(dyn Fn(usize) -> T + Sync)) -> Vec<T> {
    let slots: Vec<Mutex<Option<T>>> = (0..count).map(|_| Mutex::new(None)).collect();
    run.parallel(count, &|i| {
        let result = task(i);
        *slots[i].lock().unwrap_or_else(PoisonError::into_inner) = Some(result);
    });
    slots
        .into_iter()
        .filter_map(|slot| slot.into_inner().unwrap_or_else(PoisonError::into_inner))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn chunks_cover_everything_once() {
        let mut items = vec![0_u32; 1003];
        chunks_mut(&Serial, &mut items, 10, &|i, chunk| {
            chunk
                .iter_mut()
                .for_each(|item| *item += 1 + u32::try_from(i).unwrap_or(0));
        });
        assert_eq!(items[0], 1);
        assert_eq!(items[1002], 101);
        assert_eq!(map(&Serial, 3, &|i| i * i), [0, 1, 4]);
    }
}
