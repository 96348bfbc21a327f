use super::*;
use crate::spots::Sigma;
use crate::testing::{self, Random, plane, sum};
use puncta_testkit::Threads;

struct Image {
    field: Field,
    values: Vec<f32>,
    rendered: Rendered,
}

fn spots<'a>(x: &'a [f64], y: &'a [f64], sx: &'a [f64], sy: &'a [f64]) -> Gaussians<'a> {
    let (sigma_x, sigma_y) = (Sigma::Column(sx), Sigma::Column(sy));
    Gaussians {
        x,
        y,
        sigma_x,
        sigma_y,
        weight: None,
        sigma_min: 0.0,
        scale: 1.0,
    }
}

fn render(spots: &Gaussians<'_>, field: Field) -> Image {
    let mut values = vec![f32::NAN; field.pixels()];
    let rendered = gaussian2d(spots, &field, &mut values, &Threads(2)).unwrap();
    Image {
        field,
        values,
        rendered,
    }
}

fn covering(spots: &Gaussians<'_>, size: f64, margin: f64) -> Field {
    testing::covering(spots.x, spots.y, size, margin)
}

/// The truncated distribution function from the error function, without this crate's polynomial.
fn exact(t: f64) -> f64 {
    let phi = |t: f64| 0.5 * libm::erfc(-t / 2.0_f64.sqrt());
    ((phi(t) - phi(-4.0)) / (phi(4.0) - phi(-4.0))).clamp(0.0, 1.0)
}

/// A cloud of different widths, positions being multiples of 1/1024 nm so that shifts are exact.
fn cloud(count: usize, seed: u64) -> [Vec<f64>; 4] {
    let mut random = Random::new(seed);
    let dyadic = |v: Vec<f64>| {
        v.into_iter()
            .map(|v| (v * 1024.0).round() / 1024.0)
            .collect()
    };
    [
        dyadic(random.many(count, -700.0, 900.0)),
        dyadic(random.many(count, 300.0, 1700.0)),
        random.many(count, 0.0, 30.0),
        random.many(count, 2.0, 25.0),
    ]
}

#[test]
fn one_localisation_is_the_integral_of_its_gaussian() {
    let mut random = Random::new(7);
    for case in 0..60 {
        let (x, y) = (1000.0 + 40.0 * random.next(), -300.0 + 40.0 * random.next());
        let (sx, sy) = (
            0.05 * 500_f64.powf(random.next()),
            0.05 * 500_f64.powf(random.next()),
        );
        let field = plane(900.0, -420.0, 3.0, 81, 70);
        let image = render(&spots(&[x], &[y], &[sx], &[sy]), field);
        for (i, v) in image.values.iter().enumerate() {
            let (px, py) = (
                900.0 + 3.0 * (i % 81) as f64,
                -420.0 + 3.0 * (i / 81) as f64,
            );
            let along =
                |low: f64, u: f64, s: f64| exact((low + 3.0 - u) / s) - exact((low - u) / s);
            let truth = along(px, x, sx) * along(py, y, sy);
            let error = (f64::from(*v) - truth).abs();
            // The polynomial, widths in f32, positions in 2^-32 pixels; then the pixel in f32.
            let bound = 2e-8 + 2.4e-10 * 3.0 / sx.min(sy) + 6e-8 * truth;
            assert!(error < bound, "case {case} pixel {i}: {v} {truth}");
        }
    }
}

#[test]
fn each_localisation_adds_up_to_one_however_narrow() {
    let [x, y, mut sx, sy] = cloud(3000, 1);
    sx[..1000].iter_mut().for_each(|s| *s *= 1e-3);
    sx[1000..1100].fill(0.0);
    sx[1100] = 1e-300;
    for size in [2.0, 7.7, 130.0] {
        let spots = spots(&x, &y, &sx, &sy);
        let image = render(&spots, covering(&spots, size, 125.0));
        assert_eq!(image.rendered.rendered, 3000);
        assert!(
            (image.rendered.sum - 3000.0).abs() < 1e-9,
            "{}",
            image.rendered.sum
        );
        assert!((sum(&image.values) - 3000.0).abs() < 1e-4);
        assert!(image.values.iter().all(|v| *v >= 0.0));
    }
}

#[test]
fn a_point_on_an_edge_is_whole_in_the_pixel_above() {
    for sigma in [0.0, 1e-9, 1e-320] {
        let s = [sigma];
        let image = render(
            &spots(&[20.0], &[30.0], &s, &s),
            plane(0.0, 0.0, 10.0, 5, 5),
        );
        assert_eq!(image.values[3 * 5 + 2], 1.0, "{sigma}");
        assert_eq!(sum(&image.values), 1.0);
    }
}

