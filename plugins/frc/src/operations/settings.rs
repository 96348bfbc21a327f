//! What the operations on tables share: the parameters, and how a table is split.

use super::halves::{self, Setup, Splits, read_more, unit_is};
use super::result::{Corrected, Summary, emit};
use crate::curve::{Curve, Sums};
use crate::grid::{Axis, Grid};
use crate::points::{Points, Positions};
use crate::split::{Rule, Units};
use crate::spurious;
use puncta_sdk::input::Input;
use puncta_sdk::prelude::*;
use std::borrow::Cow;

/// How a table is split.
#[derive(Choice, Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Split {
    /// Time blocks, half of them drawn at random.
    RandomBlocks,
    /// Time blocks in turn.
    Blocks,
    /// Every localisation, or molecule, at random.
    Random,
}

/// The parameters of a call on tables.
pub(crate) struct Settings<'a> {
    pub(crate) title: &'static str,
    pub(crate) name: &'static str,
    pub(crate) axes: [Axis<'static>; 3],
    pub(crate) split: Split,
    pub(crate) block: u64,
    pub(crate) repeats: u64,
    pub(crate) seed: Seed,
    pub(crate) molecule: Option<&'a Column>,
    pub(crate) taper: f64,
    pub(crate) smoothing: Option<u64>,
    pub(crate) spurious: bool,
}

