use super::*;
use crate::grid::Axis;
use crate::testing::{Random, plane, sum};
use puncta_testkit::Threads;

const ONCE: Sampling = Sampling {
    samples: 1,
    keep: 1.0,
    seed: 1,
};

fn cube(side: usize) -> Volume {
    Volume {
        plane: plane(0.0, 0.0, 1.0, side, side),
        z: Axis::at(0.0, 1.0, side).unwrap(),
    }
}

fn random(count: usize, low: f64, high: f64) -> Vec<[f64; 3]> {
    let mut random = Random::new(count as u64);
    (0..count)
        .map(|_| std::array::from_fn(|_| low + (high - low) * random.next()))
        .collect()
}

fn cloud(points: Vec<[f64; 3]>, spread: f64) -> Cloud<3> {
    let spread = vec![[spread; 3]; points.len()];
    Cloud {
        points,
        spread,
        invalid: 0,
    }
}

fn image(cloud: &Cloud<3>, sampling: &Sampling, volume: &Volume, threads: usize) -> Vec<f32> {
    let mut out = vec![f32::NAN; volume.voxels()];
    tetrahedra3d(cloud, sampling, volume, 1.0, &mut out, &Threads(threads)).unwrap();
    out
}

#[test]
fn every_localisation_is_in_the_volume() {
    for count in [4, 5, 60, 2000] {
        let found = image(&cloud(random(count, 2.0, 29.5), 0.0), &ONCE, &cube(30), 2);
        assert!(
            (sum(&found) - count as f64).abs() < 1e-4 * count as f64,
            "{count} {}",
            sum(&found)
        );
    }
    let twice = [random(50, 2.0, 29.5), random(50, 2.0, 29.5)].concat();
    assert!((sum(&image(&cloud(twice, 0.0), &ONCE, &cube(30), 2)) - 100.0).abs() < 0.01);
}

#[test]
fn a_tetrahedron_fills_the_voxels_in_it_evenly() {
    let corners = vec![
        [0.0, 0.0, 0.0],
        [20.0, 0.0, 0.0],
        [0.0, 20.0, 0.0],
        [0.0, 0.0, 20.0],
    ];
    let found = image(&cloud(corners, 0.0), &ONCE, &cube(20), 2);
    let inside = |i: usize| (i % 20 + i / 20 % 20 + i / 400) as f64 + 1.5 <= 20.0;
    let count = (0..8000).filter(|i| inside(*i)).count() as f64;
    for (i, value) in found.iter().enumerate() {
        let expected = if inside(i) { 4.0 / count } else { 0.0 };
        assert!(
            (f64::from(*value) - expected).abs() < 1e-7,
            "{i} {value} {expected}"
        );
    }
    // Where it stands out of the volume its density stays that of the whole.
    let wide = vec![
        [-30.0, -30.0, -30.0],
        [90.0, -30.0, -30.0],
        [-30.0, 90.0, -30.0],
        [-30.0, -30.0, 90.0],
    ];
    let found = image(&cloud(wide, 0.0), &ONCE, &cube(4), 2);
    assert!(
        found
            .iter()
            .all(|v| (f64::from(*v) - 4.0 / 288_000.0).abs() < 1e-10)
    );
}

#[test]
fn the_density_of_complete_randomness_is_found_on_any_number_of_threads() {
    // 0.5 per voxel; the walls lie 10 voxels off.
    let cloud = cloud(random(13_500, -5.0, 25.0), 1.0);
    let sampling = Sampling {
        samples: 4,
        keep: 1.0,
        seed: 2,
    };
    let found = image(&cloud, &sampling, &cube(20), 2);
    let mean = sum(&found) / 8000.0;
    assert!((mean - 0.5).abs() < 0.02, "{mean}");
    for threads in [1, 3] {
        assert!(found == image(&cloud, &sampling, &cube(20), threads));
    }
    let subset = Sampling {
        keep: 0.5,
        ..sampling
    };
    let mean = sum(&image(&cloud, &subset, &cube(20), 2)) / 8000.0;
    assert!((mean - 0.5).abs() < 0.04, "{mean}");
}

#[test]
fn points_in_a_plane_show_nothing() {
    let flat = random(30, 1.0, 9.0)
        .into_iter()
        .map(|[x, y, _]| [x, y, 3.0])
        .collect();
    let mut out = vec![f32::NAN; 1000];
    let shown = tetrahedra3d(
        &cloud(flat, 0.0),
        &ONCE,
        &cube(10),
        1.0,
        &mut out,
        &Threads(2),
    );
    assert_eq!(shown, Ok(0.0));
    assert!(out.iter().all(|v| *v == 0.0));
}
