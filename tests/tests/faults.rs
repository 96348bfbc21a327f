//! Each fault at each point of a call: it costs its own call, is named, and leaves nothing.
#![cfg(target_os = "linux")]
#![allow(clippy::unwrap_used, clippy::expect_used)]

use puncta_engine::documents::FailureCode;
use puncta_engine::engine::Options;
use puncta_engine::{Cancel, Engine, Isolation, Progress};
use puncta_tests::faults::{
    Bench, DEADLY, LEAVING, PHASES, all, bundle, has, invocation, operation, pairs, turn,
};
use puncta_tests::{fingerprint, left};
use serde_json::json;
use std::sync::Arc;
use std::time::{Duration, Instant};

#[test]
fn a_crash_costs_its_own_call() {
    let _turn = turn();
    let bench = Bench::new();
    all(pairs(&DEADLY, &PHASES), |((fault, words), phase)| {
        let text = bench.sentence(fault, phase);
        let what = format!("{fault} in {phase}");
        has(&text, &["test.fault", &operation(fault)], &what);
        has(&text, words, &what);
    });
    bench.end();
}

#[test]
fn a_crash_after_the_result_costs_nothing() {
    let _turn = turn();
    let bench = Bench::new();
    let deadly = DEADLY.iter().map(|one| one.0);
    all(deadly.chain(LEAVING), |fault| {
        let what = format!("{fault} in drop");
        bench.stands(&operation(fault), &json!({"phase": "drop"}), &what);
    });
    bench.end();
}

#[test]
fn what_a_call_leaves_behind_is_cleared_away() {
    let _turn = turn();
    let bench = Bench::new();
    all(pairs(&LEAVING[..5], &PHASES), |(fault, phase)| {
        let what = format!("{fault} in {phase}");
        bench.stands(&operation(fault), &json!({"phase": phase}), &what);
        // What strikes later strikes the worker while it waits.
        std::thread::sleep(Duration::from_millis(40));
        bench.stands(&operation(fault), &json!({"phase": "never"}), &what);
    });
    bench.end();
}

#[test]
fn children_end_with_the_call() {
    let _turn = turn();
    let bench = Bench::new();
    all(["child", "detached"], |fault| {
        bench.stands(&operation(fault), &json!({"phase": "run"}), fault);
        let gone = || {
            !left::processes_left()
                .iter()
                .any(|one| one.contains("sleep"))
        };
        assert!(
            left::soon(Duration::from_secs(2), gone),
            "{fault}: {:?}",
            left::processes_left()
        );
    });
    bench.end();
}

#[test]
fn a_flood_costs_no_memory() {
    let _turn = turn();
    let bench = Bench::new();
    let flood = json!({"phase": "run"});
    bench.stands("fault.flood/1", &flood, "a first flood");
    let before = left::resident();
    for _ in 0..3 {
        bench.stands("fault.flood/1", &flood, "a flood");
    }
    let more = left::resident().saturating_sub(before);
    assert!(more < 8 << 20, "{more} bytes more after 600 MB of output");
    bench.end();
}

#[test]
fn without_descriptors_the_next_call_has_its_own() {
    let _turn = turn();
    let bench = Bench::new();
    all(PHASES, |phase| {
        // The call may go on with what it has, or fail for want of a segment.
        let called = bench.call("fault.descriptors/1", &json!({"phase": phase}));
        if let Err(failure) = called {
            let text = failure.to_string();
            has(&text, &["test.fault", "fault.descriptors/1"], phase);
        }
        bench.stands("fault.descriptors/1", &json!({}), phase);
    });
    bench.end();
}

#[test]
fn memory_beyond_the_limit_costs_its_own_call() {
    let _turn = turn();
    let options = Options {
        isolation: Isolation::Always,
        worker_memory: 400 << 20,
        ..bundle().options()
    };
    let bench = Bench::with(Engine::open(options).unwrap());
    all(PHASES, |phase| {
        let text = bench.sentence("memory", phase);
        let words = ["test.fault", "fault.memory/1", "more memory than", "0.4 GB"];
        has(&text, &words, phase);
    });
    let drop = json!({"phase": "drop"});
    bench.stands("fault.memory/1", &drop, "memory in drop");
    bench.end();
}

