//! `puncta.cluster.boundaries/1`

use crate::columns::plan;
use crate::groups::Groups;
use crate::plane::{Ring, alpha_shape, area, hull};
use puncta_sdk::ColumnMut;
use puncta_sdk::prelude::*;
use puncta_sdk::run::map;
use puncta_sdk::serde_json::json;

/// What is drawn around a cluster.
#[derive(Choice, Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outline {
    /// The convex hull
    Hull,
    /// The alpha shape, with holes
    Alpha,
}

/// Draws an outline around each cluster.
#[derive(Params)]
pub struct Boundaries {
    /// Column with the number of the cluster; rows below 1 are left out.
    #[param(default = "dbscanClumpID")]
    group: Column,
    /// What is drawn.
    #[param(default = Outline::Hull)]
    outline: Outline,
    /// Largest radius of a triangle of the alpha shape.
    #[param(default = 50, min = 1e-6, max = 1e9, unit = "nm")]
    alpha: f64,
}

impl Boundaries {
    fn rings(&self, points: &[[f64; 2]]) -> Result<Vec<Ring>, Failure> {
        let rings = match self.outline {
            Outline::Hull => vec![hull(points)],
            Outline::Alpha => alpha_shape(points, self.alpha)?,
        };
        Ok(rings.into_iter().filter(|ring| ring.len() > 2).collect())
    }
}

impl Operation for Boundaries {
    const ID: &'static str = "puncta.cluster.boundaries/1";

    fn info() -> Info {
        Info::operation("Cluster boundaries")
            .description(
                "Outlines of clusters in the plane, as a table of vertices: rows with the same \
                 outline and ring are a closed polygon, to the left around the cluster and to the \
                 right around its holes. Clusters on a line, and alpha shapes without a triangle, \
                 have no outline and are counted.",
            )
            .input(
                Ports::table("table")
                    .column("x", "nm")
                    .column("y", "nm")
                    .any_column("$group")
                    .description("Localisations with the number of their cluster"),
            )
            .output(Ports::table("outlines").description("Vertices: outline, ring, x, y"))
            .output(Ports::report("report").description("Clusters and their area"))
            .example(json!({ "group": "copy", "outline": "alpha", "alpha": 60 }))
            .example_input(
                "table",
                "puncta.synthetic.membrane/1",
                json!({ "copies": 4 }),
            )
    }

    fn prepare(&self, request: &Request) -> Result<Plan, Failure> {
        plan::<Self>(request, false, &[&self.group], 160)
    }

    fn run(&self, job: &Job) -> Result<(), Failure> {
        let table = job.input("table")?;
        let (x, y, numbers) = (table.f64("x")?, table.f64("y")?, table.f64(&self.group)?);
        let finite = |row: usize| x[row].is_finite() && y[row].is_finite();
        let groups = Groups::new(&numbers, &finite, job)?;
        job.progress(0.2, "drawing outlines")?;
        let found = map(job, groups.len(), &|group| {
            if job.cancelled() {
                return Err(Failure::cancelled());
            }
            let rows = groups.rows(group).iter().map(|row| *row as usize);
            let points: Vec<[f64; 2]> = rows.map(|row| [x[row], y[row]]).collect();
            self.rings(&points)
        });
        let found: Vec<Vec<Ring>> = found.into_iter().collect::<Result<_, _>>()?;
        let mut vertices: Vec<(i32, u32, [f64; 2])> = Vec::new();
        for (number, rings) in groups.numbers.iter().zip(&found) {
            for (ring, points) in rings.iter().enumerate() {
                let ring = u32::try_from(ring).unwrap_or(u32::MAX);
                vertices.extend(points.iter().map(|point| (*number, ring, *point)));
            }
        }
        let columns = vec![
            ColumnInfo::new("outline", Element::I32, "1")
                .role("group")
                .description("Number of the cluster"),
            ColumnInfo::new("ring", Element::U32, "1").description("Polygon of the outline"),
            ColumnInfo::new("x", Element::F64, "nm").role("position"),
            ColumnInfo::new("y", Element::F64, "nm").role("position"),
        ];
        let mut header = Header::table("outlines", vertices.len() as u64, columns);
        header.shape = Some("outline".into());
        let mut out = job.begin("outlines", header)?;
        out.commit(0, vertices.len() as u64)?;
        for (axis, column) in out.columns_mut(0)?.into_iter().enumerate() {
            match column {
                ColumnMut::I32(to) => to.iter_mut().zip(&vertices).for_each(|(to, v)| *to = v.0),
                ColumnMut::U32(to) => to.iter_mut().zip(&vertices).for_each(|(to, v)| *to = v.1),
                ColumnMut::F64(to) => {
                    to.iter_mut()
                        .zip(&vertices)
                        .for_each(|(to, v)| *to = v.2[axis - 2]);
                }
                _ => return Err(Failure::internal("the host gave another column")),
            }
        }
        out.finish()?;
        let mut report = Report::new("report");
        let drawn = found.iter().filter(|rings| !rings.is_empty()).count();
        report.number("outlines", drawn as f64, "1");
        report.number("without outline", (groups.len() - drawn) as f64, "1");
        let size: f64 = found.iter().flatten().map(|ring| area(ring)).sum();
        report.number("area", size, "nm^2").description = Some("Area of all outlines".into());
        job.report(&report)
    }
}

puncta_sdk::register!(Boundaries);
