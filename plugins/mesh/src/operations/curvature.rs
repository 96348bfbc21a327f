//! `puncta.mesh.curvature/1`

use crate::exchange::{Out, plan, port, read};
use puncta_sdk::prelude::*;
use puncta_sdk::serde_json::json;
use puncta_shared_mesh::curvature::{Curvature as Value, Method, curvatures};

/// How curvature is estimated.
#[derive(Choice, Clone, Copy, Debug, PartialEq, Eq)]
pub enum Methods {
    /// A polynomial over the neighbours (jet): accurate on irregular meshes
    Jet,
    /// The curvature tensor of the direct neighbours: fast
    Tensor,
}

/// Adds curvature to the vertices of a mesh.
#[derive(Params)]
pub struct Curvature {
    /// How curvature is estimated.
    #[param(default = Methods::Jet)]
    pub method: Methods,
    /// Degree of the polynomial: 2 for noisy meshes, 4 for smooth ones.
    #[param(default = 4, min = 2, max = 4)]
    pub degree: u32,
    /// Edges between a vertex and the farthest neighbours that the polynomial covers.
    #[param(default = 3, min = 1, max = 8)]
    pub rings: u32,
}

/// A column: its name, unit, what it is, and its value.
type Column = (&'static str, &'static str, &'static str, fn(&Value) -> f64);

const COLUMNS: [Column; 4] = [
    (
        "curvature_mean",
        "nm^-1",
        "H, positive where convex",
        Value::mean,
    ),
    ("curvature_gaussian", "nm^-2", "K", Value::gaussian),
    ("curvature_principal0", "nm^-1", "the larger", |one| {
        one.principal[0]
    }),
    ("curvature_principal1", "nm^-1", "the smaller", |one| {
        one.principal[1]
    }),
];

impl Operation for Curvature {
    const ID: &'static str = "puncta.mesh.curvature/1";

    fn info() -> Info {
        Info::operation("Curvature")
            .description(
                "Adds mean, Gaussian and both principal curvatures to the vertices.\nA sphere seen \
                 from outside has positive curvature. Remesh first, and smooth what is noisy: \
                 curvature is a second derivative.",
            )
            .input(port().description("An oriented manifold"))
            .output(Ports::mesh("mesh").description("The mesh with columns of curvature"))
            .cite("10.1016/j.cagd.2004.09.004")
            .cite("10.1109/ICCV.1995.466840")
            .example(json!({}))
            .example_input("mesh", "puncta.mesh.shape/1", json!({ "edge": 20 }))
    }

    fn prepare(&self, request: &Request) -> Result<Plan, Failure> {
        Ok(plan::<Self>(request, true))
    }

    fn run(&self, job: &Job) -> Result<(), Failure> {
        let mut mesh = read(job)?;
        let origin = mesh.compact();
        job.progress(0.1, "estimating curvature")?;
        let method = match self.method {
            Methods::Tensor => Method::Tensor,
            Methods::Jet => Method::Jet {
                degree: self.degree as u8,
                rings: self.rings as u8,
            },
        };
        let found = curvatures(&mesh, method, job)?;
        let column = |&(name, unit, text, value): &Column| {
            let info = ColumnInfo::new(name, Element::F64, unit).description(text);
            (info, found.iter().map(value).collect())
        };
        let out = Out {
            mesh: &mesh,
            origin: Some(&origin),
            columns: COLUMNS.iter().map(column).collect(),
        };
        out.give(job)
    }
}

puncta_sdk::register!(Curvature);
