//! The beginning of a run: what is there, what has to be computed, which older runs end.

use super::board::Board;
use super::check::Source;
use super::flight::lock;
use super::memo::Held;
use super::report::{StepReport, StepState};
use super::run::{Blocked, Run};
use super::session::{Runner, Shared, Ticket};
use std::time::Duration;

impl<R: Runner> Run<'_, R> {
    /// Ends older runs, and finds out which steps have to be computed.
    pub(crate) fn begin(&self, ticket: Ticket) {
        let mut shared = lock(&self.session.shared);
        let mut board = lock(&self.board);
        let mut wanted = vec![false; self.plan.steps.len()];
        for (_, source) in &self.wanted {
            if let Source::Step { step, .. } = source
                && let (Some(flag), Some(uses)) = (wanted.get_mut(*step), board.uses.get_mut(*step))
            {
                *flag = true;
                *uses += 1;
            }
        }
        let (needed, demanded) = self.demand(&shared, wanted);
        self.take_over(&mut shared, &demanded, ticket);
        let mut ended = Vec::new();
        for at in (0..self.plan.steps.len()).filter(|at| needed.get(*at) == Some(&true)) {
            if let Some(Some(key)) = self.keys.get(at) {
                shared.memo.touch(key);
            }
            let demanded = demanded.get(at) == Some(&true);
            ended.extend(self.place(&shared, &mut board, at, demanded));
        }
        drop((board, shared));
        for report in &ended {
            self.watch.finished(report);
        }
    }

    /// Which steps are before something wanted, and which of these results are needed now.
    fn demand(&self, shared: &Shared<R::Object>, wanted: Vec<bool>) -> (Vec<bool>, Vec<bool>) {
        let mut demanded = wanted.clone();
        let mut needed = wanted;
        for at in (0..self.plan.steps.len()).rev() {
            if needed.get(at) != Some(&true) {
                continue;
            }
            let held = self
                .keys
                .get(at)
                .copied()
                .flatten()
                .and_then(|key| shared.memo.held(&key));
            let compute = demanded.get(at) == Some(&true)
                && !matches!(held, Some(Held::Outputs(..) | Held::Failure(_)));
            for need in self.needs(at) {
                if let (Some(needed), Some(demanded)) =
                    (needed.get_mut(need), demanded.get_mut(need))
                {
                    *needed = true;
                    *demanded |= compute;
                }
            }
        }
        (needed, demanded)
    }

    /// Stops older runs, except for calls under way whose results are needed here too.
    fn take_over(&self, shared: &mut Shared<R::Object>, demanded: &[bool], ticket: Ticket) {
        if ticket < shared.oldest {
            self.flag.stop();
            return;
        }
        shared.oldest = ticket;
        let demanded = self
            .keys
            .iter()
            .zip(demanded)
            .filter(|(_, demanded)| **demanded);
        for key in demanded.filter_map(|(key, _)| key.as_ref()) {
            if let Some(flight) = shared.flights.get(key) {
                flight.join(&self.flag);
            }
        }
        for (_, flag) in shared.runs.iter().filter(|(older, _)| *older < ticket) {
            flag.stop();
        }
        shared.runs.push((ticket, self.flag.clone()));
    }

    /// Puts a step on the board: what is known of it, or what it waits for.
    fn place(
        &self,
        shared: &Shared<R::Object>,
        board: &mut Board<R::Object>,
        at: usize,
        demanded: bool,
    ) -> Option<StepReport> {
        let step = self.plan.steps.get(at)?;
        let key = self.keys.get(at).copied().flatten();
        let record = key.and_then(|key| shared.memo.record(&key));
        let held = key.and_then(|key| shared.memo.held(&key));
        let needs = self.needs(at);
        let lost = needs.iter().find_map(|need| board.lost(*need));
        let state = match (self.blocked.get(at), held, lost) {
            (Some(Some(Blocked::Itself(failure))), _, _) => StepState::Failed(failure.clone()),
            (Some(Some(Blocked::Because(because))), _, _) => StepState::Skipped {
                because: because.clone(),
            },
            (_, Some(Held::Outputs(outputs, _)), _) => {
                if demanded && let Some(value) = board.values.get_mut(at) {
                    *value = Some(outputs.clone());
                }
                StepState::Cached
            }
            (_, Some(Held::Failure(failure)), _) => StepState::Failed(failure.clone()),
            _ if !demanded => StepState::Cached,
            (_, _, Some(state)) => state,
            _ => {
                board.wait(at, &needs);
                return None;
            }
        };
        let report = StepReport {
            name: step.name.clone(),
            state,
            duration: Duration::ZERO,
            key,
            record,
        };
        *board.reports.get_mut(at)? = Some(report.clone());
        Some(report)
    }
}
