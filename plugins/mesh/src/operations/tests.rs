//! The operations as the host calls them.

use super::components::Components;
use super::curvature::Curvature;
use super::decimate::Decimate;
use super::distance::Distance;
use super::measures::Measures;
use super::points::Points;
use super::remesh::Remesh;
use super::repair::Repair;
use super::shape::Shape;
use super::smooth::Smooth;
use super::subdivide::Subdivide;
use puncta_sdk::documents::Element;
use puncta_sdk::output::ColumnMut;
use puncta_sdk::prelude::*;
use puncta_testkit::{Call, Done, Object, Table};
use std::f64::consts::PI;

fn shape(name: &str, edge: f64) -> Object {
    let call = Call::of::<Shape>().set("shape", name).set("edge", edge);
    call.run().unwrap().output("mesh").unwrap().clone()
}

/// A torus with everything wrong that a mesh can have, and a column of its own.
#[derive(Params)]
struct Broken {}

impl Operation for Broken {
    const ID: &'static str = "test.broken/1";

    fn info() -> Info {
        Info::operation("Broken").output(Ports::mesh("mesh"))
    }

    fn run(&self, job: &Job) -> Result<(), Failure> {
        let (positions, mut triangles) = puncta_shared_mesh::shapes::torus(100.0, 30.0, 40, 12);
        triangles[10].swap(0, 1);
        triangles.remove(500);
        triangles.push(triangles[20]);
        triangles.push([3, 3, 4]);
        triangles.push([3, 4, 70_000]);
        let mut columns = crate::exchange::positions();
        columns.push(ColumnInfo::new("mark", Element::U16, "1"));
        let rows = (positions.len() as u64, triangles.len() as u64);
        let mut out = job.begin("mesh", Header::mesh("bad", columns, rows.0, rows.1))?;
        for (axis, column) in out.columns_mut(0)?.into_iter().enumerate() {
            match column {
                ColumnMut::F64(values) => {
                    let places = positions.iter().map(|p| p[axis]);
                    values.iter_mut().zip(places).for_each(|(v, p)| *v = p);
                }
                ColumnMut::U16(values) => {
                    values.iter_mut().zip(0..).for_each(|(v, i)| *v = i);
                }
                _ => return Err(Failure::internal("another type")),
            }
        }
        for (corner, column) in out.columns_mut(1)?.into_iter().enumerate() {
            if let ColumnMut::U32(values) = column {
                let corners = triangles.iter().map(|t| t[corner]);
                values.iter_mut().zip(corners).for_each(|(v, c)| *v = c);
            }
        }
        out.finish()
    }
}

fn value(done: &Done, name: &str) -> f64 {
    done.value(name).unwrap_or(f64::NAN)
}

fn measures(mesh: &Object) -> Done {
    Call::of::<Measures>()
        .input("mesh", mesh.clone())
        .run()
        .unwrap()
}

#[test]
fn measures_of_shapes() {
    let sphere = measures(&shape("sphere", 8.0));
    assert!((value(&sphere, "area") / (4.0 * PI * 1e4) - 1.0).abs() < 0.005);
    assert!((value(&sphere, "volume") / (4.0 / 3.0 * PI * 1e6) - 1.0).abs() < 0.005);
    assert!((value(&sphere, "bending_energy") / (8.0 * PI) - 1.0).abs() < 0.02);
    assert_eq!(
        (value(&sphere, "euler"), value(&sphere, "genus")),
        (2.0, 0.0)
    );
    let torus = measures(&shape("torus", 8.0));
    assert_eq!((value(&torus, "euler"), value(&torus, "genus")), (0.0, 1.0));
    let cube = measures(&shape("cube", 50.0));
    assert_eq!(
        (value(&cube, "area"), value(&cube, "components")),
        (24e4, 1.0)
    );
    assert!((value(&cube, "volume") - 8e6).abs() < 1e-6);
    assert_eq!(value(&cube, "boundary_edges"), 0.0);
}

#[test]
fn repair_mends_and_keeps_columns() {
    let done = Call::of::<Broken>().run().unwrap();
    let bad = done.output("mesh").unwrap().clone();
    let found = measures(&bad);
    assert!(value(&found, "volume").is_nan() && value(&found, "bad_indices") == 1.0);
    for refused in [
        Call::of::<Remesh>().input("mesh", bad.clone()).run(),
        Call::of::<Curvature>().input("mesh", bad.clone()).run(),
    ] {
        assert!(refused.unwrap_err().to_string().contains("repair"));
    }
    let done = Call::of::<Repair>().input("mesh", bad).run().unwrap();
    assert_eq!(value(&done, "dropped_triangles"), 3.0);
    assert_eq!(value(&done, "turned_triangles"), 1.0);
    assert_eq!(value(&done, "filled_holes"), 1.0);
    let mesh = done.output("mesh").unwrap();
    assert_eq!(value(&measures(mesh), "genus"), 1.0);
    let marks = mesh
        .numbers(0, "mark", Element::U16, u16::from_ne_bytes)
        .unwrap();
    assert_eq!(marks, (0..480).collect::<Vec<u16>>());
}

