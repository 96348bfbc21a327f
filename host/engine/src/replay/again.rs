//! Computing a saved object again.

use super::Replay;
use crate::batch::collect::COLLECTED;
use crate::engine::Engine;
use crate::headless::single;
use crate::job::Progress;
use crate::recipe::{Inputs, Key, StepState, Wanted, Watch};
use crate::store::Object;
use puncta_documents::{Failure, Kind};
use std::collections::BTreeMap;
use std::sync::Arc;

impl Replay {
    /// Reads the inputs and runs the steps again.
    ///
    /// # Errors
    /// When an input cannot be read, a step fails, or the person stopped it.
    pub fn run(
        &self,
        engine: &Arc<Engine>,
        progress: &Arc<dyn Progress>,
        watch: &dyn Watch,
    ) -> Result<Object, Failure> {
        if self.provenance.object == COLLECTED {
            let message = "a batch collected this table from its files";
            return Err(Failure::bad_input(message)
                .remedy("replay those files, or run the batch again with --resume"));
        }
        let mut objects: Inputs<Object> = BTreeMap::new();
        let mut kinds: BTreeMap<String, Kind> = BTreeMap::new();
        for (name, paths) in &self.inputs {
            let records = self.provenance.inputs.get(name).into_iter().flatten();
            for (path, record) in paths.iter().zip(records) {
                let (reader, options) = (&record.reader.operation, &record.reader.parameters);
                let read = engine.read(path, Some(reader), options, progress)?;
                let object = read.object(Some(&record.object))?.clone();
                kinds.insert(name.clone(), object.header().kind);
                // Nothing is kept, so that no key needs to be told from another.
                let key = Key::from_bytes([0; 32]);
                objects.entry(name.clone()).or_default().push((key, object));
            }
        }
        let wanted = &self.provenance.object;
        let missing = || Failure::bad_file(format!("the provenance names no {wanted}"));
        if self.provenance.steps.is_empty() {
            let object = objects.get(wanted).and_then(|all| all.first());
            return object.map(|(_, object)| object.clone()).ok_or_else(missing);
        }
        let plan = engine.check_recipe(&self.recipe(&kinds));
        if let Some(problem) = plan.problems.first() {
            return Err(problem.failure.clone());
        }
        let session = single(engine);
        let references = Wanted::References(vec![wanted.clone()]);
        let report = session.run(&plan, &objects, &references, session.ticket(), watch);
        if report.cancelled {
            return Err(Failure::cancelled());
        }
        for step in &report.steps {
            if let StepState::Failed(failure) = &step.state {
                return Err(failure.clone().context(format!("step {}", step.name)));
            }
        }
        let found = report.results.get(wanted).ok_or_else(missing)?;
        let object = found.objects.get(self.provenance.number);
        object.cloned().ok_or_else(missing)
    }
}
