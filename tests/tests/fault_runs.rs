//! Faults at random steps and points of a running recipe, and workers that are killed at random
//! moments: what survives has the hashes of an undisturbed run, what does not is named, and nothing
//! is left behind.
//!
//! `PUNCTA_FAULT_SEED=<seed>` repeats one round; with `PUNCTA_TEST_ALL` there are ten times as many.
#![cfg(target_os = "linux")]
#![allow(clippy::unwrap_used, clippy::expect_used)]

use puncta_engine::documents::{Failure, FailureCode};
use puncta_engine::engine::{Options, Steps};
use puncta_engine::recipe::{self, Limits, RunReport, Session, StepState, Wanted, Watch};
use puncta_engine::{Engine, Isolation, Object};
use puncta_tests::faults::{DEADLY, LEAVING, PHASES, has};
use puncta_tests::{Bundle, fingerprint, left};
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

const PACKAGES: [&str; 5] = [
    "puncta_plugin_filter",
    "puncta_plugin_render",
    "puncta_plugin_synthetic",
    "puncta_test_fault",
    "puncta_test_sample",
];

/// Steps that follow orders, each with where its table comes from.
const PASSES: [(&str, &str); 6] = [
    ("first", "sphere"),
    ("second", "near"),
    ("third", "scaled"),
    ("fourth", "sphere"),
    ("fifth", "few"),
    ("sixth", "fourth"),
];

const REST: &str = r#"
[steps.sphere]
op = "puncta.synthetic.membrane/1"
set = { shape = "sphere", acceptance = 0.02, seed = 5 }
[steps.near]
op = "puncta.filter.range/1"
in.table = "first"
set.ranges = { passed = [0, inf] }
[steps.few]
op = "test.every-nth/1"
in.table = "second"
[steps.scaled]
op = "test.scale/1"
in.table = "few"
[steps.picture]
op = "puncta.render.histogram/1"
in.table = "third"
[steps.other]
op = "puncta.render.gaussian/1"
in.table = "sixth"
set = { sigma = 10, pixel_size = 20 }
[steps.last]
op = "test.scale/1"
in.table = "fifth"
"#;

fn text(orders: &Path) -> String {
    let head = String::from("format = \"puncta.recipe/1\"\n");
    PASSES.iter().fold(head, |text, (name, from)| {
        format!(
            "{text}[steps.{name}]\nop = \"fault.pass/1\"\nin.table = \"{from}\"\n\
             set = {{ orders = \"{}\", step = \"{name}\", time = 0.004 }}\n",
            orders.display()
        )
    }) + REST
}

/// Numbers from a seed (SplitMix64, Steele et al. 2014).
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    fn below(&mut self, count: usize) -> usize {
        (self.next() % count as u64) as usize
    }

    fn one<T: Copy>(&mut self, of: &[T]) -> T {
        of[self.below(of.len())]
    }
}

/// What goes wrong in a round.
#[derive(Debug, Default)]
struct Round {
    /// Phase, fault, step.
    orders: Vec<(&'static str, &'static str, &'static str)>,
    /// When workers are killed, and which.
    kills: Vec<(Duration, usize)>,
    /// When the person stops the run.
    stop: Option<Duration>,
}

const WHEN: [&str; 7] = [
    "prepare", "run", "task", "callback", "commit", "finished", "drop",
];
const LIES: [&str; 4] = ["too_many_rows", "unfinished", "wild_status", "scribble"];

impl Round {
    fn of(seed: u64) -> Round {
        let mut random = Random(seed);
        let mut round = Round::default();
        // Every tenth round has two faults at once.
        let faults = if random.below(10) == 0 { 2 } else { 1 };
        for _ in 0..faults {
            round.add(&mut random);
        }
        round
    }

    fn add(&mut self, random: &mut Random) {
        let step = random.one(&PASSES).0;
        match random.below(100) {
            0..55 => {
                let fault = random.one(&DEADLY).0;
                self.orders.push((random.one(&WHEN), fault, step));
            }
            55..65 => {
                let fault = random.one(&LEAVING);
                self.orders.push((random.one(&WHEN), fault, step));
            }
            65..72 => {
                let fault = random.one(&LIES);
                self.orders.push(("run", fault, step));
            }
            72..75 => {
                self.orders.push((random.one(&PHASES), "hang", step));
                let soon = 50 + random.below(100) as u64;
                self.stop = Some(Duration::from_millis(soon));
            }
            _ => {
                let moment = Duration::from_micros(random.below(80_000) as u64);
                self.kills.push((moment, random.below(64)));
                self.kills.sort();
            }
        }
    }

