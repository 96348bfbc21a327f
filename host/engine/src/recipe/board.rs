//! Where a run stands: what is ready, what waits, what has ended.

use super::flight::{Outcome, Outputs};
use super::report::{Record, StepReport, StepState};
use super::step::Performed;
use std::collections::BTreeSet;
use std::sync::Arc;
use std::time::Duration;

/// How a step ended.
pub(crate) struct End {
    pub state: StepState,
    pub duration: Duration,
    pub record: Option<Arc<Record>>,
}

impl Default for End {
    fn default() -> End {
        End {
            state: StepState::Cancelled,
            duration: Duration::ZERO,
            record: None,
        }
    }
}

/// Where a run stands. Each list has a place for each step of the plan.
pub(crate) struct Board<O> {
    /// Steps that can run now, in the order of the plan.
    pub ready: BTreeSet<usize>,
    /// Steps to compute that a step still waits for.
    pub open: Vec<usize>,
    /// Steps to compute that wait for a step.
    pub users: Vec<Vec<usize>>,
    /// How many steps and wanted results still need a step's outputs.
    pub uses: Vec<usize>,
    pub values: Vec<Option<Arc<Outputs<O>>>>,
    pub reports: Vec<Option<StepReport>>,
    /// Steps to compute that have not ended.
    pub left: usize,
    pub threads: usize,
}

impl<O> Board<O> {
    pub fn new(count: usize) -> Board<O> {
        Board {
            ready: BTreeSet::new(),
            open: vec![0; count],
            users: vec![Vec::new(); count],
            uses: vec![0; count],
            values: vec![None; count],
            reports: vec![None; count],
            left: 0,
            threads: 1,
        }
    }

    /// Takes the outputs of a step that was performed, and says how it ended.
    pub fn arrive(&mut self, at: usize, done: Performed<O>, duration: Duration) -> End {
        let duration = if done.here { duration } else { Duration::ZERO };
        match done.outcome {
            Outcome::Done(outputs, record) => {
                if let Some(place) = self.values.get_mut(at) {
                    *place = Some(outputs);
                }
                let state = if done.here {
                    StepState::Computed
                } else {
                    StepState::Cached
                };
                End {
                    state,
                    duration,
                    record: Some(record),
                }
            }
            Outcome::Failed(failure) => End {
                state: StepState::Failed(failure),
                duration,
                record: None,
            },
            Outcome::Cancelled => End {
                duration,
                ..End::default()
            },
        }
    }

    /// What the end of a step means for those that need it, if it has no result.
    pub fn lost(&self, at: usize) -> Option<StepState> {
        let report = self.reports.get(at)?.as_ref()?;
        match &report.state {
            StepState::Computed | StepState::Cached => None,
            StepState::Failed(_) => Some(StepState::Skipped {
                because: report.name.clone(),
            }),
            other => Some(other.clone()),
        }
    }

    /// Makes a step wait for those of its needs that are to be computed.
    pub fn wait(&mut self, at: usize, needs: &BTreeSet<usize>) {
        self.left += 1;
        let mut open = 0;
        for need in needs {
            if let Some(uses) = self.uses.get_mut(*need) {
                *uses += 1;
            }
            if self.reports.get(*need).is_some_and(Option::is_none)
                && let Some(users) = self.users.get_mut(*need)
            {
                users.push(at);
                open += 1;
            }
        }
        if open == 0 {
            self.ready.insert(at);
        }
        if let Some(place) = self.open.get_mut(at) {
            *place = open;
        }
    }

    /// One of a step's needs is there.
    pub fn close(&mut self, at: usize) {
        if let Some(open) = self.open.get_mut(at) {
            *open = open.saturating_sub(1);
            if *open == 0 && self.reports.get(at).is_some_and(Option::is_none) {
                self.ready.insert(at);
            }
        }
    }

    /// One use less; the last one gives the outputs away.
    pub fn release(&mut self, at: usize) -> Option<Arc<Outputs<O>>> {
        let uses = self.uses.get_mut(at)?;
        *uses = uses.saturating_sub(1);
        if *uses == 0 {
            self.values.get_mut(at)?.take()
        } else {
            None
        }
    }
}
