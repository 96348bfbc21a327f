//! The files of a recipe: readers of its inputs, writers of its outputs.

use super::check::{CheckedInput, CheckedOutput, Checker};
use super::{Input, OutputFile, Subject};
use puncta_documents::{Failure, FailureCode, Kind, Map, Operation, OperationKind};
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

impl Checker<'_> {
    pub(crate) fn input(&mut self, input: &Input) -> CheckedInput {
        let subject = Subject::Input(input.name.clone());
        let mut checked = CheckedInput {
            name: input.name.as_str().into(),
            kind: input.kind,
            many: input.many,
            reader: None,
            options: input.options.clone(),
            object: input.object.clone(),
            failure: None,
        };
        let Some(id) = &input.reader else {
            return checked;
        };
        let what = format!("input {}", input.name);
        match self.named(&what, id, OperationKind::Reader) {
            Ok(reader) => {
                let places = (&BTreeMap::new(), input.place);
                checked.options =
                    self.parameters(&what, &reader.parameters, &input.options, places, &subject);
                checked.reader = Some(reader);
            }
            Err(failure) => self.report(input.place, &subject, failure),
        }
        checked
    }

    pub(crate) fn output(&mut self, output: &OutputFile) -> CheckedOutput {
        let subject = Subject::Output(output.file.clone());
        let what = format!("output file {:?}", output.file);
        let target = self.target(&what, &output.from, &subject);
        let kind = target.as_ref().and_then(|target| target.kind);
        let writer = match &output.writer {
            Some(id) => self.named(&what, id, OperationKind::Writer),
            None => self.writer(&what, &output.file, kind),
        };
        let mut parameters = Map::new();
        match &writer {
            Ok(writer) => {
                let places = (&BTreeMap::new(), output.place);
                parameters =
                    self.parameters(&what, &writer.parameters, &output.set, places, &subject);
                let several = target.as_ref().is_some_and(|target| target.many);
                if several && !writer.inputs.first().is_some_and(|port| port.many) {
                    let message = format!(
                        "{what}: {} writes one object, and {} may be several",
                        writer.id, output.from
                    );
                    let remedy = "write something that is one object";
                    self.report(
                        output.place,
                        &subject,
                        Failure::bad_input(message).remedy(remedy),
                    );
                }
            }
            Err(failure) => self.report(output.place, &subject, failure.clone()),
        }
        CheckedOutput {
            file: output.file.clone(),
            from: output.from.to_string(),
            source: target.map(|target| target.source),
            writer: writer.ok(),
            parameters,
            failure: None,
        }
    }

    fn named(
        &mut self,
        what: &str,
        id: &str,
        kind: OperationKind,
    ) -> Result<Arc<Operation>, Failure> {
        match self.offer(id) {
            Some((found, _)) if found.kind == kind => Ok(found),
            Some((found, _)) => {
                let name = |kind| match kind {
                    OperationKind::Operation => "an operation",
                    OperationKind::Reader => "a reader",
                    OperationKind::Writer => "a writer",
                };
                let message = format!(
                    "{what}: {id} is {} and not {}",
                    name(found.kind),
                    name(kind)
                );
                Err(Failure::bad_input(message).remedy("`puncta ops` lists what there is"))
            }
            None => Err(self.refuse_id(what, id, kind)),
        }
    }

    /// The writer for a file name: one for this kind of object first, then the longest suffix.
    fn writer(
        &mut self,
        what: &str,
        file: &str,
        kind: Option<Kind>,
    ) -> Result<Arc<Operation>, Failure> {
        let file = file.to_lowercase();
        let mut suffixes: BTreeSet<&str> = BTreeSet::new();
        let mut best: Option<((bool, usize), &str)> = None;
        let installed = self.catalogue.operations();
        for writer in installed
            .iter()
            .filter(|one| one.kind == OperationKind::Writer)
        {
            let rule = writer
                .file
                .iter()
                .flat_map(|rule| &rule.suffixes)
                .map(String::as_str);
            suffixes.extend(rule.clone());
            let Some(length) = rule
                .filter(|suffix| file.ends_with(suffix))
                .map(str::len)
                .max()
            else {
                continue;
            };
            let fits = writer.inputs.iter().any(|port| Some(port.kind) == kind);
            let rank = (fits, length);
            let better = |(other, id)| rank > other || (rank == other && writer.id.as_str() < id);
            if best.is_none_or(better) {
                best = Some((rank, &writer.id));
            }
        }
        let found = best.and_then(|(_, id)| self.offer(id));
        found.map(|(writer, _)| writer).ok_or_else(|| {
            let held = self.catalogue.withheld_file(&file, OperationKind::Writer);
            if let Some(failure) = held {
                return failure.context(what);
            }
            let message = format!("{what}: no installed plugin writes files of this name");
            let remedy = if suffixes.is_empty() {
                "install a plugin that writes files".to_owned()
            } else {
                let list: Vec<&str> = suffixes.into_iter().take(24).collect();
                format!("let it end with one of {}", list.join(" "))
            };
            Failure::new(FailureCode::Unsupported, message).remedy(remedy)
        })
    }
}
