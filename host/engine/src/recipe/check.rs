//! A recipe against what the installed plugins offer: a plan in order, and everything that is wrong.

use super::closest::{closest, several};
use super::order::order;
use super::units::{has_limits, normalise_limits};
use super::{Catalogue, Key, Place, PluginRef, Problem, Recipe, Step, Subject, key};
use puncta_documents::schema;
use puncta_documents::{
    Failure, FailureCode, Kind, Map, Operation, OperationKind, Parameter, Port,
};
use std::collections::{BTreeMap, HashMap};
use std::sync::Arc;

/// Look-ups of close names for one recipe; they take long when everything is wrong.
const MOST_HINTS: u32 = 20;

/// A recipe that was checked. Steps without problems can run even when others cannot.
#[derive(Clone, Debug, Default)]
pub struct Checked {
    /// Files, in the order of the text.
    pub inputs: Vec<CheckedInput>,
    /// Steps, each after those that it needs, ties by name.
    pub steps: Vec<CheckedStep>,
    /// Files to write, in the order of the text.
    pub outputs: Vec<CheckedOutput>,
    /// Everything that is wrong, in the order of the text.
    pub problems: Vec<Problem>,
}

/// An input with its reader, as far as the recipe names one.
#[derive(Clone, Debug)]
pub struct CheckedInput {
    /// Name.
    pub name: Arc<str>,
    /// Kind of object.
    pub kind: Kind,
    /// Whether it binds several files.
    pub many: bool,
    /// The reader that the recipe names.
    pub reader: Option<Arc<Operation>>,
    /// Options: canonical if the recipe names the reader, as written otherwise.
    pub options: Map,
    /// Name of the object, in a file that holds several.
    pub object: Option<String>,
    /// Why it cannot be read.
    pub failure: Option<Failure>,
}

/// A step, ready to run unless it has a failure.
#[derive(Clone, Debug)]
pub struct CheckedStep {
    /// Name.
    pub name: Arc<str>,
    /// Operation id.
    pub op: Arc<str>,
    /// The operation; absent when no plugin that has it is installed.
    pub operation: Option<Arc<Operation>>,
    /// The plugin that has it.
    pub plugin: Arc<PluginRef>,
    /// Canonical parameters: all of them, in the schema's units.
    pub parameters: Arc<Map>,
    /// Ports that are bound, in the operation's order.
    pub ports: Vec<Bound>,
    /// Why it cannot run: the first of its problems.
    pub failure: Option<Failure>,
    pub(crate) call: Key,
    /// Whether limits need a column's unit.
    pub(crate) limits: bool,
}

/// A port and the objects for it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Bound {
    /// Place in the operation's inputs.
    pub port: usize,
    /// Objects.
    pub sources: Vec<Source>,
}

/// Where an object comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Source {
    /// Place in [`Checked::inputs`].
    Input(usize),
    /// A result of a step.
    Step {
        /// Place in [`Checked::steps`].
        step: usize,
        /// Place in its operation's outputs.
        output: usize,
    },
}

/// A file to write.
#[derive(Clone, Debug)]
pub struct CheckedOutput {
    /// Path below the output folder; may hold `{input}`.
    pub file: String,
    /// What is written, as the recipe says it.
    pub from: String,
    /// What is written.
    pub source: Option<Source>,
    /// The writer that the recipe names, or that fits the suffix.
    pub writer: Option<Arc<Operation>>,
    /// Canonical parameters of the writer.
    pub parameters: Map,
    /// Why it cannot be written, as far as can be told before the run.
    pub failure: Option<Failure>,
}

impl Checked {
    /// The step with this name, with its place.
    #[must_use]
    pub fn step(&self, name: &str) -> Option<(usize, &CheckedStep)> {
        self.steps
            .iter()
            .enumerate()
            .find(|(_, step)| &*step.name == name)
    }

    /// How a recipe would name a source.
    #[must_use]
    pub fn name_of(&self, source: Source) -> Option<String> {
        match source {
            Source::Input(at) => self.inputs.get(at).map(|input| input.name.to_string()),
            Source::Step { step, output } => {
                let step = self.steps.get(step)?;
                let port = step.operation.as_ref()?.outputs.get(output)?;
                Some(format!("{}.{}", step.name, port.name))
            }
        }
    }

    /// What a reference such as `step.output` means in this recipe.
    #[must_use]
    pub fn source(&self, reference: &str) -> Option<Source> {
        if let Some(at) = self
            .inputs
            .iter()
            .position(|input| &*input.name == reference)
        {
            return Some(Source::Input(at));
        }
        let (name, output) = match reference.split_once('.') {
            Some((name, output)) => (name, Some(output)),
            None => (reference, None),
        };
        let (step, found) = self.step(name)?;
        let outputs = &found.operation.as_ref()?.outputs;
        let wanted = |port: &Port| output.is_none_or(|output| port.name == output);
        Some(Source::Step {
            step,
            output: outputs.iter().position(wanted)?,
        })
    }
}

