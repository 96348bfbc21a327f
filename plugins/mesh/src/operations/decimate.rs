//! `puncta.mesh.decimate/1`

use crate::exchange::{Out, plan, port, read};
use puncta_sdk::prelude::*;
use puncta_sdk::serde_json::json;
use puncta_shared_mesh::decimate::decimate;

/// Takes triangles away where they change the shape least.
#[derive(Params)]
pub struct Decimate {
    /// Number of triangles to keep; if it is not given, the fraction decides.
    pub triangles: Option<u64>,
    /// Share of the triangles to keep.
    #[param(default = 0.5, min = 0.0, max = 1.0)]
    pub fraction: f64,
    /// Stop where the next step would move the surface by more than this.
    #[param(min = 0.0, max = 1e9, unit = "nm")]
    pub max_error: Option<f64>,
}

impl Operation for Decimate {
    const ID: &'static str = "puncta.mesh.decimate/1";

    fn info() -> Info {
        Info::operation("Decimate mesh")
            .description(
                "Collapses edges, those first that change the shape least (quadric errors, Garland \
                 and Heckbert, 1997).\nTopology and boundary stay. Columns of vertices do not go \
                 along.",
            )
            .input(port().description("An oriented manifold"))
            .output(Ports::mesh("mesh").description("The coarser mesh"))
            .cite("10.1145/258734.258849")
            .example(json!({}))
            .example_input("mesh", "puncta.mesh.shape/1", json!({ "edge": 20 }))
    }

    fn prepare(&self, request: &Request) -> Result<Plan, Failure> {
        Ok(plan::<Self>(request, false))
    }

    fn run(&self, job: &Job) -> Result<(), Failure> {
        let mut mesh = read(job)?;
        let share = (self.fraction * mesh.triangle_count() as f64).round() as usize;
        let target = self.triangles.map_or(share, |count| count as usize);
        let most = self.max_error.unwrap_or(f64::INFINITY);
        decimate(&mut mesh, target, most, job)?;
        let out = Out {
            mesh: &mesh,
            origin: None,
            columns: Vec::new(),
        };
        out.give(job)
    }
}

puncta_sdk::register!(Decimate);
