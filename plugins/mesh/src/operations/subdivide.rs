//! `puncta.mesh.subdivide/1`

use crate::exchange::{Out, plan, port, read};
use puncta_sdk::prelude::*;
use puncta_sdk::serde_json::json;
use puncta_shared_mesh::subdivide::subdivide;

/// Cuts each triangle in four and smooths.
#[derive(Params)]
pub struct Subdivide {
    /// How many times.
    #[param(default = 1, min = 1, max = 8)]
    pub levels: u32,
}

/// Most triangles of the result.
const MOST: u64 = 200_000_000;

impl Operation for Subdivide {
    const ID: &'static str = "puncta.mesh.subdivide/1";

    fn info() -> Info {
        Info::operation("Subdivide mesh")
            .description(
                "Cuts each triangle in four by Loop's scheme, which makes the surface smooth.\n\
                 Columns of vertices do not go along.",
            )
            .input(port().description("An oriented manifold"))
            .output(Ports::mesh("mesh").description("The finer mesh"))
            .cite("C. Loop, Smooth subdivision surfaces based on triangles, Utah, 1987")
            .example(json!({}))
            .example_input("mesh", "puncta.mesh.shape/1", json!({ "edge": 30 }))
    }

    fn prepare(&self, request: &Request) -> Result<Plan, Failure> {
        let parts = request.inputs.first().map(|input| &input.header.parts);
        let triangles = parts
            .and_then(|parts| parts.get(1))
            .map_or(0, |part| part.rows);
        let result = triangles.saturating_mul(4_u64.saturating_pow(self.levels));
        if result > MOST {
            let message = format!("{triangles} triangles would become {result}");
            return Err(Failure::bad_parameter("levels", message).remedy("choose fewer levels"));
        }
        let mut plan = plan::<Self>(request, false);
        plan.memory = plan.memory.saturating_add(result.saturating_mul(100));
        Ok(plan)
    }

    fn run(&self, job: &Job) -> Result<(), Failure> {
        let mut mesh = read(job)?;
        mesh.compact();
        for level in 0..self.levels {
            job.progress(f64::from(level) / f64::from(self.levels), "subdividing")?;
            mesh = subdivide(&mesh, job)?;
        }
        let out = Out {
            mesh: &mesh,
            origin: None,
            columns: Vec::new(),
        };
        out.give(job)
    }
}

puncta_sdk::register!(Subdivide);
