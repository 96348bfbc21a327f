//! Progress, messages and cancel of work, as whoever started it sees them.

use std::sync::atomic::{AtomicBool, Ordering};

/// Receives what running work says, and tells it to stop.
pub trait Progress: Send + Sync {
    /// Finished fraction (0 to 1) and what is being done.
    fn progress(&self, fraction: f64, phase: &str);
    /// Level 1 error, 2 warning, 3 information, 4 detail.
    fn message(&self, level: u32, text: &str);
    /// Whether the work should stop.
    fn cancelled(&self) -> bool;
}

/// Work that nobody watches and nobody stops.
#[derive(Clone, Copy, Debug, Default)]
pub struct Unwatched;

impl Progress for Unwatched {
    fn progress(&self, _fraction: f64, _phase: &str) {}
    fn message(&self, _level: u32, _text: &str) {}
    fn cancelled(&self) -> bool {
        false
    }
}

/// Work that can be stopped from another thread.
#[derive(Debug, Default)]
pub struct Cancel(AtomicBool);

impl Cancel {
    /// Asks the work to stop.
    pub fn cancel(&self) {
        self.0.store(true, Ordering::Relaxed);
    }
}

impl Progress for Cancel {
    fn progress(&self, _fraction: f64, _phase: &str) {}
    fn message(&self, _level: u32, _text: &str) {}
    fn cancelled(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }
}
