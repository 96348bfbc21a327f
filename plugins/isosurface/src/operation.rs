//! `puncta.isosurface.octree/1`

use crate::extract::{Extracted, Settings, extract};
use crate::output::{write_boxes, write_mesh};
use puncta_sdk::operation::default_plan;
use puncta_sdk::prelude::*;
use puncta_sdk::serde_json::json;

/// Where the surface lies.
#[derive(Choice, Clone, Copy, Debug, PartialEq, Eq)]
pub enum Place {
    /// Amid the localisations when the threshold is chosen by the data, otherwise at the threshold
    Automatic,
    /// Where the density is the threshold
    Threshold,
    /// Amid the localisations: their median signed distance is zero
    Localisations,
}

/// Extracts a closed surface from the density of localisations.
#[derive(Params)]
pub struct Isosurface {
    /// Cells of the octree with more localisations than this are cut into eight.
    #[param(default = 50, min = 1, max = 1e6)]
    pub most: u32,
    /// Smallest side of a cell.
    #[param(default = 5.0, min = 1e-3, max = 1e6, unit = "nm")]
    pub smallest_cell: f64,
    /// Localisations per volume at the surface; chosen by the data if left out.
    #[param(min = 1e-300, max = 1e6, unit = "nm^-3")]
    pub threshold: Option<f64>,
    /// Passes of smoothing over the density, each about as wide as a cell.
    #[param(default = 1, min = 0, max = 20, advanced)]
    pub smoothing: u32,
    /// Fills hollows, so that only outer sheets are left.
    #[param(default = true)]
    pub cull_inner: bool,
    /// Where the surface lies.
    #[param(default = Place::Automatic)]
    pub place: Place,
    /// Components with fewer triangles are dropped.
    #[param(default = 100, min = 0, max = 1e9)]
    pub minimum_triangles: u64,
    /// Gives the octree as a table of boxes, too.
    #[param(default = false)]
    pub boxes: bool,
}

impl Isosurface {
    fn settings(&self) -> Result<Settings, Failure> {
        let centre = match self.place {
            Place::Automatic => self.threshold.is_none() && self.cull_inner,
            Place::Threshold => false,
            Place::Localisations => true,
        };
        if centre && !self.cull_inner {
            let message = "inner and outer sheets cannot both lie amid the localisations";
            return Err(Failure::bad_parameter("place", message)
                .remedy("cull the inner sheets, or place the surface at the threshold"));
        }
        Ok(Settings {
            most: self.most,
            smallest_cell: self.smallest_cell,
            smoothing: self.smoothing,
            threshold: self.threshold,
            cull: self.cull_inner,
            centre,
            fewest_triangles: usize::try_from(self.minimum_triangles).unwrap_or(usize::MAX),
        })
    }
}

impl Operation for Isosurface {
    const ID: &'static str = "puncta.isosurface.octree/1";

    fn info() -> Info {
        Info::operation("Isosurface of localisations")
            .description(
                "Extracts a closed, oriented surface from the density of localisations.\nAn octree \
                 follows the localisations; marching cubes run on the cells of its dual grid. The \
                 surface has no boundary and no edge of more than two triangles, whatever the \
                 input. With the threshold left out, a quarter of the density at the median \
                 localisation is taken, and the outer sheet is moved along its normals into the \
                 middle of the localisations.",
            )
            .input(
                Ports::table("table")
                    .column("x", "nm")
                    .column("y", "nm")
                    .column("z", "nm")
                    .description("Localisations; rows without a finite position are left out"),
            )
            .output(Ports::mesh("surface"))
            .output(Ports::report("report"))
            .output(
                Ports::table("octree")
                    .optional()
                    .description("Leaves of the octree as boxes"),
            )
            .cite("Schaefer and Warren, Dual marching cubes: primal contouring of dual grids, 2004")
            .cite("10.1109/TVCG.2019.2934595")
            .example(json!({"most": 20, "boxes": true}))
            .example_input(
                "table",
                "puncta.synthetic.membrane/1",
                json!({"shape": "sphere", "acceptance": 0.3, "background": 0.02, "fwhm_x": 100,
                       "fwhm_y": 100, "fwhm_z": 100}),
            )
    }

    fn prepare(&self, request: &Request) -> Result<Plan, Failure> {
        self.settings()?;
        let mut plan = default_plan::<Self>(request);
        let rows = request
            .inputs
            .first()
            .map_or(0, |input| input.header.rows());
        plan.memory = rows.saturating_mul(48);
        Ok(plan)
    }

