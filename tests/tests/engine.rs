//! Calls through the engine, in this process and in workers: the same plugin, the same bits.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use puncta_engine::documents::{FailureCode, Kind, Map};
use puncta_engine::engine::{Called, Invocation};
use puncta_engine::{Cancel, Engine, Isolation, Object, Progress};
use puncta_tests::{Bundle, fingerprint, unwatched};
use serde_json::{Value, json};
use std::sync::{Arc, OnceLock};
use std::time::{Duration, Instant};

fn bundle() -> &'static Bundle {
    static BUNDLE: OnceLock<Bundle> = OnceLock::new();
    BUNDLE.get_or_init(|| Bundle::of(&["puncta_test_sample"]))
}

fn call(
    engine: &Engine,
    operation: &str,
    parameters: Value,
    inputs: &[(&str, &Object)],
) -> Result<Called, puncta_engine::documents::Failure> {
    let invocation = Invocation {
        operation: operation.into(),
        parameters: parameters.as_object().cloned().unwrap_or_default(),
        inputs: inputs
            .iter()
            .map(|(port, object)| ((*port).into(), (*object).clone()))
            .collect(),
        file: None,
    };
    engine.call(&invocation, &unwatched())
}

fn only(called: Called) -> Object {
    called.outputs.into_iter().next().expect("an output").1
}

fn both() -> [Engine; 2] {
    [
        bundle().engine(Isolation::InProcess),
        bundle().engine(Isolation::Always),
    ]
}

#[test]
fn all_kinds_cross_the_process_with_the_same_bits() {
    let prints = both().map(|engine| {
        let called = call(&engine, "test.all-kinds/1", json!({}), &[]).unwrap();
        let kinds: Vec<Kind> = called
            .outputs
            .iter()
            .map(|(_, o)| o.header().kind)
            .collect();
        assert_eq!(
            kinds,
            [
                Kind::Table,
                Kind::Image,
                Kind::Mesh,
                Kind::Figure,
                Kind::Report
            ]
        );
        let table = &called.outputs[0].1;
        assert_eq!(
            table.header().metadata["origin"]["camera"],
            json!("simulated")
        );
        let text = table.column(0, "text").unwrap();
        assert_eq!(text.text.unwrap().slice::<u8>(), "abc\u{b5}".as_bytes());
        let mesh = &called.outputs[2].1;
        assert_eq!(
            (mesh.header().parts[0].rows, mesh.header().parts[1].rows),
            (3, 1)
        );
        fingerprint(&called.outputs)
    });
    assert_eq!(prints[0], prints[1]);
}

#[test]
fn a_figure_brings_the_tables_that_its_series_name() {
    for engine in both() {
        let called = call(&engine, "test.all-kinds/1", json!({}), &[]).unwrap();
        let (_, figure) = &called.outputs[3];
        let parts = &figure.header().parts;
        assert_eq!((parts.len(), parts[0].name.as_str()), (1, "table"));
        assert_eq!(figure.bytes(), called.outputs[0].1.bytes());
        for (column, sum) in [("f32", 6), ("i16", 2), ("row", 6)] {
            let parameters = json!({"column": column});
            let summed = call(
                &engine,
                "test.sum-series/1",
                parameters,
                &[("figure", figure)],
            );
            let summed = only(summed.unwrap());
            let document = summed.header().document.as_ref().unwrap();
            assert_eq!(document["values"][0]["value"], json!(sum), "{column}");
        }
        let missing = call(
            &engine,
            "test.sum-series/1",
            json!({"column": "nothing"}),
            &[("figure", figure)],
        );
        assert_eq!(missing.unwrap_err().code, FailureCode::BadInput);
    }
}

#[test]
fn what_is_not_finished_is_dropped() {
    for engine in both() {
        let called = call(&engine, "test.all-kinds/1", json!({"forget": true}), &[]).unwrap();
        assert!(called.outputs.iter().all(|(port, _)| port != "image"));
        assert_eq!(called.outputs.len(), 4);
    }
}

