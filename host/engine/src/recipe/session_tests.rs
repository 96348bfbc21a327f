use super::flight::lock;
use super::mock::{MockRunner, Thing, good, inputs, key, plan};
use super::{Checked, Inputs, Limits, RunReport, Session, StepReport, StepState, Wanted, edit};
use std::sync::atomic::Ordering;

const HEAD: &str = "format = \"puncta.recipe/1\"\n[inputs.locs]\nkind = \"table\"\n";

/// locs -> a -> (b, c) -> d, and e beside.
pub fn diamond() -> String {
    format!(
        "{HEAD}
[steps.a]
op = \"mock.add/1\"
in.table = \"locs\"
[steps.b]
op = \"mock.add/1\"
in.table = \"a\"
set.amount = 2
[steps.c]
op = \"mock.add/1\"
in.table = \"a\"
set.amount = 3
[steps.d]
op = \"mock.add/1\"
in.table = \"b\"
in.other = \"c\"
[steps.e]
op = \"mock.image/1\"
in.table = \"locs\"
[outputs]
\"d.csv\" = \"d\"
\"e.tif\" = \"e\"
"
    )
}

pub fn session(parallel: usize) -> Session<MockRunner> {
    Session::new(
        MockRunner::default(),
        Limits {
            parallel,
            memory: 1 << 20,
        },
    )
}

pub fn run(session: &Session<MockRunner>, plan: &Checked) -> RunReport<Thing> {
    session.run(plan, &inputs(), &Wanted::Everything, session.ticket(), &())
}

fn states(report: &RunReport<Thing>) -> Vec<(String, String)> {
    let state = |step: &StepReport| match &step.state {
        StepState::Skipped { because } => format!("skipped {because}"),
        StepState::Failed(_) => "failed".into(),
        other => format!("{other:?}").to_lowercase(),
    };
    report
        .steps
        .iter()
        .map(|step| (step.name.to_string(), state(step)))
        .collect()
}

pub fn state(report: &RunReport<Thing>, name: &str) -> String {
    states(report)
        .into_iter()
        .find(|(step, _)| step == name)
        .map(|(_, state)| state)
        .unwrap()
}

#[test]
fn an_edit_runs_exactly_what_depends_on_it() {
    let session = session(2);
    let text = diamond();
    let first = run(&session, &good(&text));
    assert_eq!(session.runner().called(), ["a", "b", "c", "d", "e"]);
    assert_eq!(first.results["d"].objects, first.results["d.table"].objects);

    let edited = edit::set_parameter(&text, "b", "amount", &5.into()).unwrap();
    let second = run(&session, &good(&edited));
    assert_eq!(session.runner().called(), ["b", "d"]);
    assert_ne!(first.results["d"].objects, second.results["d"].objects);
    assert_eq!(first.results["c"].objects, second.results["c"].objects);

    // Back again, a comment, another order and another spelling of the same number: nothing runs.
    for same in [
        text.clone(),
        text.replace("set.amount = 2", "set.amount = 2.0 # nm"),
        text.replace("set.amount = 2", "set = { amount = \"0.002 um\" }"),
        text.replace(
            "in.table = \"b\"\nin.other = \"c\"",
            "in.other = \"c\"\nin.table = \"b\"",
        ),
        edit::rename_step(&text, "a", "aa").unwrap(),
    ] {
        let again = run(&session, &good(&same));
        assert_eq!(session.runner().called(), Vec::<String>::new(), "{same}");
        assert_eq!(again.results["d"].objects, first.results["d"].objects);
        assert_eq!(again.results["d"].key, first.results["d"].key);
        assert!(
            again
                .steps
                .iter()
                .all(|step| step.state == StepState::Cached)
        );
        assert!(again.steps.iter().all(|step| step.record.is_some()));
    }
}