#[test]
fn lies_are_refused() {
    let _turn = turn();
    let bench = Bench::new();
    let cases: [(&str, &str, &[&str]); 12] = [
        ("bad_document", "prepare", &["plan"]),
        ("null_document", "prepare", &["plan"]),
        ("not_utf8", "prepare", &["plan"]),
        ("wild_status", "prepare", &["without saying why"]),
        ("wild_status", "run", &["without saying why"]),
        ("no_reason", "prepare", &["without saying why"]),
        ("no_reason", "run", &["without saying why"]),
        ("bad_reason", "run", &["all is lost"]),
        ("unwind", "prepare", &["abort"]),
        ("unwind", "run", &["abort"]),
        ("scribble", "run", &["segmentation fault"]),
        ("too_many_rows", "run", &["5001", "5000"]),
    ];
    all(cases, |(fault, phase, words)| {
        let text = bench.sentence(fault, phase);
        let what = format!("{fault} in {phase}");
        has(&text, &["test.fault", &operation(fault)], &what);
        has(&text, words, &what);
    });
    let run = json!({"phase": "run"});
    bench.stands("fault.misuse/1", &run, "wrong calls of the host");
    // What is not finished is not there; a recipe misses it (see fault_runs).
    let called = bench.call("fault.unfinished/1", &run).unwrap();
    assert!(called.outputs.is_empty());
    bench.end();
}

#[test]
fn what_does_not_stop_is_ended() {
    let _turn = turn();
    let bench = Bench::new();
    all(PHASES, |phase| {
        let cancel = Arc::new(Cancel::default());
        let progress: Arc<dyn Progress> = Arc::clone(&cancel) as Arc<dyn Progress>;
        let hang = json!({"phase": phase});
        let call = invocation("fault.hang/1", &hang, Some(&bench.table));
        let (failure, time) = std::thread::scope(|scope| {
            let call = scope.spawn(|| (bench.engine.call(&call, &progress), Instant::now()));
            std::thread::sleep(Duration::from_millis(150));
            let told = Instant::now();
            cancel.cancel();
            let (called, end) = call.join().unwrap();
            (called.unwrap_err(), end - told)
        });
        assert_eq!(failure.code, FailureCode::Cancelled, "{phase}: {failure}");
        // 250 ms are promised, with a fourfold margin.
        assert!(time < Duration::from_secs(1), "{phase}: {time:?}");
        bench.stands("fault.hang/1", &json!({}), phase);
    });
    // Nobody waits for a call that hangs in its end.
    let begin = Instant::now();
    bench.stands("fault.hang/1", &json!({"phase": "drop"}), "hang in drop");
    assert!(
        begin.elapsed() < Duration::from_secs(2),
        "{:?}",
        begin.elapsed()
    );
    bench.end();
}

#[test]
fn two_at_once_cost_two_calls() {
    let _turn = turn();
    let bench = Bench::new();
    let cases = [
        ("segfault", "run", "exit_three", "run"),
        ("panic", "task", "kill", "commit"),
        ("abort", "prepare", "overflow", "callback"),
        ("close", "run", "close", "run"),
    ];
    all(cases, |(one, when, other, then)| {
        std::thread::scope(|scope| {
            let bench = &bench;
            let good = scope.spawn(|| bench.call("fault.pass/1", &json!({"time": 0.1})));
            let calls = [(one, when), (other, then)].map(|(fault, phase)| {
                let call = move || bench.call(&operation(fault), &json!({"phase": phase}));
                (fault, scope.spawn(call))
            });
            for (fault, call) in calls {
                let text = call.join().unwrap().unwrap_err().to_string();
                has(&text, &["test.fault", &operation(fault)], fault);
            }
            let outputs = good.join().unwrap().unwrap().outputs;
            assert_eq!(fingerprint(&outputs), bench.truth);
        });
        bench.stands("fault.pass/1", &json!({}), one);
    });
    bench.end();
}

#[test]
fn a_worker_that_was_killed_while_it_waited_is_replaced() {
    let _turn = turn();
    let bench = Bench::new();
    for _ in 0..10 {
        for worker in left::workers() {
            left::kill(worker);
        }
        bench.stands("fault.pass/1", &json!({}), "killed while it waited");
    }
    bench.end();
}
