use super::*;
use crate::testing::{Random, adjusted_rand, canonical, planted, real};
use puncta_sdk::run::Serial;
use puncta_testkit::{Stopped, Threads};

/// DBSCAN as it is defined: expands the clusters one after another in the order of the rows.
fn brute(at: &[&[f64]], eps: f64, min_points: usize) -> (Vec<i32>, u64) {
    let count = at[0].len();
    let near = |a: usize| -> Vec<usize> {
        let square = |b: usize| -> f64 { at.iter().map(|v| (v[a] - v[b]) * (v[a] - v[b])).sum() };
        (0..count).filter(|b| square(*b) <= eps * eps).collect()
    };
    let core: Vec<bool> = (0..count)
        .map(|row| near(row).len() >= min_points)
        .collect();
    let (mut labels, mut clusters) = (vec![0; count], 0);
    for row in 0..count {
        if !core[row] || labels[row] != 0 {
            continue;
        }
        clusters += 1;
        labels[row] = clusters;
        let mut waiting = vec![row];
        while let Some(row) = waiting.pop() {
            for other in near(row) {
                if labels[other] == 0 {
                    labels[other] = clusters;
                    if core[other] {
                        waiting.push(other);
                    }
                }
            }
        }
    }
    (labels, core.into_iter().filter(|core| *core).count() as u64)
}

fn ours<const D: usize>(at: [&[f64]; D], eps: f64, min_points: usize) -> (Vec<i32>, Found) {
    let mut labels = vec![7; at[0].len()];
    let found = dbscan(at, eps, min_points, &mut labels, &Threads(2)).unwrap();
    (labels, found)
}

fn check(at: &[Vec<f64>; 3], eps: f64, min_points: usize) {
    let plane = [&at[0][..], &at[1][..]];
    let (labels, found) = ours(plane, eps, min_points);
    let (expected, core) = brute(&plane, eps, min_points);
    assert_eq!(labels, expected, "eps {eps}, min_points {min_points}");
    assert_eq!(found.core, core);
    let space = at.each_ref().map(|values| &values[..]);
    let (labels, found) = ours(space, eps, min_points);
    let (expected, core) = brute(&space, eps, min_points);
    assert_eq!(labels, expected, "3D, eps {eps}, min_points {min_points}");
    assert_eq!(found.core, core);
    assert_eq!(
        found.sizes.iter().sum::<u64>(),
        labels.iter().filter(|l| **l > 0).count() as u64
    );
}

#[test]
fn random_points_give_the_clusters_of_brute_force() {
    let mut random = Random(3);
    let at: [Vec<f64>; 3] =
        std::array::from_fn(|_| (0..700).map(|_| 300.0 * random.unit() - 100.0).collect());
    for eps in [1.0, 9.0, 15.0, 30.0, 60.0, 1000.0] {
        for min_points in [1, 2, 4, 10] {
            check(&at, eps, min_points);
        }
    }
    let (clusters, _) = planted(9, 40, 25.0, 200);
    for eps in [10.0, 20.0, 40.0] {
        check(&clusters, eps, 6);
    }
}

#[test]
fn lattices_and_coincident_points_give_the_clusters_of_brute_force() {
    // Distances equal to eps count, and borders lie between clusters.
    let lattice: [Vec<f64>; 3] = [
        (0..600).map(|k| f64::from(k % 20) * 10.0).collect(),
        (0..600).map(|k| f64::from(k / 20 % 15) * 10.0).collect(),
        (0..600).map(|k| f64::from(k / 300) * 10.0).collect(),
    ];
    for eps in [9.999, 10.0, 14.0, 15.0, 20.0, 30.0] {
        for min_points in [2, 5, 7, 9, 14, 40] {
            check(&lattice, eps, min_points);
        }
    }
    let mut random = Random(8);
    let few: [Vec<f64>; 3] = std::array::from_fn(|_| {
        (0..500)
            .map(|_| (random.unit() * 6.0).floor() * 7.0)
            .collect()
    });
    for eps in [1e-4, 7.0, 9.9, 21.0] {
        check(&few, eps, 5);
    }
    let same = [vec![5.0; 300], vec![-5.0; 300], vec![1e9; 300]];
    check(&same, 1.0, 300);
    check(&same, 1.0, 301);
    check(&[vec![], vec![], vec![]], 1.0, 1);
    check(&[vec![1.0], vec![2.0], vec![3.0]], 1.0, 1);
    check(&[vec![1.0], vec![2.0], vec![3.0]], 1.0, 2);
}

