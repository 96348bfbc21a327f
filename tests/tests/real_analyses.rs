//! Analyses of real localisations, compared with what other programs make of the same files
//! (`tests/expected/analyses.json`). Files that are not there, or are other files of the same name,
//! are skipped.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use puncta_engine::documents::Map;
use puncta_engine::engine::Invocation;
use puncta_engine::{Engine, Isolation, Object};
use puncta_tests::{Bundle, root, shared_data, unwatched};
use serde_json::{Value, json};

/// One set of localisations, and what it should give.
struct Set<'a> {
    engine: &'a Engine,
    table: Object,
    expected: &'a Value,
    problems: Vec<String>,
}

impl Set<'_> {
    fn deep(&self) -> bool {
        self.expected["axes"] == 3
    }

    fn run(&self, operation: &str, parameters: &Value, table: &Object) -> Vec<(String, Object)> {
        let invocation = Invocation {
            operation: operation.into(),
            parameters: parameters.as_object().cloned().unwrap_or_default(),
            inputs: vec![("table".into(), table.clone())],
            file: None,
        };
        let called = self.engine.call(&invocation, &unwatched());
        called.expect("the operation runs").outputs
    }

    fn near(&mut self, what: &str, ours: f64, theirs: f64, relative: f64) {
        let allowed = relative * theirs.abs().max(1.0);
        if ours.is_nan() || (ours - theirs).abs() > allowed {
            let (file, axes) = (&self.expected["file"], &self.expected["axes"]);
            let problem = format!("{file}, {axes} axes: {what} is {ours}, not {theirs}");
            self.problems.push(problem);
        }
    }

    /// Nearest neighbours; distances are those of f64 positions, summed in another order.
    fn nearest(&mut self) {
        let mut parameters = json!({ "k": 1 });
        if self.deep() {
            parameters["z"] = json!("z");
        }
        let outputs = self.run("puncta.ripley.density/1", &parameters, &self.table);
        let mut distances = f64s(output(&outputs, "table"), "nn_distance");
        distances.retain(|distance| distance.is_finite());
        distances.sort_by(f64::total_cmp);
        let count = distances.len();
        let mean = distances.iter().sum::<f64>() / count as f64;
        let median = f64::midpoint(distances[(count - 1) / 2], distances[count / 2]);
        self.near("rows", count as f64, number(&self.expected["rows"]), 0.0);
        let theirs = [
            &self.expected["nearest_mean"],
            &self.expected["nearest_median"],
        ]
        .map(number);
        self.near("mean distance", mean, theirs[0], 1e-9);
        self.near("median distance", median, theirs[1], 1e-9);
    }

    /// Counts are exact; who gets a border point that two clusters could have is not compared.
    fn dbscan(&mut self) {
        for expected in self.expected["dbscan"].as_array().unwrap() {
            let mut parameters = json!({
                "eps": expected["eps"], "min_points": expected["min_points"],
            });
            if self.deep() {
                parameters["eps_z"] = expected["eps"].clone();
            }
            let outputs = self.run("puncta.cluster.dbscan/1", &parameters, &self.table);
            let report = output(&outputs, "report");
            for name in ["clusters", "noise", "core"] {
                let what = format!("{name} within {}", expected["eps"]);
                self.near(&what, reported(report, name), number(&expected[name]), 0.0);
            }
        }
    }

    /// The hull of everything, as that of one cluster.
    fn hull(&mut self) {
        let mut parameters = json!({ "eps": 1e6, "min_points": 1 });
        if self.deep() {
            parameters["eps_z"] = json!(1e6);
        }
        let outputs = self.run("puncta.cluster.dbscan/1", &parameters, &self.table);
        let one = output(&outputs, "table").clone();
        let outputs = self.run(
            "puncta.cluster.measures/1",
            &json!({ "axial": self.deep() }),
            &one,
        );
        let clusters = output(&outputs, "clusters");
        let (size, rim) = if self.deep() {
            ("hull_volume", "hull_surface")
        } else {
            ("hull_area", "hull_perimeter")
        };
        for (ours, theirs) in [(size, "hull_size"), (rim, "hull_rim")] {
            let theirs = number(&self.expected[theirs]);
            self.near(ours, f64s(clusters, ours)[0], theirs, 1e-9);
        }
    }

    /// L - r without edge correction, in the bounding box.
    fn ripley(&mut self) {
        let parameters = json!({ "step": 10, "r_max": 500, "edges": "none" });
        let outputs = self.run("puncta.ripley.k/1", &parameters, &self.table);
        let found = f64s(output(&outputs, "curve"), "h");
        let lists = ["radii", "l_minus_r"].map(|name| self.expected[name].as_array().unwrap());
        for (r, theirs) in lists[0].iter().zip(lists[1]) {
            let ours = found[(number(r) / 10.0).round() as usize - 1];
            // A pair whose distance is a radius to within rounding may fall on either side.
            self.near(&format!("L - r at {r} nm"), ours, number(theirs), 1e-5);
        }
    }

    fn pixels(&mut self) {
        let expected = &self.expected["pixels"];
        let parameters = json!({ "pixel_size": expected["size"] });
        let outputs = self.run("puncta.render.histogram/1", &parameters, &self.table);
        let column = output(&outputs, "image").column(0, "value").unwrap();
        let values = column.data.as_ref().unwrap().slice::<f32>().to_vec();
        let set = values.iter().filter(|value| **value > 0.0).count() as f64;
        let most = f64::from(values.iter().copied().fold(0.0, f32::max));
        let sum: f64 = values.iter().copied().map(f64::from).sum();
        let theirs = [&expected["set"], &expected["most"], &self.expected["rows"]].map(number);
        for (what, ours, theirs) in [
            ("pixels with localisations", set, theirs[0]),
            ("fullest pixel", most, theirs[1]),
            ("sum of the pixels", sum, theirs[2]),
        ] {
            self.near(what, ours, theirs, 0.0);
        }
    }
}

