use super::*;
use crate::testing::{Random, plane, sum};
use puncta_testkit::Threads;

fn cloud(points: Vec<[f64; 2]>, spread: f64) -> Cloud<2> {
    let spread = vec![[spread; 2]; points.len()];
    Cloud {
        points,
        spread,
        invalid: 0,
    }
}

fn image(cloud: &Cloud<2>, sampling: &Sampling, field: &Field, threads: usize) -> Vec<f32> {
    let mut out = vec![f32::NAN; field.pixels()];
    triangles2d(cloud, sampling, field, 1.0, &mut out, &Threads(threads)).unwrap();
    out
}

const ONCE: Sampling = Sampling {
    samples: 1,
    keep: 1.0,
    seed: 1,
};

fn random(count: usize, low: f64, high: f64) -> Vec<[f64; 2]> {
    let mut random = Random::new(count as u64);
    let (x, y) = (random.many(count, low, high), random.many(count, low, high));
    x.into_iter().zip(y).map(|(x, y)| [x, y]).collect()
}

#[test]
fn a_triangle_covers_its_pixels_exactly() {
    // Area 8 for three localisations; the diagonal halves the pixels on it.
    let corners = cloud(vec![[1.0, 1.0], [5.0, 1.0], [1.0, 5.0]], 0.0);
    let found = image(&corners, &ONCE, &plane(0.0, 0.0, 1.0, 6, 6), 2);
    for (i, value) in found.iter().enumerate() {
        let (x, y) = (i % 6, i / 6);
        let share = match (x, y) {
            (1..=4, 1..=4) if x + y < 5 => 1.0,
            (1..=4, 1..=4) if x + y == 5 => 0.5,
            _ => 0.0,
        };
        assert!(
            (f64::from(*value) - share * 3.0 / 8.0).abs() < 1e-7,
            "{x} {y} {value}"
        );
    }
}

#[test]
fn every_localisation_is_in_the_image_whatever_the_size_of_triangles() {
    for count in [3, 4, 50, 3000, 40_000] {
        let points = random(count, 3.3, 60.2);
        let field = plane(0.0, 0.0, 1.0, 64, 64);
        let found = image(&cloud(points, 0.0), &ONCE, &field, 2);
        assert!(
            (sum(&found) - count as f64).abs() < 1e-4 * count as f64,
            "{count} {}",
            sum(&found)
        );
    }
    // A lattice, and every point four times.
    let lattice: Vec<[f64; 2]> = (0..1600)
        .map(|i| [f64::from(i % 20) + 2.0, f64::from(i / 20 % 20) + 2.0])
        .collect();
    let found = image(
        &cloud(lattice, 0.0),
        &ONCE,
        &plane(0.0, 0.0, 1.0, 25, 25),
        2,
    );
    assert!((sum(&found) - 1600.0).abs() < 1e-2);
    // A square of the lattice has two diagonals, so that shares differ from corner to corner.
    let inside = (6..18).flat_map(|y| found[y * 25 + 6..y * 25 + 18].iter());
    let mean = inside.map(|v| f64::from(*v)).sum::<f64>() / 144.0;
    assert!((mean - 4.0).abs() < 0.1, "{mean}");
}

#[test]
fn a_crop_is_the_crop_of_the_image() {
    let points = random(500, -5.0, 45.0);
    let whole = image(
        &cloud(points.clone(), 0.0),
        &ONCE,
        &plane(0.0, 0.0, 1.0, 40, 40),
        2,
    );
    let moved = points.iter().map(|[x, y]| [x - 10.0, y - 20.0]).collect();
    let crop = image(&cloud(moved, 0.0), &ONCE, &plane(0.0, 0.0, 1.0, 15, 10), 2);
    for (i, value) in crop.iter().enumerate() {
        let same = whole[(i / 15 + 20) * 40 + i % 15 + 10];
        assert!(
            (value - same).abs() < 1e-5 * same.max(1e-3),
            "{i} {value} {same}"
        );
    }
}

#[test]
fn the_density_of_complete_randomness_is_found() {
    // 2 per pixel; the jitter of 10 samples smooths the triangles.
    let cloud = cloud(random(20_000, 0.0, 100.0), 1.5);
    let sampling = Sampling {
        samples: 10,
        keep: 1.0,
        seed: 3,
    };
    let field = plane(10.0, 10.0, 1.0, 80, 80);
    let cloud = Cloud {
        points: cloud
            .points
            .iter()
            .map(|[x, y]| [x - 10.0, y - 10.0])
            .collect(),
        ..cloud
    };
    let found = image(&cloud, &sampling, &field, 2);
    let mean = sum(&found) / found.len() as f64;
    assert!((mean - 2.0).abs() < 0.03, "{mean}");
    let spread = found
        .iter()
        .map(|v| (f64::from(*v) - mean).powi(2))
        .sum::<f64>();
    assert!((spread / found.len() as f64).sqrt() < 0.7);
    let subset = Sampling {
        keep: 0.3,
        ..sampling
    };
    let mean = sum(&image(&cloud, &subset, &field, 2)) / found.len() as f64;
    assert!((mean - 2.0).abs() < 0.06, "{mean}");
    for threads in [1, 3] {
        assert!(found == image(&cloud, &sampling, &field, threads));
    }
}

#[test]
fn points_on_a_line_show_nothing() {
    let mut out = vec![f32::NAN; 100];
    let field = plane(0.0, 0.0, 1.0, 10, 10);
    for count in [0, 1, 2, 9] {
        let line = (0..count).map(|i| [f64::from(i), f64::from(i)]).collect();
        let shown = triangles2d(&cloud(line, 0.0), &ONCE, &field, 1.0, &mut out, &Threads(2));
        assert_eq!(shown, Ok(0.0));
        assert!(out.iter().all(|v| *v == 0.0));
    }
}