#[test]
fn each_mesh_operation_gives_a_sound_mesh() {
    let torus = shape("torus", 6.0);
    let all = [
        Call::of::<Remesh>().set("edge", 5.0),
        Call::of::<Smooth>(),
        Call::of::<Smooth>().set("method", "fit"),
        Call::of::<Subdivide>(),
        Call::of::<Decimate>().set("fraction", 0.3),
        Call::of::<Components>().set("largest", 1),
        Call::of::<Curvature>(),
        Call::of::<Repair>(),
    ];
    for call in all {
        let done = call.input("mesh", torus.clone()).run().unwrap();
        let found = measures(done.output("mesh").unwrap());
        assert_eq!(
            (value(&found, "genus"), value(&found, "boundary_edges")),
            (1.0, 0.0)
        );
        let truth = 2.0 * PI * PI * 100.0 * 900.0;
        assert!((value(&found, "volume") / truth - 1.0).abs() < 0.03);
    }
}

#[test]
fn curvature_is_a_column() {
    let done = Call::of::<Curvature>()
        .input("mesh", shape("sphere", 10.0))
        .run()
        .unwrap();
    let mesh = done.output("mesh").unwrap();
    for (name, truth) in [
        ("curvature_mean", 0.01),
        ("curvature_gaussian", 1e-4),
        ("curvature_principal0", 0.01),
        ("curvature_principal1", 0.01),
    ] {
        let values = mesh.f64(name).unwrap();
        assert!(
            values.iter().all(|k| (k / truth - 1.0).abs() < 0.01),
            "{name}"
        );
    }
}

#[test]
fn distances_are_a_column_of_the_table() {
    let table = Table::new("locs")
        .f64("x", "nm", &[0.0, 150.0, f64::NAN])
        .f64("y", "nm", &[0.0; 3])
        .f64("z", "nm", &[30.0, 0.0, 0.0]);
    let call = || Call::of::<Distance>().input("table", table.clone());
    let cube = shape("cube", 25.0);
    let done = call().input("mesh", cube.clone()).run().unwrap();
    let found = done
        .output("table")
        .unwrap()
        .f64("distance_to_mesh")
        .unwrap();
    assert_eq!(found[..2], [-70.0, 50.0]);
    assert!(found[2].is_nan());
    let done = call()
        .input("mesh", cube)
        .set("sign", "never")
        .set("name", "d")
        .run();
    assert_eq!(
        done.unwrap().output("table").unwrap().f64("d").unwrap()[0],
        70.0
    );
}

#[test]
fn points_lie_on_the_mesh() {
    let call = || Call::of::<Points>().input("mesh", shape("cube", 40.0));
    let done = call().set("count", 500).run().unwrap();
    let points = done.output("points").unwrap();
    let axes = ["x", "y", "z"].map(|axis| points.f64(axis).unwrap());
    for i in 0..500 {
        let most = axes.iter().map(|axis| axis[i].abs()).fold(0.0, f64::max);
        assert!((most - 100.0).abs() < 1e-9);
    }
    let by_density = call().set("density", 0.001).run().unwrap();
    assert_eq!(by_density.output("points").unwrap().header.rows(), 240);
    assert!(call().set("density", 1e6).run().is_err());
}

#[test]
fn bad_values_are_refused_and_cancel_is_heard() {
    let torus = shape("torus", 20.0);
    let refused = |call: Call, word: &str| {
        let text = call
            .input("mesh", torus.clone())
            .run()
            .unwrap_err()
            .to_string();
        assert!(text.contains(word), "{text}");
    };
    refused(Call::of::<Remesh>().set("edge", 0.0001), "triangles");
    refused(Call::of::<Subdivide>().set("levels", 9), "levels");
    let thick = Call::of::<Shape>()
        .set("shape", "torus")
        .set("tube", 200.0)
        .run();
    assert!(thick.unwrap_err().to_string().contains("tube"));
    let fine = Call::of::<Shape>().set("edge", 0.001).run();
    assert!(fine.unwrap_err().to_string().contains("triangles"));
    let stopped = Call::of::<Remesh>().set("edge", 5.0).cancel_after(3);
    let stopped = stopped.input("mesh", torus).run().unwrap_err();
    assert!(stopped.is_cancelled());
}
