//! `puncta.mesh.measures/1`

use crate::exchange::{plan, port, raw};
use puncta_sdk::prelude::*;
use puncta_sdk::serde_json::json;
use puncta_shared_mesh::check::check;
use puncta_shared_mesh::curvature::{Method, curvatures};
use puncta_shared_mesh::energy::{Membrane, bending_energy};
use puncta_shared_mesh::measure::edge_lengths;
use puncta_shared_mesh::topology::describe;
use puncta_shared_mesh::vector::{area_vector, norm};
use puncta_shared_mesh::{Mesh, Point};

/// Measures a mesh.
#[derive(Params)]
pub struct Measures {
    /// Bending rigidity of the membrane, in the unit that the energy shall have (20 in k T).
    #[param(default = 1.0, min = 0.0, max = 1e9)]
    pub rigidity: f64,
    /// Saddle splay modulus, in the same unit.
    #[param(default = 0.0, min = -1e9, max = 1e9)]
    pub saddle_splay: f64,
    /// Spontaneous curvature of the membrane.
    #[param(default = 0.0, min = -1e3, max = 1e3, unit = "nm^-1")]
    pub spontaneous: f64,
}

impl Operation for Measures {
    const ID: &'static str = "puncta.mesh.measures/1";

    fn info() -> Info {
        Info::operation("Mesh measures")
            .description(
                "Reports area, volume, components, genus, Euler characteristic, bending energy, \
                 lengths of edges and defects.\nThe bending energy is that of Helfrich: a sphere \
                 has 8 pi times the rigidity at any radius. Of a mesh that is no oriented manifold \
                 only area and defects are reported.",
            )
            .input(port().description("Any mesh"))
            .output(Ports::report("report").description("The measures"))
            .cite("10.1515/znc-1973-11-1209")
            .example(json!({}))
            .example_input("mesh", "puncta.mesh.shape/1", json!({ "edge": 20 }))
    }

    fn prepare(&self, request: &Request) -> Result<Plan, Failure> {
        Ok(plan::<Self>(request, false))
    }

    fn run(&self, job: &Job) -> Result<(), Failure> {
        let (positions, triangles) = raw(job)?;
        job.progress(0.0, "checking the triangles")?;
        let mut report = Report::new("report");
        report.number("vertices", positions.len() as f64, "1");
        report.number("triangles", triangles.len() as f64, "1");
        report.number("area", area(&positions, &triangles), "nm^2");
        let defects = check(&positions, &triangles);
        if defects.is_manifold() {
            self.measure(job, &mut report, Mesh::new(positions, &triangles)?)?;
        } else {
            job.warn("the mesh is no oriented manifold: repair it for volume, genus and energy");
        }
        for (name, count) in [
            ("boundary_edges", defects.boundary_edges),
            ("unused_vertices", defects.unused),
            ("not_finite_vertices", defects.not_finite),
            ("bad_indices", defects.bad_index),
            ("degenerate_triangles", defects.degenerate),
            ("duplicate_triangles", defects.duplicate),
            ("non_manifold_edges", defects.non_manifold_edges),
            ("non_manifold_vertices", defects.non_manifold_vertices),
            ("flipped_edges", defects.flipped_edges),
        ] {
            report.number(name, count as f64, "1");
        }
        job.report(&report)
    }
}

impl Measures {
    fn measure(&self, job: &Job, report: &mut Report, mesh: Mesh) -> Result<(), Failure> {
        job.progress(0.2, "measuring components")?;
        let (all, _) = describe(&mesh);
        let closed = all.iter().filter(|one| one.loops == 0);
        let volume = closed.map(|one| one.volume).sum::<f64>();
        report.number("volume", volume, "nm^3");
        let total = |value: fn(&_) -> i64| all.iter().map(value).sum::<i64>() as f64;
        report.number("components", all.len() as f64, "1");
        report.number("boundary_loops", total(|one| one.loops as i64), "1");
        report.number("euler", total(|one| one.euler), "1");
        report.number("genus", total(|one| one.genus), "1");
        job.progress(0.4, "estimating curvature")?;
        let curvatures = curvatures(&mesh, Method::default(), job)?;
        let membrane = Membrane {
            rigidity: self.rigidity,
            saddle_splay: self.saddle_splay,
            spontaneous: self.spontaneous,
        };
        let energy = bending_energy(&mesh, &curvatures, membrane, job)?;
        report.number("bending_energy", energy, "1");
        let edges = edge_lengths(&mesh, job)?;
        report.number("edges", edges.count as f64, "1");
        for (name, length) in [
            ("edge_min", edges.least),
            ("edge_median", edges.median),
            ("edge_mean", edges.mean),
            ("edge_deviation", edges.deviation),
            ("edge_max", edges.most),
        ] {
            report.number(name, length, "nm");
        }
        Ok(())
    }
}

/// Area of those triangles that have one.
fn area(positions: &[Point], triangles: &[[u32; 3]]) -> f64 {
    let place = |v: u32| positions.get(v as usize).copied();
    let areas = triangles.iter().filter_map(|&[a, b, c]| {
        let area = 0.5 * norm(area_vector([place(a)?, place(b)?, place(c)?]));
        area.is_finite().then_some(area)
    });
    areas.sum()
}

puncta_sdk::register!(Measures);
