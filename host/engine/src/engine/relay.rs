//! Progress that is lent for a call, for work that needs to own it.

use crate::job::Progress;
use puncta_documents::{Failure, FailureCode};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// How often a running step looks whether the person wants to stop.
const POLL: Duration = Duration::from_millis(10);

/// Does work that needs progress for itself, while another thread passes on what it says.
///
/// # Errors
/// Those of the work, or when the system gives no thread.
pub(super) fn watched<T>(
    job: &dyn Progress,
    work: impl FnOnce(&Arc<dyn Progress>) -> Result<T, Failure>,
) -> Result<T, Failure> {
    let relay = Arc::new(Relay::default());
    relay.cancelled.store(job.cancelled(), Ordering::Relaxed);
    let progress: Arc<dyn Progress> = Arc::clone(&relay) as Arc<dyn Progress>;
    std::thread::scope(|scope| {
        let ended = Ended(&relay);
        let forward = || relay.forward(job);
        std::thread::Builder::new()
            .spawn_scoped(scope, forward)
            .map_err(|_| {
                Failure::new(
                    FailureCode::Resources,
                    "the system gives no thread for a step",
                )
            })?;
        let done = work(&progress);
        drop(ended);
        done
    })
}

#[derive(Default)]
struct Relay {
    cancelled: AtomicBool,
    said: Mutex<Said>,
    news: Condvar,
}

#[derive(Default)]
struct Said {
    progress: Option<(f64, String)>,
    messages: Vec<(u32, String)>,
    over: bool,
}

/// Ends the passing on, also when the work panics.
struct Ended<'a>(&'a Relay);

impl Drop for Ended<'_> {
    fn drop(&mut self) {
        self.0.said().over = true;
        self.0.news.notify_all();
    }
}

impl Relay {
    fn said(&self) -> MutexGuard<'_, Said> {
        self.said.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn forward(&self, job: &dyn Progress) {
        let mut said = self.said();
        loop {
            let news = std::mem::take(&mut *said);
            drop(said);
            for (level, text) in &news.messages {
                job.message(*level, text);
            }
            if let Some((fraction, phase)) = &news.progress {
                job.progress(*fraction, phase);
            }
            if news.over {
                return;
            }
            if job.cancelled() {
                self.cancelled.store(true, Ordering::Relaxed);
            }
            said = self.said();
            // Messages and the end are passed on at once, progress when it is time to look.
            if said.messages.is_empty() && !said.over {
                let waited = self.news.wait_timeout(said, POLL);
                said = waited.unwrap_or_else(PoisonError::into_inner).0;
            }
        }
    }
}

impl Progress for Relay {
    fn progress(&self, fraction: f64, phase: &str) {
        let mut said = self.said();
        match &mut said.progress {
            Some((last, text)) => {
                *last = fraction;
                if text != phase {
                    phase.clone_into(text);
                }
            }
            none => *none = Some((fraction, phase.to_owned())),
        }
    }

    fn message(&self, level: u32, text: &str) {
        self.said().messages.push((level, text.to_owned()));
        self.news.notify_all();
    }

    fn cancelled(&self) -> bool {
        self.cancelled.load(Ordering::Relaxed)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::job::Cancel;

    #[derive(Default)]
    struct Notes(Mutex<Vec<String>>);

    impl Progress for Notes {
        fn progress(&self, fraction: f64, phase: &str) {
            self.0.lock().unwrap().push(format!("{fraction} {phase}"));
        }
        fn message(&self, level: u32, text: &str) {
            self.0.lock().unwrap().push(format!("{level} {text}"));
        }
        fn cancelled(&self) -> bool {
            false
        }
    }

    #[test]
    fn what_work_says_arrives() {
        let notes = Notes::default();
        let done = watched(&notes, |progress| {
            progress.message(2, "one");
            progress.message(3, "two");
            progress.progress(0.5, "half");
            Ok(7)
        });
        assert_eq!(done, Ok(7));
        let said = notes.0.lock().unwrap();
        let messages: Vec<&String> = said.iter().filter(|text| !text.contains("half")).collect();
        assert_eq!(messages, ["2 one", "3 two"]);
        assert_eq!(said.last().map(String::as_str), Some("0.5 half"));
    }

    #[test]
    fn cancel_reaches_the_work() {
        let cancel = Cancel::default();
        let done: Result<(), Failure> = watched(&cancel, |progress| {
            assert!(!progress.cancelled());
            cancel.cancel();
            while !progress.cancelled() {
                std::thread::yield_now();
            }
            Err(Failure::cancelled())
        });
        assert!(done.unwrap_err().is_cancelled());
    }

    #[test]
    fn a_panic_in_the_work_ends_it() {
        let caught = std::panic::catch_unwind(|| {
            watched::<()>(&crate::job::Unwatched, |_| panic!("on purpose"))
        });
        assert!(caught.is_err());
    }
}
