//! Distances to nearest neighbours and empty space: G, F and J.
//!
//! The distribution functions are Kaplan and Meier's: a distance is censored by that of the boundary
//! (Baddeley and Gill, Ann. Stat. 25, 263, 1997), so that they need no correction beside it.

use crate::edges::ends;
use crate::pairs::grid;
use crate::window::{Rim, Window};
use puncta_sdk::run::{Run, map};
use puncta_sdk::{Cancelled, Failure};
use puncta_shared_neighbours::{Grid, Nearest};
use std::sync::{Mutex, PoisonError};

/// Rows between two polls for cancel.
const CHUNK: usize = 2048;

/// Distance of each point of the first set to its nearest neighbour: in the second set, or, without
/// one, among the others of its own. Infinite if there is none.
///
/// # Errors
/// When cancelled, or as [`Grid::new`].
pub fn nearest<const D: usize>(
    one: [&[f64]; D],
    two: Option<[&[f64]; D]>,
    run: &dyn Run,
) -> Result<Vec<f64>, Failure> {
    let Some(two) = two else {
        let grid = Grid::for_nearest(one, [1.0; D], 1, run)?;
        return Ok(grid.nearest_distances(1, run)?);
    };
    let grid = Grid::for_nearest(two, [1.0; D], 1, run)?;
    let rows = one[0].len();
    let parts = map(run, rows.div_ceil(CHUNK), &|chunk| {
        let mut nearest = Nearest::new(1);
        let rows = chunk * CHUNK..rows.min((chunk + 1) * CHUNK);
        if run.cancelled() {
            return Vec::new();
        }
        let distance = |row: usize| {
            grid.nearest(&one.map(|axis| axis[row]), None, &mut nearest);
            nearest.last().map_or(f64::INFINITY, |one| one.0.sqrt())
        };
        rows.map(distance).collect::<Vec<f64>>()
    });
    if run.cancelled() {
        return Err(Failure::cancelled());
    }
    Ok(parts.concat())
}

/// Distance of each point from the boundary; infinite beyond `reach`.
///
/// # Errors
/// When cancelled, or as [`Grid::new`].
pub fn border<const D: usize>(
    points: [&[f64]; D],
    window: &dyn Window<D>,
    reach: f64,
    run: &dyn Run,
) -> Result<Vec<f64>, Failure> {
    let grid = grid(points, reach, run)?;
    let blocks = grid.map_blocks(run, |block| {
        let (mut rim, mut distances) = (Rim::default(), Vec::with_capacity(block.len()));
        for cell in grid.cells(block) {
            let (low, high) = ends(&grid, cell.clone());
            let pieces = window.pieces(&low, &high, reach);
            for i in cell {
                if pieces.is_empty() {
                    distances.push(f64::INFINITY);
                } else {
                    window.about(&grid.point(i), &pieces, reach, &mut rim);
                    distances.push(rim.distance);
                }
            }
        }
        distances
    })?;
    let mut border = vec![f64::INFINITY; points[0].len()];
    for (&row, distance) in grid.rows().iter().zip(blocks.into_iter().flatten()) {
        border[row as usize] = distance;
    }
    Ok(border)
}

/// Places of a square (cubic) lattice of about so many, those that lie in the region.
#[must_use]
pub fn lattice<const D: usize>(window: &dyn Window<D>, count: usize) -> [Vec<f64>; D] {
    let [low, high] = window.bounds();
    let sides: [f64; D] = std::array::from_fn(|a| high[a] - low[a]);
    let volume: f64 = sides.iter().product();
    // Thin regions keep at least one place along each axis.
    let pitch = (volume / count as f64).powf(1.0 / D as f64);
    let numbers = sides.map(|side| ((side / pitch).round() as usize).clamp(1, count));
    let mut axes: [Vec<f64>; D] = std::array::from_fn(|_| Vec::new());
    for place in 0..numbers.iter().product() {
        let mut rest = place;
        let point: [f64; D] = std::array::from_fn(|a| {
            let number = rest % numbers[a];
            rest /= numbers[a];
            low[a] + (number as f64 + 0.5) * sides[a] / numbers[a] as f64
        });
        if window.holds(&point) {
            axes.iter_mut()
                .zip(point)
                .for_each(|(axis, x)| axis.push(x));
        }
    }
    axes
}

