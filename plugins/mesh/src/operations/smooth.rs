//! `puncta.mesh.smooth/1`

use crate::exchange::{Out, plan, port, read};
use puncta_sdk::prelude::*;
use puncta_sdk::serde_json::json;
use puncta_shared_mesh::smooth::{Fitting, Smoothing, fit, smooth};

/// How a mesh is smoothed.
#[derive(Choice, Clone, Copy, Debug, PartialEq, Eq)]
pub enum Methods {
    /// A low-pass filter (Taubin): fast
    Filter,
    /// Each vertex onto a polynomial over its neighbours: keeps curvature
    Fit,
}

/// Smooths a mesh without shrinking it.
#[derive(Params)]
pub struct Smooth {
    /// How the mesh is smoothed.
    #[param(default = Methods::Filter)]
    pub method: Methods,
    /// Number of steps.
    #[param(default = 10, max = 10000)]
    pub steps: u32,
    /// Filter: how far a vertex moves towards the mean of its neighbours, before it swells again.
    #[param(default = 0.5, min = 0.01, max = 1.0)]
    pub strength: f64,
    /// Filter: frequency up to which shape is kept; 0.1 keeps what is wider than about ten edges.
    #[param(default = 0.1, min = 0.01, max = 0.5)]
    pub pass_band: f64,
    /// Fit: degree of the polynomials.
    #[param(default = 3, min = 2, max = 4)]
    pub degree: u32,
    /// Fit: edges between a vertex and the farthest neighbours that its polynomial covers.
    #[param(default = 3, min = 1, max = 8)]
    pub rings: u32,
    /// Bring closed components back to exactly the volume that they had.
    #[param(default = true)]
    pub keep_volume: bool,
}

impl Operation for Smooth {
    const ID: &'static str = "puncta.mesh.smooth/1";

    fn info() -> Info {
        Info::operation("Smooth mesh")
            .description(
                "Takes noise off a mesh without shrinking it, with a low-pass filter (Taubin, 1995) \
                 or by polynomials over the neighbours of each vertex.\nThe polynomials keep \
                 curvature, on unequal triangles too. The boundary moves along itself only, or \
                 stays.",
            )
            .input(port().description("An oriented manifold"))
            .output(Ports::mesh("mesh").description("The smooth mesh, with its columns"))
            .cite("10.1145/218380.218473")
            .example(json!({}))
            .example_input("mesh", "puncta.mesh.shape/1", json!({ "edge": 20 }))
    }

    fn prepare(&self, request: &Request) -> Result<Plan, Failure> {
        Ok(plan::<Self>(request, true))
    }

    fn run(&self, job: &Job) -> Result<(), Failure> {
        let mut mesh = read(job)?;
        match self.method {
            Methods::Filter => {
                let how = Smoothing {
                    steps: self.steps,
                    strength: self.strength,
                    pass_band: self.pass_band,
                    keep_volume: self.keep_volume,
                };
                smooth(&mut mesh, how, job)?;
            }
            Methods::Fit => {
                let how = Fitting {
                    steps: self.steps,
                    degree: self.degree as u8,
                    rings: self.rings as u8,
                    keep_volume: self.keep_volume,
                };
                fit(&mut mesh, how, job)?;
            }
        }
        let origin = mesh.compact();
        let out = Out {
            mesh: &mesh,
            origin: Some(&origin),
            columns: Vec::new(),
        };
        out.give(job)
    }
}

puncta_sdk::register!(Smooth);