fn output<'a>(outputs: &'a [(String, Object)], port: &str) -> &'a Object {
    let found = outputs.iter().find(|(name, _)| name == port);
    &found.expect("the output").1
}

fn f64s(object: &Object, name: &str) -> Vec<f64> {
    let column = object.column(0, name).unwrap();
    column.data.as_ref().unwrap().slice::<f64>().to_vec()
}

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap()
}

fn reported(report: &Object, name: &str) -> f64 {
    let document = report.header().document.clone().unwrap();
    let values = document["values"].as_array().unwrap();
    let found = values.iter().find(|value| value["name"] == name).unwrap();
    number(&found["value"])
}

#[test]
fn real_localisations_as_other_programs_see_them() {
    let Some(data) = shared_data() else { return };
    let text = std::fs::read_to_string(root().join("tests/expected/analyses.json")).unwrap();
    let expected: Value = serde_json::from_str(&text).unwrap();
    let bundle = Bundle::of(&[
        "puncta_plugin_text",
        "puncta_plugin_hdf5",
        "puncta_plugin_cluster",
        "puncta_plugin_render",
        "puncta_plugin_ripley",
    ]);
    let engine = bundle.engine(Isolation::ByPlugin);
    let (mut compared, mut problems) = (0, Vec::new());
    for one in expected["sets"].as_array().unwrap() {
        let path = data.join(one["file"].as_str().unwrap());
        let Ok(bytes) = std::fs::read(&path) else {
            continue;
        };
        if puncta_tests::sha256(&bytes) != one["sha256"].as_str().unwrap() {
            continue;
        }
        let options: Map = one["reader"].as_object().cloned().unwrap_or_default();
        let read = engine.read(&path, None, &options, &unwatched());
        let mut set = Set {
            engine: &engine,
            table: read.unwrap().object(None).unwrap().clone(),
            expected: one,
            problems: Vec::new(),
        };
        set.nearest();
        set.dbscan();
        set.hull();
        if !set.deep() {
            set.ripley();
            set.pixels();
        }
        compared += 1;
        problems.append(&mut set.problems);
    }
    let list = problems.join("\n");
    assert!(
        problems.is_empty(),
        "{} differences:\n{list}",
        problems.len()
    );
    assert!(compared >= 9, "only {compared} sets were compared");
}