/// Kaplan and Meier's distribution function of distances that a boundary censors, at increasing
/// radii.
///
/// # Errors
/// When cancelled.
pub fn kaplan_meier(
    distances: &[f64],
    border: &[f64],
    radii: &[f64],
    run: &dyn Run,
) -> Result<Vec<f64>, Cancelled> {
    // Ends by the first radius that they do not exceed; those beyond all are still at risk.
    let mut buckets: Vec<Vec<(f64, bool)>> = vec![Vec::new(); radii.len()];
    for (row, (distance, border)) in distances.iter().zip(border).enumerate() {
        if row % (1 << 16) == 0 {
            alive(run)?;
        }
        let end = distance.min(*border);
        if let Some(bucket) = buckets.get_mut(radii.partition_point(|radius| *radius < end)) {
            bucket.push((end, distance <= border));
        }
    }
    let buckets: Vec<Mutex<Vec<(f64, bool)>>> = buckets.into_iter().map(Mutex::new).collect();
    run.parallel(buckets.len(), &|bucket| {
        if !run.cancelled() {
            let mut ends = buckets[bucket]
                .lock()
                .unwrap_or_else(PoisonError::into_inner);
            ends.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
        }
    });
    alive(run)?;
    let (mut left, mut kept) = (distances.len(), 1.0);
    let mut values = Vec::with_capacity(radii.len());
    for bucket in buckets {
        let ends = bucket.into_inner().unwrap_or_else(PoisonError::into_inner);
        for same in ends.chunk_by(|a, b| a.0 == b.0) {
            let found = same.iter().filter(|end| end.1).count();
            kept *= 1.0 - found as f64 / left as f64;
            left -= same.len();
        }
        values.push(1.0 - kept);
    }
    Ok(values)
}

/// Share of the distances up to each of increasing radii.
#[must_use]
pub fn shares(distances: &[f64], radii: &[f64]) -> Vec<f64> {
    let mut counts = vec![0_u64; radii.len() + 1];
    for distance in distances {
        counts[radii.partition_point(|radius| radius < distance)] += 1;
    }
    let sum = |sum: &mut u64, count: &u64| {
        *sum += count;
        Some(*sum as f64 / distances.len() as f64)
    };
    counts.iter().take(radii.len()).scan(0, sum).collect()
}

/// Mean distance over that of complete spatial randomness, without correction for the boundary, and
/// its standard score in the plane (Clark and Evans, Ecology 35, 445, 1954).
#[must_use]
pub fn clark_evans(distances: &[f64], density: f64, dimensions: usize) -> (f64, f64) {
    let count = distances.len() as f64;
    let mean = distances.iter().sum::<f64>() / count;
    if dimensions == 2 {
        let expected = 0.5 / density.sqrt();
        // Variance (4 - pi) / (4 pi density) of a distance.
        let error = 0.261_361_362 / (count * density).sqrt();
        (mean / expected, (mean - expected) / error)
    } else {
        // Gamma(4/3) (4 pi density / 3)^(-1/3).
        (mean / (0.553_960_278 / density.cbrt()), f64::NAN)
    }
}

