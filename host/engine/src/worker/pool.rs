//! Idle workers, kept for the next call.

use super::client::Prepared;
use super::process::{GRACE, Start, Worker};
use super::protocol::{FromWorker, ToWorker};
use crate::job::{Progress, Unwatched};
use puncta_documents::{Failure, Manifest, Plan, Request};
use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, Weak};
use std::time::{Duration, Instant};

/// A worker that nobody called for so long is ended.
const IDLE: Duration = Duration::from_secs(60);
/// How often idle workers are looked at.
const ROUND: Duration = Duration::from_millis(500);

struct Resting {
    worker: Worker,
    since: Instant,
    /// Whether it has yet to say that its last call is put away.
    busy: bool,
}

#[derive(Default)]
struct Idle {
    by_library: HashMap<PathBuf, Vec<Resting>>,
    /// What went wrong when calls were put away, for whoever calls the plugin next.
    notes: HashMap<PathBuf, Vec<String>>,
    watched: bool,
}

/// Idle workers by plugin.
pub struct Pool {
    start: Start,
    idle: Mutex<Idle>,
}

impl Pool {
    /// A pool without workers.
    #[must_use]
    pub fn new(start: Start) -> Pool {
        Pool {
            start,
            idle: Mutex::default(),
        }
    }

    /// Describes a library in a worker that is thrown away.
    ///
    /// # Errors
    /// When it cannot be opened, or the worker dies of it or stays silent.
    pub fn describe(&self, path: &Path, door: bool) -> Result<Manifest, Failure> {
        let name = path
            .file_name()
            .map(|name| name.to_string_lossy().into_owned());
        let start = Start {
            threads: 1,
            ..self.start.clone()
        };
        Worker::start(&start, &name.unwrap_or_default())?.open(path, door, &Unwatched)
    }

    fn idle(&self) -> MutexGuard<'_, Idle> {
        self.idle.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Prepares a call in a worker of the plugin at `path`.
    ///
    /// # Errors
    /// What the plugin refuses, how its worker died, or that the person cancelled.
    pub fn prepare(
        self: &Arc<Self>,
        path: &Path,
        door: bool,
        name: &str,
        request: &Request,
        progress: &dyn Progress,
    ) -> Result<Prepared, Failure> {
        let notes = self.idle().notes.remove(path);
        for note in notes.into_iter().flatten() {
            progress.message(2, &format!("{name} {note}"));
        }
        if let Some(mut worker) = self.take(path, name, progress) {
            match plan(&mut worker, request, progress) {
                // It was ended from outside while it rested: another is not the plugin's fault.
                Err(_) if !worker.alive() && !progress.cancelled() => {}
                other => return self.prepared(other, worker, path, request),
            }
        }
        let mut worker = Worker::start(&self.start, name)?;
        worker.open(path, door, progress)?;
        let planned = plan(&mut worker, request, progress);
        self.prepared(planned, worker, path, request)
    }

    fn prepared(
        self: &Arc<Self>,
        planned: Result<Plan, Failure>,
        worker: Worker,
        path: &Path,
        request: &Request,
    ) -> Result<Prepared, Failure> {
        match planned {
            Ok(plan) => {
                let pool = Arc::clone(self);
                let operation = request.operation.clone();
                Ok(Prepared::new(worker, pool, path, operation, plan))
            }
            Err(failure) => {
                self.rest(path, worker);
                Err(failure)
            }
        }
    }

    /// A worker that waits for a call of this plugin.
    fn take(&self, path: &Path, name: &str, progress: &dyn Progress) -> Option<Worker> {
        loop {
            let mut found = self.idle().by_library.get_mut(path)?.pop()?;
            match found.settle(GRACE) {
                Settled::Fit => return Some(found.worker),
                Settled::Unfit(Some(why)) => progress.message(2, &format!("{name} {why}")),
                Settled::Busy | Settled::Unfit(None) => {}
            }
        }
    }

    /// Puts the worker's call away and keeps it for the next one, if it still runs.
    pub(super) fn rest(self: &Arc<Self>, path: &Path, mut worker: Worker) {
        if !worker.alive() || worker.say(&ToWorker::Drop, &[]).is_err() {
            return;
        }
        let resting = Resting {
            worker,
            since: Instant::now(),
            busy: true,
        };
        let mut idle = self.idle();
        idle.by_library
            .entry(path.into())
            .or_default()
            .push(resting);
        if !std::mem::replace(&mut idle.watched, true) {
            let pool = Arc::downgrade(self);
            std::thread::spawn(move || watch(&pool));
        }
    }

    /// Ends workers that rested too long or do not come to rest, and takes back memory that they hold.
    /// Whether there are any left.
    fn look_after(&self) -> bool {
        // Looked at outside the lock: a worker may be slow to answer, and callers should not wait.
        let resting = std::mem::take(&mut self.idle().by_library);
        let mut unfit = Vec::new();
        for (path, mut workers) in resting {
            let gone = workers.extract_if(.., |one| match one.settle(Duration::ZERO) {
                Settled::Fit => {
                    one.worker.forget_dropped();
                    one.since.elapsed() > IDLE
                }
                Settled::Busy => false,
                Settled::Unfit(why) => {
                    let notes = &mut self.idle().notes;
                    notes.entry(path.clone()).or_default().extend(why);
                    true
                }
            });
            unfit.extend(gone);
            if !workers.is_empty() {
                let idle = &mut self.idle().by_library;
                idle.entry(path).or_default().extend(workers);
            }
        }
        let mut idle = self.idle();
        idle.watched = !idle.by_library.is_empty();
        idle.watched
    }
}

fn plan(worker: &mut Worker, request: &Request, progress: &dyn Progress) -> Result<Plan, Failure> {
    let order = ToWorker::Prepare {
        request: request.clone(),
    };
    worker.say(&order, &[])?;
    let what = format!("preparing {}", request.operation);
    match worker.wait_soon(progress, &what)? {
        (FromWorker::Prepared { plan }, _) => Ok(plan),
        _ => Err(worker.confused()),
    }
}

/// Looks after idle workers as long as there are any.
fn watch(pool: &Weak<Pool>) {
    loop {
        std::thread::sleep(ROUND);
        match pool.upgrade() {
            Some(pool) if pool.look_after() => {}
            _ => return,
        }
    }
}

enum Settled {
    Fit,
    Busy,
    /// With what is worth telling.
    Unfit(Option<String>),
}

impl Resting {
    /// Whether the worker may be called again.
    fn settle(&mut self, within: Duration) -> Settled {
        if !self.busy {
            return if self.worker.alive() {
                Settled::Fit
            } else {
                Settled::Unfit(None)
            };
        }
        if !self.worker.readable(within) {
            let late = self.since.elapsed() > GRACE;
            let why = "did not come to an end when its call was put away, and was ended";
            return if late {
                Settled::Unfit(Some(why.into()))
            } else {
                Settled::Busy
            };
        }
        match self.worker.wait_soon(&Unwatched, "putting a call away") {
            Ok((FromWorker::Rested { worn: None }, _)) => {
                self.busy = false;
                Settled::Fit
            }
            Ok((FromWorker::Rested { worn: Some(why) }, _)) => {
                Settled::Unfit(Some(format!("{why}; its worker was replaced")))
            }
            Ok(_) => Settled::Unfit(Some("spoke out of turn; its worker was replaced".into())),
            Err(failure) => Settled::Unfit(Some(format!(
                "failed after its call ended: {}",
                failure.message
            ))),
        }
    }
}
