//! The cases.

use crate::calls::{self, CALLS};
use crate::data;
use crate::figures::Figure;
use crate::surfaces;
use puncta_engine::documents::Map;
use puncta_engine::engine::Steps;
use puncta_engine::recipe::{self, Limits, Session, Wanted};
use puncta_engine::{Engine, Isolation, Object};
use puncta_tests::unwatched;
use rayon::prelude::*;
use serde_json::json;
use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Instant;

/// Names in the order of running; those of other programs' measurements where there are any.
const NAMES: &[&str] = &[
    "csv_load_1000000",
    "csv_load_10000000",
    "hdf_load_1000000",
    "hdf_load_10000000",
    "hist2d_1000000_10nm",
    "hist2d_10000000_10nm",
    "render_gauss_1000000_10nm",
    "render_gauss_1000000_5nm",
    "filter_and_sum_1000000",
    "filter_and_sum_10000000",
    "empty_call",
    "empty_step",
    "worker_call",
    "worker_fresh_160mb",
];

/// Names of all cases.
pub fn names() -> impl Iterator<Item = &'static str> {
    let calls = CALLS.iter().map(|(name, ..)| *name);
    let surfaces = surfaces::NAMES.iter().copied();
    NAMES.iter().copied().chain(calls).chain(surfaces)
}

/// Runs a case.
pub fn run(name: &str) -> Figure {
    let bundle = data::bundle();
    let engine = data::engine(&bundle);
    if let Some(case) = CALLS.iter().find(|(call, ..)| *call == name) {
        return calls::run(case, &engine);
    }
    if surfaces::NAMES.contains(&name) {
        return surfaces::run(name, &engine);
    }
    let count = |place: usize| -> String {
        name.split('_')
            .nth(place)
            .expect("a number in the case's name")
            .to_owned()
    };
    match name {
        _ if name.starts_with("csv_load") => load(name, &engine, &format!("sim_{}.csv", count(2))),
        _ if name.starts_with("hdf_load") => {
            load(name, &engine, &format!("sim_{}_locs.hdf5", count(2)))
        }
        _ if name.starts_with("hist2d") => {
            let table = data::read(&engine, &format!("sim_{}_locs.hdf5", count(1)));
            image(name, &engine, "puncta.render.histogram/1", &table, 10.0)
        }
        _ if name.starts_with("render_gauss") => {
            let table = data::read(&engine, &format!("sim_{}_locs.hdf5", count(2)));
            let pixel = if name.ends_with("_5nm") { 5.0 } else { 10.0 };
            image(name, &engine, "puncta.render.gaussian/1", &table, pixel)
        }
        _ if name.starts_with("filter_and_sum") => {
            let table = data::read(&engine, &format!("sim_{}.csv", count(3)));
            filter(name, &engine, &table)
        }
        "empty_call" => empty(name, &engine),
        "empty_step" => steps(name, engine),
        "worker_call" => worker(name, &bundle.engine(Isolation::Always)),
        _ => fresh(name, &bundle.engine(Isolation::Always)),
    }
}

/// Median of seven runs after two that warm up.
pub fn measure(name: &str, mut work: impl FnMut() -> String) -> Figure {
    let mut times = Vec::new();
    let mut digest = String::new();
    for turn in 0..9 {
        let begin = Instant::now();
        digest = work();
        if turn > 1 {
            times.push(begin.elapsed().as_secs_f64());
        }
    }
    figure(name, times, digest)
}

/// A figure with its digest.
pub fn figure_of(figure: Figure, digest: String) -> Figure {
    Figure { digest, ..figure }
}

fn figure(name: &str, mut times: Vec<f64>, digest: String) -> Figure {
    times.sort_by(f64::total_cmp);
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let peak = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
    let peak = peak.and_then(|text| text.split_whitespace().next()?.parse::<f64>().ok());
    Figure {
        name: name.into(),
        seconds: times[times.len() / 2],
        range: [times[0], times[times.len() - 1]],
        megabytes: peak.unwrap_or(0.0) / 1024.0,
        digest,
    }
}

fn load(name: &str, engine: &Engine, file: &str) -> Figure {
    let path = data::file(file);
    let mut last = None;
    let figure = measure(name, || {
        last = None;
        let read = engine
            .read(&path, None, &Map::new(), &unwatched())
            .expect("the file reads");
        let object = read.object(None).expect("an object").clone();
        let rows = object.header().rows();
        last = Some(object);
        format!("rows={rows}")
    });
    let x = last
        .as_ref()
        .map(|object| data::column(object, "x"))
        .unwrap_or_default();
    Figure {
        digest: format!("{};sumx={:.1}", figure.digest, x.iter().sum::<f64>()),
        ..figure
    }
}

