//! `puncta.mesh.components/1`

use crate::exchange::{Out, plan, port, read};
use puncta_sdk::prelude::*;
use puncta_sdk::serde_json::json;
use puncta_shared_mesh::topology::{Component, components, describe, keep_components};

/// Keeps the components of a mesh that are large enough, and numbers them.
#[derive(Params)]
pub struct Components {
    /// Keep only so many, those with the most area; all if it is not given.
    #[param(min = 1)]
    pub largest: Option<u64>,
    /// Least number of triangles.
    #[param(default = 1)]
    pub min_triangles: u64,
    /// Least area.
    #[param(default = 0.0, min = 0.0, unit = "nm^2")]
    pub min_area: f64,
    /// Least volume, without its sign; open components have none and pass only at 0.
    #[param(default = 0.0, min = 0.0, unit = "nm^3")]
    pub min_volume: f64,
    /// Largest volume, without its sign; all if it is not given.
    #[param(min = 0.0, unit = "nm^3")]
    pub max_volume: Option<f64>,
}

impl Components {
    fn wants(&self, one: &Component) -> bool {
        let volume = if one.loops == 0 {
            one.volume.abs()
        } else {
            0.0
        };
        one.triangles as u64 >= self.min_triangles
            && one.area >= self.min_area
            && volume >= self.min_volume
            && self.max_volume.is_none_or(|most| volume <= most)
    }
}

impl Operation for Components {
    const ID: &'static str = "puncta.mesh.components/1";

    fn info() -> Info {
        Info::operation("Mesh components")
            .description(
                "Keeps the connected parts of a mesh within limits of triangles, area and volume, \
                 or the largest of them.\nThe column component numbers those that are kept, from 0 \
                 in the order of their first triangle.",
            )
            .input(port().description("An oriented manifold"))
            .output(Ports::mesh("mesh").description("What is kept, with its columns"))
            .output(Ports::report("report").description("How many there were and are"))
            .example(json!({ "largest": 1 }))
            .example_input("mesh", "puncta.mesh.shape/1", json!({ "edge": 20 }))
    }

    fn prepare(&self, request: &Request) -> Result<Plan, Failure> {
        Ok(plan::<Self>(request, true))
    }

    fn run(&self, job: &Job) -> Result<(), Failure> {
        let mesh = read(job)?;
        job.progress(0.3, "measuring components")?;
        let (all, of) = describe(&mesh);
        let mut order: Vec<usize> = (0..all.len()).filter(|&i| self.wants(&all[i])).collect();
        // By area; of equal ones the first.
        order.sort_by(|&a, &b| all[b].area.total_cmp(&all[a].area).then(a.cmp(&b)));
        if let Some(largest) = self.largest {
            order.truncate(usize::try_from(largest).unwrap_or(usize::MAX));
        }
        let mut kept = vec![false; all.len()];
        order.iter().for_each(|&i| kept[i] = true);
        drop(of);
        let mut number = 0;
        let mut mesh = keep_components(&mesh, |_| {
            number += 1;
            kept[number - 1]
        });
        let origin = mesh.compact();
        let (of, count) = components(&mesh);
        let vertices = 0..mesh.positions().len() as u32;
        let component = |v: u32| f64::from(of[(mesh.out(v) / 3) as usize]);
        let info = ColumnInfo::new("component", Element::F64, "1").role("group");
        let info = info.description("number of the connected part");
        let out = Out {
            mesh: &mesh,
            origin: Some(&origin),
            columns: vec![(info, vertices.map(component).collect())],
        };
        out.give(job)?;
        let mut report = Report::new("report");
        report.number("components_found", all.len() as f64, "1");
        report.number("components_kept", count as f64, "1");
        job.report(&report)
    }
}

puncta_sdk::register!(Components);
