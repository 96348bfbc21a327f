//! `puncta.cluster.tessellation/1`

use crate::columns::{depth, missing, plan, warn_of_missing};
use crate::sizes;
use crate::tiles::{Tiles, random_factor};
use puncta_sdk::ColumnMut;
use puncta_sdk::prelude::*;
use puncta_sdk::serde_json::json;

/// What the density of a cluster is compared with.
#[derive(Choice, Clone, Copy, Debug, PartialEq, Eq)]
pub enum Threshold {
    /// A multiple of the reference density
    Factor,
    /// A quantile of the densities of complete spatial randomness, by simulation
    Random,
}

/// The density that thresholds are multiples of.
#[derive(Choice, Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reference {
    /// Of the localisations outside clusters, in their cells
    Background,
    /// Of all localisations, in the box around them
    Mean,
}

/// Finds clusters as neighbouring cells of a Voronoi tessellation that are small.
#[derive(Params)]
pub struct Tessellation {
    /// What the density of a cluster is compared with.
    #[param(default = Threshold::Factor)]
    threshold: Threshold,
    /// Multiple of the reference density that a localisation of a cluster has at least.
    #[param(default = 3, min = 0, max = 1e9)]
    factor: f64,
    /// The density that the threshold is a multiple of.
    #[param(default = Reference::Background)]
    reference: Reference,
    /// Join localisations that lie close beside a cluster, whose own density its rim spoils.
    #[param(default = true)]
    border: bool,
    /// Share of localisations under complete spatial randomness that have a lower density than the threshold.
    #[param(default = 0.99, min = 0, max = 1)]
    level: f64,
    /// Fewest localisations of a cluster.
    #[param(default = 10, min = 1, max = 2e9)]
    min_size: usize,
    /// Factor on z, for clusters in 3D: 1, or less where z is less precise.
    #[param(min = 1e-6, max = 1e6)]
    z_scale: Option<f64>,
    /// Localisations that are simulated for complete spatial randomness.
    #[param(default = 100_000, min = 1000, max = 1e7, advanced)]
    simulated: usize,
    /// Seed of the simulation.
    #[param(default = 0)]
    seed: Seed,
}

impl Tessellation {
    fn write<const D: usize>(&self, at: [&[f64]; D], scale: f64, job: &Job) -> Result<(), Failure> {
        let tiles = Tiles::new(at, job)?;
        let factor = match self.threshold {
            Threshold::Factor => self.factor,
            Threshold::Random => {
                job.progress(0.6, "simulating complete spatial randomness")?;
                random_factor::<D>(self.simulated, self.level, self.seed.0, job)?
            }
        };
        let reference = match self.reference {
            Reference::Background => tiles.background(factor, self.min_size, job)?,
            Reference::Mean => tiles.mean,
        };
        job.progress(0.9, "joining cells")?;
        let least = factor * reference;
        let (labels, sizes) = tiles.clusters(least, self.min_size, self.border, at[0].len());
        // Sizes of cells in nm, not in scaled units.
        let unit = if D == 3 { "nm^3" } else { "nm^2" };
        let mut out = job.add_columns("table", columns(unit))?;
        let columns = <[ColumnMut<'_>; 3]>::try_from(out.columns_mut(0)?);
        let Ok(
            [
                ColumnMut::I32(id),
                ColumnMut::F64(size),
                ColumnMut::F64(density),
            ],
        ) = columns
        else {
            return Err(Failure::internal("the host gave other columns"));
        };
        id.copy_from_slice(&labels);
        size.fill(f64::NAN);
        density.fill(f64::NAN);
        tiles.each_row(|row, cell, local| {
            size[row] = cell / scale;
            density[row] = local * scale;
        });
        out.finish()?;
        let missing = missing(at);
        warn_of_missing(job, missing);
        let outside = at[0].len() as u64 - missing - sizes.iter().sum::<u64>();
        let mut report = Report::new("report");
        report.number("clusters", sizes.len() as f64, "1");
        report.number("outside", outside as f64, "1");
        report.number("left out", missing as f64, "1");
        report.number("mean density", tiles.mean * scale, &format!("1/{unit}"));
        let per = format!("1/{unit}");
        report
            .number("reference density", reference * scale, &per)
            .description = Some("What the threshold is a multiple of".into());
        report.number("factor", factor, "1").description =
            Some("Threshold over the reference density".into());
        job.report(&report)?;
        let caption = format!(
            "tessellation, {factor:.4} x the {} density, min_size {}, {} border",
            match self.reference {
                Reference::Background => "background",
                Reference::Mean => "mean",
            },
            self.min_size,
            if self.border { "with" } else { "without" }
        );
        job.figure(&sizes::figure(&sizes, &caption))
    }
}

/// The columns that are added, for cells in units of `unit`.
fn columns(unit: &str) -> [ColumnInfo; 3] {
    let size = if unit == "nm^3" {
        "voronoi_volume"
    } else {
        "voronoi_area"
    };
    let id = ColumnInfo::new("tessellation_id", Element::I32, "1").role("group");
    let size = ColumnInfo::new(size, Element::F64, unit);
    let density = ColumnInfo::new("voronoi_density", Element::F64, format!("1/{unit}"));
    [
        id.description("Number of the cluster, from 1; 0 outside"),
        size.description("Size of the Voronoi cell"),
        density.description("Localisations of the cell and its neighbours for their size"),
    ]
}

impl Operation for Tessellation {
    const ID: &'static str = "puncta.cluster.tessellation/1";

    fn info() -> Info {
        Info::operation("Tessellation clusters")
            .description(
                "Cuts the box around all localisations into Voronoi cells. The density of a \
                 localisation is the number of localisations in its cell and the neighbouring \
                 ones over their area (volume). Neighbouring cells whose density reaches the \
                 threshold are a cluster. The threshold is a multiple, given or found as a quantile \
                 of simulated complete spatial randomness, of the density outside clusters or of \
                 the mean. A localisation of less density beside a cluster joins it where it is \
                 near enough. Localisations at the same position share a cell. Clusters are numbered from 1 by their first \
                 row.",
            )
            .input(
                Ports::table("table")
                    .column("x", "nm")
                    .column("y", "nm")
                    .description("Localisations"),
            )
            .output(Ports::columns("table", "table").description(
                "With tessellation_id, voronoi_area or voronoi_volume, voronoi_density",
            ))
            .output(Ports::report("report").description("Clusters and the threshold"))
            .output(Ports::figure("figure").description("Sizes of the clusters"))
            .cite("Levet et al., Nature Methods 12, 1065 (2015)")
            .cite("Andronov et al., Scientific Reports 6, 24084 (2016)")
            .example(json!({ "threshold": "random", "simulated": 10_000 }))
            .example_input("table", "puncta.synthetic.membrane/1", json!({}))
    }

    fn prepare(&self, request: &Request) -> Result<Plan, Failure> {
        plan::<Self>(request, self.z_scale.is_some(), &[], 480)
    }

    fn run(&self, job: &Job) -> Result<(), Failure> {
        let table = job.input("table")?;
        let (x, y) = (table.f64("x")?, table.f64("y")?);
        match self.z_scale {
            None => self.write([&x[..], &y[..]], 1.0, job),
            Some(scale) => {
                let z = depth(&table, scale)?;
                self.write([&x[..], &y[..], &z[..]], scale, job)
            }
        }
    }
}

puncta_sdk::register!(Tessellation);

#[cfg(test)]
mod tests;