/// Cancels between phases.
pub(crate) fn alive(run: &dyn Run) -> Result<(), Cancelled> {
    if run.cancelled() {
        Err(Cancelled)
    } else {
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::flat::Flat;
    use crate::flat::tests::letter;
    use crate::simulate::{stream, uniform};
    use crate::window::Cuboid;
    use puncta_testkit::{Stopped, Threads};

    #[test]
    fn censored_distances_as_by_hand() {
        // Deaths at 1 (5 at risk) and 3 (2 at risk, one of them censored there); censored at 2, 3, 2.
        let distances = [1.0, 5.0, 3.0, 4.0, 9.0];
        let border = [7.0, 2.0, 3.0, 3.0, 2.0];
        let radii = [0.5, 1.0, 2.0, 3.0, 10.0];
        let found = kaplan_meier(&distances, &border, &radii, &Threads(2)).expect("not cancelled");
        let expected = [0.0, 0.2, 0.2, 1.0 - 0.8 * 0.5, 1.0 - 0.8 * 0.5];
        for (found, expected) in found.iter().zip(expected) {
            assert!((found - expected).abs() < 1e-15, "{found} {expected}");
        }
        assert_eq!(
            shares(&[1.0, 1.0, 2.0, f64::INFINITY], &[1.0, 3.0]),
            [0.5, 0.75]
        );
    }

    fn check<const D: usize>(window: &dyn Window<D>, count: usize) {
        let density = count as f64 / window.volume();
        let scale = density.powf(-1.0 / D as f64);
        let radii: Vec<f64> = (1..=10).map(|k| f64::from(k) * scale / 10.0).collect();
        let run = Threads(2);
        let points = uniform(window, count, &mut stream(5, 0));
        let axes = points.each_ref().map(Vec::as_slice);
        let places = lattice(window, 20_000);
        let places = places.each_ref().map(Vec::as_slice);
        let g = nearest(axes, None, &run).expect("valid");
        let f = nearest(places, Some(axes), &run).expect("valid");
        let g_border = border(axes, window, scale, &run).expect("valid");
        let f_border = border(places, window, scale, &run).expect("valid");
        let g = kaplan_meier(&g, &g_border, &radii, &run).expect("not cancelled");
        let f = kaplan_meier(&f, &f_border, &radii, &run).expect("not cancelled");
        for ((g, f), r) in g.iter().zip(&f).zip(&radii) {
            let volume = crate::ripley::ball(D) * r.powi(D as i32);
            let expected = 1.0 - (-density * volume).exp();
            assert!((g - expected).abs() < 0.02, "G({r}) = {g}, not {expected}");
            assert!((f - expected).abs() < 0.02, "F({r}) = {f}, not {expected}");
        }
    }

    #[test]
    fn complete_spatial_randomness_has_its_distances() {
        check(&Flat::rectangle([0.0, -50.0], [1000.0, 450.0]), 8000);
        check(&letter(0.0), 8000);
        let cube = Cuboid {
            low: [0.0; 3],
            high: [500.0, 400.0, 300.0],
        };
        check(&cube, 8000);
        let plane = Flat::rectangle([0.0, 0.0], [1e4, 1e4]);
        let points = uniform(&plane, 20_000, &mut stream(1, 1));
        let axes = points.each_ref().map(Vec::as_slice);
        let distances = nearest(axes, None, &Threads(2)).expect("valid");
        let (ratio, score) = clark_evans(&distances, 20_000.0 / 1e8, 2);
        assert!(
            (ratio - 1.0).abs() < 0.02 && score.abs() < 4.0,
            "{ratio} {score}"
        );
    }

    #[test]
    fn distances_from_the_boundary() {
        let (x, y) = ([450.0, 100.0, 700.0, 440.0], [450.0, 30.0, 440.0, 800.0]);
        let found = border([&x, &y], &letter(0.0), 50.0, &Threads(1)).expect("valid");
        assert_eq!(found, [0.0, 30.0, 10.0, 10.0]);
        let far = border([&x[1..2], &y[1..2]], &letter(0.0), 20.0, &Threads(1)).expect("valid");
        assert_eq!(far, [f64::INFINITY]);
    }

    /// Expected values: the second neighbour in a tree of another program, to five places.
    #[test]
    fn real_localisations_as_another_program_sees_them() {
        let root = concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/data/");
        let check = |axes: Option<Vec<Vec<f64>>>, mean: f64, median: f64| {
            let Some(axes) = axes else {
                return;
            };
            let run = Threads(2);
            let mut found = match axes.as_slice() {
                [x, y] => nearest([x, y], None, &run).expect("valid"),
                [x, y, z, ..] => nearest([x, y, z], None, &run).expect("valid"),
                _ => return,
            };
            found.sort_by(f64::total_cmp);
            let count = found.len();
            let middle = (found[(count - 1) / 2] + found[count / 2]) / 2.0;
            let average = found.iter().sum::<f64>() / count as f64;
            assert!((average - mean).abs() < 6e-6, "{average} {mean}");
            assert!((middle - median).abs() < 6e-6, "{middle} {median}");
        };
        let flat = |file: &str, names: [&str; 2]| {
            crate::testing::columns(&format!("{root}{file}"), names).map(Vec::from)
        };
        let deep = |file: &str, names: [&str; 3]| {
            crate::testing::columns(&format!("{root}{file}"), names).map(Vec::from)
        };
        let names = ["x [nm]", "y [nm]"];
        let space = ["x [nm]", "y [nm]", "z [nm]"];
        let neuron = "pyme-smlm-import-tests/ThunderSTORM_TS3D.csv";
        check(flat(neuron, names), 8.50028, 5.01623);
        check(deep(neuron, space), 20.25739, 14.66765);
        check(flat("colicoords/01_storm.csv", names), 9.66961, 6.6841);
        check(
            flat("smlm-clustering/Training_MEDIUM.csv", names),
            65.12566,
            37.59502,
        );
        check(
            flat("smlm-clustering/Training_EASY.csv", names),
            98.41241,
            32.96533,
        );
        let cells = "pyme-smlm-import-tests/CaulobacterC_2_R09_MoernerLab.csv";
        check(deep(cells, ["0", "1", "2"]), 29.60923, 26.88661);
        let pores = "mean-shift-drift/NPCdata_meanshift_example.csv";
        check(flat(pores, ["0", "1"]), 25.4833, 9.38504);
        check(
            flat("frc-resolution/TestData01.txt", ["0", "1"]),
            1.51502,
            1.40115,
        );
    }

    #[test]
    fn no_neighbour_and_cancel() {
        assert_eq!(
            nearest([&[1.0], &[2.0]], None, &Threads(1)),
            Ok(vec![f64::INFINITY])
        );
        let none: [&[f64]; 2] = [&[], &[]];
        assert_eq!(
            nearest([&[1.0], &[2.0]], Some(none), &Threads(1)),
            Ok(vec![f64::INFINITY])
        );
        assert!(nearest([&[1.0], &[2.0]], None, &Stopped).is_err());
    }
}
