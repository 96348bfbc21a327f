//! Trying faults: an engine with a table to work on, and what must hold after each fault.

use crate::{Bundle, fingerprint, left, unwatched};
use puncta_engine::documents::Failure;
use puncta_engine::engine::{Called, Invocation};
use puncta_engine::{Engine, Isolation, Object};
use serde_json::{Value, json};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Mutex, MutexGuard, OnceLock, PoisonError};

/// Faults that end a process, and what the sentence must name.
pub const DEADLY: [(&str, &[&str]); 11] = [
    ("abort", &["abort"]),
    ("segfault", &["segmentation fault"]),
    ("overflow", &[]),
    ("exit_zero", &["exit status 0"]),
    ("exit_three", &["exit status 3"]),
    ("close", &[]),
    ("kill", &["kill"]),
    ("bus", &["bus error"]),
    ("illegal", &["illegal instruction"]),
    ("arithmetic", &["arithmetic"]),
    ("panic", &["panic", "this plugin is wrong"]),
];

/// Faults after which the call goes on.
pub const LEAVING: [&str; 6] = [
    "flood",
    "child",
    "detached",
    "thread",
    "late_crash",
    "descriptors",
];

/// Points of a call at which a fault strikes.
pub const PHASES: [&str; 6] = ["prepare", "run", "task", "callback", "commit", "finished"];

/// The fault plugin and the sample plugin.
#[must_use]
pub fn bundle() -> &'static Bundle {
    static BUNDLE: OnceLock<Bundle> = OnceLock::new();
    BUNDLE.get_or_init(|| Bundle::of(&["puncta_test_fault", "puncta_test_sample"]))
}

/// Each test counts the children of its process, so that only one runs at a time.
pub fn turn() -> MutexGuard<'static, ()> {
    static TURN: Mutex<()> = Mutex::new(());
    TURN.lock().unwrap_or_else(PoisonError::into_inner)
}

/// The operation with a fault.
#[must_use]
pub fn operation(fault: &str) -> String {
    format!("fault.{}/1", fault.replace('_', "-"))
}

/// A call with a table or without.
#[must_use]
pub fn invocation(operation: &str, parameters: &Value, table: Option<&Object>) -> Invocation {
    let inputs = table.map(|one| ("table".into(), one.clone()));
    Invocation {
        operation: operation.into(),
        parameters: parameters.as_object().cloned().unwrap_or_default(),
        inputs: inputs.into_iter().collect(),
        file: None,
    }
}

/// Fails unless the text has the words.
pub fn has(text: &str, words: &[&str], what: &str) {
    for word in words {
        assert!(text.contains(word), "{what}: no \"{word}\" in \"{text}\"");
    }
    assert!(!text.contains('\n'), "{what}: {text}");
}

/// Every one of `left` with every one of `right`.
#[must_use]
pub fn pairs<L: Copy, R: Copy>(left: &[L], right: &[R]) -> Vec<(L, R)> {
    let pairs = left.iter().flat_map(|l| right.iter().map(|r| (*l, *r)));
    pairs.collect()
}

/// Tries all cases, and fails with the sentences of all that failed.
pub fn all<C>(cases: impl IntoIterator<Item = C>, one: impl Fn(C)) {
    let tried = cases.into_iter().filter_map(|case| {
        let tried = catch_unwind(AssertUnwindSafe(|| one(case)));
        let why = tried.err()?;
        let text = why.downcast_ref::<String>().cloned();
        text.or_else(|| why.downcast_ref::<&str>().map(|text| (*text).to_owned()))
    });
    let problems: Vec<String> = tried.collect();
    assert!(problems.is_empty(), "{}", problems.join("\n"));
}

/// An engine with a table to work on, and the hash of what is to come out of it.
pub struct Bench {
    /// The engine.
    pub engine: Engine,
    /// 5000 points, with x from 0.
    pub table: Object,
    /// Hash of the table with the column that every operation of the fault plugin adds.
    pub truth: String,
}

impl Bench {
    /// With all plugins in workers.
    #[must_use]
    pub fn new() -> Bench {
        Bench::with(bundle().engine(Isolation::Always))
    }

    /// With this engine.
    #[must_use]
    pub fn with(engine: Engine) -> Bench {
        let points = invocation("test.points/1", &json!({"rows": 5000}), None);
        let made = engine.call(&points, &unwatched()).expect("points");
        let mut bench = Bench {
            engine,
            table: made.outputs.into_iter().next().expect("an output").1,
            truth: String::new(),
        };
        let outputs = bench.call("fault.pass/1", &json!({})).expect("a pass");
        let outputs = outputs.outputs;
        bench.truth = fingerprint(&outputs);
        let passed = outputs[0].1.column(0, "passed").expect("the column");
        let passed = passed.data.expect("numbers");
        let right = passed.slice::<f64>().iter().enumerate();
        assert!(
            right
                .into_iter()
                .all(|(i, x)| (x - i as f64 - 1.0).abs() < 1e-9)
        );
        bench
    }

    /// Calls an operation with the table.
    ///
    /// # Errors
    /// Why it failed.
    pub fn call(&self, operation: &str, parameters: &Value) -> Result<Called, Failure> {
        let invocation = invocation(operation, parameters, Some(&self.table));
        self.engine.call(&invocation, &unwatched())
    }

    /// Fails unless this call gives what it should, another as well, and the table is whole.
    pub fn stands(&self, operation: &str, parameters: &Value, after: &str) {
        let nothing = json!({});
        for (operation, parameters) in [(operation, parameters), ("fault.pass/1", &nothing)] {
            let called = self.call(operation, parameters);
            let called = called.unwrap_or_else(|why| panic!("{after}: then {operation}: {why}"));
            let print = fingerprint(&called.outputs);
            assert_eq!(print, self.truth, "{after}: then {operation}");
        }
        let x = self.table.column(0, "x").expect("x").data.expect("numbers");
        let mut whole = x.slice::<f64>().iter().enumerate();
        assert!(
            whole.all(|(i, x)| (x - i as f64).abs() < 1e-9),
            "{after}: the input was changed"
        );
    }

    /// The one sentence of a call's failure; the same step runs when the fault is gone.
    #[must_use]
    pub fn sentence(&self, fault: &str, phase: &str) -> String {
        let folder = tempfile::tempdir().expect("a folder");
        let there = folder.path().join("there");
        std::fs::write(&there, "").expect("a file");
        let (operation, what) = (operation(fault), format!("{fault} in {phase}"));
        let parameters = json!({"phase": phase, "only_while": there});
        let failure = match self.call(&operation, &parameters) {
            Err(failure) => failure,
            Ok(_) => panic!("{what} was not noticed"),
        };
        std::fs::remove_file(there).expect("a file");
        self.stands(&operation, &parameters, &what);
        failure.to_string()
    }

    /// Ends the engine; nothing may be left of it.
    pub fn end(self) {
        drop(self);
        left::nothing();
    }
}

impl Default for Bench {
    fn default() -> Bench {
        Bench::new()
    }
}