#[test]
fn the_three_forms_compose_without_copies() {
    for engine in both() {
        let points = only(call(&engine, "test.points/1", json!({"rows": 10}), &[]).unwrap());
        let third = call(
            &engine,
            "test.every-nth/1",
            json!({"n": 3}),
            &[("table", &points)],
        );
        let third = only(third.unwrap());
        let ninth = call(
            &engine,
            "test.every-nth/1",
            json!({"n": 3}),
            &[("table", &third)],
        );
        let ninth = only(ninth.unwrap());
        let scaled = call(
            &engine,
            "test.scale/1",
            json!({"factor": 10}),
            &[("table", &ninth)],
        );
        let scaled = only(scaled.unwrap());
        let numbers = |object: &Object, name: &str| -> Vec<f64> {
            object
                .column(0, name)
                .unwrap()
                .data
                .unwrap()
                .slice()
                .to_vec()
        };
        assert_eq!(numbers(&third, "x"), [0.0, 3.0, 6.0, 9.0]);
        assert_eq!(numbers(&ninth, "x"), [0.0, 9.0]);
        assert_eq!(numbers(&scaled, "scaled"), [0.0, 90.0]);
        // The first selection's columns are still those of the points.
        assert!(
            third.columns(0)[1].gathered_bytes() == 0,
            "y was gathered, and nobody read it"
        );
        let half = call(
            &engine,
            "test.every-nth/1",
            json!({"n": 2}),
            &[("table", &scaled)],
        );
        let half = only(half.unwrap());
        assert_eq!(
            (numbers(&half, "scaled"), numbers(&half, "y")),
            (vec![0.0], vec![0.0])
        );
        let rows = half
            .column(0, "row")
            .unwrap()
            .data
            .unwrap()
            .slice::<u64>()
            .to_vec();
        assert_eq!(rows, [0]);
    }
}

#[test]
fn units_are_converted_or_refused() {
    for engine in both() {
        let points = |unit: &str| {
            only(
                call(
                    &engine,
                    "test.points/1",
                    json!({"rows": 3, "unit": unit}),
                    &[],
                )
                .unwrap(),
            )
        };
        let called = call(
            &engine,
            "test.scale/1",
            json!({"factor": 1}),
            &[("table", &points("um"))],
        );
        let called = called.unwrap();
        assert_eq!(
            (
                called.converted[0].factor,
                called.converted[0].from.as_str()
            ),
            (1000.0, "um")
        );
        let scaled = only(called).column(0, "scaled").unwrap().data.unwrap();
        assert_eq!(scaled.slice::<f64>(), [0.0, 1000.0, 2000.0]);
        for unit in ["unknown", "frame"] {
            let failure = call(
                &engine,
                "test.scale/1",
                json!({}),
                &[("table", &points(unit))],
            );
            let text = failure.unwrap_err().to_string();
            assert!(
                text.contains(unit) && text.contains("nm") && text.contains("units = \"x=nm\""),
                "{text}"
            );
        }
    }
}

#[test]
fn wrong_calls_are_refused_in_one_sentence() {
    let engine = bundle().engine(Isolation::InProcess);
    let points = only(call(&engine, "test.points/1", json!({}), &[]).unwrap());
    let image = call(&engine, "test.all-kinds/1", json!({}), &[])
        .unwrap()
        .outputs[1]
        .1
        .clone();
    type Case<'a> = (&'a str, Value, &'a [(&'a str, &'a Object)], &'a str);
    let cases: [Case<'_>; 6] = [
        (
            "test.none/1",
            json!({}),
            &[],
            "no operation test.none/1 is installed",
        ),
        ("test.scale/1", json!({}), &[], "needs table as table"),
        (
            "test.scale/1",
            json!({}),
            &[("tables", &points)],
            "has no input tables; its inputs are table",
        ),
        (
            "test.scale/1",
            json!({}),
            &[("table", &image)],
            "takes a table as table, not an image",
        ),
        (
            "test.scale/1",
            json!({"factr": 2}),
            &[("table", &points)],
            "no parameter factr; there are factor",
        ),
        (
            "test.every-nth/1",
            json!({"n": 0}),
            &[("table", &points)],
            "below 1",
        ),
    ];
    for (operation, parameters, inputs, expected) in cases {
        let text = call(&engine, operation, parameters, inputs)
            .unwrap_err()
            .to_string();
        assert!(text.contains(expected), "{text}");
        assert!(!text.contains('\n'), "{text}");
    }
}