#[test]
fn moving_by_whole_pixels_moves_the_image_bit_for_bit() {
    let [x, y, sx, sy] = cloud(2000, 2);
    for size in [5.0, 7.0, 0.5 * 13.0] {
        let still = spots(&x, &y, &sx, &sy);
        let still = render(&still, covering(&still, size, 0.0));
        for (i, j) in [(1.0, 0.0), (-3.0, 1.0), (1000.0, -250.0)] {
            let mx: Vec<f64> = x.iter().map(|x| x + i * size).collect();
            let my: Vec<f64> = y.iter().map(|y| y + j * size).collect();
            let moved = spots(&mx, &my, &sx, &sy);
            let moved = render(&moved, covering(&moved, size, 0.0));
            assert_eq!(moved.field.x.origin(), still.field.x.origin() + i * size);
            assert_eq!(moved.field.y.origin(), still.field.y.origin() + j * size);
            assert!(moved.values == still.values, "{size} {i} {j}");
        }
    }
}

#[test]
fn a_crop_of_the_image_is_the_image_of_the_crop() {
    let [x, y, sx, sy] = cloud(2000, 3);
    let spots = spots(&x, &y, &sx, &sy);
    let whole = render(&spots, plane(-800.0, 200.0, 5.0, 350, 330));
    // Not at a multiple of a tile's side, so that the tiles are other ones.
    let part = render(
        &spots,
        plane(-800.0 + 5.0 * 37.0, 200.0 + 5.0 * 51.0, 5.0, 211, 190),
    );
    for (j, row) in part.values.chunks(211).enumerate() {
        let from = (j + 51) * 350 + 37;
        assert!(row == &whole.values[from..from + 211], "row {j}");
    }
    let (p, w) = (part.rendered, whole.rendered);
    assert!(p.outside > 0 && w.outside == 0 && p.rendered + p.outside == w.rendered);
}

#[test]
fn swapped_axes_transpose() {
    let [x, y, sx, sy] = cloud(1500, 4);
    let image = render(
        &spots(&x, &y, &sx, &sy),
        plane(-800.0, 200.0, 5.0, 350, 330),
    );
    let swapped = render(
        &spots(&y, &x, &sy, &sx),
        plane(200.0, -800.0, 5.0, 330, 350),
    );
    for (i, v) in image.values.iter().enumerate() {
        assert_eq!(
            v.to_bits(),
            swapped.values[(i % 350) * 330 + i / 350].to_bits()
        );
    }
}

#[test]
fn threads_rounds_order_and_duplicates_do_not_matter() {
    let [x, y, sx, sy] = cloud(1500, 5);
    let field = plane(-800.0, 200.0, 5.0, 350, 330);
    let all = spots(&x, &y, &sx, &sy);
    let image = render(&all, field);
    let near = |a: f32, b: f32| (a - b).abs() <= 1.5e-7 * b + 1e-12;
    let mut one = vec![f32::NAN; field.pixels()];
    let rendered = gaussian2d(&all, &field, &mut one, &Threads(1)).unwrap();
    assert!(one == image.values && rendered == image.rendered);
    // Small bounds of memory: rounds, and spots sorted in pieces.
    let sorting = Sorting {
        piece: 24,
        together: 8,
    };
    let small = Limits {
        rows: 700,
        entries: 100,
        sorting,
    };
    let mut rounds = [
        vec![f32::NAN; field.pixels()],
        vec![f32::NAN; field.pixels()],
    ];
    for (threads, out) in (1..=2).zip(&mut rounds) {
        let rendered = within(&all, &field, out, &Threads(threads), &small).unwrap();
        assert_eq!(rendered.rendered, image.rendered.rendered);
        assert!((rendered.sum - image.rendered.sum).abs() < 1e-9);
        assert!(
            out.iter()
                .zip(&image.values)
                .all(|(a, b)| (a - b).abs() <= 1e-6 * b + 1e-12)
        );
    }
    assert!(rounds[0] == rounds[1]);
    let reversed = [&x, &y, &sx, &sy].map(|v| v.iter().rev().copied().collect::<Vec<f64>>());
    let reversed = render(
        &spots(&reversed[0], &reversed[1], &reversed[2], &reversed[3]),
        field,
    );
    assert!(
        reversed
            .values
            .iter()
            .zip(&image.values)
            .all(|(a, b)| near(*a, *b))
    );
    let doubled = [x, y, sx, sy].map(|v| [v.clone(), v].concat());
    let doubled = render(
        &spots(&doubled[0], &doubled[1], &doubled[2], &doubled[3]),
        field,
    );
    assert!(
        doubled
            .values
            .iter()
            .zip(&image.values)
            .all(|(a, b)| near(*a, 2.0 * b))
    );
}