#[test]
fn real_tables_have_the_published_numbers_of_clusters() {
    let thunderstorm = ["x [nm]", "y [nm]", "z [nm]"];
    let cases = [
        (
            "pyme-smlm-import-tests/ThunderSTORM_TS3D.csv",
            thunderstorm,
            true,
            [[78, 1026, 9537], [13, 389, 10624], [4, 279, 10808]],
        ),
        (
            "pyme-smlm-import-tests/ThunderSTORM_TS3D.csv",
            thunderstorm,
            false,
            [[272, 6446, 3119], [42, 1749, 8272], [7, 442, 10150]],
        ),
        (
            "smolr/3d_localizations.csv",
            thunderstorm,
            false,
            [[6, 13954, 13], [17, 13758, 73], [8, 13797, 65]],
        ),
        (
            "colicoords/01_storm.csv",
            ["x [nm]", "y [nm]", "-"],
            true,
            [[685, 8262, 18493], [87, 1991, 25727], [41, 635, 28222]],
        ),
        (
            "smlm-clustering/Training_MEDIUM.csv",
            ["x [nm]", "y [nm]", "-"],
            true,
            [[33, 16054, 75], [35, 14523, 957], [13, 13653, 2041]],
        ),
        (
            "smlm-clustering/Training_EASY.csv",
            ["x [nm]", "y [nm]", "-"],
            true,
            [[6, 3220, 7], [27, 2845, 119], [19, 2035, 538]],
        ),
    ];
    for (file, columns, flat, expected) in cases {
        let Some(at) = real(file, columns) else {
            continue;
        };
        let settings = [(20.0, 5), (50.0, 10), (100.0, 20)];
        for ((eps, min_points), [clusters, noise, core]) in settings.into_iter().zip(expected) {
            let (labels, found) = if flat {
                ours([&at[0], &at[1]], eps, min_points)
            } else {
                ours([&at[0], &at[1], &at[2]], eps, min_points)
            };
            let ours = [
                u64::from(found.clusters),
                labels.iter().filter(|label| **label == 0).count() as u64,
                found.core,
            ];
            assert_eq!(ours, [clusters, noise, core], "{file} eps {eps}");
        }
    }
}

#[test]
fn more_real_tables_have_the_published_numbers_of_clusters() {
    let cases = [
        (
            "pyme-smlm-import-tests/CaulobacterC_2_R09_MoernerLab.csv",
            true,
            [[28, 8485, 150], [111, 5275, 1604], [2, 340, 6680]],
        ),
        (
            "mean-shift-drift/NPCdata_meanshift_example.csv",
            false,
            [[793, 10781, 6269], [325, 12700, 5023], [109, 14871, 2871]],
        ),
    ];
    for (file, deep, expected) in cases {
        let columns = if deep {
            ["x", "y", "z"]
        } else {
            ["0", "1", "2"]
        };
        let Some(at) = real(file, columns) else {
            continue;
        };
        for ((eps, min_points), [clusters, noise, core]) in [(20.0, 5), (50.0, 10), (100.0, 20)]
            .into_iter()
            .zip(expected)
        {
            let (labels, found) = if deep {
                ours([&at[0], &at[1], &at[2]], eps, min_points)
            } else {
                ours([&at[0], &at[1]], eps, min_points)
            };
            let left = labels.iter().filter(|label| **label == 0).count() as u64;
            assert_eq!(
                [u64::from(found.clusters), left, found.core],
                [clusters, noise, core]
            );
        }
    }
}

