//! The operation `puncta.ripley.density/1`.

use crate::pairs::reach;
use crate::ripley::ball;
use crate::study::points;
use puncta_sdk::prelude::*;
use puncta_sdk::serde_json::json;
use puncta_shared_neighbours::Grid;

/// Density about each localisation.
#[derive(Params)]
pub struct Density {
    /// Radius within which neighbours are counted.
    #[param(default = 50, min = 1e-6, max = 1e9, unit = "nm")]
    radius: f64,
    /// Which neighbour's distance is given: 1 is the nearest.
    #[param(default = 1, min = 1, max = 1000)]
    k: usize,
    /// Column with the third coordinate, such as z; in the plane if left out.
    z: Option<Column>,
}

impl Density {
    fn go<const D: usize>(&self, job: &Job) -> Result<(), Failure> {
        let data = points::<D>(job, "table", self.z.as_ref())?;
        let axes = data.each_ref().map(|axis| &**axis);
        job.progress(0.0, "counting neighbours")?;
        let (counts, left_out) = neighbours(axes, self.radius, job)?;
        if left_out > 0 {
            job.warn(&format!(
                "{left_out} rows have no finite position: their density is NaN"
            ));
        }
        job.progress(0.5, "finding nearest neighbours")?;
        let grid = Grid::for_nearest(axes, [1.0; D], self.k, job)?;
        let distances = grid.nearest_distances(self.k, job)?;
        let unit = if D == 2 { "nm^-2" } else { "nm^-3" };
        let power = i32::try_from(D).unwrap_or(2);
        let columns = [
            ColumnInfo::new("neighbours", Element::U32, "1")
                .description("Localisations within the radius, without itself"),
            ColumnInfo::new("density", Element::F64, unit)
                .description("Neighbours within the radius over its area or volume"),
            ColumnInfo::new("nn_distance", Element::F64, "nm")
                .description("Distance from the k-th nearest localisation"),
            ColumnInfo::new("nn_density", Element::F64, unit)
                .description("k over the area or volume up to the k-th nearest localisation"),
        ];
        let mut out = job.add_columns("table", columns)?;
        let volume = ball(D) * self.radius.powi(power);
        let missing = |row: usize| distances[row].is_nan();
        out.u32_mut("neighbours")?.copy_from_slice(&counts);
        for (row, density) in out.f64_mut("density")?.iter_mut().enumerate() {
            *density = if missing(row) {
                f64::NAN
            } else {
                f64::from(counts[row]) / volume
            };
        }
        out.f64_mut("nn_distance")?.copy_from_slice(&distances);
        for (density, distance) in out.f64_mut("nn_density")?.iter_mut().zip(&distances) {
            *density = self.k as f64 / (ball(D) * distance.powi(power));
        }
        out.finish()
    }
}

/// Points in the cell of a point above which finer cells are counted whole.
const CROWD: f64 = 64.0;

/// Number of other points within a radius of each, in the order of the rows, and the number of rows
/// without a place.
fn neighbours<const D: usize>(
    axes: [&[f64]; D],
    radius: f64,
    run: &dyn Run,
) -> Result<(Vec<u32>, usize), Failure> {
    let coarse = Grid::new(axes, radius, run)?;
    let left_out = coarse.left_out();
    if coarse.crowd(run)? <= CROWD {
        let count = |i: usize| coarse.count_within(&coarse.point(i), radius) as u32 - 1;
        return Ok((coarse.by_row(run, 0, count)?, left_out));
    }
    drop(coarse);
    let grid = Grid::new(axes, radius / 8.0, run)?;
    let counts = grid.by_row(run, 0, |i| {
        if run.cancelled() {
            return 0;
        }
        crowd_within(&grid, i, radius) as u32 - 1
    })?;
    Ok((counts, left_out))
}

