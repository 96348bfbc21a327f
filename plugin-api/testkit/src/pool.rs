//! Pools for tests of an algorithm that takes `&dyn Run`.

use puncta_sdk::{Cancelled, Run};
use std::sync::atomic::{AtomicUsize, Ordering};

/// So many scoped threads a call; nobody cancels.
pub struct Threads(pub usize);

impl Run for Threads {
    fn parallel(&self, count: usize, task: &(dyn Fn(usize) + Sync)) {
        let next = AtomicUsize::new(0);
        let work = || {
            loop {
                let i = next.fetch_add(1, Ordering::Relaxed);
                if i >= count {
                    break;
                }
                task(i);
            }
        };
        std::thread::scope(|scope| {
            for _ in 1..self.0 {
                scope.spawn(work);
            }
            work();
        });
    }
    fn threads(&self) -> usize {
        self.0
    }
    fn progress(&self, _: f64, _: &str) -> Result<(), Cancelled> {
        Ok(())
    }
    fn cancelled(&self) -> bool {
        false
    }
}

/// A call that the person has already stopped.
pub struct Stopped;

impl Run for Stopped {
    fn parallel(&self, count: usize, task: &(dyn Fn(usize) + Sync)) {
        (0..count).for_each(task);
    }
    fn threads(&self) -> usize {
        1
    }
    fn progress(&self, _: f64, _: &str) -> Result<(), Cancelled> {
        Err(Cancelled)
    }
    fn cancelled(&self) -> bool {
        true
    }
}