#[test]
fn another_file_or_library_runs_everything_that_uses_it() {
    let session = session(2);
    let text = diamond();
    run(&session, &good(&text));
    session.runner().called();
    let other = Inputs::from([("locs".to_owned(), vec![(key(2), Thing::table(2, "nm"))])]);
    session.run(
        &good(&text),
        &other,
        &Wanted::Everything,
        session.ticket(),
        &(),
    );
    assert_eq!(session.runner().called().len(), 5);
    let mut mock = super::mock::Mock::new();
    mock.library = [8; 32];
    let plan = super::check(&super::parse(&text).unwrap(), &mock);
    run(&session, &plan);
    assert_eq!(session.runner().called().len(), 5);
}

#[test]
fn only_what_is_wanted_runs() {
    let session = session(1);
    let plan = good(&diamond());
    let wanted = Wanted::References(vec!["b.table".into(), "nothing".into()]);
    let report = session.run(&plan, &inputs(), &wanted, session.ticket(), &());
    assert_eq!(session.runner().called(), ["a", "b"]);
    assert_eq!(report.results.keys().collect::<Vec<_>>(), ["b.table"]);
    let report = session.run(&plan, &inputs(), &Wanted::Outputs, session.ticket(), &());
    assert_eq!(session.runner().called(), ["c", "d", "e"]);
    assert_eq!(report.results.keys().collect::<Vec<_>>(), ["d", "e"]);
}

#[test]
fn a_failed_step_leaves_the_rest_standing() {
    for parallel in [1, 2, 4] {
        let session = session(parallel);
        let text = diamond().replace(
            "[steps.b]\nop = \"mock.add/1\"",
            "[steps.b]\nop = \"mock.fail/1\"",
        );
        let report = run(&session, &good(&text));
        assert_eq!(
            [
                state(&report, "a"),
                state(&report, "b"),
                state(&report, "c"),
                state(&report, "d"),
                state(&report, "e")
            ],
            ["computed", "failed", "computed", "skipped b", "computed"]
        );
        assert_eq!(
            report.step("b").unwrap().message().unwrap(),
            "the table is empty"
        );
        assert_eq!(
            report.step("d").unwrap().message().unwrap(),
            "not run because b failed"
        );
        assert!(report.results.contains_key("c") && !report.results.contains_key("d"));
        // It would fail again, so that it is not tried again until that is asked for.
        session.runner().called();
        assert_eq!(state(&run(&session, &good(&text)), "d"), "skipped b");
        assert!(session.runner().called().is_empty());
        session.runner().healed.store(true, Ordering::SeqCst);
        session.forget_failures();
        assert_eq!(state(&run(&session, &good(&text)), "d"), "computed");
        assert_eq!(session.runner().called(), ["b", "d"]);
    }
}

#[test]
fn a_crash_is_tried_again() {
    let session = session(2);
    let text = diamond().replace(
        "[steps.b]\nop = \"mock.add/1\"",
        "[steps.b]\nop = \"mock.crash/1\"",
    );
    assert_eq!(state(&run(&session, &good(&text)), "b"), "failed");
    session.runner().called();
    session.runner().healed.store(true, Ordering::SeqCst);
    assert_eq!(state(&run(&session, &good(&text)), "d"), "computed");
    assert_eq!(session.runner().called(), ["b", "d"]);
}

#[test]
fn steps_with_problems_do_not_keep_others_from_running() {
    let session = session(2);
    let text = diamond().replace(
        "[steps.b]\nop = \"mock.add/1\"",
        "[steps.b]\nop = \"gone.add/1\"",
    );
    let report = run(&session, &plan(&text));
    assert_eq!(session.runner().called(), ["a", "c", "e"]);
    assert_eq!(state(&report, "d"), "skipped b");
    assert!(
        report
            .step("b")
            .unwrap()
            .message()
            .unwrap()
            .contains("gone.add/1 is not installed")
    );
    assert_eq!(report.step("d").unwrap().key, None);
}

