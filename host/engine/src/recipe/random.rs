//! Random recipes against a plain evaluation without cache, order and threads.

use super::mock::{Mock, MockRunner, Thing, inputs, result};
use super::{Limits, Recipe, Session, StepState, Wanted, check, edit, parse};
use puncta_documents::schema;
use serde_json::json;
use std::collections::{BTreeMap, HashSet};

/// xorshift64*: Marsaglia 2003, Vigna 2016.
pub struct Random(u64);

impl Random {
    pub fn new(seed: u64) -> Random {
        Random(seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1)
    }

    pub fn next(&mut self) -> u64 {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        self.0.wrapping_mul(0x2545_f491_4f6c_dd1d)
    }

    pub fn below(&mut self, count: usize) -> usize {
        (self.next() >> 33) as usize % count.max(1)
    }

    pub fn pick<'a, T>(&mut self, list: &'a [T]) -> &'a T {
        &list[self.below(list.len())]
    }
}

/// What a step gives, by output; `None` when it or something before it fails.
type Value = Option<BTreeMap<String, Vec<u64>>>;

/// Evaluates a step from nothing, with what tells it apart from every other call.
fn evaluate(recipe: &Recipe, mock: &Mock, name: &str) -> (Value, String) {
    let step = recipe.step(name).unwrap();
    let operation = super::Catalogue::operation(mock, &step.op).unwrap();
    let parameters = schema::canonical(&operation.parameters, &step.set).unwrap();
    let parameters = serde_json::to_string(&parameters).unwrap();
    let mut inputs = Vec::new();
    let mut signature = format!("{} {parameters}", step.op);
    for port in &operation.inputs {
        let Some(binding) = step.inputs.iter().find(|one| one.port == port.name) else {
            continue;
        };
        for from in &binding.from {
            if from.source == "locs" {
                inputs.push((port.name.clone(), 1));
                signature += &format!("({}: locs)", port.name);
                continue;
            }
            let (value, below) = evaluate(recipe, mock, &from.source);
            let source = recipe.step(&from.source).unwrap();
            let outputs = &super::Catalogue::operation(mock, &source.op)
                .unwrap()
                .outputs;
            let output = from
                .output
                .clone()
                .unwrap_or_else(|| outputs[0].name.clone());
            signature += &format!("({}: {output} of {below})", port.name);
            let Some(value) = value else {
                return (None, signature);
            };
            inputs.extend(
                value[&output]
                    .iter()
                    .map(|value| (port.name.clone(), *value)),
            );
        }
    }
    if step.op == "mock.fail/1" {
        return (None, signature);
    }
    let outputs = operation.outputs.iter().map(|port| {
        let value = result(&step.op, &parameters, &inputs, &port.name);
        let count = if port.many { 3 } else { 1 };
        (
            port.name.clone(),
            (0..count).map(|extra| value.wrapping_add(extra)).collect(),
        )
    });
    (Some(outputs.collect()), signature)
}

/// Names of things that a step after `steps` earlier ones can bind: single ones, and several.
fn sources(random: &mut Random, recipe: &[(String, &str)], at: usize, several: bool) -> String {
    for _ in 0..20 {
        let pick = random.below(at + 1);
        let Some((name, op)) = recipe[..at].get(pick) else {
            break;
        };
        match *op {
            "mock.split/1" => {
                let side = ["", ".left", ".right"][random.below(3)];
                return format!("{name}{side}");
            }
            "mock.parts/1" if several => return name.clone(),
            "mock.parts/1" => {}
            _ => return name.clone(),
        }
    }
    "locs".into()
}

const OPS: [&str; 5] = [
    "mock.add/1",
    "mock.join/1",
    "mock.split/1",
    "mock.parts/1",
    "mock.fail/1",
];

/// Bindings of a step that make no circle.
fn bindings(
    random: &mut Random,
    steps: &[(String, &str)],
    at: usize,
) -> Vec<(&'static str, Vec<String>)> {
    match steps[at].1 {
        "mock.join/1" => {
            let count = 1 + random.below(3);
            vec![(
                "tables",
                (0..count)
                    .map(|_| sources(random, steps, at, true))
                    .collect(),
            )]
        }
        "mock.add/1" => {
            let mut list = vec![("table", vec![sources(random, steps, at, false)])];
            if random.below(2) == 0 {
                list.push(("other", vec![sources(random, steps, at, false)]));
            }
            list
        }
        _ => vec![("table", vec![sources(random, steps, at, false)])],
    }
}

