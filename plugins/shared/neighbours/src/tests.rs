//! Every query against brute force, on patterns that are hard for cells.

use crate::{Grid, Nearest};
use puncta_sdk::run::Serial;
use puncta_testkit::{Stopped, Threads};

/// A small generator, so that the patterns never change.
struct Random(u64);

impl Random {
    fn next(&mut self) -> f64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 >> 11) as f64 / (1_u64 << 53) as f64
    }
}

type Pattern = (&'static str, [Vec<f64>; 3], f64);

/// Name, coordinates, a radius that finds something.
fn patterns(count: usize) -> Vec<Pattern> {
    let mut random = Random(0x1234_5678_9abc_def1);
    let mut make = |name, radius, point: &mut dyn FnMut(&mut Random, usize) -> [f64; 3]| {
        let mut axes: [Vec<f64>; 3] = Default::default();
        for i in 0..count {
            let point = point(&mut random, i);
            axes.iter_mut()
                .zip(point)
                .for_each(|(axis, x)| axis.push(x));
        }
        (name, axes, radius)
    };
    let uniform = |r: &mut Random| [r.next(), r.next(), r.next()].map(|u| u * 1000.0 - 500.0);
    vec![
        make("uniform", 60.0, &mut |r, _| uniform(r)),
        make("clustered", 8.0, &mut |r, i| {
            let centre = (i % 7) as f64 * 100.0;
            [r.next(), r.next(), r.next()].map(|u| centre + u * u * 20.0)
        }),
        make("lattice", 10.0, &mut |_, i| {
            [i % 12, i / 12 % 12, i / 144].map(|n| n as f64 * 10.0 - 60.0)
        }),
        make("coincident", 1.0, &mut |_, _| [7.0, -3.0, 1e5]),
        make("line", 5.0, &mut |r, _| [r.next() * 3000.0, 2.0, -1.0]),
        make("diagonal", 2e4, &mut |r, _| [r.next() * 1e7; 3]),
        make("far apart", 30.0, &mut |r, i| {
            let shift = if i % 2 == 0 { 0.0 } else { 1e7 };
            [r.next(), r.next(), r.next()].map(|u| shift + u * 150.0)
        }),
        make("outliers", 50.0, &mut |r, i| match i {
            5 => [1e300, 0.0, -1e200],
            9 => [-1e300, 1e18, 0.0],
            _ => uniform(r).map(|x| x / 3.0),
        }),
        make("missing", 60.0, &mut |r, i| match i % 5 {
            0 => [f64::NAN, 1.0, 1.0],
            1 => [1.0, f64::INFINITY, f64::NEG_INFINITY],
            _ => uniform(r),
        }),
    ]
}

fn distance<const D: usize>(one: &[f64; D], two: &[f64; D]) -> f64 {
    let mut squared = 0.0;
    for a in 0..D {
        let difference = one[a] - two[a];
        squared += difference * difference;
    }
    squared
}

fn points<const D: usize>(axes: &[&[f64]; D]) -> Vec<(u32, [f64; D])> {
    let point = |row: usize| std::array::from_fn(|a| axes[a][row]);
    (0..axes[0].len())
        .map(|row| (row as u32, point(row)))
        .filter(|(_, point): &(u32, [f64; D])| point.iter().all(|x| x.is_finite()))
        .collect()
}

fn check_radius<const D: usize>(name: &str, axes: [&[f64]; D], radius: f64, edge: f64) {
    let grid = Grid::new(axes, edge, &Threads(2)).expect("valid");
    let all = points(&axes);
    assert_eq!(
        (grid.len(), grid.left_out()),
        (all.len(), axes[0].len() - all.len()),
        "{name}"
    );
    let limit = radius * radius;
    let (mut pairs, mut brute) = (Vec::new(), Vec::new());
    for i in 0..grid.len() {
        let (row, point) = (grid.rows()[i], grid.point(i));
        let mut found = Vec::new();
        grid.within(&point, radius, |j, squared| {
            found.push((grid.rows()[j], squared))
        });
        found.sort_by_key(|one| one.0);
        let near = |(other, place): &(u32, [f64; D])| Some((*other, distance(place, &point)));
        let expected: Vec<(u32, f64)> = all
            .iter()
            .filter_map(near)
            .filter(|(_, squared)| *squared <= limit)
            .collect();
        assert_eq!(found, expected, "{name} D {D} radius {radius} edge {edge}");
        assert_eq!(grid.count_within(&point, radius), expected.len(), "{name}");
        brute.extend(
            expected
                .iter()
                .filter(|one| one.0 > row)
                .map(|one| (row, one.0)),
        );
        grid.later_within(i, radius, |j, _| {
            assert!(j > i);
            pairs.push((row.min(grid.rows()[j]), row.max(grid.rows()[j])));
        });
    }
    pairs.sort_unstable();
    brute.sort_unstable();
    assert_eq!(pairs, brute, "{name} D {D} radius {radius} edge {edge}");
    let cells: Vec<_> = (0..grid.len())
        .step_by(37)
        .flat_map(|i| {
            let block = i..grid.len().min(i + 37);
            grid.cells(block).collect::<Vec<_>>()
        })
        .collect();
    assert_eq!(
        cells.iter().map(ExactSizeIterator::len).sum::<usize>(),
        grid.len(),
        "{name}"
    );
    assert!(
        cells.windows(2).all(|two| two[0].end == two[1].start),
        "{name}"
    );
    let whole = |cell: &std::ops::Range<usize>| {
        cell.clone()
            .all(|i| grid.cell_of(i) == grid.cell_of(cell.start))
    };
    assert!(cells.iter().all(whole), "{name}");
}

fn check_nearest<const D: usize>(name: &str, axes: [&[f64]; D], edge: Option<f64>) {
    let run = Threads(2);
    let all = points(&axes);
    for k in [1, 2, 7, 1000] {
        let grid = match edge {
            Some(edge) => Grid::new(axes, edge, &run),
            None => Grid::for_nearest(axes, [1.0; D], k, &run),
        }
        .expect("valid");
        let distances = grid.nearest_distances(k, &run).expect("not cancelled");
        assert_eq!(distances.len(), axes[0].len());
        let mut nearest = Nearest::new(k);
        for (row, point) in &all {
            let mut brute: Vec<(f64, u32)> = all
                .iter()
                .filter(|(other, _)| other != row)
                .map(|(other, place)| (distance(place, point), *other))
                .collect();
            brute.sort_by(|a, b| a.partial_cmp(b).expect("no NaN"));
            let expected = brute.get(k - 1).map_or(f64::INFINITY, |one| one.0.sqrt());
            assert_eq!(
                distances[*row as usize], expected,
                "{name} D {D} k {k} row {row}"
            );
            let i = (0..grid.len()).find(|i| grid.rows()[*i] == *row);
            grid.nearest(point, i, &mut nearest);
            let found: Vec<f64> = nearest.iter().map(|one| one.0).collect();
            let wanted: Vec<f64> = brute.iter().take(k).map(|one| one.0).collect();
            assert_eq!(found, wanted, "{name}");
            if name == "uniform" {
                let rows: Vec<u32> = nearest.iter().map(|one| grid.rows()[one.1]).collect();
                assert_eq!(
                    rows,
                    brute.iter().take(k).map(|one| one.1).collect::<Vec<_>>()
                );
            }
        }
        let left_out = (0..axes[0].len() as u32).filter(|row| all.iter().all(|one| one.0 != *row));
        assert!(
            left_out
                .into_iter()
                .all(|row| distances[row as usize].is_nan()),
            "{name}"
        );
    }
}

#[test]
fn radius_queries_equal_brute_force() {
    for (name, [x, y, z], radius) in patterns(300) {
        for edge in [radius, radius * 2.5, radius / 3.0, 1e-3, 1e9] {
            for radius in [radius, 0.0, radius * 2.0] {
                check_radius::<2>(name, [&x, &y], radius, edge);
                check_radius::<3>(name, [&x, &y, &z], radius, edge);
            }
        }
    }
}

#[test]
fn nearest_neighbours_equal_brute_force() {
    for (name, [x, y, z], radius) in patterns(150) {
        for edge in [None, Some(radius), Some(radius / 100.0), Some(1e9)] {
            check_nearest::<2>(name, [&x, &y], edge);
            check_nearest::<3>(name, [&x, &y, &z], edge);
        }
    }
}

#[test]
fn many_points_are_sorted_alike_for_any_number_of_threads() {
    for (name, [x, y, z], _) in patterns(200_000) {
        for edge in [1.0, 40.0] {
            let one = Grid::new([&x, &y, &z], edge, &Serial).expect("valid");
            let three = Grid::new([&x, &y, &z], edge, &Threads(3)).expect("valid");
            assert_eq!(one.rows(), three.rows(), "{name}");
            assert!((0..3).all(|a| one.axis(a) == three.axis(a)));
            let mut seen = vec![false; x.len()];
            for i in 0..one.len() {
                let row = one.rows()[i] as usize;
                assert!(!std::mem::replace(&mut seen[row], true));
                assert_eq!(one.point(i), [x[row], y[row], z[row]]);
                if i > 0 && one.cell_of(i) == one.cell_of(i - 1) {
                    assert!(
                        one.rows()[i - 1] < one.rows()[i],
                        "rows increase inside a cell"
                    );
                }
            }
            let counted = |grid: &Grid<3>, run: &dyn puncta_sdk::Run| {
                grid.by_row(run, 0, |i| grid.cell_of(i)[0])
            };
            assert_eq!(counted(&one, &Serial), counted(&three, &Threads(3)));
        }
    }
}

#[test]
fn axes_are_scaled() {
    let (x, y) = ([0.0, 10.0], [0.0, 10.0]);
    let grid = Grid::scaled([&x, &y], [1.0, 0.5], 5.0, &Serial).expect("valid");
    assert_eq!(grid.point(1), [10.0, 5.0]);
    assert_eq!(grid.count_within(&[10.0, 0.0], 5.0), 1);
}

#[test]
fn bad_grids_are_refused_and_no_points_are_a_grid() {
    let (x, y) = ([0.0; 3], [0.0; 2]);
    assert!(Grid::new([&x, &y], 1.0, &Serial).is_err());
    for edge in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        assert!(Grid::new([&x, &x], edge, &Serial).is_err(), "{edge}");
    }
    assert!(Grid::scaled([&x, &x], [1.0, f64::NAN], 1.0, &Serial).is_err());
    let cancelled = Grid::new([&x, &x], 1.0, &Stopped);
    assert!(cancelled.is_err_and(|failure| failure.is_cancelled()));
    let none = Grid::new([&[], &[]], 1.0, &Serial).expect("valid");
    assert!(none.is_empty());
    assert_eq!(none.count_within(&[0.0, 0.0], 10.0), 0);
    let mut nearest = Nearest::new(1);
    none.nearest(&[0.0, 0.0], None, &mut nearest);
    assert_eq!(nearest.last(), None);
    let some = Grid::new([&x, &x], 1.0, &Serial).expect("valid");
    for radius in [-1.0, f64::NAN] {
        assert_eq!(some.count_within(&[0.0, 0.0], radius), 0);
    }
    assert_eq!(some.count_within(&[f64::NAN, 0.0], 1.0), 0);
    assert_eq!(some.count_within(&[0.0, 0.0], f64::INFINITY), 3);
    assert!(some.map_blocks(&Stopped, |_| ()).is_err());
}
