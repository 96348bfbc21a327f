//! Cases of surfaces: from localisations that the bench makes to meshes and distances.

use crate::calls::summary;
use crate::cases::{figure_of, measure};
use crate::data;
use crate::figures::Figure;
use puncta_engine::{Engine, Object};
use puncta_tests::unwatched;
use serde_json::{Value, json};

/// Names of the cases: surfaces of shells of so many points, the same with repair, remeshing and
/// curvature, and distances of points near a mesh (15 nm) and far from it (500 nm).
pub const NAMES: &[&str] = &[
    "isosurface_points_100000",
    "isosurface_points_200000",
    "isosurface_points_1000000",
    "isosurface_points_10000000",
    "measured_surface_100000",
    "measured_surface_1700000",
    "measured_surface_10000000",
    "mesh_distance_100000_200000",
    "mesh_distance_1000000_200000",
    "mesh_distance_far_1000000_200000",
    "mesh_distance_10000000_200000",
];

/// Runs a case of [`NAMES`].
pub fn run(name: &str, engine: &Engine) -> Figure {
    let mut numbers = name.split('_').filter_map(|word| word.parse::<u64>().ok());
    let count = numbers.next().expect("a number in the case's name");
    if name.starts_with("mesh_distance") {
        let far = name.contains("far");
        return distance(name, engine, count, if far { 500.0 } else { 15.0 });
    }
    let mut steps = vec!["puncta.isosurface.octree/1"];
    if name.starts_with("measured") {
        steps.extend([
            "puncta.mesh.repair/1",
            "puncta.mesh.remesh/1",
            "puncta.mesh.curvature/1",
        ]);
    }
    chain(name, engine, &shell(engine, count), &steps)
}

/// The first output of a call.
fn first(
    engine: &Engine,
    operation: &str,
    parameters: Value,
    inputs: &[(&str, &Object)],
) -> Object {
    let invocation = data::bound(operation, parameters, inputs);
    let called = engine.call(&invocation, &unwatched()).expect("a result");
    called.outputs.into_iter().next().expect("an output").1
}

/// A spherical shell with errors of 15 nm, as dense for any count as the peers' of 200 000 points on
/// a radius of 1500 nm.
fn shell(engine: &Engine, count: u64) -> Object {
    let radius = 1500.0 * (count as f64 / 200_000.0).sqrt();
    let sphere = json!({"shape": "sphere", "radius": radius, "edge": radius / 100.0});
    let sphere = first(engine, "puncta.mesh.shape/1", sphere, &[]);
    let points = json!({"count": count, "noise": 15, "seed": "3"});
    first(engine, "puncta.mesh.points/1", points, &[("mesh", &sphere)])
}

/// Calls one after the other, each on the first output of the one before.
fn chain(name: &str, engine: &Engine, table: &Object, steps: &[&str]) -> Figure {
    let mut digest = String::new();
    let figure = measure(name, || {
        let mut at = ("table", table.clone());
        digest.clear();
        for step in steps {
            let invocation = data::bound(step, json!({}), &[(at.0, &at.1)]);
            let called = engine.call(&invocation, &unwatched()).expect("a result");
            for (port, object) in &called.outputs {
                digest.push_str(&format!("{port}:{};", summary(object)));
            }
            at = ("mesh", called.outputs.into_iter().next().expect("a mesh").1);
        }
        String::new()
    });
    figure_of(figure, digest)
}

/// Signed distances of points about a torus of 200 thousand triangles.
fn distance(name: &str, engine: &Engine, count: u64, noise: f64) -> Figure {
    let torus = json!({"shape": "torus", "radius": 1000, "tube": 400, "edge": 14.87});
    let torus = first(engine, "puncta.mesh.shape/1", torus, &[]);
    let points = json!({"count": count, "noise": noise, "seed": "3"});
    let points = first(engine, "puncta.mesh.points/1", points, &[("mesh", &torus)]);
    let inputs = [("table", &points), ("mesh", &torus)];
    let invocation = data::bound("puncta.mesh.distance/1", json!({}), &inputs);
    let mut prepared = engine.prepare(&invocation, &unwatched()).expect("a plan");
    let mut last = None;
    let figure = measure(name, || {
        last = prepared
            .run(&unwatched())
            .expect("distances")
            .into_iter()
            .next();
        String::new()
    });
    let (_, table) = last.expect("a table");
    let distances = data::column(&table, "distance_to_mesh");
    let inside = distances.iter().filter(|distance| **distance < 0.0).count();
    let sum: f64 = distances.iter().map(|distance| distance.abs()).sum();
    let triangles = torus.header().parts.get(1).map_or(0, |part| part.rows);
    let digest = format!("triangles={triangles};inside={inside};sum={sum:.3}");
    figure_of(figure, digest)
}
