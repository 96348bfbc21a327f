//! `puncta.mesh.distance/1`

use crate::exchange::{plan, port, read};
use puncta_sdk::prelude::*;
use puncta_sdk::serde_json::json;
use puncta_shared_mesh::Distance as Distances;

/// Whether distances have a sign.
#[derive(Choice, Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sign {
    /// Negative inside a closed mesh, without sign of an open one
    Closed,
    /// Negative behind the triangles, closed or not
    Always,
    /// Never negative
    Never,
}

/// Adds the distance of each localisation from a mesh.
#[derive(Params)]
pub struct Distance {
    /// Whether distances have a sign.
    #[param(default = Sign::Closed)]
    pub sign: Sign,
    /// Name of the new column.
    #[param(default = "distance_to_mesh")]
    pub name: String,
}

impl Operation for Distance {
    const ID: &'static str = "puncta.mesh.distance/1";

    fn info() -> Info {
        Info::operation("Distance to mesh")
            .description(
                "Adds the exact distance of each localisation from the nearest triangle, negative \
                 inside.\nThe side is decided by angle-weighted normals, which is right at edges \
                 and corners, too. Localisations without a position get NaN.",
            )
            .input(
                Ports::table("table")
                    .column("x", "nm")
                    .column("y", "nm")
                    .column("z", "nm")
                    .description("Localisations"),
            )
            .input(port().description("An oriented manifold"))
            .output(Ports::columns("table", "table").description("With the distance"))
            .cite("10.1109/TVCG.2005.49")
            .example(json!({}))
            .example_input(
                "table",
                "puncta.synthetic.membrane/1",
                json!({ "shape": "sphere" }),
            )
            .example_input("mesh", "puncta.mesh.shape/1", json!({}))
    }

    fn prepare(&self, request: &Request) -> Result<Plan, Failure> {
        if self.name.trim().is_empty() {
            let message = "the new column needs a name";
            return Err(Failure::bad_parameter("name", message));
        }
        let mut plan = plan::<Self>(request, false);
        let table = request.inputs.iter().find(|input| input.port == "table");
        let rows = table.map_or(0, |table| table.header.rows());
        plan.memory = plan.memory.saturating_add(rows.saturating_mul(40));
        Ok(plan)
    }

    fn run(&self, job: &Job) -> Result<(), Failure> {
        let table = job.input("table")?;
        let [x, y, z] = [table.f64("x")?, table.f64("y")?, table.f64("z")?];
        job.progress(0.0, "sorting the triangles")?;
        let mesh = read(job)?;
        if mesh.is_empty() {
            return Err(Failure::bad_input("the mesh has no triangle to be near to"));
        }
        let distances = Distances::new(&mesh, job)?;
        let signed = match self.sign {
            Sign::Closed => distances.is_closed(),
            Sign::Always => true,
            Sign::Never => false,
        };
        if self.sign == Sign::Closed && !signed {
            job.warn("the mesh is open, so that there is no inside: distances have no sign");
        }
        job.progress(0.2, "measuring distances")?;
        let found = distances.all([&x, &y, &z], signed, job)?;
        let text = if signed {
            "negative inside the mesh"
        } else {
            "without sign"
        };
        let info = ColumnInfo::new(&self.name, Element::F64, "nm").description(text);
        let mut out = job.add_columns("table", [info])?;
        out.f64_mut(&self.name)?.copy_from_slice(&found);
        out.finish()
    }
}

puncta_sdk::register!(Distance);