#[test]
fn inputs_that_are_not_there_or_wrong_are_named() {
    let session = session(1);
    let plan = good(&diamond());
    let image = {
        let report = session.run(&plan, &inputs(), &Wanted::Everything, session.ticket(), &());
        report.results["e"].objects[0].clone()
    };
    let bound = |list: Vec<Thing>| {
        let list = list.into_iter().map(|thing| (key(9), thing)).collect();
        Inputs::from([("locs".to_owned(), list)])
    };
    let table = || Thing::table(1, "nm");
    for (inputs, word) in [
        (Inputs::new(), "say --input locs=FILE"),
        (bound(vec![]), "no file is bound"),
        (bound(vec![table(), table()]), "takes one file, not 2"),
        (
            bound(vec![image]),
            "is to be a table, and the file gives an image",
        ),
    ] {
        let report = session.run(&plan, &inputs, &Wanted::Everything, session.ticket(), &());
        let message = report.step("a").unwrap().message().unwrap();
        assert!(message.contains(word), "{message}");
        assert_eq!(state(&report, "d"), "skipped a");
        assert_eq!(state(&report, "e"), "failed");
    }
}

#[test]
fn outputs_that_a_plugin_does_not_announce_are_refused() {
    let session = session(1);
    let text = format!("{HEAD}[steps.a]\nop = \"mock.lie/1\"\nin.table = \"locs\"\n");
    let report = run(&session, &good(&text));
    let message = report.step("a").unwrap().message().unwrap();
    assert!(message.contains("gave an image as table"), "{message}");
}

