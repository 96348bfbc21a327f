//! `puncta.mesh.repair/1`

use crate::exchange::{Out, plan, port, raw};
use puncta_sdk::prelude::*;
use puncta_sdk::serde_json::json;
use puncta_shared_mesh::repair::{Mended, repair};

/// Mends a mesh, and says what was wrong.
#[derive(Params)]
pub struct Repair {
    /// Vertices at most this far apart become one.
    #[param(default = 0.0, min = 0.0, max = 1e9, unit = "nm")]
    pub merge_distance: f64,
    /// Holes of up to this many edges are filled; 0 fills none.
    #[param(default = 100, max = 1000000)]
    pub fill_edges: u32,
    /// Turn closed components outwards, and those inside another inwards.
    #[param(default = true)]
    pub turn: bool,
}

impl Operation for Repair {
    const ID: &'static str = "puncta.mesh.repair/1";

    fn info() -> Info {
        Info::operation("Repair mesh")
            .description(
                "Makes a closed or open, oriented 2-manifold of any triangles.\nTriangles that \
                 cannot be used go, equal vertices become one, winding is made the same, sheets \
                 that meet in an edge or a vertex are parted, and holes are filled. The report \
                 counts what was found and done.",
            )
            .input(port().description("Any mesh"))
            .output(Ports::mesh("mesh").description("The mended mesh, with its columns"))
            .output(Ports::report("report").description("Defects found and what was mended"))
            .cite("10.1109/2945.928166")
            .example(json!({}))
            .example_input("mesh", "puncta.mesh.shape/1", json!({ "edge": 20 }))
    }

    fn prepare(&self, request: &Request) -> Result<Plan, Failure> {
        Ok(plan::<Self>(request, true))
    }

    fn run(&self, job: &Job) -> Result<(), Failure> {
        let (positions, triangles) = raw(job)?;
        let how = puncta_shared_mesh::repair::Repair {
            merge_distance: self.merge_distance,
            fill_edges: self.fill_edges as usize,
            turn: self.turn,
        };
        let (mesh, origin, mended) = repair(&positions, &triangles, how, job)?;
        let out = Out {
            mesh: &mesh,
            origin: Some(&origin),
            columns: Vec::new(),
        };
        out.give(job)?;
        job.report(&report(&mended))
    }
}

fn report(mended: &Mended) -> Report {
    let found = mended.found;
    let mut report = Report::new("report");
    for (name, value) in [
        ("found_not_finite_vertices", found.not_finite),
        ("found_unused_vertices", found.unused),
        ("found_bad_indices", found.bad_index),
        ("found_degenerate_triangles", found.degenerate),
        ("found_duplicate_triangles", found.duplicate),
        ("found_boundary_edges", found.boundary_edges),
        ("found_non_manifold_edges", found.non_manifold_edges),
        ("found_flipped_edges", found.flipped_edges),
        ("found_non_manifold_vertices", found.non_manifold_vertices),
        ("merged_vertices", mended.merged),
        ("dropped_triangles", mended.dropped),
        ("turned_triangles", mended.turned),
        ("parted_edges", mended.parted),
        ("copied_vertices", mended.copied),
        ("flattened_triangles", mended.flattened),
        ("filled_holes", mended.filled),
        ("holes_left", mended.holes),
        ("reversed_components", mended.reversed),
    ] {
        report.number(name, value as f64, "1");
    }
    report
}

puncta_sdk::register!(Repair);