/// As [`Grid::count_within`] about a point of the grid. Cells that lie within the radius as a whole
/// are not looked into.
fn crowd_within<const D: usize>(grid: &Grid<D>, i: usize, radius: f64) -> usize {
    let (point, limit) = (grid.point(i), radius * radius);
    let mut count = 0;
    reach(grid, grid.cell_of(i), radius, |slice| {
        let inside = |k: usize| {
            let other = grid.point(k);
            (0..D).map(|a| (other[a] - point[a]).powi(2)).sum::<f64>() <= limit
        };
        let mut at = slice.start;
        while at < slice.end {
            let cell = grid.cell_of(at);
            let mut end = slice.end;
            grid.in_cells(cell, cell, |whole| end = whole.end);
            let farthest = (0..D).map(|a| {
                let low = cell[a] as f64 * grid.edge() - point[a];
                low.abs().max((low + grid.edge()).abs()).powi(2)
            });
            count += if farthest.sum::<f64>() < limit * (1.0 - 1e-9) {
                end - at
            } else {
                (at..end).filter(|k| inside(*k)).count()
            };
            at = end;
        }
    });
    count
}

impl Operation for Density {
    const ID: &'static str = "puncta.ripley.density/1";

    fn info() -> Info {
        Info::operation("Local density")
            .description(
                "Adds to each localisation the number of others within a radius, their density, the \
                 distance from its k-th nearest neighbour and the density that follows from it. No \
                 correction for the boundary of the field.",
            )
            .input(Ports::table("table").column("x", "nm").column("y", "nm").column("$z", "nm"))
            .output(Ports::columns("table", "table").description("The table with four columns"))
            .example(json!({"radius": 100, "k": 10}))
            .example_input("table", "puncta.synthetic.membrane/1", json!({}))
    }

    fn prepare(&self, request: &Request) -> Result<Plan, Failure> {
        let mut plan = puncta_sdk::operation::default_plan::<Self>(request);
        plan.memory = request.rows() * 80 + (64 << 20);
        Ok(plan)
    }

    fn run(&self, job: &Job) -> Result<(), Failure> {
        if self.z.is_some() {
            self.go::<3>(job)
        } else {
            self.go::<2>(job)
        }
    }
}

puncta_sdk::register!(Density);

#[cfg(test)]
mod tests {
    use super::*;
    use puncta_testkit::{Call, Table};

    #[test]
    fn four_columns() {
        let table = Table::new("localisations")
            .f64("x", "nm", &[0.0, 3.0, f64::NAN, 0.0])
            .f64("y", "nm", &[0.0, 4.0, 0.0, 0.0])
            .f64("depth", "nm", &[0.0, 12.0, 0.0, 0.0]);
        let call = Call::of::<Density>()
            .input("table", table.clone())
            .set("radius", 5)
            .set("k", 2);
        let done = call.run().expect("valid");
        let out = done.output("table").expect("finished");
        assert_eq!(out.u32("neighbours").expect("there"), [2, 2, 0, 2]);
        let density = out.f64("density").expect("there");
        assert!((density[0] - 2.0 / (25.0 * std::f64::consts::PI)).abs() < 1e-15);
        assert!(density[2].is_nan());
        let distances = out.f64("nn_distance").expect("there");
        assert_eq!((distances[0], distances[1]), (5.0, 5.0));
        let call = Call::of::<Density>()
            .input("table", table)
            .set("radius", 5)
            .set("z", "depth");
        let done = call.run().expect("valid");
        let out = done.output("table").expect("finished");
        assert_eq!(out.u32("neighbours").expect("there"), [1, 0, 0, 1]);
        assert_eq!(out.f64("nn_distance").expect("there")[1], 13.0);
    }