    fn write(&self, orders: &Path) {
        let lines = self.orders.iter();
        let lines: Vec<String> = lines
            .map(|(phase, fault, step)| format!("{phase} {fault} {step}\n"))
            .collect();
        std::fs::write(orders, lines.concat()).unwrap();
    }

    /// Kills workers from outside.
    fn kill(&self) {
        let begin = Instant::now();
        for (moment, which) in &self.kills {
            std::thread::sleep(moment.saturating_sub(begin.elapsed()));
            let workers = left::workers();
            if !workers.is_empty() {
                left::kill(workers[which % workers.len()]);
            }
        }
    }

    fn ordered(&self, fault: &str) -> bool {
        self.orders.iter().any(|order| order.1 == fault)
    }
}

struct Stopper(Instant, Option<Duration>);

impl Watch for Stopper {
    fn cancelled(&self) -> bool {
        self.1.is_some_and(|after| self.0.elapsed() > after)
    }
}

struct Rounds {
    engine: Arc<Engine>,
    folder: tempfile::TempDir,
    plan: recipe::Checked,
    /// The steps that each step takes its inputs from.
    sources: BTreeMap<String, BTreeSet<String>>,
    truth: BTreeMap<String, String>,
}

fn prints(report: &RunReport<Object>) -> BTreeMap<String, String> {
    let results = report.results.iter().map(|(name, found)| {
        let own = |object: &Object| (name.clone(), object.clone());
        let objects: Vec<(String, Object)> = found.objects.iter().map(own).collect();
        (name.clone(), fingerprint(&objects))
    });
    results.collect()
}

impl Rounds {
    fn new(options: Options) -> Rounds {
        let engine = Arc::new(Engine::open(options).unwrap());
        let folder = tempfile::tempdir().unwrap();
        let parsed = recipe::parse(&text(&folder.path().join("orders"))).unwrap();
        let plan = engine.check_recipe(&parsed);
        assert!(plan.problems.is_empty(), "{:?}", plan.problems);
        let sources = parsed.steps.iter().map(|step| {
            let bound = step.inputs.iter().flat_map(|one| &one.from);
            (
                step.name.clone(),
                bound.map(|one| one.source.clone()).collect(),
            )
        });
        let mut rounds = Rounds {
            engine,
            sources: sources.collect(),
            folder,
            plan,
            truth: BTreeMap::new(),
        };
        let report = rounds.run(&rounds.session(), None);
        rounds.truth = prints(&report);
        for step in &report.steps {
            assert!(matches!(step.state, StepState::Computed), "{step:?}");
        }
        assert_eq!(report.steps.len(), PASSES.len() + 7);
        assert!(rounds.truth.len() >= report.steps.len());
        rounds
    }

    fn orders(&self) -> std::path::PathBuf {
        self.folder.path().join("orders")
    }

    fn session(&self) -> Session<Steps> {
        Session::new(Steps(Arc::clone(&self.engine)), Limits::default())
    }

    fn run(&self, session: &Session<Steps>, stop: Option<Duration>) -> RunReport<Object> {
        let stopper = Stopper(Instant::now(), stop);
        let ticket = session.ticket();
        let nothing = BTreeMap::new();
        session.run(&self.plan, &nothing, &Wanted::Everything, ticket, &stopper)
    }

    /// A round of faults, then a run without.
    fn round(&self, round: &Round) {
        let session = self.session();
        round.write(&self.orders());
        let report = std::thread::scope(|scope| {
            scope.spawn(|| round.kill());
            self.run(&session, round.stop)
        });
        std::fs::remove_file(self.orders()).unwrap();
        self.check(round, &report);
        session.forget_failures();
        let again = self.run(&session, None);
        for step in &again.steps {
            if let Some(why) = step.message() {
                panic!("step {} does not run again: {why}", step.name);
            }
        }
        assert_eq!(prints(&again), self.truth, "after the faults");
    }