/// Compares a recipe with what is installed. Never fails: problems are part of the result.
pub fn check(recipe: &Recipe, catalogue: &dyn Catalogue) -> Checked {
    let mut checker = Checker::new(recipe, catalogue);
    let names: Vec<&str> = recipe.steps.iter().map(|step| step.name.as_str()).collect();
    let needs: Vec<Vec<usize>> = recipe
        .steps
        .iter()
        .map(|step| checker.needs(step))
        .collect();
    let sorted = order(&names, &needs);
    for (at, step) in sorted.order.iter().enumerate() {
        checker.places.insert(*step, at);
    }
    for circle in &sorted.circles {
        checker.circle(circle);
    }
    let steps = sorted
        .order
        .iter()
        .filter_map(|step| recipe.steps.get(*step));
    let steps: Vec<CheckedStep> = steps.map(|step| checker.step(step)).collect();
    let mut checked = Checked {
        steps,
        ..Checked::default()
    };
    checked.inputs = recipe
        .inputs
        .iter()
        .map(|input| checker.input(input))
        .collect();
    checked.outputs = recipe
        .outputs
        .iter()
        .map(|output| checker.output(output))
        .collect();
    checked.problems = std::mem::take(&mut checker.problems);
    checked.problems.sort_by_key(|problem| problem.place);
    checker.first_failures(&mut checked);
    checked
}

type Offer = (Arc<Operation>, Arc<PluginRef>);

pub(crate) struct Checker<'a> {
    pub(crate) recipe: &'a Recipe,
    pub(crate) catalogue: &'a dyn Catalogue,
    pub(crate) problems: Vec<Problem>,
    pub(crate) inputs: HashMap<&'a str, usize>,
    pub(crate) steps: HashMap<&'a str, usize>,
    /// Places of the recipe's steps in the order.
    pub(crate) places: HashMap<usize, usize>,
    offers: HashMap<String, Option<Offer>>,
    hints: u32,
}