    #[test]
    fn changes_that_do_not_matter_change_nothing() {
        let points = crate::pairs::tests::points(1500, 100.0, 0.5, 6);
        let run = |at: &[Vec<f64>; 3], radius: f64| {
            let [x, y, z] = at;
            let table = Table::new("localisations")
                .f64("x", "nm", x)
                .f64("y", "nm", y);
            let call = Call::of::<Density>().input("table", table.f64("z", "nm", z));
            let call = call.set("radius", radius).set("k", 3).set("z", "z");
            let done = call.run().expect("valid");
            let out = done.output("table").expect("finished");
            let counts = out.u32("neighbours").expect("there");
            (counts, out.f64("nn_distance").expect("there"))
        };
        let (counts, distances) = run(&points, 8.0);
        let same = |found: (Vec<u32>, Vec<f64>), factor: f64| {
            assert_eq!(found.0[..1500], counts);
            let pairs = found.1.iter().zip(&distances);
            assert!(
                pairs
                    .into_iter()
                    .all(|(a, b)| (a - factor * b).abs() < 1e-6 * factor)
            );
        };
        let changed = |change: &dyn Fn(f64) -> f64| {
            points
                .each_ref()
                .map(|axis| axis.iter().map(|x| change(*x)).collect::<Vec<f64>>())
        };
        same(run(&changed(&|x| 3.0 * x), 24.0), 3.0);
        same(run(&changed(&|x| x + 1e7), 8.0), 1.0);
        let [x, y, z] = points.clone();
        same(run(&[y.iter().map(|y| -y).collect(), x, z], 8.0), 1.0);
        let mut doubled = points.clone();
        for axis in &mut doubled {
            let copy: Vec<f64> = axis.iter().map(|x| x + 1e6).collect();
            axis.extend(copy);
        }
        same(run(&doubled, 8.0), 1.0);
        let (mut backward, mut back) = run(
            &points.each_ref().map(|a| a.iter().rev().copied().collect()),
            8.0,
        );
        backward.reverse();
        back.reverse();
        same((backward, back), 1.0);
    }

    #[test]
    fn crowds_are_counted_as_one_by_one() {
        use puncta_testkit::Threads;
        let [mut x, mut y, mut z] = crate::pairs::tests::points(4000, 100.0, 0.5, 2);
        for axis in [&mut x, &mut y, &mut z] {
            axis.extend([50.0; 500]);
        }
        for radius in [5.0, 20.0, 300.0] {
            let grid = Grid::new([&x, &y], radius / 8.0, &Threads(2)).expect("valid");
            let deep = Grid::new([&x, &y, &z], radius / 8.0, &Threads(2)).expect("valid");
            for i in (0..4500).step_by(7) {
                let expected = grid.count_within(&grid.point(i), radius);
                assert_eq!(crowd_within(&grid, i, radius), expected);
                let expected = deep.count_within(&deep.point(i), radius);
                assert_eq!(crowd_within(&deep, i, radius), expected);
            }
            let (counts, _) = neighbours([&x, &y], radius, &Threads(2)).expect("valid");
            let first = grid.rows().iter().position(|row| *row == 0).expect("there");
            let expected = grid.count_within(&grid.point(first), radius);
            assert_eq!(counts[0] as usize + 1, expected);
        }
    }

    #[test]
    fn empty_single_and_cancelled() {
        let table = |n: usize| {
            let zeros = vec![0.0; n];
            Table::new("localisations")
                .f64("x", "nm", &zeros)
                .f64("y", "nm", &zeros)
        };
        let run = |n: usize| {
            Call::of::<Density>()
                .input("table", table(n))
                .run()
                .expect("valid")
        };
        assert!(
            run(0)
                .output("table")
                .expect("finished")
                .u32("neighbours")
                .expect("there")
                .is_empty()
        );
        let one = run(1);
        let one = one.output("table").expect("finished");
        assert_eq!(one.f64("nn_distance").expect("there"), [f64::INFINITY]);
        assert_eq!(one.f64("nn_density").expect("there"), [0.0]);
        let stopped = Call::of::<Density>()
            .input("table", table(100))
            .cancel_after(2)
            .run();
        assert!(stopped.expect_err("cancelled").is_cancelled());
        let zero = Call::of::<Density>()
            .input("table", table(3))
            .set("radius", 0)
            .run();
        assert_eq!(
            zero.expect_err("refused").parameter.as_deref(),
            Some("radius")
        );
    }
}
