use super::flight::lock;
use super::mock::{good, inputs};
use super::session_tests::{diamond, run, session, state};
use super::{StepReport, StepState, Wanted, Watch};
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

#[derive(Default)]
struct Stop {
    stop: AtomicBool,
    events: Mutex<Vec<String>>,
    begun: AtomicBool,
}

impl Watch for Stop {
    fn started(&self, step: &str) {
        lock(&self.events).push(format!("started {step}"));
    }
    fn progress(&self, step: &str, fraction: f64, phase: &str) {
        if !self.begun.swap(true, Ordering::SeqCst) {
            lock(&self.events).push(format!("progress {step} {fraction} {phase}"));
        }
    }
    fn finished(&self, report: &StepReport) {
        lock(&self.events).push(format!("finished {}", report.name));
    }
    fn cancelled(&self) -> bool {
        self.stop.load(Ordering::SeqCst)
    }
}

fn until(what: impl Fn() -> bool) {
    for _ in 0..20_000 {
        if what() {
            return;
        }
        std::thread::sleep(Duration::from_millis(1));
    }
    panic!("waited in vain");
}

fn waiting() -> String {
    diamond().replace(
        "[steps.b]\nop = \"mock.add/1\"",
        "[steps.b]\nop = \"mock.wait/1\"",
    )
}

#[test]
fn cancel_stops_the_run_and_keeps_what_is_there() {
    for parallel in [1, 2] {
        let session = session(parallel);
        let plan = good(&waiting());
        let watch = Stop::default();
        let report = std::thread::scope(|scope| {
            let run = scope.spawn(|| {
                session.run(
                    &plan,
                    &inputs(),
                    &Wanted::Everything,
                    session.ticket(),
                    &watch,
                )
            });
            until(|| watch.begun.load(Ordering::SeqCst));
            watch.stop.store(true, Ordering::SeqCst);
            run.join().unwrap()
        });
        assert!(report.cancelled);
        assert_eq!(state(&report, "a"), "computed");
        assert_eq!(state(&report, "b"), "cancelled");
        assert_eq!(state(&report, "d"), "cancelled");
        assert_eq!(report.steps.len(), 5);
        let events = lock(&watch.events).clone();
        assert!(
            events.contains(&"progress b 0.5 waiting".to_owned()),
            "{events:?}"
        );
        assert_eq!(
            events
                .iter()
                .filter(|event| event.starts_with("finished"))
                .count(),
            5
        );
        session.runner().open.store(true, Ordering::SeqCst);
        session.runner().called();
        let report = run(&session, &plan);
        assert!(!report.cancelled);
        assert!(!session.runner().called().contains(&"a".to_owned()));
        assert_eq!(state(&report, "d"), "computed");
    }
}

#[test]
fn a_newer_edit_ends_an_older_run() {
    let session = session(2);
    let old = good(&waiting());
    let new = good(&waiting().replace("set.amount = 2", "set.amount = 4"));
    let watch = Stop::default();
    let (older, newer) = (session.ticket(), session.ticket());
    std::thread::scope(|scope| {
        let first =
            scope.spawn(|| session.run(&old, &inputs(), &Wanted::Everything, older, &watch));
        until(|| watch.begun.load(Ordering::SeqCst));
        let second = scope.spawn(|| session.run(&new, &inputs(), &Wanted::Everything, newer, &()));
        let first = first.join().unwrap();
        assert!(first.cancelled);
        assert_eq!(state(&first, "b"), "cancelled");
        session.runner().open.store(true, Ordering::SeqCst);
        let second = second.join().unwrap();
        assert!(!second.cancelled);
        assert_eq!(state(&second, "d"), "computed");
    });
    assert_eq!(*lock(&session.runner().stopped), ["b"]);
}

#[test]
fn a_call_that_the_newer_run_needs_goes_on() {
    let session = session(2);
    let old = good(&waiting());
    let new = good(&waiting().replace("set.amount = 3", "set.amount = 4"));
    let (watch, other) = (Stop::default(), Stop::default());
    let (older, newer) = (session.ticket(), session.ticket());
    std::thread::scope(|scope| {
        let first =
            scope.spawn(|| session.run(&old, &inputs(), &Wanted::Everything, older, &watch));
        until(|| watch.begun.load(Ordering::SeqCst));
        let second =
            scope.spawn(|| session.run(&new, &inputs(), &Wanted::Everything, newer, &other));
        // It shows the progress of the call it waits for.
        until(|| other.begun.load(Ordering::SeqCst));
        session.runner().open.store(true, Ordering::SeqCst);
        let second = second.join().unwrap();
        assert!(first.join().unwrap().cancelled);
        assert_eq!(state(&second, "b"), "cached");
        assert_eq!(state(&second, "d"), "computed");
    });
    assert!(lock(&session.runner().stopped).is_empty());
    assert_eq!(
        session
            .runner()
            .called()
            .iter()
            .filter(|step| *step == "b")
            .count(),
        1
    );
}

#[test]
fn a_call_ends_when_nobody_waits_for_it_any_more() {
    let session = session(2);
    let plan = good(&waiting());
    let (watch, other) = (Stop::default(), Stop::default());
    let (older, newer) = (session.ticket(), session.ticket());
    std::thread::scope(|scope| {
        let first =
            scope.spawn(|| session.run(&plan, &inputs(), &Wanted::Everything, older, &watch));
        until(|| watch.begun.load(Ordering::SeqCst));
        let second =
            scope.spawn(|| session.run(&plan, &inputs(), &Wanted::Everything, newer, &other));
        until(|| other.begun.load(Ordering::SeqCst));
        other.stop.store(true, Ordering::SeqCst);
        assert!(second.join().unwrap().cancelled);
        assert!(first.join().unwrap().cancelled);
    });
    assert_eq!(*lock(&session.runner().stopped), ["b"]);
}

#[test]
fn superseded_runs_do_not_begin() {
    let session = session(2);
    let plan = good(&diamond());
    let old = session.ticket();
    session.supersede();
    let report = session.run(&plan, &inputs(), &Wanted::Everything, old, &());
    assert!(
        report.cancelled
            && report
                .steps
                .iter()
                .all(|step| step.state == StepState::Cancelled)
    );
    assert!(session.runner().called().is_empty());
    assert!(!run(&session, &plan).cancelled);
    let watch = Stop::default();
    let plan = good(&waiting());
    std::thread::scope(|scope| {
        let run = scope.spawn(|| {
            session.run(
                &plan,
                &inputs(),
                &Wanted::Everything,
                session.ticket(),
                &watch,
            )
        });
        until(|| watch.begun.load(Ordering::SeqCst));
        session.supersede();
        assert!(run.join().unwrap().cancelled);
    });
}

struct Clumsy;

impl Watch for Clumsy {
    fn finished(&self, _: &StepReport) {
        panic!("on purpose");
    }
}

#[test]
fn a_panic_in_what_watches_does_not_hang_the_run() {
    let session = session(4);
    let plan = good(&diamond());
    let run = || {
        session.run(
            &plan,
            &inputs(),
            &Wanted::Everything,
            session.ticket(),
            &Clumsy,
        )
    };
    assert!(std::panic::catch_unwind(std::panic::AssertUnwindSafe(run)).is_err());
    assert!(!super::session_tests::run(&session, &plan).cancelled);
}