#[test]
fn planted_clusters_are_found() {
    let (at, truth) = planted(100, 60, 20.0, 6000);
    let (labels, _) = ours([&at[0], &at[1]], 35.0, 8);
    assert!(adjusted_rand(&labels, &truth) > 0.95);
    let (labels, _) = ours([&at[0], &at[1], &at[2]], 45.0, 6);
    assert!(adjusted_rand(&labels, &truth) > 0.95);
}

#[test]
fn changes_that_do_not_matter_change_nothing() {
    let (at, _) = planted(25, 50, 30.0, 1000);
    let (labels, found) = ours([&at[0], &at[1]], 25.0, 7);
    let mapped = |factor: f64, shift: f64| -> [Vec<f64>; 2] {
        [&at[0], &at[1]].map(|values| values.iter().map(|v| v * factor + shift).collect())
    };
    let other = |[x, y]: [Vec<f64>; 2], eps| ours([&x, &y], eps, 7);
    assert_eq!(
        other(mapped(3.0, 0.0), 75.0),
        (labels.clone(), found.clone())
    );
    assert_eq!(
        other(mapped(1.0, 1e7), 25.0),
        (labels.clone(), found.clone())
    );
    let [x, y] = mapped(1.0, 0.0);
    let turned = [y.iter().map(|y| -y).collect(), x.clone()];
    assert_eq!(other(turned, 25.0), (labels.clone(), found.clone()));
    // Rows backwards: core points and noise stay; borders may change sides.
    let back = |values: &[f64]| values.iter().rev().copied().collect::<Vec<_>>();
    let (mut reversed, again) = other([back(&x), back(&y)], 25.0);
    reversed.reverse();
    assert_eq!((again.clusters, again.core), (found.clusters, found.core));
    let noise = |labels: &[i32]| labels.iter().map(|label| *label == 0).collect::<Vec<_>>();
    assert_eq!(noise(&reversed), noise(&labels));
    assert!(adjusted_rand(&reversed, &labels) > 0.99);
    // A copy far away has the same clusters once more.
    let double = |values: &[f64], shift: f64| -> Vec<f64> {
        values
            .iter()
            .copied()
            .chain(values.iter().map(|v| v + shift))
            .collect()
    };
    let (both, twice) = other([double(&x, 1e6), double(&y, 0.0)], 25.0);
    assert_eq!(twice.clusters, 2 * found.clusters);
    assert_eq!(canonical(&both[labels.len()..]), canonical(&labels));
    assert_eq!(both[..labels.len()], labels);
}

#[test]
fn threads_do_not_matter_and_cancel_ends_it() {
    let (at, _) = planted(400, 100, 40.0, 40_000);
    let run = |threads: usize| {
        let mut labels = vec![0; at[0].len()];
        let found = dbscan([&at[0], &at[1]], 30.0, 10, &mut labels, &Threads(threads)).unwrap();
        (labels, found)
    };
    let one = run(1);
    assert!(one.1.clusters > 100);
    assert_eq!(run(2), one);
    assert_eq!(run(3), one);
    let mut labels = vec![0; at[0].len()];
    let stopped = dbscan([&at[0], &at[1]], 30.0, 10, &mut labels, &Stopped);
    assert!(stopped.unwrap_err().is_cancelled());
}

#[test]
fn positions_that_are_missing_or_far_have_a_defined_result() {
    let nan = f64::NAN;
    let x = [0.0, 1.0, nan, 2.0, 5.0, f64::INFINITY];
    let y = [0.0, 0.0, 0.0, nan, 0.0, 0.0];
    assert_eq!(ours([&x, &y], 1.5, 2).0, [1, 1, 0, 0, 0, 0]);
    let far = [0.0, 1.0, 1e300];
    let mut labels = vec![0; 3];
    let failure = dbscan([&far, &[0.0; 3]], 1.5, 2, &mut labels, &Serial).unwrap_err();
    assert_eq!(failure.parameter.as_deref(), Some("eps"));
    // A radius beyond the field: all are one cluster.
    assert_eq!(ours([&[0.0, 1.0, 500.0], &[0.0; 3]], 1e9, 3).0, [1, 1, 1]);
}