#[test]
fn faults_cost_their_own_call() {
    for engine in both() {
        let isolated = !engine.in_process(&engine.catalogue().plugins()[0]);
        let points = only(call(&engine, "test.points/1", json!({}), &[]).unwrap());
        let mut faults = vec![
            ("panic", "panicked: this plugin is wrong"),
            ("panic_in_task", "task 7 is wrong"),
            ("fail", "the data are wrong (row 7); mend them"),
            ("too_many_rows", "3 rows were finished, with room for 2"),
            ("unordered", "do not increase"),
        ];
        if isolated {
            faults.extend([("abort", "abort"), ("exit", "exit status 3")]);
        }
        for (fault, expected) in faults {
            for early in [false, true] {
                let parameters = json!({"fault": fault, "early": early});
                let called = call(
                    &engine,
                    "test.misbehave/1",
                    parameters,
                    &[("table", &points)],
                );
                let text = called.unwrap_err().to_string();
                assert!(early || text.contains(expected), "{fault}: {text}");
                let again = call(&engine, "test.scale/1", json!({}), &[("table", &points)]);
                assert_eq!(only(again.unwrap()).header().rows(), 10);
            }
        }
    }
}

/// Cancels after a while and returns how long the call then took.
fn cancelled(engine: &Engine, operation: &str, parameters: Value) -> Duration {
    let cancel = Arc::new(Cancel::default());
    let progress: Arc<dyn Progress> = Arc::clone(&cancel) as Arc<dyn Progress>;
    let invocation = Invocation {
        operation: operation.into(),
        parameters: parameters.as_object().cloned().unwrap_or_default(),
        ..Invocation::default()
    };
    std::thread::scope(|scope| {
        let call = scope.spawn(|| (engine.call(&invocation, &progress), Instant::now()));
        std::thread::sleep(Duration::from_millis(600));
        let told = Instant::now();
        cancel.cancel();
        let (result, end) = call.join().unwrap();
        assert_eq!(result.unwrap_err().code, FailureCode::Cancelled);
        end - told
    })
}

#[test]
fn cancel_returns_control_in_time() {
    for engine in both() {
        assert!(cancelled(&engine, "test.wait/1", json!({"time": 20})) < Duration::from_secs(1));
    }
    let engine = bundle().engine(Isolation::Always);
    // A worker that does not listen is ended.
    let hang = json!({"fault": "hang"});
    assert!(cancelled(&engine, "test.misbehave/1", hang) < Duration::from_secs(1));
    assert!(call(&engine, "test.points/1", json!({}), &[]).is_ok());
}

#[test]
fn thread_counts_do_not_change_results() {
    let points = json!({"rows": 100_000});
    let prints = [1, 2, 5].map(|threads| {
        let options = puncta_engine::engine::Options {
            threads,
            ..bundle().options()
        };
        let engine = Engine::open(options).unwrap();
        let table = only(call(&engine, "test.points/1", points.clone(), &[]).unwrap());
        fingerprint(
            &call(&engine, "test.scale/1", json!({}), &[("table", &table)])
                .unwrap()
                .outputs,
        )
    });
    assert!(prints.iter().all(|print| print == &prints[0]));
}

#[test]
fn an_empty_host_refuses_every_file() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("a.csv");
    std::fs::write(&file, "x,y\n1,2\n").unwrap();
    let options = puncta_engine::engine::Options {
        folders: Vec::new(),
        ..bundle().options()
    };
    let engine = Engine::open(options).unwrap();
    assert_eq!(engine.catalogue().operations().count(), 0);
    let failure = engine
        .read(&file, None, &Map::new(), &unwatched())
        .unwrap_err();
    assert!(
        failure.to_string().contains("no reader installed"),
        "{failure}"
    );
}

#[test]
fn a_changed_library_is_refused() {
    let bundle = Bundle::of(&["puncta_test_sample"]);
    let library = std::fs::read_dir(bundle.path().join("plugins/puncta_test_sample"))
        .unwrap()
        .flatten()
        .map(|entry| entry.path())
        .find(|path| path.extension().is_some_and(|suffix| suffix != "json"))
        .unwrap();
    let mut bytes = std::fs::read(&library).unwrap();
    std::fs::remove_file(&library).unwrap();
    bytes.push(0);
    std::fs::write(&library, &bytes).unwrap();
    let engine = bundle.engine(Isolation::ByPlugin);
    let text = call(&engine, "test.points/1", json!({}), &[])
        .unwrap_err()
        .to_string();
    assert!(text.contains("has changed since it was packed"), "{text}");
    std::fs::write(&library, &bytes[..bytes.len() / 2]).unwrap();
    let engine = bundle.engine(Isolation::ByPlugin);
    let text = call(&engine, "test.points/1", json!({}), &[])
        .unwrap_err()
        .to_string();
    assert!(text.contains("part of"), "{text}");
}
