//! Files and tables that the cases work on.

use puncta_engine::documents::Map;
use puncta_engine::{Engine, Invocation, Isolation, Object};
use puncta_tests::{Bundle, unwatched};
use serde_json::Value;
use std::path::PathBuf;

/// The product's plugins and the test plugin.
pub fn bundle() -> Bundle {
    Bundle::of(&[
        "puncta_plugin_arrow_io",
        "puncta_plugin_chaining",
        "puncta_plugin_cluster",
        "puncta_plugin_drift",
        "puncta_plugin_filter",
        "puncta_plugin_frc",
        "puncta_plugin_hdf5",
        "puncta_plugin_precision",
        "puncta_plugin_isosurface",
        "puncta_plugin_mesh",
        "puncta_plugin_render",
        "puncta_plugin_ripley",
        "puncta_plugin_text",
        "puncta_test_sample",
    ])
}

/// An engine as a person has it.
pub fn engine(bundle: &Bundle) -> Engine {
    bundle.engine(Isolation::ByPlugin)
}

/// A file of the benchmark's data folder.
pub fn file(name: &str) -> PathBuf {
    let folder = std::env::var_os("BENCH_DATA")
        .map(PathBuf::from)
        .or_else(|| std::env::var_os("HOME").map(|home| PathBuf::from(home).join("smlm-bench")));
    let path = folder.unwrap_or_default().join(name);
    assert!(
        path.exists(),
        "{} is missing; set BENCH_DATA",
        path.display()
    );
    path
}

pub fn map(value: Value) -> Map {
    value.as_object().cloned().unwrap_or_default()
}

/// The first object of a file.
pub fn read(engine: &Engine, name: &str) -> Object {
    let read = engine
        .read(&file(name), None, &Map::new(), &unwatched())
        .expect("the file reads");
    read.object(None).expect("an object").clone()
}

/// A call with one table.
pub fn invocation(operation: &str, parameters: Value, table: Option<&Object>) -> Invocation {
    let inputs: Vec<(&str, &Object)> = table.map(|table| ("table", table)).into_iter().collect();
    bound(operation, parameters, &inputs)
}

/// A call with objects by port.
pub fn bound(operation: &str, parameters: Value, inputs: &[(&str, &Object)]) -> Invocation {
    Invocation {
        operation: operation.into(),
        parameters: map(parameters),
        inputs: inputs
            .iter()
            .map(|(port, object)| ((*port).to_owned(), (*object).clone()))
            .collect(),
        file: None,
    }
}

/// A column of f64.
pub fn column(object: &Object, name: &str) -> Vec<f64> {
    object
        .column(0, name)
        .expect("the column")
        .data
        .expect("numbers")
        .slice::<f64>()
        .to_vec()
}