#[test]
fn several_objects_go_to_ports_that_take_several() {
    let session = session(2);
    let text = "format = \"puncta.recipe/1\"
[inputs.files]
kind = \"table\"
many = true
[inputs.locs]
kind = \"table\"
[steps.cut]
op = \"mock.parts/1\"
in.table = \"locs\"
[steps.all]
op = \"mock.join/1\"
in.tables = [\"files\", \"locs\", \"cut.parts\"]
";
    let table = |value| (key(value), Thing::table(value.into(), "nm"));
    let mut inputs = inputs();
    inputs.insert("files".into(), vec![table(3), table(4)]);
    let plan = good(text);
    let run = |inputs: &Inputs<Thing>| {
        session.run(&plan, inputs, &Wanted::Everything, session.ticket(), &())
    };
    let first = run(&inputs);
    assert_eq!(session.runner().called(), ["all", "cut"]);
    assert_eq!(first.results["cut"].objects.len(), 3);
    let record = first.step("all").unwrap().record.clone().unwrap();
    assert_eq!(record.inputs[0].keys.len(), 3);
    inputs.get_mut("files").unwrap().reverse();
    let second = run(&inputs);
    assert_eq!(
        session.runner().called(),
        ["all"],
        "the order of files matters"
    );
    assert_ne!(first.results["all"].key, second.results["all"].key);
}

#[test]
fn an_optional_output_may_be_missing() {
    let session = session(1);
    let text = format!(
        "{HEAD}[steps.a]\nop = \"mock.maybe/1\"\nin.table = \"locs\"
[steps.b]\nop = \"mock.add/1\"\nin.table = \"a.maybe\"
[steps.c]\nop = \"mock.add/1\"\nin.table = \"a\"\nin.other = \"a.maybe\"\n"
    );
    let report = run(&session, &good(&text));
    assert!(
        report
            .step("b")
            .unwrap()
            .message()
            .unwrap()
            .contains("nothing came for the input table")
    );
    assert_eq!(state(&report, "c"), "computed");
    assert!(!report.results.contains_key("a.maybe"));
}

#[test]
fn units_are_converted_and_recorded() {
    let session = session(1);
    let text = format!(
        "{HEAD}[steps.a]\nop = \"mock.measure/1\"\nin.table = \"locs\"
[steps.b]\nop = \"mock.range/1\"\nin.table = \"locs\"\nset.ranges = {{ x = [\"15 nm\", inf] }}\n"
    );
    let plan = good(&text);
    let with = |byte, unit: &str| {
        let inputs = Inputs::from([("locs".to_owned(), vec![(key(byte), Thing::table(1, unit))])]);
        session.run(&plan, &inputs, &Wanted::Everything, session.ticket(), &())
    };
    let report = with(1, "um");
    let converted = std::mem::take(&mut *lock(&session.runner().converted));
    assert_eq!((converted.len(), converted[0].factor), (1, 1000.0));
    let record = report.step("a").unwrap().record.clone().unwrap();
    assert_eq!(record.inputs[0].conversions, [(0, converted[0].clone())]);
    let json = record.to_json();
    assert_eq!(json["inputs"][0]["converted"][0]["from"], "um");
    assert_eq!(json["plugin"]["version"], "1.2.3");
    // Limits come in the unit of the column that the operation sees.
    let record = report.step("b").unwrap().record.clone().unwrap();
    assert_eq!(
        record.parameters["ranges"].to_string(),
        r#"{"x":[0.015,"inf"]}"#
    );
    assert_eq!(record.to_json()["parameters"]["amount"], 1);

    let report = with(2, "px");
    let message = report.step("a").unwrap().message().unwrap();
    assert!(
        message.contains("has the unit px, which does not convert to nm"),
        "{message}"
    );
    assert!(message.contains("options.units = \"x=nm\""), "{message}");
    assert!(report.step("b").unwrap().message().unwrap().contains("px"));
    with(3, "nm");
    assert!(lock(&session.runner().converted).is_empty());
}

#[test]
fn results_over_the_budget_are_dropped_and_computed_again() {
    let session = Session::new(
        MockRunner::default(),
        Limits {
            parallel: 1,
            memory: 250,
        },
    );
    let plan = good(&diamond());
    let first = run(&session, &plan);
    assert_eq!(session.runner().called().len(), 5);
    assert!(session.memory() <= 250);
    // Only the two results that were used last are there: e, and d, which needs no other then.
    let wanted = Wanted::References(vec!["d".into(), "e".into()]);
    let again = session.run(&plan, &inputs(), &wanted, session.ticket(), &());
    assert!(session.runner().called().is_empty());
    assert_eq!(state(&again, "a"), "cached");
    assert!(
        again.step("a").unwrap().record.is_some(),
        "provenance outlives the result"
    );
    let again = run(&session, &plan);
    assert_eq!(session.runner().called(), ["a", "b", "c"]);
    for (name, found) in &again.results {
        assert_eq!(found.objects, first.results[name].objects, "{name}");
    }
    session.set_memory(0);
    assert_eq!(session.memory(), 0);
    session.clear();
    run(&session, &plan);
    assert_eq!(session.runner().called().len(), 5);
}

#[test]
fn equal_steps_are_computed_once() {
    for parallel in [1, 4] {
        let session = session(parallel);
        let steps: String = (0..50)
            .map(|at| format!("[steps.s{at}]\nop = \"mock.add/1\"\nin.table = \"locs\"\n"))
            .collect();
        let report = run(&session, &good(&format!("{HEAD}{steps}")));
        assert_eq!(session.runner().called().len(), 1);
        assert_eq!(report.results["s0"].objects, report.results["s49"].objects);
    }
}

#[test]
fn long_chains_run() {
    let session = session(2);
    let step = |at: usize| {
        let from = if at == 0 {
            "locs".into()
        } else {
            format!("s{}", at - 1)
        };
        format!("[steps.s{at}]\nop = \"mock.add/1\"\nin.table = \"{from}\"\n")
    };
    let text: String = HEAD.to_owned() + &(0..10_000).map(step).collect::<String>();
    let report = run(&session, &good(&text));
    assert_eq!(session.runner().called().len(), 10_000);
    assert!(
        report
            .steps
            .iter()
            .all(|step| step.state == StepState::Computed)
    );
}
