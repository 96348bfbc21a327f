//! `puncta.chaining.find/1`

use crate::chain::{Chains, chain};
use crate::columns::{check_length, length};
use crate::compatible;
use crate::spots::{Radius, Rows, Spots, spots};
use puncta_sdk::documents::Read;
use puncta_sdk::operation::default_plan;
use puncta_sdk::prelude::*;
use puncta_sdk::run::chunks_mut;
use puncta_sdk::serde_json::json;
use puncta_sdk::{ColumnMut, Figure, Input, Series};

/// Rows of a task.
const CHUNK: usize = 1 << 15;
/// Chains of this length and longer are one bar of the figure.
const LONGEST: usize = 100;

/// Rules by which localisations become chains.
#[derive(Choice, Clone, Copy, Debug, PartialEq, Eq)]
pub enum Rule {
    /// Closest pairs of a frame first, one localisation a frame, compared with the chain's last one
    Nearest,
    /// As PYME: twice the radius of the later one, its first neighbour, same frame too, x and y only
    Pyme,
}

/// Groups the repeats of a molecule in later frames.
#[derive(Params)]
pub struct Find {
    /// Column with the standard deviation in x and y; the radius is its combination of both localisations times the scale.
    #[param(default = "error_x")]
    sigma: Column,
    /// Factor on the combined standard deviation; 3.5 misses 0.2 % of the repeats in a plane.
    #[param(default = 3.5, min = 0, max = 1e6)]
    scale: f64,
    /// One radius for all localisations, instead of the column.
    #[param(min = 0, max = 1e12, unit = "nm")]
    radius: Option<f64>,
    /// Column with the standard deviation along z; with it the localisations are chained in 3D.
    sigma_z: Option<Column>,
    /// One radius along z for all localisations, instead of the column.
    #[param(min = 0, max = 1e12, unit = "nm")]
    radius_z: Option<f64>,
    /// Most dark frames within a chain.
    #[param(default = 1, min = 0, max = 1e12, unit = "frame")]
    gap: u64,
    /// How localisations are joined.
    #[param(default = Rule::Nearest, advanced)]
    rule: Rule,
}

impl Find {
    fn axial(&self) -> bool {
        self.rule == Rule::Nearest && (self.sigma_z.is_some() || self.radius_z.is_some())
    }
}

impl Operation for Find {
    const ID: &'static str = "puncta.chaining.find/1";

    fn info() -> Info {
        Info::operation("Find repeats")
            .description(
                "Chains the localisations of one molecule in successive frames. A localisation \
                 continues a chain when it lies within the radius of the chain's last \
                 localisation, at most `gap` dark frames back. Where several could, the closest \
                 pair is joined first, the distance taken in units of the radius, so that each \
                 localisation joins one chain and a chain takes one localisation a frame. With a \
                 standard deviation or a radius along z the squares of both distances, each in \
                 units of its radius, add up to at most 1. Frames are rounded to whole numbers. \
                 Rows without a finite position, frame and radius get clumpIndex 0.",
            )
            .input(
                Ports::table("table")
                    .column("x", "nm")
                    .column("y", "nm")
                    .column("t", "frame")
                    .description("Localisations, in any order"),
            )
            .output(Ports::columns("table", "table").description("With clumpIndex and clumpSize"))
            .output(Ports::report("report").description("Chains and their lengths"))
            .output(Ports::figure("figure").description("Lengths of the chains"))
            .example(json!({ "sigma": "error_x" }))
            .example_input("table", "puncta.synthetic.membrane/1", json!({}))
    }

    fn prepare(&self, request: &Request) -> Result<Plan, Failure> {
        let mut plan = default_plan::<Self>(request);
        let Some(input) = request.inputs.first() else {
            return Ok(plan);
        };
        let header = &input.header;
        let mut columns = vec!["x", "y", "t"];
        if self.radius.is_none() {
            check_length(header, &self.sigma, "sigma")?;
            columns.push(&self.sigma);
        }
        if self.axial() {
            check_length(header, "z", "sigma_z")?;
            columns.push("z");
            if let (None, Some(sigma)) = (self.radius_z, &self.sigma_z) {
                check_length(header, sigma, "sigma_z")?;
                columns.push(sigma);
            }
        }
        if header.rows() >= u64::from(u32::MAX) {
            let message = format!("{} has too many rows to be chained", header.name);
            return Err(Failure::bad_input(message).remedy("split it by frames"));
        }
        let mut seen = std::collections::BTreeSet::new();
        columns.retain(|name| seen.insert(*name));
        plan.read = vec![Read {
            input: 0,
            part: 0,
            columns: columns.into_iter().map(Into::into).collect(),
        }];
        plan.memory = header.rows() * 80 + (64 << 20);
        Ok(plan)
    }

