//! The operation `puncta.frc.shell/1`.

use super::result::outputs;
use super::settings::{Settings, Split};
use crate::grid::Axis;
use puncta_sdk::operation::default_plan;
use puncta_sdk::prelude::*;
use puncta_sdk::serde_json::json;

/// Fourier shell correlation of localisations in three dimensions.
#[derive(Params)]
pub struct Shell {
    /// Side of a voxel in x and y.
    #[param(default = 20, min = 1e-6, max = 1e9, unit = "nm")]
    voxel_size: f64,
    /// Side of a voxel in z; that in x and y if left out.
    #[param(min = 1e-6, max = 1e9, unit = "nm")]
    voxel_size_z: Option<f64>,
    /// How the table is split into halves.
    #[param(default = Split::RandomBlocks)]
    split: Split,
    /// Frames of a time block.
    #[param(default = 500, min = 1, unit = "frame")]
    block: u64,
    /// Splits into halves, if they are drawn at random.
    #[param(default = 5, min = 1, max = 1000)]
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
    /// Shells that are averaged for the crossing; a twentieth of them if left out, at least 5.
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
    /// Low edge of the field in z; from the data if left out.
    #[param(unit = "nm", advanced)]
    z_min: Option<f64>,
    /// High edge of the field in z; from the data if left out.
    #[param(unit = "nm", advanced)]
    z_max: Option<f64>,
}

impl Shell {
    fn settings(&self) -> Settings<'_> {
        let axis = |name, limits, voxel, parameter| Axis {
            name,
            limits,
            voxel,
            parameter,
        };
        let size = self.voxel_size;
        let deep = self.voxel_size_z.unwrap_or(size);
        Settings {
            title: "Fourier shell correlation",
            name: "fsc",
            axes: [
                axis("z", [self.z_min, self.z_max], deep, "voxel_size_z"),
                axis("y", [self.y_min, self.y_max], size, "voxel_size"),
                axis("x", [self.x_min, self.x_max], size, "voxel_size"),
            ],
            split: self.split,
            block: self.block,
            repeats: self.repeats,
            seed: self.seed,
            molecule: self.molecule.as_ref(),
            taper: self.taper,
            smoothing: self.smoothing,
            spurious: false,
        }
    }
}

impl Operation for Shell {
    const ID: &'static str = "puncta.frc.shell/1";

    fn info() -> Info {
        let table = |name| {
            let port = Ports::table(name).column("x", "nm").column("y", "nm");
            port.column("z", "nm")
        };
        let info = Info::operation("Fourier shell correlation")
            .description(
                "Splits the localisations into halves, counts them in voxels, and correlates the \
                 spectra on shells of equal spatial frequency. The resolution is that of all \
                 directions together.\nWith a second table the two are the halves. Volumes are \
                 compared by the correlation of images.",
            )
            .cite("van Heel and Schatz, Journal of Structural Biology 151, 250 (2005)")
            .input(table("table"))
            .input(
                table("second")
                    .optional()
                    .description("The other half; the table is not split then"),
            );
        outputs(info)
            .example(json!({"voxel_size": 5, "repeats": 2}))
            .example_input("table", "puncta.synthetic.membrane/1", json!({}))
    }

    fn prepare(&self, request: &Request) -> Result<Plan, Failure> {
        self.settings().plan(request, default_plan::<Self>(request))
    }

    fn run(&self, job: &Job) -> Result<(), Failure> {
        self.settings().run(job)
    }
}

puncta_sdk::register!(Shell);

#[cfg(test)]
mod tests {
    use super::super::testing::{Random, value};
    use super::*;
    use puncta_testkit::{Call, Table};

    /// Emitters at random places in a box, m localisations each.
    fn emitters(count: usize, m: usize, sigma: f64, side: [f64; 3], seed: u64) -> [Vec<f64>; 3] {
        let mut random = Random(seed);
        let mut out = [vec![], vec![], vec![]];
        for _ in 0..count {
            let centre = side.map(|side| random.unit() * side);
            for _ in 0..m {
                for (axis, column) in out.iter_mut().enumerate() {
                    column.push(centre[axis] + sigma * random.normal());
                }
            }
        }
        out
    }

    fn call(rows: &[Vec<f64>; 3]) -> Call {
        let [x, y, z] = rows;
        let table = Table::new("locs").f64("x", "nm", x).f64("y", "nm", y);
        let table = table.f64("z", "nm", z);
        let call = Call::of::<Shell>().input("table", table);
        call.set("split", "random")
            .set("repeats", 2)
            .set("voxel_size", 15)
    }

    /// As in two dimensions: (m - 1) / 2 exp(-4 pi^2 sigma^2 q^2) = 1/6 at the crossing.
    #[test]
    fn a_planted_sigma_is_found_in_three_dimensions() {
        let rows = emitters(2000, 20, 25.0, [1500.0, 1200.0, 900.0], 4);
        let done = call(&rows).run().unwrap();
        let truth = std::f64::consts::TAU * 25.0 / (3.0 * 19.0_f64).ln().sqrt();
        let found = value(&done, "resolution");
        assert!((found / truth - 1.0).abs() < 0.05, "{found} {truth}");
        let other = call(&rows)
            .set("voxel_size_z", 20)
            .threads(3)
            .run()
            .unwrap();
        let found = value(&other, "resolution");
        assert!((found / truth - 1.0).abs() < 0.05, "{found} {truth}");
    }

    #[test]
    fn noise_flat_and_stopped() {
        let rows = emitters(20_000, 1, 0.0, [900.0; 3], 5);
        let done = call(&rows).run().unwrap();
        assert!(value(&done, "resolution").is_nan() && done.text().contains("than noise"));
        let mut flat = rows.clone();
        flat[2].fill(3.0);
        let error = call(&flat).run().unwrap_err();
        assert_eq!(error.parameter.as_deref(), Some("voxel_size_z"), "{error}");
        assert!(
            call(&rows)
                .cancel_after(3)
                .run()
                .unwrap_err()
                .is_cancelled()
        );
        let curves = [1, 2, 3].map(|n| {
            let done = call(&rows).threads(n).run().unwrap();
            done.output("curve").unwrap().f64("fsc").unwrap()
        });
        assert!(curves[0][1..] == curves[1][1..] && curves[1][1..] == curves[2][1..]);
    }
}
