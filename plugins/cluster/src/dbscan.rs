//! `puncta.cluster.dbscan/1`

use crate::columns::{depth, missing, plan, warn_of_missing};
use crate::density::{Found, dbscan};
use crate::sizes;
use puncta_sdk::ColumnMut;
use puncta_sdk::prelude::*;
use puncta_sdk::serde_json::json;

/// Finds clusters by the number of localisations nearby.
#[derive(Params)]
pub struct Dbscan {
    /// Radius eps within which neighbours are counted (<=), in x and y.
    #[param(default = 50, min = 1e-6, max = 1e9, unit = "nm")]
    eps: f64,
    /// Radius along z, for clusters in 3D: neighbours lie within the ellipsoid.
    #[param(min = 1e-6, max = 1e9, unit = "nm")]
    eps_z: Option<f64>,
    /// Localisations within the radius, itself included, that make a core point.
    #[param(default = 10, min = 1, max = 2e9)]
    min_points: usize,
}

impl Operation for Dbscan {
    const ID: &'static str = "puncta.cluster.dbscan/1";

    fn info() -> Info {
        Info::operation("DBSCAN")
            .description(
                "A core point has at least min_points localisations, itself included, within eps. \
                 Core points within eps of each other are in one cluster, and so are other \
                 localisations within eps of a core point; one that several clusters could have \
                 goes to the one with the lowest number. Clusters are numbered from 1 by their \
                 first core point; noise, and rows without a finite position, get 0. With eps_z \
                 the clusters are 3D; give it the value of eps for spheres.",
            )
            .input(
                Ports::table("table")
                    .column("x", "nm")
                    .column("y", "nm")
                    .description("Localisations"),
            )
            .output(Ports::columns("table", "table").description("With dbscanClumpID"))
            .output(Ports::report("report").description("Clusters, noise, core points"))
            .output(Ports::figure("figure").description("Sizes of the clusters"))
            .cite("Ester et al., Proc. KDD 226 (1996)")
            .example(json!({ "eps": 30, "min_points": 5 }))
            .example_input("table", "puncta.synthetic.membrane/1", json!({}))
    }

    fn prepare(&self, request: &Request) -> Result<Plan, Failure> {
        plan::<Self>(request, self.eps_z.is_some(), &[], 56)
    }

    fn run(&self, job: &Job) -> Result<(), Failure> {
        let table = job.input("table")?;
        let (x, y) = (table.f64("x")?, table.f64("y")?);
        let id = ColumnInfo::new("dbscanClumpID", Element::I32, "1");
        let id = id
            .role("group")
            .description("Number of the cluster, from 1; 0 is noise");
        let mut out = job.add_columns("table", [id])?;
        let ColumnMut::I32(labels) = out.column_mut(0, "dbscanClumpID")? else {
            return Err(Failure::internal("the host gave another column"));
        };
        let (found, missing) = match self.eps_z {
            None => {
                let at = [&x[..], &y[..]];
                (
                    dbscan(at, self.eps, self.min_points, labels, job)?,
                    missing(at),
                )
            }
            Some(eps_z) => {
                let z = depth(&table, self.eps / eps_z)?;
                let at = [&x[..], &y[..], &z[..]];
                (
                    dbscan(at, self.eps, self.min_points, labels, job)?,
                    missing(at),
                )
            }
        };
        out.finish()?;
        warn_of_missing(job, missing);
        job.report(&report(&found, table.rows() as u64, missing))?;
        let depth = self
            .eps_z
            .map_or(String::new(), |eps_z| format!(", {eps_z} nm along z"));
        let caption = format!(
            "DBSCAN with eps {} nm{depth}, min_points {}",
            self.eps, self.min_points
        );
        job.figure(&sizes::figure(&found.sizes, &caption))
    }
}

fn report(found: &Found, rows: u64, missing: u64) -> Report {
    let mut report = Report::new("report");
    let clustered: u64 = found.sizes.iter().sum();
    report.number("clusters", f64::from(found.clusters), "1");
    report
        .number("noise", (rows - missing - clustered) as f64, "1")
        .description = Some("Localisations in no cluster".into());
    report.number("core", found.core as f64, "1").description = Some("Core points".into());
    report
        .number("border", (clustered - found.core) as f64, "1")
        .description = Some("Localisations of clusters that are no core points".into());
    report.number("left out", missing as f64, "1").description =
        Some("Rows without a finite position".into());
    let largest = found.sizes.iter().max().copied().unwrap_or(0);
    report.number("largest", largest as f64, "1").description =
        Some("Localisations of the largest cluster".into());
    report
}

puncta_sdk::register!(Dbscan);

#[cfg(test)]
mod tests;