#[test]
fn weights_widths_and_factors() {
    let [x, y, sx, sy] = cloud(300, 6);
    let field = plane(-900.0, 100.0, 10.0, 200, 180);
    let ones = render(&spots(&x, &y, &sx, &sy), field);
    let weight = vec![250.0; 300];
    let weighted = render(
        &Gaussians {
            weight: Some(&weight),
            ..spots(&x, &y, &sx, &sy)
        },
        field,
    );
    assert!((weighted.rendered.sum - 250.0 * ones.rendered.sum).abs() < 1e-6);
    let half: Vec<f64> = sx.iter().map(|s| s / 2.0).collect();
    let half_y: Vec<f64> = sy.iter().map(|s| s / 2.0).collect();
    let scaled = render(
        &Gaussians {
            scale: 2.0,
            ..spots(&x, &y, &half, &half_y)
        },
        field,
    );
    assert!(scaled.values == ones.values);
    let fixed = Gaussians {
        sigma_x: Sigma::Fixed(12.0),
        sigma_y: Sigma::Fixed(12.0),
        ..spots(&x, &y, &sx, &sy)
    };
    let raised = Gaussians {
        sigma_min: 12.0,
        ..spots(&x, &y, &sx, &sy)
    };
    let (low, twelve) = (vec![0.5; 300], vec![12.0; 300]);
    let raised_all = Gaussians {
        sigma_min: 12.0,
        ..spots(&x, &y, &low, &low)
    };
    assert!(render(&fixed, field).values == render(&raised_all, field).values);
    assert!(render(&fixed, field).values == render(&spots(&x, &y, &twelve, &twelve), field).values);
    assert!(render(&fixed, field).values != render(&raised, field).values);
}

#[test]
fn rows_that_are_no_localisations_are_left_out() {
    let x = [
        10.0,
        f64::NAN,
        10.0,
        10.0,
        f64::INFINITY,
        10.0,
        10.0,
        1e300,
        500.0,
    ];
    let y = [
        10.0,
        10.0,
        f64::NEG_INFINITY,
        10.0,
        10.0,
        10.0,
        10.0,
        10.0,
        10.0,
    ];
    let s = [2.0, 2.0, 2.0, f64::NAN, 2.0, -1.0, f64::INFINITY, 2.0, 2.0];
    let image = render(&spots(&x, &y, &s, &s), plane(0.0, 0.0, 1.0, 40, 30));
    let r = image.rendered;
    assert_eq!((r.rendered, r.outside, r.invalid), (1, 2, 6));
    assert!((sum(&image.values) - 1.0).abs() < 1e-6);
    let weight = [f64::NAN, 1e300, 1.0];
    let part = Gaussians {
        weight: Some(&weight),
        ..spots(&x[..1], &y[..1], &s[..1], &s[..1])
    };
    assert_eq!(
        render(&part, plane(0.0, 0.0, 1.0, 40, 30)).rendered.invalid,
        1
    );
}

#[test]
fn empty_tables_single_pixels_and_equal_points() {
    let image = render(&spots(&[], &[], &[], &[]), plane(0.0, 0.0, 1.0, 300, 7));
    assert!(image.values.iter().all(|v| *v == 0.0) && image.rendered == Rendered::default());
    let (p, s) = (vec![3.25; 5000], vec![0.125; 5000]);
    let same = spots(&p, &p, &s, &s);
    let image = render(&same, covering(&same, 10.0, 0.0));
    assert_eq!((image.field.pixels(), image.values[0]), (1, 5000.0));
    // As wide as the image and much wider: all pixels get their share.
    let image = render(
        &spots(&[50.0], &[50.0], &[1e4], &[1e4]),
        plane(0.0, 0.0, 1.0, 100, 100),
    );
    let density = 1e-8 / (2.0 * std::f64::consts::PI) / 0.999_936_657_5_f64.powi(2);
    assert!(
        image
            .values
            .iter()
            .all(|v| (f64::from(*v) / density - 1.0).abs() < 1e-4)
    );
    let image = render(
        &spots(&[50.0], &[50.0], &[1e300], &[1e300]),
        plane(0.0, 0.0, 1.0, 100, 100),
    );
    assert!(image.values.iter().all(|v| v.is_finite() && *v >= 0.0));
}

#[test]
fn cancel_stops() {
    struct Stopped;
    impl Run for Stopped {
        fn parallel(&self, count: usize, task: &(dyn Fn(usize) + Sync)) {
            (0..count).for_each(task);
        }
        fn threads(&self) -> usize {
            1
        }
        fn progress(&self, _: f64, _: &str) -> Result<(), Cancelled> {
            Ok(())
        }
        fn cancelled(&self) -> bool {
            true
        }
    }
    let mut out = vec![0.0; 100];
    let one = spots(&[5.0], &[5.0], &[1.0], &[1.0]);
    assert_eq!(
        gaussian2d(&one, &plane(0.0, 0.0, 1.0, 10, 10), &mut out, &Stopped),
        Err(Cancelled)
    );
}
