//! `puncta.cluster.hdbscan/1`

use crate::columns::{depth, missing, plan, warn_of_missing};
use crate::condense::{Chosen, Condensed};
use crate::sizes;
use crate::spanning::{core_squares, spanning_tree};
use crate::tree::Tree;
use puncta_sdk::ColumnMut;
use puncta_sdk::prelude::*;
use puncta_sdk::serde_json::json;

/// How clusters are chosen from the hierarchy.
#[derive(Choice, Clone, Copy, Debug, PartialEq, Eq)]
pub enum Selection {
    /// The most stable ones (excess of mass)
    Excess,
    /// The smallest ones, without clusters within
    Leaf,
}

/// Finds clusters of different densities.
#[derive(Params)]
pub struct Hdbscan {
    /// Fewest localisations of a cluster.
    #[param(default = 10, min = 2, max = 2e9)]
    min_size: usize,
    /// Neighbours, itself included, that the density of a localisation is measured with; as min_size if left out.
    #[param(min = 1, max = 100_000)]
    min_samples: Option<u64>,
    /// How clusters are chosen.
    #[param(default = Selection::Excess)]
    selection: Selection,
    /// Whether all localisations together may be the only cluster.
    #[param(default = false, advanced)]
    allow_single: bool,
    /// Factor on z, for clusters in 3D: 1, or less where z is less precise.
    #[param(min = 1e-6, max = 1e6)]
    z_scale: Option<f64>,
}

impl Hdbscan {
    fn cluster<const D: usize>(
        &self,
        at: [&[f64]; D],
        job: &Job,
    ) -> Result<(Tree<D>, Chosen), Failure> {
        let tree = Tree::new(at, job)?;
        let samples = match self.min_samples {
            Some(samples) => usize::try_from(samples).unwrap_or(usize::MAX),
            None => self.min_size,
        };
        job.progress(0.0, "measuring densities")?;
        let core = core_squares(&tree, samples, job)?;
        let edges = spanning_tree(&tree, &core, job)?;
        drop(core);
        job.progress(0.9, "choosing clusters")?;
        let condensed = Condensed::new(&edges, tree.len(), self.min_size);
        let chosen = match self.selection {
            Selection::Excess => condensed.excess(self.allow_single),
            Selection::Leaf => condensed.leaves(self.allow_single),
        };
        let chosen = condensed.choose(&chosen);
        Ok((tree, chosen))
    }

    fn write<const D: usize>(&self, at: [&[f64]; D], job: &Job) -> Result<(), Failure> {
        let (tree, chosen) = self.cluster(at, job)?;
        let rows = at[0].len();
        let labels = labels(&tree.order, &chosen, rows);
        let mut sizes = vec![0_u64; chosen.count as usize];
        for label in labels.iter().filter(|label| **label > 0) {
            sizes[*label as usize - 1] += 1;
        }
        let mut out = job.add_columns(
            "table",
            [
                ColumnInfo::new("hdbscan_id", Element::I32, "1")
                    .role("group")
                    .description("Number of the cluster, from 1; 0 is noise"),
                ColumnInfo::new("hdbscan_probability", Element::F32, "1")
                    .description("How near the localisation is to the core of its cluster"),
                ColumnInfo::new("outlier_score", Element::F32, "1")
                    .description("GLOSH outlier score, 0 to 1"),
            ],
        )?;
        let columns = <[ColumnMut<'_>; 3]>::try_from(out.columns_mut(0)?);
        let Ok(
            [
                ColumnMut::I32(id),
                ColumnMut::F32(probability),
                ColumnMut::F32(outlier),
            ],
        ) = columns
        else {
            return Err(Failure::internal("the host gave other columns"));
        };
        id.copy_from_slice(&labels);
        probability.fill(0.0);
        outlier.fill(f32::NAN);
        for (point, row) in tree.order.iter().enumerate() {
            probability[*row as usize] = chosen.probability[point] as f32;
            outlier[*row as usize] = chosen.outlier[point] as f32;
        }
        out.finish()?;
        let missing = missing(at);
        warn_of_missing(job, missing);
        let clustered: u64 = sizes.iter().sum();
        let mut report = Report::new("report");
        report.number("clusters", f64::from(chosen.count), "1");
        report
            .number("noise", (tree.len() as u64 - clustered) as f64, "1")
            .description = Some("Localisations in no cluster".into());
        report.number("left out", missing as f64, "1").description =
            Some("Rows without a finite position".into());
        job.report(&report)?;
        let caption = format!("HDBSCAN with min_size {}", self.min_size);
        job.figure(&sizes::figure(&sizes, &caption))
    }
}

/// Clusters numbered from 1 by their first row; 0 for noise.
fn labels(order: &[u32], chosen: &Chosen, rows: usize) -> Vec<i32> {
    let mut labels = vec![0_i32; rows];
    for (row, cluster) in order.iter().zip(&chosen.cluster) {
        if let Some(cluster) = cluster {
            labels[*row as usize] = cluster.cast_signed() + 1;
        }
    }
    let mut numbers = vec![0; chosen.count as usize + 1];
    let mut count = 0;
    for label in labels.iter_mut().filter(|label| **label > 0) {
        let number = &mut numbers[*label as usize];
        if *number == 0 {
            count += 1;
            *number = count;
        }
        *label = *number;
    }
    labels
}

impl Operation for Hdbscan {
    const ID: &'static str = "puncta.cluster.hdbscan/1";

    fn info() -> Info {
        Info::operation("HDBSCAN")
            .description(
                "Clusters of any density: the hierarchy of DBSCAN clusters over all radii is \
                 condensed to those of at least min_size localisations, and the most stable ones, \
                 or those without clusters within, are chosen. Exact: the spanning tree of mutual \
                 reachability distances is the minimal one. Clusters are numbered from 1 by their \
                 first row; noise, and rows without a finite position, get 0.",
            )
            .input(
                Ports::table("table")
                    .column("x", "nm")
                    .column("y", "nm")
                    .description("Localisations"),
            )
            .output(
                Ports::columns("table", "table")
                    .description("With hdbscan_id, hdbscan_probability and outlier_score"),
            )
            .output(Ports::report("report").description("Clusters and noise"))
            .output(Ports::figure("figure").description("Sizes of the clusters"))
            .cite("Campello, Moulavi, Sander, PAKDD 160 (2013)")
            .cite("Campello et al., ACM TKDD 10:5 (2015)")
            .example(json!({ "min_size": 20, "min_samples": 5 }))
            .example_input("table", "puncta.synthetic.membrane/1", json!({}))
    }

    fn prepare(&self, request: &Request) -> Result<Plan, Failure> {
        plan::<Self>(request, self.z_scale.is_some(), &[], 320)
    }

    fn run(&self, job: &Job) -> Result<(), Failure> {
        let table = job.input("table")?;
        let (x, y) = (table.f64("x")?, table.f64("y")?);
        match self.z_scale {
            None => self.write([&x[..], &y[..]], job),
            Some(scale) => {
                let z = depth(&table, scale)?;
                self.write([&x[..], &y[..], &z[..]], job)
            }
        }
    }
}

puncta_sdk::register!(Hdbscan);

#[cfg(test)]
mod tests;
