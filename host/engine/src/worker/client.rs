//! Calls in a worker, as the host sees them.

use super::pool::Pool;
use super::process::Worker;
use super::protocol::{FromWorker, Sent, ToWorker, accept, announce};
use crate::job::Progress;
use crate::plugins::Finished;
use crate::store::{Object, Segment};
use puncta_documents::{Failure, Plan};
use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// A prepared call in a worker.
pub struct Prepared {
    worker: Option<Worker>,
    pool: Arc<Pool>,
    path: PathBuf,
    operation: String,
    plan: Arc<Plan>,
}

impl Prepared {
    pub(super) fn new(
        worker: Worker,
        pool: Arc<Pool>,
        path: &Path,
        operation: String,
        plan: Plan,
    ) -> Prepared {
        Prepared {
            worker: Some(worker),
            pool,
            path: path.into(),
            operation,
            plan: Arc::new(plan),
        }
    }

    /// What the call will do.
    #[must_use]
    pub fn plan(&self) -> &Arc<Plan> {
        &self.plan
    }

    /// Runs it with these inputs.
    ///
    /// # Errors
    /// What the plugin fails with, or how its worker died.
    pub fn run(
        &mut self,
        inputs: &[Object],
        progress: &dyn Progress,
    ) -> Result<Vec<Finished>, Failure> {
        let what = format!("running {}", self.operation);
        let mut sent = Sent::default();
        let wired = inputs
            .iter()
            .enumerate()
            .map(|(i, object)| sent.input(object, i, &self.plan))
            .collect::<Result<Vec<_>, _>>()?;
        let worker = self
            .worker
            .as_mut()
            .ok_or_else(|| Failure::internal("the call's worker is gone; prepare it again"))?;
        let fresh: Vec<Arc<Segment>> = sent
            .segments()
            .iter()
            .filter(|segment| !worker.known.contains_key(&segment.id()))
            .cloned()
            .collect();
        let forget = worker.dropped();
        worker
            .known
            .extend(fresh.iter().map(|one| (one.id(), Arc::downgrade(one))));
        let (new, descriptors) = announce(&fresh)?;
        worker.say(
            &ToWorker::Run {
                inputs: wired,
                new,
                forget,
            },
            &descriptors,
        )?;
        let (finished, new, received) = match worker.wait_for(progress, &what) {
            Ok((FromWorker::Done { finished, new }, received)) => (finished, new, received),
            Ok(_) => return Err(worker.confused()),
            Err(failure) => {
                if !worker.alive() {
                    self.worker = None;
                }
                return Err(failure);
            }
        };
        let mut segments = HashMap::new();
        accept(&new, received, &mut segments)?;
        finished
            .into_iter()
            .map(|one| one.unwire(&segments))
            .collect()
    }
}

impl Drop for Prepared {
    fn drop(&mut self) {
        if let Some(worker) = self.worker.take() {
            self.pool.rest(&self.path, worker);
        }
    }
}
