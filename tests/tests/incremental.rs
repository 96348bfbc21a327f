//! A recipe whose text is edited: what runs again is counted inside the plugin.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use puncta_engine::engine::{Invocation, Steps};
use puncta_engine::recipe::{self, Limits, RunReport, Session, StepState, Wanted};
use puncta_engine::{Engine, Isolation, Object};
use puncta_tests::{Bundle, fingerprint, unwatched};
use std::collections::BTreeMap;
use std::sync::Arc;

const RECIPE: &str = r#"format = "puncta.recipe/1"
[steps.points]
op = "test.points/1"
set.rows = 100
[steps.left]
op = "test.scale/1"
in.table = "points"
set.factor = 2
[steps.right]
op = "test.every-nth/1"
in.table = "points"
[steps.last]
op = "test.scale/1"
in.table = "right"
"#;

/// Runs of the plugin in this process so far.
fn runs(engine: &Engine) -> f64 {
    let invocation = Invocation {
        operation: "test.count/1".into(),
        ..Invocation::default()
    };
    let called = engine.call(&invocation, &unwatched()).unwrap();
    let report = called.outputs[0].1.header().document.clone().unwrap();
    report["values"][0]["value"].as_f64().unwrap()
}

fn run(engine: &Arc<Engine>, session: &Session<Steps>, text: &str) -> RunReport<Object> {
    let parsed = recipe::parse(text).unwrap();
    let plan = engine.check_recipe(&parsed);
    assert!(plan.problems.is_empty(), "{:?}", plan.problems);
    session.run(
        &plan,
        &BTreeMap::new(),
        &Wanted::Everything,
        session.ticket(),
        &(),
    )
}

fn prints(report: &RunReport<Object>) -> Vec<String> {
    report
        .results
        .iter()
        .map(|(name, found)| {
            let objects: Vec<(String, Object)> = found
                .objects
                .iter()
                .map(|object| (name.clone(), object.clone()))
                .collect();
            fingerprint(&objects)
        })
        .collect()
}

#[test]
fn an_edit_runs_its_step_and_what_depends_on_it() {
    let bundle = Bundle::of(&["puncta_test_sample"]);
    let engine = Arc::new(bundle.engine(Isolation::InProcess));
    let session = Session::new(Steps(Arc::clone(&engine)), Limits::default());
    let mut before = runs(&engine);
    let mut ran = |text: &str| -> (f64, RunReport<Object>) {
        let report = run(&engine, &session, text);
        let now = runs(&engine);
        let count = now - before;
        before = now;
        (count, report)
    };
    let (count, first) = ran(RECIPE);
    assert!((count - 4.0).abs() < 0.1, "{count} runs at first");
    assert!(
        first
            .steps
            .iter()
            .all(|step| matches!(step.state, StepState::Computed))
    );
    let edits = [
        (
            "a comment",
            RECIPE.replace("set.rows", "# more\nset.rows"),
            0.0,
        ),
        ("another order", reordered(), 0.0),
        (
            "the spelling of a number",
            RECIPE.replace("factor = 2", "factor = 2.0"),
            0.0,
        ),
        ("a leaf", RECIPE.replace("factor = 2", "factor = 3"), 1.0),
        ("its reversal", RECIPE.into(), 0.0),
        (
            "an inner step",
            RECIPE.replace(
                "in.table = \"points\"\n[steps.last]",
                "in.table = \"points\"\nset.n = 5\n[steps.last]",
            ),
            2.0,
        ),
        ("the root", RECIPE.replace("rows = 100", "rows = 50"), 4.0),
        ("back to the beginning", RECIPE.into(), 0.0),
    ];
    for (what, text, expected) in edits {
        let (count, report) = ran(&text);
        assert!(
            (count - expected).abs() < 0.1,
            "{what}: {count} runs, not {expected}"
        );
        if text == RECIPE {
            assert_eq!(prints(&report), prints(&first));
        }
    }
}

fn reordered() -> String {
    let (head, steps) = RECIPE.split_once("[steps.points]").unwrap();
    let (points, rest) = steps.split_once("[steps.left]").unwrap();
    format!("{head}[steps.left]{rest}[steps.points]{points}")
}

#[test]
fn both_ways_of_running_give_the_same_results() {
    let bundle = Bundle::of(&["puncta_test_sample"]);
    let results = [Isolation::InProcess, Isolation::Always].map(|isolation| {
        let engine = Arc::new(bundle.engine(isolation));
        let session = Session::new(Steps(Arc::clone(&engine)), Limits::default());
        prints(&run(&engine, &session, RECIPE))
    });
    assert!(results[0].len() >= 4, "{results:?}");
    assert_eq!(results[0], results[1]);
}

#[test]
fn a_failed_step_leaves_the_rest_standing() {
    let bundle = Bundle::of(&["puncta_test_sample"]);
    let engine = Arc::new(bundle.engine(Isolation::Always));
    let session = Session::new(Steps(Arc::clone(&engine)), Limits::default());
    let text = RECIPE.to_owned()
        + "[steps.bad]\nop = \"test.misbehave/1\"\nin.table = \"points\"\nset.fault = \"abort\"\n\
           [steps.after]\nop = \"test.scale/1\"\nin.table = \"bad\"\n";
    let report = run(&engine, &session, &text);
    let state = |name: &str| &report.step(name).unwrap().state;
    assert!(
        matches!(state("bad"), StepState::Failed(failure) if failure.message.contains("abort"))
    );
    assert!(matches!(state("after"), StepState::Skipped { .. }));
    assert!(matches!(state("last"), StepState::Computed));
    let again = run(&engine, &session, RECIPE);
    assert!(
        again
            .steps
            .iter()
            .all(|step| matches!(step.state, StepState::Cached))
    );
}
