//! What is bound to the ports of a step.

use super::check::{Bound, Checker, Source};
use super::{Binding, Reference, Step, Subject, a_kind};
use puncta_documents::{Failure, Kind, Operation, Port};

/// What a reference leads to, and what is known of it.
pub(crate) struct Target {
    pub source: Source,
    pub kind: Option<Kind>,
    pub many: bool,
}

impl Checker<'_> {
    pub(crate) fn ports(
        &mut self,
        step: &Step,
        operation: &Operation,
        subject: &Subject,
    ) -> Vec<Bound> {
        let what = format!("step {}", step.name);
        let mut bound = Vec::with_capacity(step.inputs.len());
        for binding in &step.inputs {
            let mut ports = operation.inputs.iter().enumerate();
            match ports.find(|(_, port)| port.name == binding.port) {
                Some((at, port)) => {
                    let sources = self.sources(&what, port, binding, subject);
                    bound.push(Bound { port: at, sources });
                }
                None => {
                    let names: Vec<&str> =
                        operation.inputs.iter().map(|port| &*port.name).collect();
                    let all = match names.as_slice() {
                        [] => "it has no inputs".to_owned(),
                        names => format!("there are {}", names.join(", ")),
                    };
                    let remedy = self.hint(&binding.port, names.iter().copied(), &all);
                    let message = format!("{what}: {} has no input {}", step.op, binding.port);
                    let failure = Failure::bad_input(message).remedy(remedy);
                    self.report(binding.place, subject, failure);
                }
            }
        }
        bound.retain(|one| !one.sources.is_empty());
        bound.sort_by_key(|one| one.port);
        for port in operation.inputs.iter().filter(|port| !port.optional) {
            if !step
                .inputs
                .iter()
                .any(|one| one.port == port.name && !one.from.is_empty())
            {
                let message = format!("{what}: nothing is bound to its input {}", port.name);
                let remedy = format!("add in.{} = \"NAME\" of {}", port.name, a_kind(port.kind));
                let failure = Failure::bad_input(message).remedy(remedy);
                self.report(step.place, subject, failure);
            }
        }
        bound
    }

    fn sources(
        &mut self,
        what: &str,
        port: &Port,
        binding: &Binding,
        subject: &Subject,
    ) -> Vec<Source> {
        if !port.many && binding.from.len() > 1 {
            let message = format!(
                "{what}: its input {} takes one object, not {}",
                port.name,
                binding.from.len()
            );
            let failure = Failure::bad_input(message).remedy("bind one name without brackets");
            self.report(binding.place, subject, failure);
        }
        let mut sources = Vec::with_capacity(binding.from.len());
        for reference in &binding.from {
            let Some(target) = self.target(what, reference, subject) else {
                continue;
            };
            if let Some(kind) = target.kind.filter(|kind| *kind != port.kind) {
                let message = format!(
                    "{what}: its input {} takes {}, and {reference} is {}",
                    port.name,
                    a_kind(port.kind),
                    a_kind(kind)
                );
                let failure =
                    Failure::bad_input(message).remedy(format!("bind {}", a_kind(port.kind)));
                self.report(reference.place, subject, failure);
            }
            if target.many && !port.many {
                let message = format!(
                    "{what}: its input {} takes one object, and {reference} may be several",
                    port.name
                );
                let remedy = "bind something that is one, or run the recipe for each file";
                self.report(
                    reference.place,
                    subject,
                    Failure::bad_input(message).remedy(remedy),
                );
            }
            sources.push(target.source);
        }
        sources
    }

    /// Of an operation that is not installed only the references can be checked.
    pub(crate) fn unknown_ports(&mut self, step: &Step, subject: &Subject) -> Vec<Bound> {
        let what = format!("step {}", step.name);
        let references = step.inputs.iter().flat_map(|binding| &binding.from);
        let targets = references.filter_map(|one| self.target(&what, one, subject));
        let sources: Vec<Source> = targets.map(|target| target.source).collect();
        vec![Bound { port: 0, sources }]
    }

    /// What a reference leads to.
    pub(crate) fn target(
        &mut self,
        what: &str,
        reference: &Reference,
        subject: &Subject,
    ) -> Option<Target> {
        match self.resolve(what, reference) {
            Ok(target) => Some(target),
            Err(failure) => {
                self.report(reference.place, subject, failure);
                None
            }
        }
    }

    fn resolve(&mut self, what: &str, reference: &Reference) -> Result<Target, Failure> {
        let recipe = self.recipe;
        let input = self.inputs.get(reference.source.as_str()).copied();
        if let Some((at, input)) = input.and_then(|at| Some((at, recipe.inputs.get(at)?))) {
            if let Some(output) = &reference.output {
                let message = format!(
                    "{what}: {} is an input and has no output {output}",
                    input.name
                );
                let remedy = format!("say object = \"{output}\" in [inputs.{}]", input.name);
                return Err(Failure::bad_input(message).remedy(remedy));
            }
            let source = Source::Input(at);
            return Ok(Target {
                source,
                kind: Some(input.kind),
                many: input.many,
            });
        }
        let step = self.steps.get(reference.source.as_str()).copied();
        if let Some((at, step)) = step.and_then(|at| Some((at, recipe.steps.get(at)?))) {
            let at = self.places.get(&at).copied().unwrap_or(usize::MAX);
            return match self.offer(&step.op) {
                Some((operation, _)) => self.output_of(what, reference, at, &operation),
                None => {
                    let source = Source::Step {
                        step: at,
                        output: 0,
                    };
                    Ok(Target {
                        source,
                        kind: None,
                        many: false,
                    })
                }
            };
        }
        let names: Vec<&str> = self
            .inputs
            .keys()
            .chain(self.steps.keys())
            .copied()
            .collect();
        let name = &reference.source;
        let remedy = self.hint(name, names, "name an input, a step, or \"step.output\"");
        let message = format!("{what}: there is no input or step {name}");
        Err(Failure::bad_input(message).remedy(remedy))
    }

    fn output_of(
        &mut self,
        what: &str,
        reference: &Reference,
        step: usize,
        operation: &Operation,
    ) -> Result<Target, Failure> {
        let wanted = |port: &Port| {
            reference
                .output
                .as_ref()
                .is_none_or(|name| *name == port.name)
        };
        let mut ports = operation.outputs.iter().enumerate();
        if let Some((output, port)) = ports.find(|(_, port)| wanted(port)) {
            let source = Source::Step { step, output };
            return Ok(Target {
                source,
                kind: Some(port.kind),
                many: port.many,
            });
        }
        let names: Vec<&str> = operation
            .outputs
            .iter()
            .map(|port| port.name.as_str())
            .collect();
        let all = match names.as_slice() {
            [] => "it has no outputs".to_owned(),
            names => format!("there are {}", names.join(", ")),
        };
        let message = match &reference.output {
            None => format!("{what}: the step {} gives no result", reference.source),
            Some(name) => format!("{what}: the step {} has no output {name}", reference.source),
        };
        let name = reference.output.as_deref().unwrap_or("");
        let remedy = self.hint(name, names.iter().copied(), &all);
        Err(Failure::bad_input(message).remedy(remedy))
    }
}