impl<'a> Checker<'a> {
    fn new(recipe: &'a Recipe, catalogue: &'a dyn Catalogue) -> Checker<'a> {
        let inputs = recipe.inputs.iter().enumerate();
        let steps = recipe.steps.iter().enumerate();
        Checker {
            recipe,
            catalogue,
            problems: Vec::new(),
            inputs: inputs
                .map(|(at, input)| (input.name.as_str(), at))
                .collect(),
            steps: steps.map(|(at, step)| (step.name.as_str(), at)).collect(),
            places: HashMap::new(),
            offers: HashMap::new(),
            hints: MOST_HINTS,
        }
    }

    fn needs(&self, step: &Step) -> Vec<usize> {
        let references = step.inputs.iter().flat_map(|binding| &binding.from);
        references
            .filter_map(|one| self.steps.get(one.source.as_str()).copied())
            .collect()
    }

    pub(crate) fn report(&mut self, place: Place, subject: &Subject, failure: Failure) {
        self.problems
            .push(Problem::new(place, subject.clone(), failure));
    }

    /// "did you mean NAME?", while there is time for it, and `else_` otherwise.
    pub(crate) fn hint<'n>(
        &mut self,
        name: &str,
        known: impl IntoIterator<Item = &'n str>,
        else_: &str,
    ) -> String {
        if self.hints > 0 {
            self.hints -= 1;
            if let Some(near) = closest(name, known) {
                return format!("did you mean {near}?");
            }
        }
        else_.to_owned()
    }

    fn circle(&mut self, circle: &[usize]) {
        const SHOWN: usize = 8;
        let recipe = self.recipe;
        let steps: Vec<&Step> = circle
            .iter()
            .filter_map(|step| recipe.steps.get(*step))
            .collect();
        let Some(first) = steps.first() else {
            return;
        };
        let mut names: Vec<&str> = steps
            .iter()
            .take(SHOWN)
            .map(|step| step.name.as_str())
            .collect();
        if steps.len() > SHOWN {
            names.push("...");
        }
        names.push(&first.name);
        for step in &steps {
            let message = format!(
                "step {} waits for its own result: {}",
                step.name,
                names.join(" needs ")
            );
            let failure = Failure::bad_input(message).remedy("bind one of these to something else");
            let place = step
                .inputs
                .first()
                .map_or(step.place, |binding| binding.place);
            self.report(place, &Subject::Step(step.name.clone()), failure);
        }
    }

    pub(crate) fn offer(&mut self, id: &str) -> Option<Offer> {
        if let Some(known) = self.offers.get(id) {
            return known.clone();
        }
        let found = self.catalogue.operation(id).zip(self.catalogue.plugin(id));
        let found =
            found.map(|(operation, plugin)| (Arc::new(operation.clone()), Arc::new(plugin)));
        self.offers.insert(id.to_owned(), found.clone());
        found
    }

    /// Why an id cannot be used as `kind`.
    pub(crate) fn refuse_id(&mut self, what: &str, id: &str, kind: OperationKind) -> Failure {
        if let Some(failure) = self.catalogue.withheld(id) {
            return failure.context(format!("{what} needs {id}"));
        }
        let installed = self.catalogue.operations();
        let fitting = || {
            installed
                .iter()
                .filter(|one| one.kind == kind)
                .map(|one| one.id.as_str())
        };
        let stem = id.split('/').next().unwrap_or(id);
        let revision = fitting().find(|one| one.split('/').next() == Some(stem));
        let remedy = if let Some(other) = revision {
            format!("installed is {other}, whose parameters may mean something else")
        } else {
            let near = if self.hints > 0 {
                several(id, fitting(), 3)
            } else {
                Vec::new()
            };
            self.hints = self.hints.saturating_sub(1);
            match near.as_slice() {
                [] => "install the plugin that has it; `puncta ops` lists what is there".into(),
                near => format!("did you mean {}?", near.join(" or ")),
            }
        };
        let message = format!("{what}: {id} is not installed");
        Failure::new(FailureCode::Unsupported, message).remedy(remedy)
    }

    fn step(&mut self, step: &Step) -> CheckedStep {
        let subject = Subject::Step(step.name.clone());
        let what = format!("step {}", step.name);
        let offer = self.offer(&step.op);
        let mut checked = CheckedStep {
            name: step.name.as_str().into(),
            op: step.op.as_str().into(),
            operation: None,
            plugin: Arc::default(),
            parameters: Arc::new(step.set.clone()),
            ports: Vec::new(),
            failure: None,
            call: Key::from_bytes([0; 32]),
            limits: false,
        };
        let Some((operation, plugin)) = offer else {
            let failure = self.refuse_id(&what, &step.op, OperationKind::Operation);
            self.report(step.op_place, &subject, failure);
            checked.ports = self.unknown_ports(step, &subject);
            return checked;
        };
        if operation.kind != OperationKind::Operation {
            let reader = operation.kind == OperationKind::Reader;
            let (kind, remedy) = if reader {
                ("reader", "name it in [inputs.NAME] as reader = \"ID\"")
            } else {
                (
                    "writer",
                    "name it in [outputs] as { from = \"STEP\", writer = \"ID\" }",
                )
            };
            let message = format!("{what}: {} is a {kind} and no operation", step.op);
            self.report(
                step.op_place,
                &subject,
                Failure::bad_input(message).remedy(remedy),
            );
        }
        let places = (&step.set_places, step.place);
        let parameters = self.parameters(&what, &operation.parameters, &step.set, places, &subject);
        checked.ports = self.ports(step, &operation, &subject);
        checked.call = key::call_key(&operation.id, &plugin.library, &parameters);
        checked.limits = has_limits(&operation.parameters, &parameters);
        checked.parameters = Arc::new(parameters);
        checked.operation = Some(operation);
        checked.plugin = plugin;
        checked
    }

    /// Canonical parameters; each wrong one is a problem of its own.
    pub(crate) fn parameters(
        &mut self,
        what: &str,
        schema: &[Parameter],
        set: &Map,
        (places, place): (&BTreeMap<String, Place>, Place),
        subject: &Subject,
    ) -> Map {
        let at = |name: &str| places.get(name).copied().unwrap_or(place);
        let names = || schema.iter().map(|parameter| parameter.name.as_str());
        for name in set
            .keys()
            .filter(|name| !names().any(|known| known == name.as_str()))
        {
            let all: Vec<&str> = names().collect();
            let all = match all.as_slice() {
                [] => "there are none".to_owned(),
                all => format!("there are {}", all.join(", ")),
            };
            let remedy = self.hint(name, names(), &all);
            let message = format!("{what}: there is no parameter {name}");
            let failure = Failure::bad_parameter(name, message).remedy(remedy);
            self.report(at(name), subject, failure);
        }
        let mut canonical = Map::new();
        for parameter in schema {
            let mut given = Map::new();
            if let Some(value) = set.get(&parameter.name) {
                given.insert(parameter.name.clone(), value.clone());
            }
            let one = std::slice::from_ref(parameter);
            let found = schema::canonical(one, &given)
                .and_then(|mut found| normalise_limits(one, &mut found).map(|()| found));
            match found {
                Ok(found) => canonical.extend(found),
                Err(failure) => self.report(at(&parameter.name), subject, failure.context(what)),
            }
        }
        canonical
    }

    /// Gives each part of the recipe the first of its problems.
    fn first_failures(&self, checked: &mut Checked) {
        let mut first: BTreeMap<&Subject, &Failure> = BTreeMap::new();
        for problem in &checked.problems {
            first.entry(&problem.subject).or_insert(&problem.failure);
        }
        let of = |subject: Subject| first.get(&subject).map(|failure| (*failure).clone());
        for step in &mut checked.steps {
            step.failure = of(Subject::Step(step.name.to_string()));
        }
        for input in &mut checked.inputs {
            input.failure = of(Subject::Input(input.name.to_string()));
        }
        for output in &mut checked.outputs {
            output.failure = of(Subject::Output(output.file.clone()));
        }
    }
}

#[cfg(test)]
#[path = "check_tests.rs"]
mod tests;
