//! Cases that are one call of an operation on a table.

use crate::cases::{figure_of, measure};
use crate::data;
use crate::figures::Figure;
use puncta_engine::{Engine, Object};
use puncta_tests::unwatched;
use serde_json::{Value, json};

/// A case: its name, the operation, its parameters as JSON, and the file with the table.
type Case = (&'static str, &'static str, &'static str, &'static str);

/// The cases, by operation.
pub const CALLS: &[Case] = &[
    (
        "frc_58844",
        "puncta.frc.table/1",
        r#"{"pixel_size": 10, "split": "random", "repeats": 1, "x_min": 15000, "x_max": 25000, "y_min": 15000, "y_max": 25000}"#,
        "sim_1000000_locs.hdf5",
    ),
    (
        "frc_1000000_40um",
        "puncta.frc.table/1",
        r#"{"pixel_size": 10, "split": "random_blocks", "repeats": 1}"#,
        "sim_1000000_locs.hdf5",
    ),
    (
        "nena_1000000",
        "puncta.precision.nena/1",
        "{}",
        "sim_1000000_locs.hdf5",
    ),
    (
        "link_1000000",
        "puncta.chaining.find/1",
        r#"{"radius": 40, "gap": 1}"#,
        "sim_1000000.csv",
    ),
    (
        "link_1000000_combined",
        "puncta.chaining.find/1",
        "{}",
        "sim_1000000.csv",
    ),
    (
        "link_10000000",
        "puncta.chaining.find/1",
        r#"{"radius": 40, "gap": 1}"#,
        "sim_10000000.csv",
    ),
    (
        "dbscan_1000000_eps20_min10",
        "puncta.cluster.dbscan/1",
        r#"{"eps": 20, "min_points": 10}"#,
        "sim_1000000.csv",
    ),
    (
        "dbscan_10000000_eps8_min10",
        "puncta.cluster.dbscan/1",
        r#"{"eps": 8, "min_points": 10}"#,
        "sim_10000000.csv",
    ),
    (
        "hdbscan_100000_min10",
        "puncta.cluster.hdbscan/1",
        r#"{"min_size": 10}"#,
        "sim_100000.csv",
    ),
    (
        "tessellation_1000000",
        "puncta.cluster.tessellation/1",
        "{}",
        "sim_1000000.csv",
    ),
    (
        "quadtree_render_1000000_10nm",
        "puncta.render.quadtree/1",
        "{\"pixel_size\": 10}",
        "sim_1000000_locs.hdf5",
    ),
    (
        "quadtree_render_10000000_10nm",
        "puncta.render.quadtree/1",
        "{\"pixel_size\": 10}",
        "sim_10000000_locs.hdf5",
    ),
    (
        "triangles_render_100000_10nm",
        "puncta.render.triangulation/1",
        "{\"pixel_size\": 10}",
        "sim_100000_locs.hdf5",
    ),
    (
        "triangles_render_1000000_10nm",
        "puncta.render.triangulation/1",
        "{\"pixel_size\": 10}",
        "sim_1000000_locs.hdf5",
    ),
    // The peers' patterns are others of as many points.
    (
        "ripleyK_100000",
        "puncta.ripley.k/1",
        r#"{"edges": "none"}"#,
        "sim_100000.csv",
    ),
    (
        "ripleyK_edges_100000",
        "puncta.ripley.k/1",
        "{}",
        "sim_100000.csv",
    ),
    (
        "pairhist_100000",
        "puncta.ripley.pairs/1",
        "{}",
        "sim_100000.csv",
    ),
    (
        "nn_1000000",
        "puncta.ripley.density/1",
        r#"{"radius": 1}"#,
        "sim_1000000.csv",
    ),
    (
        "nn_functions_1000000",
        "puncta.ripley.nearest/1",
        "{}",
        "sim_1000000.csv",
    ),
    (
        "drift_1000000",
        "puncta.drift.auto/1",
        "{}",
        "sim_1000000_drift_locs.hdf5",
    ),
    (
        "drift_100000",
        "puncta.drift.auto/1",
        "{}",
        "sim_100000_drift_locs.hdf5",
    ),
    (
        "drift_10000000",
        "puncta.drift.auto/1",
        "{}",
        "sim_10000000_drift_locs.hdf5",
    ),
    (
        "drift_1000000_aim",
        "puncta.drift.aim/1",
        "{}",
        "sim_1000000_drift_locs.hdf5",
    ),
    (
        "drift_1000000_rcc",
        "puncta.drift.rcc/1",
        "{}",
        "sim_1000000_drift_locs.hdf5",
    ),
];

/// Runs a case of [`CALLS`]. Its digest: the rows of each output and the numbers of each report.
pub fn run(case: &Case, engine: &Engine) -> Figure {
    let (name, operation, parameters, file) = case;
    let table = data::read(engine, file);
    let parameters: Value = serde_json::from_str(parameters).expect("parameters");
    let invocation = data::invocation(operation, parameters, Some(&table));
    let mut prepared = engine.prepare(&invocation, &unwatched()).expect("a plan");
    let mut outputs = Vec::new();
    let figure = measure(name, || {
        outputs.clear();
        outputs = prepared.run(&unwatched()).expect("a result");
        String::new()
    });
    let digest: Vec<String> = outputs
        .iter()
        .map(|(port, object)| format!("{port}:{}", summary(object)))
        .collect();
    figure_of(figure, digest.join(";"))
}

/// Rows of an object, or the numbers of a report.
pub fn summary(object: &Object) -> String {
    match &object.header().document {
        Some(document) => document
            .get("values")
            .and_then(Value::as_array)
            .into_iter()
            .flatten()
            .map(|value| format!("{}={}", value["name"], value["value"]))
            .collect::<Vec<_>>()
            .join(","),
        None => format!("rows={}", json!(object.header().rows())),
    }
}