    fn run(&self, job: &Job) -> Result<(), Failure> {
        let table = job.input("table")?;
        let (x, y, z) = (table.f64("x")?, table.f64("y")?, table.f64("z")?);
        let extracted = extract([&x, &y, &z], &self.settings()?, job)?;
        write_mesh(job, "surface", &extracted.surface)?;
        if self.boxes {
            write_boxes(job, "octree", &extracted.octree)?;
        }
        job.report(&report(&extracted))
    }
}

fn report(extracted: &Extracted) -> Report {
    let Extracted {
        surface,
        octree,
        threshold,
        components,
        median,
        ..
    } = extracted;
    let mut report = Report::new("report");
    let mut count = |name: &str, value: usize| {
        report.number(name, value as f64, "1");
    };
    count("rows_left_out", extracted.left_out);
    count("octree_leaves", octree.len());
    count("balanced_leaves", extracted.leaves);
    count("components", components[0]);
    count("components_dropped", components[1]);
    count("vertices", surface.positions.len());
    count("triangles", surface.triangles.len());
    report.number("threshold", *threshold, "nm^-3");
    report.number("euler_characteristic", surface.euler() as f64, "1");
    report.number("area", surface.area(), "nm^2");
    report.number("volume", surface.volume(), "nm^3");
    report.number("median_distance_at_threshold", median[0], "nm");
    report.number("median_distance", median[1], "nm");
    report
}

register!(Isosurface);

#[cfg(test)]
mod tests {
    use super::*;
    use puncta_testkit::{Call, Done, Table};

    fn sphere(count: usize) -> [Vec<f64>; 3] {
        let mut random = puncta_testkit::Random(5);
        let mut columns: [Vec<f64>; 3] = Default::default();
        for _ in 0..count {
            let p = crate::tests::direction(&mut random).map(|x| 100.0 * x);
            crate::tests::push(&mut columns, p);
        }
        columns
    }

    fn call(columns: &[Vec<f64>; 3]) -> Call {
        let [x, y, z] = columns;
        let table = Table::new("t")
            .f64("x", "nm", x)
            .f64("y", "nm", y)
            .f64("z", "nm", z);
        Call::of::<Isosurface>().input("table", table)
    }

    fn message(result: Result<Done, Failure>) -> String {
        result
            .err()
            .map(|failure| failure.to_string())
            .unwrap_or_default()
    }

    #[test]
    fn outputs_do_not_depend_on_threads() {
        let columns = sphere(20_000);
        let of = |threads| {
            let done = call(&columns)
                .set("boxes", true)
                .threads(threads)
                .run()
                .expect("done");
            let surface = done
                .output("surface")
                .expect("surface")
                .f64("x")
                .expect("x");
            let bits: Vec<u64> = surface.into_iter().map(f64::to_bits).collect();
            (
                bits,
                done.output("octree")
                    .expect("boxes")
                    .u32("count")
                    .expect("count"),
            )
        };
        let one = of(1);
        assert_eq!(one.1.iter().sum::<u32>(), 20_000);
        assert!(one.0.len() > 250);
        assert_eq!(one, of(2));
        assert_eq!(one, of(3));
    }

    #[test]
    fn bad_input_is_refused_in_a_sentence() {
        let none: [Vec<f64>; 3] = Default::default();
        assert!(message(call(&none).run()).contains("no localisation has a finite position"));
        let nan = [vec![f64::NAN; 3], vec![1.0; 3], vec![1.0; 3]];
        assert!(message(call(&nan).run()).contains("no localisation has a finite position"));
        let one = [vec![1.0], vec![2.0], vec![3.0]];
        assert!(message(call(&one).run()).contains("lie at one place"));
        let equal = [vec![1.0; 500], vec![2.0; 500], vec![3.0; 500]];
        assert!(message(call(&equal).run()).contains("all 500 localisations lie at one place"));
        let mut flat = sphere(1000);
        flat[2].fill(7.0);
        assert!(message(call(&flat).run()).contains("z is the same for all 1000 localisations"));
        let columns = sphere(1000);
        let high = call(&columns).set("threshold", 1e3).run();
        assert!(message(high).contains("no cell reaches the threshold"));
        let small = call(&columns).set("minimum_triangles", 1_000_000).run();
        assert!(message(small).contains("fewer than 1000000 triangles"));
        let both = call(&columns)
            .set("cull_inner", false)
            .set("place", "localisations")
            .run();
        assert!(message(both).contains("inner and outer sheets"));
        assert!(call(&columns).cancel_after(2).run().is_err());
    }

    #[test]
    fn a_threshold_below_every_density_gives_a_closed_surface() {
        let mut columns = sphere(5000);
        columns[0][17] = f64::NAN;
        let done = call(&columns).set("threshold", 1e-300).run().expect("done");
        let x = done
            .output("surface")
            .expect("surface")
            .f64("x")
            .expect("x");
        assert!(x.iter().all(|x| x.is_finite()) && x.len() > 100);
    }
}