    fn check(&self, round: &Round, report: &RunReport<Object>) {
        for (name, print) in prints(report) {
            assert_eq!(Some(&print), self.truth.get(&name), "{name} survived");
        }
        let failed = |name: &str| {
            let step = report.step(name);
            step.is_some_and(|step| matches!(step.state, StepState::Failed(_)))
        };
        for step in &report.steps {
            match &step.state {
                StepState::Computed => {
                    assert!(report.results.contains_key(&*step.name), "{}", step.name);
                    self.check_survivor(round, &step.name);
                }
                StepState::Failed(failure) => check_failure(round, &step.name, failure),
                StepState::Skipped { because } => {
                    assert!(failed(because), "{because} did not fail");
                    assert!(
                        self.needs(&step.name, because),
                        "{} needs {because}",
                        step.name
                    );
                }
                StepState::Cancelled => assert!(round.stop.is_some(), "nobody stopped it"),
                StepState::Cached => panic!("{} was not run", step.name),
            }
        }
    }

    /// A step that was to fail must not have a result.
    fn check_survivor(&self, round: &Round, name: &str) {
        for (phase, fault, step) in &round.orders {
            let deadly = DEADLY.iter().any(|one| one.0 == *fault) || LIES.contains(fault);
            if *step == name && deadly && *phase != "drop" {
                panic!("{name} has a result in spite of {fault} in {phase}");
            }
        }
    }

    fn needs(&self, step: &str, other: &str) -> bool {
        let sources = self.sources.get(step);
        sources.is_some_and(|sources| {
            sources.contains(other) || sources.iter().any(|source| self.needs(source, other))
        })
    }
}

/// The sentence names the plugin, the operation and the cause, which was asked for.
fn check_failure(round: &Round, name: &str, failure: &Failure) {
    let text = failure.to_string();
    if !round.kills.is_empty() && text.contains("kill") {
        assert_eq!(failure.code, FailureCode::Crashed, "{text}");
        return;
    }
    // A thread that was left behind may strike in the next call.
    if round.ordered("late_crash") && text.contains("segmentation fault") {
        return has(&text, &["test.fault"], name);
    }
    let mut orders = round.orders.iter().filter(|order| order.2 == name);
    let named = orders.any(|(_, fault, _)| {
        let deadly = DEADLY.iter().find(|one| one.0 == *fault);
        deadly.is_none_or(|(_, words)| words.iter().all(|word| text.contains(word)))
    });
    assert!(named, "{name} failed without a reason to: {text}");
    has(&text, &["test.fault", "fault.pass/1"], name);
}

fn rounds(count: u64) {
    let bundle = Bundle::of(&PACKAGES);
    let descriptors = left::descriptors();
    let rounds = Rounds::new(Options {
        isolation: Isolation::Always,
        ..bundle.options()
    });
    let given = std::env::var("PUNCTA_FAULT_SEED").ok();
    let given = given.map(|seed| seed.parse::<u64>().expect("a number"));
    let seeds: Vec<u64> = given.map_or((0..count).collect(), |seed| vec![seed]);
    let mut memory = Vec::new();
    for (i, seed) in seeds.iter().enumerate() {
        let round = Round::of(*seed);
        let tried = std::panic::AssertUnwindSafe(|| rounds.round(&round));
        if std::panic::catch_unwind(tried).is_err() {
            panic!("PUNCTA_FAULT_SEED={seed} repeats this round: {round:?}");
        }
        if i + 1 == seeds.len().div_ceil(2) || i + 1 == seeds.len() {
            rounds.round(&Round::default());
            memory.push(left::resident());
        }
    }
    drop(rounds);
    left::nothing();
    let files = || left::descriptors() <= descriptors;
    assert!(
        left::soon(Duration::from_secs(2), files),
        "files are left open"
    );
    let (half, end) = (memory[0], memory[memory.len() - 1]);
    assert!(
        end <= half + half / 20,
        "{half} bytes after half of the faults, {end} at the end"
    );
}

#[test]
fn a_recipe_survives_random_faults() {
    let all = std::env::var_os("PUNCTA_TEST_ALL").is_some();
    rounds(if all { 500 } else { 50 });
}
