//! Progress that is lent for a call, for work that needs to own it.
#![allow(unsafe_code)]

use crate::job::Progress;
use std::sync::{Arc, PoisonError, RwLock};

/// Progress of somebody else, until it is taken back.
struct Lent(RwLock<Option<&'static dyn Progress>>);

/// Takes the progress back, also when the work panics.
struct Return<'a>(&'a Lent);

impl Drop for Return<'_> {
    fn drop(&mut self) {
        // Waits for whoever uses it at this moment.
        *self.0.0.write().unwrap_or_else(PoisonError::into_inner) = None;
    }
}

/// Does work that needs progress for itself. What the work leaves behind finds it cancelled.
pub(super) fn watched<T>(job: &dyn Progress, work: impl FnOnce(&Arc<dyn Progress>) -> T) -> T {
    // SAFETY: the reference is only reached through the lock, and `Return` empties it before this
    // function returns, that is before the borrow of `job` ends.
    let job = unsafe { std::mem::transmute::<&dyn Progress, &'static dyn Progress>(job) };
    let lent = Arc::new(Lent(RwLock::new(Some(job))));
    let _return = Return(&lent);
    let shared: Arc<dyn Progress> = Arc::clone(&lent) as Arc<dyn Progress>;
    work(&shared)
}

impl Lent {
    fn with<T>(&self, otherwise: T, use_it: impl FnOnce(&dyn Progress) -> T) -> T {
        match *self.0.read().unwrap_or_else(PoisonError::into_inner) {
            Some(job) => use_it(job),
            None => otherwise,
        }
    }
}

impl Progress for Lent {
    fn progress(&self, fraction: f64, phase: &str) {
        self.with((), |job| job.progress(fraction, phase));
    }

    fn message(&self, level: u32, text: &str) {
        self.with((), |job| job.message(level, text));
    }

    fn cancelled(&self) -> bool {
        self.with(true, |job| job.cancelled())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::job::Cancel;

    #[test]
    fn what_is_left_behind_finds_it_cancelled() {
        let cancel = Cancel::default();
        let kept = watched(&cancel, |progress| {
            assert!(!progress.cancelled());
            cancel.cancel();
            assert!(progress.cancelled());
            Arc::clone(progress)
        });
        assert!(kept.cancelled());
        kept.message(3, "nobody hears this");
    }
}
