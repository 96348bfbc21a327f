use super::*;
use crate::testing::{Random, around, covering, plane};
use puncta_testkit::Threads;

fn image(x: &[f64], y: &[f64], field: &Field) -> (Vec<f32>, Counted) {
    let mut out = vec![f32::NAN; field.pixels()];
    let counted = histogram2d(x, y, field, &mut out, &Threads(2)).unwrap();
    (out, counted)
}

#[test]
fn counts_are_those_of_a_plain_loop() {
    let mut random = Random::new(1);
    for (count, width, height) in [
        (150_000, 300, 210),
        (1000, 2000, 3),
        (5000, 1, 900),
        (1, 1, 1),
    ] {
        let x = random.many(count, -30.0, 10.0 * width as f64 + 30.0);
        let y = random.many(count, -30.0, 10.0 * height as f64 + 30.0);
        let (found, counted) = image(&x, &y, &plane(0.0, 0.0, 10.0, width, height));
        let mut truth = vec![0.0; width * height];
        for (x, y) in x.iter().zip(&y) {
            let (i, j) = ((x / 10.0).floor(), (y / 10.0).floor());
            if (0.0..width as f64).contains(&i) && (0.0..height as f64).contains(&j) {
                truth[j as usize * width + i as usize] += 1.0;
            }
        }
        assert!(found == truth);
        assert_eq!(counted.inside as f32, truth.iter().sum::<f32>());
        assert_eq!(counted.inside + counted.outside, count as u64);
    }
}

#[test]
fn edges_belong_to_the_pixel_above() {
    for size in [0.1, 0.3, 10.0, 49.0] {
        let edges: Vec<f64> = (0..=20).map(|k| f64::from(k) * size).collect();
        let zero = vec![0.0; 21];
        let (found, counted) = image(&edges, &zero, &plane(0.0, 0.0, size, 20, 1));
        assert!(found.iter().all(|v| *v == 1.0), "{size} {found:?}");
        assert_eq!((counted.inside, counted.outside), (20, 1));
    }
}

#[test]
fn shift_swap_order_duplicates_and_threads() {
    let mut random = Random::new(2);
    let x = random.many(100_000, -4000.0, 9000.0);
    let y = random.many(100_000, 100.0, 8000.0);
    for size in [10.0, 7.5, 0.1 * 130.0] {
        let field = covering(&x, &y, size, 0.0);
        let (still, counted) = image(&x, &y, &field);
        assert_eq!(
            counted,
            Counted {
                inside: 100_000,
                ..Counted::default()
            }
        );
        let mx: Vec<f64> = x.iter().map(|x| x + 3.0 * size).collect();
        let my: Vec<f64> = y.iter().map(|y| y - 5.0 * size).collect();
        let moved = covering(&mx, &my, size, 0.0);
        assert_eq!(
            (moved.x.count(), moved.y.count()),
            (field.x.count(), field.y.count())
        );
        assert!((moved.x.origin() - field.x.origin() - 3.0 * size).abs() < 1e-9);
        assert!(image(&mx, &my, &moved).0 == still, "{size}");
        let swapped = image(
            &y,
            &x,
            &Field {
                x: field.y,
                y: field.x,
            },
        )
        .0;
        let (w, h) = (field.x.count(), field.y.count());
        assert!((0..w * h).all(|i| still[i] == swapped[(i % w) * h + i / w]));
        let turned = [&x, &y].map(|v| v.iter().rev().copied().collect::<Vec<f64>>());
        assert!(image(&turned[0], &turned[1], &field).0 == still);
        let doubled = image(&[&x[..], &x].concat(), &[&y[..], &y].concat(), &field).0;
        assert!(doubled.iter().zip(&still).all(|(d, s)| *d == 2.0 * s));
        let mut one = vec![0.0; field.pixels()];
        histogram2d(&x, &y, &field, &mut one, &Threads(1)).unwrap();
        assert!(one == still);
    }
}

#[test]
fn rows_that_are_no_positions_are_left_out() {
    let x = [5.0, f64::NAN, f64::INFINITY, 1e300, -0.0, 10.0, 5.0];
    let y = [5.0, 5.0, 5.0, 5.0, 0.0, 5.0, f64::NEG_INFINITY];
    let (found, counted) = image(&x, &y, &plane(0.0, 0.0, 10.0, 1, 1));
    assert_eq!(found, [2.0]);
    assert_eq!(
        counted,
        Counted {
            inside: 2,
            outside: 2,
            invalid: 3
        }
    );
    let (found, counted) = image(&[], &[], &plane(0.0, 0.0, 10.0, 3, 2));
    assert!(found.iter().all(|v| *v == 0.0) && counted == Counted::default());
    let same = vec![-7.25; 200_000];
    let field = covering(&same, &same, 10.0, 0.0);
    assert_eq!(image(&same, &same, &field).0, [200_000.0]);
}

#[test]
fn a_volume_is_counted_as_by_a_plain_loop_and_sums_up_to_the_plane() {
    let mut random = Random::new(5);
    let [x, y] = [(); 2].map(|()| random.many(60_000, -700.0, 900.0));
    let z = random.many(60_000, -310.0, 295.0);
    let volume = around([&x, &y, &z], 10.0, 25.0, 0.0);
    let make = |threads| {
        let mut out = vec![f32::NAN; volume.voxels()];
        let counted = histogram3d([&x, &y, &z], &volume, &mut out, &Threads(threads));
        assert_eq!(counted.unwrap().inside, 60_000);
        out
    };
    let found = make(2);
    assert!(found == make(1));
    let index = |v: f64, size: f64, axis: &Axis| (v / size).floor() as i64 - axis.first();
    let mut plain = vec![0.0_f32; volume.voxels()];
    let (w, h) = (volume.plane.x.count(), volume.plane.y.count());
    for ((x, y), z) in x.iter().zip(&y).zip(&z) {
        let k = index(*z, 25.0, &volume.z) as usize;
        let j = index(*y, 10.0, &volume.plane.y) as usize;
        let i = index(*x, 10.0, &volume.plane.x) as usize;
        plain[(k * h + j) * w + i] += 1.0;
    }
    assert!(found == plain);
    let (flat, _) = image(&x, &y, &volume.plane);
    let mut projected = vec![0.0_f32; w * h];
    for slice in found.chunks(w * h) {
        projected.iter_mut().zip(slice).for_each(|(p, v)| *p += v);
    }
    assert!(projected == flat);
}