impl Settings<'_> {
    fn is_flat(&self) -> bool {
        self.axes[0].voxel <= 0.0
    }

    /// Completes the plan by the columns that the split needs.
    pub(crate) fn plan(&self, request: &Request, mut plan: Plan) -> Result<Plan, Failure> {
        let second = request.inputs.iter().any(|input| input.port == "second");
        let table = request
            .inputs
            .iter()
            .position(|input| input.port == "table");
        if self.spurious && second {
            let message = "repeats of molecules are estimated from halves of one table";
            return Err(Failure::bad_parameter("spurious", message)
                .remedy("clear spurious, or give one table"));
        }
        if let (Some(place), false) = (table, second) {
            if self.spurious {
                for column in ["error_x", "error_y"] {
                    unit_is(&request.inputs[place].header, column, &["nm"])?;
                }
                read_more(&mut plan, place, &["error_x", "error_y"]);
            }
            self.plan_split(&mut plan, place, &request.inputs[place].header)?;
        }
        plan.memory = request.rows() * 24;
        Ok(plan)
    }

    fn plan_split(&self, plan: &mut Plan, place: usize, header: &Header) -> Result<(), Failure> {
        let has_t = header.column("t").is_some();
        if self.split != Split::Random {
            if !has_t {
                let message = format!("{} has no column t, which time blocks need", header.name);
                return Err(Failure::bad_input(message).remedy("set split to random"));
            }
            unit_is(header, "t", &["frame", "frames"])?;
        }
        if has_t {
            read_more(plan, place, &["t"]);
        }
        match self.molecule {
            Some(molecule) if header.column(molecule).is_some() => {
                read_more(plan, place, &[molecule]);
            }
            Some(molecule) if &molecule.0 != "clumpIndex" => {
                let message = format!("{} has no column {}", header.name, molecule.0);
                return Err(Failure::bad_parameter("molecule", message)
                    .remedy("name a column of the table, or leave it empty"));
            }
            _ => {}
        }
        Ok(())
    }

    /// Does it.
    pub(crate) fn run(&self, job: &Job) -> Result<(), Failure> {
        job.progress(0.0, "finding the field")?;
        let table = job.input("table")?;
        let first = self.positions(&table)?;
        let second = job.inputs("second").next();
        let second = second.map(|second| self.positions(&second)).transpose()?;
        let memory = job.request().memory;
        let at = borrowed(&first);
        let (grid, setup, splits, how, units);
        let mut weight = 0.0;
        if let Some(second) = &second {
            let other = borrowed(second);
            grid = halves::field(job, self.axes, &[at, other], memory)?;
            setup = Setup::new(grid.size, grid.voxel, self.taper);
            let first = Points::new(job, &grid, at, &[])?;
            let second = Points::new(job, &grid, other, &[])?;
            splits = halves::pair(job, &setup, [&first, &second])?;
            (how, units) = ("two tables".to_owned(), 0);
        } else {
            let of_rows = self.units(&table)?;
            grid = halves::field(job, self.axes, &[at], memory)?;
            setup = Setup::new(grid.size, grid.voxel, self.taper);
            let points = Points::new(job, &grid, at, &of_rows.of_row)?;
            splits = halves::split(job, &setup, &points, &of_rows, self.repeats, self.seed.0)?;
            weight = points.squared_weights(&setup.window);
            how = self.described(splits.sums.len());
            units = of_rows.count;
        }
        let corrected = if self.spurious {
            self.corrected(&table, &setup, &splits, weight)?
        } else {
            None
        };
        let summary = Summary {
            title: self.title,
            name: self.name,
            caption: self.caption(&grid, &splits, &how),
            values: counted(&splits, units),
            corrected,
        };
        emit(
            job,
            &self.curve(&setup, &splits.frequencies, &splits.sums),
            &summary,
        )
    }

    fn curve(&self, setup: &Setup, frequencies: &[f64], sums: &[Sums]) -> Curve {
        let span = self.smoothing.map(|span| span as usize);
        Curve::new(
            &setup.rings,
            frequencies.to_vec(),
            setup.independent,
            sums,
            span,
        )
    }

    /// The curve without the correlation by repeats.
    fn corrected(
        &self,
        table: &Input<'_>,
        setup: &Setup,
        splits: &Splits,
        weight: f64,
    ) -> Result<Option<Corrected>, Failure> {
        let (x, y) = (table.f64("error_x")?, table.f64("error_y")?);
        let pairs = x.iter().zip(y.iter());
        let variances: Vec<f64> = pairs.map(|(x, y)| 0.5 * (x * x + y * y)).collect();
        let rings = splits.frequencies.len();
        let decay = spurious::decay(&variances, rings, setup.rings.step(), self.axes[2].voxel);
        let decay = decay.ok_or_else(|| {
            Failure::bad_input("no localisation has an error_x and error_y above 0")
                .remedy("clear spurious, or give the localisations their errors")
        })?;
        let found = spurious::remove(&splits.sums, &splits.frequencies, &decay, weight);
        Ok(found.map(|found| Corrected {
            q: found.q,
            curve: self.curve(setup, &splits.frequencies, &found.sums),
        }))
    }

    /// The positions z, y, x of a table.
    fn positions<'t>(&self, table: &Input<'t>) -> Result<[Cow<'t, [f64]>; 3], Failure> {
        let z = if self.is_flat() {
            Cow::Borrowed(&[][..])
        } else {
            table.f64("z")?
        };
        Ok([z, table.f64("y")?, table.f64("x")?])
    }

    /// The units of a table's split, from the columns that the plan read.
    fn units(&self, table: &Input<'_>) -> Result<Units, Failure> {
        let column = |name: &str| {
            let read = table.names(0).iter().any(|known| known == name);
            read.then(|| table.f64(name)).transpose()
        };
        let t = column("t")?;
        let molecules = match self.molecule {
            Some(molecule) => column(molecule)?,
            None => None,
        };
        let rule = match self.split {
            Split::RandomBlocks => Rule::RandomBlocks(self.block as f64),
            Split::Blocks => Rule::Blocks(self.block as f64),
            Split::Random => Rule::Random,
        };
        Units::new(rule, table.rows(), t.as_deref(), molecules.as_deref())
    }

    fn described(&self, repeats: usize) -> String {
        let block = self.block;
        match self.split {
            Split::RandomBlocks => format!("{repeats} random splits of blocks of {block} frames"),
            Split::Blocks => format!("blocks of {block} frames in turn"),
            Split::Random => format!("{repeats} random splits"),
        }
    }

    fn caption(&self, grid: &Grid, splits: &Splits, how: &str) -> String {
        let [depth, height, width] = grid.size;
        let [a, b] = splits.rows;
        let voxel = self.axes[2].voxel;
        let field = if self.is_flat() {
            format!("{width} x {height} pixels of {voxel} nm")
        } else {
            let deep = self.axes[0].voxel;
            format!("{width} x {height} x {depth} voxels of {voxel} x {voxel} x {deep} nm")
        };
        let taper = self.taper;
        format!("{field}, {a} and {b} localisations, {how}, Tukey window {taper}.")
    }
}

fn borrowed<'a>(columns: &'a [Cow<'_, [f64]>; 3]) -> Positions<'a> {
    columns.each_ref().map(|column| &column[..])
}

/// The counts of a split for the report.
fn counted(splits: &Splits, units: usize) -> Vec<(&'static str, f64, &'static str, String)> {
    let number = |name, value: f64, text: &str| (name, value, "1", text.to_owned());
    let [a, b] = splits.rows;
    let first = "Localisations of the first half, of the first split";
    let second = "Localisations of the second half, of the first split";
    let invalid = "Rows without a finite position or frame, left out";
    let outside = "Rows outside the field, left out";
    let mut values = vec![
        number("first", a as f64, first),
        number("second", b as f64, second),
        number("outside", splits.outside as f64, outside),
        number("invalid", splits.invalid as f64, invalid),
    ];
    if units > 0 {
        let text = "Blocks, molecules or localisations that were put into halves";
        values.push(number("units", units as f64, text));
    }
    values
}