fn recipe(random: &mut Random) -> (String, Vec<(String, &'static str)>) {
    let count = 1 + random.below(10);
    let mut names: Vec<String> = (0..count).map(|at| format!("s{at}")).collect();
    for at in (1..count).rev() {
        names.swap(at, random.below(at + 1));
    }
    let op = |random: &mut Random| OPS[[0, 0, 0, 0, 1, 1, 2, 2, 3, 4][random.below(10)]];
    let steps: Vec<(String, &str)> = names.into_iter().map(|name| (name, op(random))).collect();
    let mut text = "format = \"puncta.recipe/1\"\n[inputs.locs]\nkind = \"table\"\n".to_owned();
    let mut order: Vec<usize> = (0..count).collect();
    for at in (1..count).rev() {
        order.swap(at, random.below(at + 1));
    }
    for at in order {
        let bound = bindings(random, &steps, at);
        let bound: Vec<(&str, Vec<&str>)> = bound
            .iter()
            .map(|(port, from)| (*port, from.iter().map(String::as_str).collect()))
            .collect();
        let bound: Vec<(&str, &[&str])> = bound
            .iter()
            .map(|(port, from)| (*port, from.as_slice()))
            .collect();
        let mut set = puncta_documents::Map::new();
        if random.below(2) == 0 {
            set.insert("amount".into(), json!(random.below(3)));
        }
        text = edit::add_step(&text, &steps[at].0, steps[at].1, &bound, &set).unwrap();
    }
    (text, steps)
}

fn edited(random: &mut Random, text: &str, steps: &[(String, &str)]) -> String {
    let at = random.below(steps.len());
    let name = &steps[at].0;
    match random.below(4) {
        0 => edit::set_parameter(text, name, "amount", &json!(random.below(3))).unwrap(),
        1 => edit::remove_parameter(text, name, "amount").unwrap(),
        2 => format!("# {}\n{text}", random.next()),
        _ => bindings(random, steps, at)
            .into_iter()
            .fold(text.to_owned(), |text, (port, from)| {
                let from: Vec<&str> = from.iter().map(String::as_str).collect();
                edit::rebind(&text, name, port, &from).unwrap()
            }),
    }
}

/// Compares a run with the plain evaluation, and returns the calls that had to be made.
fn compare(text: &str, session: &Session<MockRunner>, seen: &mut HashSet<String>) -> usize {
    let mock = Mock::new();
    let recipe = parse(text).unwrap_or_else(|problems| panic!("{problems:?}\n{text}"));
    let plan = check(&recipe, &mock);
    assert!(plan.problems.is_empty(), "{:?}\n{text}", plan.problems);
    let report = session.run(&plan, &inputs(), &Wanted::Everything, session.ticket(), &());
    assert_eq!(report.steps.len(), recipe.steps.len());
    let mut new = 0;
    for step in &report.steps {
        let (value, signature) = evaluate(&recipe, &mock, &step.name);
        let skipped = matches!(step.state, StepState::Skipped { .. });
        new += usize::from(!skipped && seen.insert(signature));
        for port in &plan
            .step(&step.name)
            .unwrap()
            .1
            .operation
            .as_ref()
            .unwrap()
            .outputs
        {
            let found = report.results.get(&format!("{}.{}", step.name, port.name));
            let found: Option<Vec<u64>> = found.map(|found| {
                found
                    .objects
                    .iter()
                    .map(|thing: &Thing| thing.value)
                    .collect()
            });
            let wanted = value.as_ref().map(|value| value[&port.name].clone());
            assert_eq!(found, wanted, "{} of {text}", step.name);
        }
        assert_eq!(
            step.message().is_none(),
            value.is_some(),
            "{} of {text}",
            step.name
        );
    }
    new
}

#[test]
fn any_order_of_edits_gives_what_a_plain_evaluation_gives() {
    for seed in 0..80 {
        let mut random = Random::new(seed);
        let limits = Limits {
            parallel: 1 + random.below(3),
            memory: 1 << 30,
        };
        let session = Session::new(MockRunner::default(), limits);
        let small = Session::new(
            MockRunner::default(),
            Limits {
                memory: 500,
                ..limits
            },
        );
        let (mut text, steps) = recipe(&mut random);
        let (mut seen, mut ignored) = (HashSet::new(), HashSet::new());
        for _ in 0..8 {
            let new = compare(&text, &session, &mut seen);
            // Exactly the calls that were never made before.
            assert_eq!(session.runner().called().len(), new, "{seed}\n{text}");
            compare(&text, &small, &mut ignored);
            assert!(small.memory() <= 500);
            text = edited(&mut random, &text, &steps);
        }
    }
}
