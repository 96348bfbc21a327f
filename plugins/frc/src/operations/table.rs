//! The operation `puncta.frc.table/1`.

use super::halves::{self, Setup, Splits, read_more, unit_is};
use super::result::{Summary, emit, outputs};
use crate::curve::Curve;
use crate::grid::{Axis, Grid};
use crate::points::{Points, Positions};
use crate::split::{Rule, Units};
use puncta_sdk::input::Input;
use puncta_sdk::operation::default_plan;
use puncta_sdk::prelude::*;
use puncta_sdk::serde_json::json;

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

impl Split {
    pub(crate) fn rule(self, block: u64) -> Rule {
        match self {
            Split::RandomBlocks => Rule::RandomBlocks(block as f64),
            Split::Blocks => Rule::Blocks(block as f64),
            Split::Random => Rule::Random,
        }
    }
}

/// Fourier ring correlation of localisations.
#[derive(Params)]
pub struct Table {
    /// Side of a pixel of the histograms; at most a quarter of the resolution.
    #[param(default = 10, min = 1e-6, max = 1e9, unit = "nm")]
    pixel_size: f64,
    /// How the table is split into halves.
    #[param(default = Split::RandomBlocks)]
    split: Split,
    /// Frames of a time block.
    #[param(default = 500, min = 1, unit = "frame")]
    block: u64,
    /// Splits into halves, if they are drawn at random.
    #[param(default = 10, min = 1, max = 1000)]
    repeats: u64,
    /// Seed of the random splits.
    #[param(default = 1)]
    seed: Seed,
    /// Column with the numbers of molecules; all rows of one go into the same half.
    #[param(default = "clumpIndex")]
    molecule: Option<Column>,
    /// Share of the field over which the window falls to zero, both ends together.
    #[param(default = 0.25, min = 0, max = 1)]
    taper: f64,
    /// Rings that are averaged for the crossing; a twentieth of them if left out, at least 5.
    #[param(min = 1, max = 100000, advanced)]
    smoothing: Option<u64>,
    /// Low edge of the field in x; from the data if left out.
    #[param(unit = "nm", advanced)]
    x_min: Option<f64>,
    /// High edge of the field in x; from the data if left out.
    #[param(unit = "nm", advanced)]
    x_max: Option<f64>,
    /// Low edge of the field in y; from the data if left out.
    #[param(unit = "nm", advanced)]
    y_min: Option<f64>,
    /// High edge of the field in y; from the data if left out.
    #[param(unit = "nm", advanced)]
    y_max: Option<f64>,
}

impl Table {
    fn axes(&self) -> [Axis<'static>; 3] {
        let axis = |name, limits, voxel| Axis {
            name,
            limits,
            voxel,
            parameter: "pixel_size",
        };
        [
            axis("z", [None; 2], 0.0),
            axis("y", [self.y_min, self.y_max], self.pixel_size),
            axis("x", [self.x_min, self.x_max], self.pixel_size),
        ]
    }

    fn caption(&self, grid: &Grid, splits: &Splits, how: &str) -> String {
        let [_, height, width] = grid.size;
        let [a, b] = splits.rows;
        format!(
            "{width} x {height} pixels of {} nm, {a} and {b} localisations, {how}, Tukey window \
             {}.",
            self.pixel_size, self.taper
        )
    }
}

impl Operation for Table {
    const ID: &'static str = "puncta.frc.table/1";

    fn info() -> Info {
        let info = Info::operation("Fourier ring correlation")
            .description(
                "Splits the localisations into halves, counts them in pixels, and correlates the \
                 spectra on rings of equal spatial frequency. The resolution is where the curve \
                 falls below a threshold.\nWith a second table the two are the halves. Repeats of \
                 one molecule in both halves correlate without saying anything of the structure: \
                 chain the localisations first, or split by blocks longer than a molecule blinks.",
            )
            .cite("Nieuwenhuizen et al., Nature Methods 10, 557 (2013)")
            .cite("van Heel and Schatz, Journal of Structural Biology 151, 250 (2005)")
            .input(Ports::table("table").column("x", "nm").column("y", "nm"))
            .input(
                Ports::table("second")
                    .column("x", "nm")
                    .column("y", "nm")
                    .optional()
                    .description("The other half; the table is not split then"),
            );
        outputs(info)
            .example(json!({"pixel_size": 5, "repeats": 3}))
            .example_input("table", "puncta.synthetic.membrane/1", json!({"copies": 4}))
    }

    fn prepare(&self, request: &Request) -> Result<Plan, Failure> {
        let mut plan = default_plan::<Self>(request);
        let second = request.inputs.iter().any(|input| input.port == "second");
        let table = request
            .inputs
            .iter()
            .position(|input| input.port == "table");
        if let (Some(place), false) = (table, second) {
            plan_split(
                &mut plan,
                request,
                place,
                self.split,
                self.molecule.as_ref(),
            )?;
        }
        plan.memory = request.inputs.iter().map(|i| i.header.rows() * 24).sum();
        Ok(plan)
    }

