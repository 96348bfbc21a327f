//! Calls under way, which several runs may wait for.

use super::report::Record;
use super::session::Watch;
use crate::job::Progress;
use puncta_documents::Failure;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// How often a run that waits for another's call looks whether it is to stop.
const POLL: Duration = Duration::from_millis(10);

/// Locks; a panic elsewhere leaves data that is whole, since nothing panics while it changes it.
pub(crate) fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Outputs of a step by port.
pub(crate) type Outputs<O> = Vec<(String, O)>;

/// How a call ended.
pub(crate) enum Outcome<O> {
    Done(Arc<Outputs<O>>, Arc<Record>),
    Failed(Failure),
    Cancelled,
}

impl<O> Clone for Outcome<O> {
    fn clone(&self) -> Outcome<O> {
        match self {
            Outcome::Done(outputs, record) => Outcome::Done(outputs.clone(), record.clone()),
            Outcome::Failed(failure) => Outcome::Failed(failure.clone()),
            Outcome::Cancelled => Outcome::Cancelled,
        }
    }
}

/// Whether a run is to stop.
#[derive(Default)]
pub(crate) struct Flag(AtomicBool);

impl Flag {
    pub fn stop(&self) {
        self.0.store(true, Ordering::Release);
    }

    pub fn stopped(&self) -> bool {
        self.0.load(Ordering::Acquire)
    }

    /// Asks the person too.
    pub fn poll(&self, watch: &dyn Watch) -> bool {
        if !self.stopped() && watch.cancelled() {
            self.stop();
        }
        self.stopped()
    }
}

/// A call under way. It goes on as long as one of the runs that want its result does.
pub(crate) struct Flight<O> {
    wanted_by: Mutex<Vec<Arc<Flag>>>,
    ended: Mutex<Option<Outcome<O>>>,
    end: Condvar,
    progress: Mutex<(f64, String)>,
}

impl<O> Flight<O> {
    pub fn new(flag: Arc<Flag>) -> Flight<O> {
        Flight {
            wanted_by: Mutex::new(vec![flag]),
            ended: Mutex::new(None),
            end: Condvar::new(),
            progress: Mutex::new((0.0, String::new())),
        }
    }

    pub fn join(&self, flag: &Arc<Flag>) {
        let mut list = lock(&self.wanted_by);
        if !list.iter().any(|one| Arc::ptr_eq(one, flag)) {
            list.push(flag.clone());
        }
    }

    pub fn finish(&self, outcome: Outcome<O>) {
        *lock(&self.ended) = Some(outcome);
        self.end.notify_all();
    }

    /// Waits for the end, or for the waiting run to be stopped.
    pub fn wait(&self, flag: &Flag, watch: &dyn Watch, step: &str) -> Outcome<O> {
        let mut shown = -1.0;
        let mut ended = lock(&self.ended);
        loop {
            if let Some(outcome) = ended.as_ref() {
                return outcome.clone();
            }
            if flag.poll(watch) {
                return Outcome::Cancelled;
            }
            let (fraction, phase) = lock(&self.progress).clone();
            if fraction > shown {
                watch.progress(step, fraction, &phase);
                shown = fraction;
            }
            ended = self
                .end
                .wait_timeout(ended, POLL)
                .unwrap_or_else(PoisonError::into_inner)
                .0;
        }
    }
}

/// Progress and cancel of a call, as the runner sees them.
pub(crate) struct Reporter<'a, O> {
    pub flight: &'a Flight<O>,
    pub flag: &'a Flag,
    pub watch: &'a dyn Watch,
    pub step: &'a str,
}

impl<O: Send + Sync> Progress for Reporter<'_, O> {
    fn progress(&self, fraction: f64, phase: &str) {
        {
            let mut last = lock(&self.flight.progress);
            last.0 = fraction;
            if last.1 != phase {
                phase.clone_into(&mut last.1);
            }
        }
        self.watch.progress(self.step, fraction, phase);
    }

    fn message(&self, level: u32, text: &str) {
        self.watch.message(self.step, level, text);
    }

    fn cancelled(&self) -> bool {
        self.flag.poll(self.watch)
            && lock(&self.flight.wanted_by)
                .iter()
                .all(|flag| flag.stopped())
    }
}
