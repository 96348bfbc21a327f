//! `puncta.mesh.shape/1`

use crate::exchange::Out;
use puncta_sdk::prelude::*;
use puncta_sdk::serde_json::json;
use puncta_shared_mesh::{Mesh, shapes};
use std::f64::consts::TAU;

/// The shapes.
#[derive(Choice, Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kinds {
    /// A sphere
    Sphere,
    /// A torus around the z axis
    Torus,
    /// A cube, its faces along the axes
    Cube,
}

/// Makes a mesh of a shape of which everything is known.
#[derive(Params)]
pub struct Shape {
    /// The shape, around the origin.
    #[param(default = Kinds::Sphere)]
    pub shape: Kinds,
    /// Radius of the sphere or of the centre line of the torus; half the edge of the cube.
    #[param(default = 100.0, min = 0.001, max = 1e9, unit = "nm")]
    pub radius: f64,
    /// Radius of the tube of the torus.
    #[param(default = 30.0, min = 0.001, max = 1e9, unit = "nm")]
    pub tube: f64,
    /// Length that edges shall have, roughly.
    #[param(default = 10.0, min = 0.0001, max = 1e9, unit = "nm")]
    pub edge: f64,
}

/// Most triangles of a shape.
const MOST: f64 = 2e7;

impl Shape {
    fn mesh(&self) -> Result<Mesh, Failure> {
        let cells = |length: f64| (length / self.edge).ceil().clamp(3.0, 1e9);
        let (triangles, too_few) = match self.shape {
            // An icosahedron's edge is 1.05 radii, and halved at each level.
            Kinds::Sphere => {
                let levels = (1.05 * self.radius / self.edge).log2().round().max(0.0);
                (20.0 * 4f64.powf(levels), levels)
            }
            Kinds::Torus => (
                2.0 * cells(TAU * (self.radius + self.tube)) * cells(TAU * self.tube),
                0.0,
            ),
            Kinds::Cube => (
                12.0 * (2.0 * self.radius / self.edge).ceil().max(1.0).powi(2),
                0.0,
            ),
        };
        if triangles > MOST {
            let message = format!(
                "edges of {} nm would give {triangles:.1e} triangles",
                self.edge
            );
            return Err(Failure::bad_parameter("edge", message).remedy("choose longer edges"));
        }
        let (positions, triangles) = match self.shape {
            Kinds::Sphere => shapes::sphere(self.radius, too_few as u32),
            Kinds::Torus => {
                let around = cells(TAU * (self.radius + self.tube)) as u32;
                shapes::torus(
                    self.radius,
                    self.tube,
                    around,
                    cells(TAU * self.tube) as u32,
                )
            }
            Kinds::Cube => {
                let along = (2.0 * self.radius / self.edge).ceil().max(1.0);
                shapes::cube(2.0 * self.radius, along as u32)
            }
        };
        Mesh::new(positions, &triangles)
    }
}

impl Operation for Shape {
    const ID: &'static str = "puncta.mesh.shape/1";

    fn info() -> Info {
        Info::operation("Mesh of a shape")
            .description(
                "Makes a sphere, torus or cube of triangles.\nVertices lie exactly on the shape, \
                 so that area, volume and curvature can be compared with what they are.",
            )
            .output(Ports::mesh("mesh").description("The shape"))
            .example(json!({ "shape": "torus" }))
    }

    fn prepare(&self, _: &Request) -> Result<Plan, Failure> {
        if self.shape == Kinds::Torus && self.tube >= self.radius {
            let message = "the tube of the torus must be thinner than its ring";
            return Err(Failure::bad_parameter("tube", message));
        }
        Ok(Plan {
            interruptible: true,
            ..Plan::default()
        })
    }

    fn run(&self, job: &Job) -> Result<(), Failure> {
        job.progress(0.0, "making the shape")?;
        let out = Out {
            mesh: &self.mesh()?,
            origin: None,
            columns: Vec::new(),
        };
        out.give(job)
    }
}

puncta_sdk::register!(Shape);
