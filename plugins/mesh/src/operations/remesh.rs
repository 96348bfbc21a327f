//! `puncta.mesh.remesh/1`

use crate::exchange::{Out, plan, port, read};
use puncta_sdk::prelude::*;
use puncta_sdk::serde_json::json;
use puncta_shared_mesh::measure::edge_lengths;
use puncta_shared_mesh::remesh::{Remeshing, remesh};

/// Gives a mesh edges of one length.
#[derive(Params)]
pub struct Remesh {
    /// Length that edges shall have; the mean of the input if it is not given.
    #[param(min = 0.0001, max = 1e9, unit = "nm")]
    pub edge: Option<f64>,
    /// Rounds of splitting, collapsing, flipping and relaxing.
    #[param(default = 5, max = 100)]
    pub rounds: u32,
    /// Relaxation steps in each round.
    #[param(default = 3, max = 100)]
    pub relaxations: u32,
    /// Keep vertices on the smooth surface through the vertices of the input.
    #[param(default = true)]
    pub project: bool,
}

impl Operation for Remesh {
    const ID: &'static str = "puncta.mesh.remesh/1";

    fn info() -> Info {
        Info::operation("Remesh")
            .description(
                "Gives a mesh triangles of one size with about six neighbours each (Botsch and \
                 Kobbelt, 2004).\nNew vertices lie on a curved surface through the old ones, so \
                 that volume and curvature stay. Columns of vertices do not go along, except to \
                 be computed again.",
            )
            .input(port().description("An oriented manifold"))
            .output(Ports::mesh("mesh").description("The new mesh"))
            .cite("10.1145/1057432.1057457")
            .example(json!({ "edge": 15 }))
            .example_input("mesh", "puncta.mesh.shape/1", json!({ "edge": 20 }))
    }

    fn prepare(&self, request: &Request) -> Result<Plan, Failure> {
        Ok(plan::<Self>(request, false))
    }

    fn run(&self, job: &Job) -> Result<(), Failure> {
        let mut mesh = read(job)?;
        if !mesh.is_empty() {
            let edge = match self.edge {
                Some(edge) => edge,
                None => edge_lengths(&mesh, job)?.mean,
            };
            let how = Remeshing {
                rounds: self.rounds,
                relaxations: self.relaxations,
                project: self.project,
                ..Remeshing::to(edge)
            };
            remesh(&mut mesh, how, job)?;
        }
        mesh.compact();
        let out = Out {
            mesh: &mesh,
            origin: None,
            columns: Vec::new(),
        };
        out.give(job)
    }
}

puncta_sdk::register!(Remesh);