fn image(name: &str, engine: &Engine, operation: &str, table: &Object, pixel: f64) -> Figure {
    let bounds = json!({
        "pixel_size": pixel, "x_min": 0, "x_max": 40960, "y_min": 0, "y_max": 40960
    });
    let mut prepared = engine
        .prepare(
            &data::invocation(operation, bounds, Some(table)),
            &unwatched(),
        )
        .expect("a plan");
    let mut last = None;
    let figure = measure(name, || {
        last = None;
        last = prepared
            .run(&unwatched())
            .expect("an image")
            .into_iter()
            .next();
        String::new()
    });
    let (_, image) = last.expect("an image");
    let column = image
        .column(0, "value")
        .expect("values")
        .data
        .expect("numbers");
    let size = image
        .header()
        .image
        .as_ref()
        .map(|image| image.size)
        .unwrap_or_default();
    let values = column.slice::<f32>();
    let sum: f64 = values.iter().map(|value| f64::from(*value)).sum();
    let max = values.iter().copied().fold(0.0, f32::max);
    let digest = format!("shape=({},{});sum={sum:.1};max={max:.3}", size[3], size[4]);
    Figure { digest, ..figure }
}

fn filter(name: &str, engine: &Engine, table: &Object) -> Figure {
    let x = data::column(table, "x");
    let mut sorted = x.clone();
    let middle = sorted.len() / 2;
    let (_, median, _) = sorted.select_nth_unstable_by(middle, f64::total_cmp);
    let parameters = json!({"ranges": {"x": ["-inf", *median]}});
    drop(x);
    let invocation = data::invocation("puncta.filter.range/1", parameters, Some(table));
    measure(name, || {
        let called = engine.call(&invocation, &unwatched()).expect("a selection");
        let (_, selected) = &called.outputs[0];
        let column = engine
            .pool()
            .install(|| selected.column(0, "x"))
            .expect("x");
        let sum: f64 = engine.pool().install(|| {
            let region = column.data.as_ref().expect("numbers");
            let blocks = region.slice::<f64>().par_chunks(65536);
            blocks
                .map(|block| block.iter().sum::<f64>())
                .collect::<Vec<_>>()
                .iter()
                .sum()
        });
        format!("rows={};sumx={sum:.1}", selected.header().rows())
    })
}

fn empty(name: &str, engine: &Engine) -> Figure {
    let invocation = data::invocation("test.empty/1", json!({}), None);
    let progress = unwatched();
    let mut prepared = engine.prepare(&invocation, &progress).expect("a plan");
    let mut times = Vec::new();
    for turn in 0..9 {
        let begin = Instant::now();
        for _ in 0..20_000 {
            prepared.run(&progress).expect("a run");
        }
        if turn > 1 {
            times.push(begin.elapsed().as_secs_f64() / 20_000.0);
        }
    }
    figure(name, times, "20000 runs".into())
}

/// A step of an empty operation with its checks, key and record.
fn steps(name: &str, engine: Engine) -> Figure {
    const COUNT: usize = 1000;
    let engine = Arc::new(engine);
    let mut text = String::from("format = \"puncta.recipe/1\"\n");
    for i in 0..COUNT {
        text.push_str(&format!(
            "[steps.s{i}]\nop = \"test.empty/1\"\nset.tag = {i}\n"
        ));
    }
    let plan = engine.check_recipe(&recipe::parse(&text).expect("a recipe"));
    let session = Session::new(
        Steps(engine),
        Limits {
            parallel: 1,
            memory: 0,
        },
    );
    let mut times = Vec::new();
    for turn in 0..9 {
        let begin = Instant::now();
        session.clear();
        let report = session.run(
            &plan,
            &BTreeMap::new(),
            &Wanted::Everything,
            session.ticket(),
            &(),
        );
        assert!(report.steps.len() == COUNT && !report.cancelled);
        if turn > 1 {
            times.push(begin.elapsed().as_secs_f64() / COUNT as f64);
        }
    }
    figure(name, times, format!("{COUNT} steps"))
}

fn worker(name: &str, engine: &Engine) -> Figure {
    let invocation = data::invocation("test.points/1", json!({"rows": 1000}), None);
    let points = engine
        .call(&invocation, &unwatched())
        .expect("points")
        .outputs[0]
        .1
        .clone();
    let invocation = data::invocation("test.scale/1", json!({}), Some(&points));
    measure(name, || {
        let called = engine.call(&invocation, &unwatched()).expect("a call");
        format!("rows={}", called.outputs[0].1.header().rows())
    })
}

/// A call in a worker that sees its 80 MB of input for the first time and writes 80 MB.
fn fresh(name: &str, engine: &Engine) -> Figure {
    let points = json!({"rows": 10_000_000});
    let points = data::invocation("test.points/1", points, None);
    let mut times = Vec::new();
    for turn in 0..9 {
        let called = engine.call(&points, &unwatched()).expect("points");
        let invocation = data::invocation("test.scale/1", json!({}), Some(&called.outputs[0].1));
        let begin = Instant::now();
        let scaled = engine.call(&invocation, &unwatched()).expect("a call");
        if turn > 1 {
            times.push(begin.elapsed().as_secs_f64());
        }
        drop(scaled);
    }
    figure(name, times, "10000000 rows".into())
}
