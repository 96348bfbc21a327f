//! The operation `puncta.frc.table/1`.

use super::result::outputs;
use super::settings::{Settings, Split};
use crate::grid::Axis;
use puncta_sdk::operation::default_plan;
use puncta_sdk::prelude::*;
use puncta_sdk::serde_json::json;

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
    /// Estimate how often molecules are found again from error_x and error_y, and correct for it.
    #[param(default = false)]
    spurious: bool,
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

    fn settings(&self) -> Settings<'_> {
        Settings {
            title: "Fourier ring correlation",
            name: "frc",
            axes: self.axes(),
            split: self.split,
            block: self.block,
            repeats: self.repeats,
            seed: self.seed,
            molecule: self.molecule.as_ref(),
            taper: self.taper,
            smoothing: self.smoothing,
            spurious: self.spurious,
        }
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
            .example(json!({"pixel_size": 5, "repeats": 3, "spurious": true}))
            .example_input("table", "puncta.synthetic.membrane/1", json!({"copies": 4}))
    }

    fn prepare(&self, request: &Request) -> Result<Plan, Failure> {
        self.settings().plan(request, default_plan::<Self>(request))
    }

    fn run(&self, job: &Job) -> Result<(), Failure> {
        self.settings().run(job)
    }
}

puncta_sdk::register!(Table);

#[cfg(test)]
mod tests;