    fn run(&self, job: &Job) -> Result<(), Failure> {
        job.progress(0.0, "finding the field")?;
        let table = job.input("table")?;
        let (x, y) = (table.f64("x")?, table.f64("y")?);
        let at: Positions<'_> = [&[], &y, &x];
        let second = job.inputs("second").next();
        let memory = job.request().memory;
        let (grid, setup, splits, how, units);
        if let Some(second) = second {
            let (x, y) = (second.f64("x")?, second.f64("y")?);
            let other: Positions<'_> = [&[], &y, &x];
            grid = halves::field(job, self.axes(), &[at, other], memory)?;
            setup = Setup::new(grid.size, grid.voxel, self.taper);
            let first = Points::new(job, &grid, at, &[])?;
            let second = Points::new(job, &grid, other, &[])?;
            splits = halves::pair(job, &setup, [&first, &second])?;
            (how, units) = ("two tables".to_owned(), 0);
        } else {
            let of_rows = units_of(&table, self.split, self.block, self.molecule.as_ref())?;
            grid = halves::field(job, self.axes(), &[at], memory)?;
            setup = Setup::new(grid.size, grid.voxel, self.taper);
            let points = Points::new(job, &grid, at, &of_rows.of_row)?;
            splits = halves::split(job, &setup, &points, &of_rows, self.repeats, self.seed.0)?;
            how = described(self.split, self.block, splits.sums.len());
            units = of_rows.count;
        }
        let caption = self.caption(&grid, &splits, &how);
        let span = self.smoothing.map(|span| span as usize);
        let values = counted(&splits, units);
        let curve = Curve::new(
            &setup.rings,
            splits.frequencies,
            setup.independent,
            &splits.sums,
            span,
        );
        let summary = Summary {
            title: "Fourier ring correlation",
            name: "frc",
            caption,
            values,
        };
        emit(job, &curve, &summary)
    }
}

/// Has the columns read that a split needs.
pub(crate) fn plan_split(
    plan: &mut Plan,
    request: &Request,
    place: usize,
    split: Split,
    molecule: Option<&Column>,
) -> Result<(), Failure> {
    let header = &request.inputs[place].header;
    let has_t = header.column("t").is_some();
    if split != Split::Random {
        if !has_t {
            let message = format!("{} has no column t, which time blocks need", header.name);
            return Err(Failure::bad_input(message).remedy("set split to random"));
        }
        unit_is(header, "t", &["frame", "frames"])?;
    }
    if has_t {
        read_more(plan, place, &["t"]);
    }
    match molecule {
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

/// The units of a table's split, from the columns that the plan read.
pub(crate) fn units_of(
    table: &Input<'_>,
    split: Split,
    block: u64,
    molecule: Option<&Column>,
) -> Result<Units, Failure> {
    let column = |name: &str| {
        let read = table.names(0).iter().any(|known| known == name);
        read.then(|| table.f64(name)).transpose()
    };
    let t = column("t")?;
    let molecules = match molecule {
        Some(molecule) => column(molecule)?,
        None => None,
    };
    Units::new(
        split.rule(block),
        table.rows(),
        t.as_deref(),
        molecules.as_deref(),
    )
}

/// What was split how, for a caption.
pub(crate) fn described(split: Split, block: u64, repeats: usize) -> String {
    match split {
        Split::RandomBlocks => format!("{repeats} random splits of blocks of {block} frames"),
        Split::Blocks => format!("blocks of {block} frames in turn"),
        Split::Random => format!("{repeats} random splits"),
    }
}

/// The counts of a split for the report.
pub(crate) fn counted(
    splits: &Splits,
    units: usize,
) -> Vec<(&'static str, f64, &'static str, String)> {
    let number = |name, value: f64, text: &str| (name, value, "1", text.to_owned());
    let [a, b] = splits.rows;
    let mut values = vec![
        number(
            "first",
            a as f64,
            "Localisations of the first half, of the first split",
        ),
        number(
            "second",
            b as f64,
            "Localisations of the second half, of the first split",
        ),
        number(
            "outside",
            splits.outside as f64,
            "Rows outside the field, left out",
        ),
        number(
            "invalid",
            splits.invalid as f64,
            "Rows without a finite position or frame, left out",
        ),
    ];
    if units > 0 {
        let text = "Blocks, molecules or localisations that were put into halves";
        values.push(number("units", units as f64, text));
    }
    values
}

puncta_sdk::register!(Table);

#[cfg(test)]
mod tests;