    fn run(&self, job: &Job) -> Result<(), Failure> {
        let table = job.input("table")?;
        let (x, y, t) = (table.f64("x")?, table.f64("y")?, table.f64("t")?);
        let sigma = match self.radius {
            None => Some(length(&table, &self.sigma, "sigma")?),
            Some(_) => None,
        };
        let radius = |constant: f64, sigma| match sigma {
            None => Radius::Constant(constant),
            Some(sigma) => Radius::Combined {
                sigma,
                scale: self.scale,
            },
        };
        let axial = self.axial_columns(&table)?;
        let rows = Rows {
            x: &x,
            y: &y,
            t: &t,
            radius: radius(self.radius.unwrap_or(0.0), sigma.as_deref()),
            axial: axial.as_ref().map(|(z, sigma)| {
                let constant = self.radius_z.unwrap_or(0.0);
                (&z[..], radius(constant, sigma.as_deref()))
            }),
        };
        let spots = spots(&rows, job)?;
        let chains = match self.rule {
            Rule::Nearest => chain(&spots, self.gap, job)?,
            Rule::Pyme => compatible::chain(&rows, &spots, self.gap, job)?,
        };
        write(job, &spots, &chains)?;
        let left_out = table.rows() - spots.frames.len();
        if left_out > 0 {
            job.warn(&format!(
                "{left_out} rows without a finite position, frame and radius are in no chain"
            ));
        }
        job.report(&report(&chains, left_out))?;
        job.figure(&self.figure(&chains))
    }
}

/// z and, unless there is one radius for all, its standard deviation.
type Axial<'a> = (
    std::borrow::Cow<'a, [f64]>,
    Option<std::borrow::Cow<'a, [f64]>>,
);

impl Find {
    fn axial_columns<'a>(&self, table: &Input<'a>) -> Result<Option<Axial<'a>>, Failure> {
        if !self.axial() {
            return Ok(None);
        }
        let sigma = match (self.radius_z, &self.sigma_z) {
            (None, Some(name)) => Some(length(table, name, "sigma_z")?),
            _ => None,
        };
        Ok(Some((length(table, "z", "sigma_z")?, sigma)))
    }

    fn figure(&self, chains: &Chains) -> Figure {
        let mut bars = [0.0_f64; LONGEST];
        for size in &chains.sizes {
            bars[(*size as usize).clamp(1, LONGEST) - 1] += 1.0;
        }
        let last = bars
            .iter()
            .rposition(|count| *count > 0.0)
            .map_or(0, |at| at + 1);
        let lengths: Vec<f64> = (1..=last).map(|length| length as f64).collect();
        let radius = match self.radius {
            Some(radius) => format!("radius {radius} nm"),
            None => format!("radius {} x combined {}", self.scale, self.sigma.0),
        };
        let mut figure = Figure::new(
            "figure",
            "Lengths of chains",
            ["localisations in the chain", "1"],
            ["chains", "1"],
        )
        .with(Series::numbers("chains", "bars", &lengths, &bars[..last]));
        figure.logarithmic = "y".into();
        let more = if last == LONGEST {
            "; the last bar holds all longer ones"
        } else {
            ""
        };
        figure.caption = format!(
            "{} chains; {radius}, at most {} dark frames{more}.",
            chains.sizes.len(),
            self.gap
        );
        figure
    }
}

fn write(job: &Job, spots: &Spots<'_>, chains: &Chains) -> Result<(), Failure> {
    let mut out = job.add_columns(
        "table",
        [
            ColumnInfo::new("clumpIndex", Element::U32, "1")
                .role("group")
                .description("Number of the chain, from 1; 0 in none"),
            ColumnInfo::new("clumpSize", Element::U32, "1")
                .description("Localisations in the chain"),
        ],
    )?;
    let mut columns = out.columns_mut(0)?.into_iter();
    let (Some(ColumnMut::U32(index)), Some(ColumnMut::U32(size))) =
        (columns.next(), columns.next())
    else {
        return Err(Failure::internal("the host gave other columns"));
    };
    match &spots.order {
        None => index.copy_from_slice(&chains.labels),
        Some(order) => {
            index.fill(0);
            for (row, label) in order.iter().zip(&chains.labels) {
                index[*row as usize] = *label;
            }
        }
    }
    let index = &*index;
    chunks_mut(job, size, CHUNK, &|chunk, part| {
        for (i, slot) in part.iter_mut().enumerate() {
            let label = index[chunk * CHUNK + i] as usize;
            *slot = if label == 0 {
                0
            } else {
                chains.sizes[label - 1]
            };
        }
    });
    drop(columns);
    out.finish()
}

fn report(chains: &Chains, left_out: usize) -> Report {
    let mut report = Report::new("report");
    let (count, rows) = (chains.sizes.len() as f64, chains.labels.len() as f64);
    report.number("chains", count, "1");
    report.number("localisations", rows, "1");
    report.number("left out", left_out as f64, "1").description =
        Some("Rows without a finite position, frame and radius".into());
    report.number("mean length", rows / count, "1").description =
        Some("Localisations of a chain".into());
    let single = chains.sizes.iter().filter(|size| **size == 1).count();
    report.number("single", single as f64, "1").description =
        Some("Chains of one localisation".into());
    report
}

puncta_sdk::register!(Find);

#[cfg(test)]
mod tests;
