//! `puncta.mesh.points/1`

use crate::exchange::{plan, port, positions, read};
use puncta_sdk::prelude::*;
use puncta_sdk::serde_json::json;
use puncta_shared_mesh::sample::{normal_errors, points};
use puncta_shared_mesh::{Mesh, measure};

/// Draws points from a mesh.
#[derive(Params)]
pub struct Points {
    /// Number of points; if it is not given, the density decides.
    #[param(max = 1000000000)]
    pub count: Option<u64>,
    /// Points for each nm^2.
    #[param(default = 0.01, min = 0.0, max = 1e6, unit = "nm^-2")]
    pub density: f64,
    /// Standard deviation along each axis by which points are moved.
    #[param(default = 0.0, min = 0.0, max = 1e6, unit = "nm")]
    pub noise: f64,
    /// Seed of the random numbers.
    #[param(default = 0)]
    pub seed: Seed,
}

/// Most points.
const MOST: f64 = 1e9;

impl Points {
    fn count(&self, mesh: &Mesh, job: &Job) -> Result<usize, Failure> {
        if let Some(count) = self.count {
            return Ok(usize::try_from(count).unwrap_or(usize::MAX));
        }
        let count = (self.density * measure::area(mesh, job)?).round();
        if count > MOST {
            let message = format!("this density would give {count:.1e} points");
            return Err(Failure::bad_parameter("density", message).remedy("choose a lower one"));
        }
        Ok(count as usize)
    }
}

impl Operation for Points {
    const ID: &'static str = "puncta.mesh.points/1";

    fn info() -> Info {
        Info::operation("Points from mesh")
            .description(
                "Draws points uniformly from the area of a mesh, with a normal error if wanted.\n\
                 The same seed gives the same points.",
            )
            .input(port().description("An oriented manifold"))
            .output(Ports::table("points").description("x, y, z, their errors, and the triangle"))
            .example(json!({ "count": 1000, "noise": 5 }))
            .example_input("mesh", "puncta.mesh.shape/1", json!({ "edge": 20 }))
    }

    fn prepare(&self, request: &Request) -> Result<Plan, Failure> {
        let mut plan = plan::<Self>(request, false);
        let count = self.count.unwrap_or(0);
        plan.memory = plan.memory.saturating_add(count.saturating_mul(60));
        Ok(plan)
    }

    fn run(&self, job: &Job) -> Result<(), Failure> {
        let mesh = read(job)?;
        let count = self.count(&mesh, job)?;
        job.progress(0.1, "drawing points")?;
        let (mut places, triangles) = points(&mesh, count, self.seed.0, job)?;
        if self.noise > 0.0 {
            normal_errors(&mut places, self.noise, self.seed.0, job)?;
        }
        let mut columns = positions();
        let error = |axis: &str| ColumnInfo::new(axis, Element::F64, "nm").role("error");
        columns.extend(["error_x", "error_y", "error_z"].map(error));
        columns.push(ColumnInfo::new("triangle", Element::U32, "1"));
        let mut out = job.begin("points", Header::table("points", count as u64, columns))?;
        let names = ["x", "y", "z", "error_x", "error_y", "error_z"];
        let [x, y, z, errors @ ..] = out.f64s_mut(names)?;
        for (axis, column) in [x, y, z].into_iter().enumerate() {
            let values = places.iter().map(|place| place[axis]);
            column
                .iter_mut()
                .zip(values)
                .for_each(|(out, value)| *out = value);
        }
        for column in errors {
            column.fill(self.noise);
        }
        out.u32_mut("triangle")?.copy_from_slice(&triangles);
        out.finish()
    }
}

puncta_sdk::register!(Points);
