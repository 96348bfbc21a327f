use super::*;
use puncta_engine::recipe::Place;
use std::collections::BTreeMap;
use std::time::Duration;

fn plan(many: bool) -> Checked {
    let input = |name: &str| CheckedInput {
        name: name.into(),
        kind: puncta_engine::documents::Kind::Table,
        many,
        reader: None,
        options: Default::default(),
        object: None,
        failure: None,
    };
    Checked {
        inputs: vec![input("locs"), input("beads")],
        ..Checked::default()
    }
}

fn texts(line: &str) -> Vec<String> {
    line.split_whitespace().map(String::from).collect()
}

#[test]
fn files_go_to_inputs() {
    let one = plan(false);
    let bound = bind(&one, &texts("beads=b.csv locs=a=1.csv")).unwrap();
    let bound: Vec<String> = bound
        .iter()
        .map(|(input, path)| format!("{}:{}", input.name, path.display()))
        .collect();
    assert_eq!(bound, ["locs:a=1.csv", "beads:b.csv"]);
    for (line, expected) in [
        (
            "a.csv",
            "--input a.csv does not name the input; write NAME=FILE; its inputs are locs, beads",
        ),
        (
            "x=a.csv",
            "the recipe has no input x; its inputs are locs, beads",
        ),
        (
            "locs=a",
            "no file is given for the input beads; add --input beads=FILE",
        ),
        (
            "locs=a locs=b",
            "the input locs takes one file; say many = true in [inputs.locs]",
        ),
    ] {
        assert_eq!(bind(&one, &texts(line)).unwrap_err().to_string(), expected);
    }
    assert_eq!(
        bind(&plan(true), &texts("locs=a locs=b beads=c"))
            .unwrap()
            .len(),
        3
    );
}

#[test]
fn a_problem_names_file_and_place() {
    let text = "format = \"puncta.recipe/1\"\n[steps.a]\n[steps.a]\n";
    let problems = recipe::parse(text).unwrap_err();
    let failure = refuse(Path::new("r.toml"), &problems).unwrap_err();
    assert!(
        failure
            .to_string()
            .starts_with("r.toml, line 3, column 8: "),
        "{failure}"
    );
    let problem = Problem {
        place: Place { line: 2, column: 1 },
        subject: recipe::Subject::Recipe,
        failure: Failure::bad_parameter("x", "no"),
    };
    assert_eq!(
        refuse(Path::new("r"), &[problem]).unwrap_err().code,
        FailureCode::BadFile
    );
}

#[test]
fn the_exit_code_tells_how_much_was_done() {
    let step = |state| StepReport {
        name: "a".into(),
        state,
        duration: Duration::from_millis(1500),
        key: None,
        record: None,
    };
    let report = |states: Vec<StepState>| RunReport {
        steps: states.into_iter().map(step).collect(),
        results: BTreeMap::new(),
        cancelled: false,
    };
    let failed = || StepState::Failed(Failure::bad_input("no"));
    assert_eq!(ended(&report(vec![StepState::Computed]), &[]), Ended::Done);
    assert_eq!(
        ended(&report(vec![StepState::Computed, failed()]), &[]),
        Ended::Partly
    );
    assert_eq!(ended(&report(vec![failed()]), &[]), Ended::Failed);
    let full = (
        "a".to_owned(),
        Err(Failure::new(FailureCode::Io, "the disk is full")),
    );
    assert_eq!(
        ended(&report(vec![StepState::Computed]), &[full]),
        Ended::Failed
    );
    let mut stopped = report(vec![StepState::Cancelled]);
    stopped.cancelled = true;
    assert_eq!(ended(&stopped, &[]), Ended::Stopped);
    assert_eq!(
        row(&step(StepState::Computed)),
        ["a", "done", "1.500 s", ""]
    );
    let skipped = StepState::Skipped {
        because: "b".into(),
    };
    assert_eq!(row(&step(skipped)), ["a", "skipped", "", "needs b"]);
}
