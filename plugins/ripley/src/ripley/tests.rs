use super::*;
use crate::flat::Flat;
use crate::flat::tests::letter;
use crate::polygon::mask;
use crate::simulate::{stream, uniform};
use crate::solid::Solid;
use crate::window::{Cuboid, Random};
use puncta_sdk::ImageInfo;
use puncta_testkit::Threads;

fn curves<const D: usize>(
    axes: [&[f64]; D],
    window: &dyn Window<D>,
    edges: Edges,
    bins: &Bins,
) -> Curves {
    let sets = Sets {
        one: axes,
        two: None,
    };
    let rings = rings(&sets, window, edges, bins, &Threads(2)).expect("valid");
    Curves::new(&rings, bins, D)
}

/// L - r of complete spatial randomness stays below 2 % of the radius to a third of the width; the
/// first radii, with few pairs, are left to the exact tests.
fn is_random<const D: usize>(window: &dyn Window<D>, width: f64, count: usize, edges: Edges) {
    let bins = Bins::up_to(width / 30.0, 10);
    for seed in 0..3 {
        let points = uniform(window, count, &mut stream(seed, 0));
        let axes = points.each_ref().map(Vec::as_slice);
        let found = curves(axes, window, edges, &bins);
        for (h, r) in found.h.iter().zip(&found.r) {
            assert!(
                (h / r).abs() < 0.02,
                "{} {edges:?} r {r} h {h}",
                window.describe()
            );
        }
        // The same, from one half of the points to the other.
        let (one, two) = (axes.map(|x| &x[..count / 2]), axes.map(|x| &x[count / 2..]));
        let sets = Sets {
            one,
            two: Some(two),
        };
        let rings = rings(&sets, window, edges, &bins, &Threads(2)).expect("valid");
        let found = Curves::new(&rings, &bins, D);
        for (h, r) in found.h.iter().zip(&found.r).skip(1) {
            assert!(
                (h / r).abs() < 0.02,
                "{} cross r {r} h {h}",
                window.describe()
            );
        }
    }
}

fn ell_mask() -> Flat {
    let info = ImageInfo::plane(40, 40, 25.0, 1e4, -300.0);
    let pixel = |i: usize| if i % 40 < 20 || i / 40 < 20 { 1.0 } else { 0.0 };
    mask(&info, &(0..1600).map(pixel).collect::<Vec<f64>>()).expect("valid")
}

/// An L, 500 nm thick.
fn ell_solid() -> Solid {
    let mut info = ImageInfo::plane(20, 20, 50.0, 1e4, -300.0);
    (info.size[2], info.voxel[0], info.origin[0]) = (5, 100.0, 50.0);
    let pixel = |i: usize| {
        if i % 20 < 10 || i / 20 % 20 < 10 {
            1.0
        } else {
            0.0
        }
    };
    Solid::new(&info, &(0..2000).map(pixel).collect::<Vec<f64>>()).expect("valid")
}

#[test]
fn a_mask_in_space_has_no_isotropic_correction() {
    let solid = ell_solid();
    let points = uniform(&solid, 500, &mut stream(4, 0));
    let sets = Sets {
        one: points.each_ref().map(Vec::as_slice),
        two: None,
    };
    let bins = Bins::up_to(10.0, 10);
    let refused = rings(&sets, &solid, Edges::Isotropic, &bins, &Threads(1)).unwrap_err();
    assert_eq!(refused.parameter.as_deref(), Some("edges"));
    assert!(refused.to_string().contains("translation"));
}

#[test]
fn complete_spatial_randomness_has_no_structure() {
    let plane = Flat::rectangle([100.0, -50.0], [2100.0, 950.0]);
    is_random(&plane, 1000.0, 20_000, Edges::Isotropic);
    is_random(&plane, 1000.0, 20_000, Edges::Translation);
    is_random(&letter(0.0), 450.0, 20_000, Edges::Isotropic);
    is_random(&letter(1e7), 450.0, 20_000, Edges::Isotropic);
    is_random(&letter(1e7), 450.0, 20_000, Edges::Translation);
    is_random(&ell_mask(), 500.0, 20_000, Edges::Isotropic);
    is_random(&ell_mask(), 500.0, 20_000, Edges::Translation);
    is_random(&ell_solid(), 500.0, 12_000, Edges::Translation);
    let cube = Cuboid {
        low: [0.0, 10.0, -400.0],
        high: [1000.0, 1210.0, 400.0],
    };
    is_random(&cube, 800.0, 12_000, Edges::Isotropic);
    is_random(&cube, 800.0, 12_000, Edges::Translation);
}

#[test]
fn a_region_means_the_same_however_it_is_given() {
    let plane = Flat::rectangle([0.0, 0.0], [900.0, 900.0]);
    let outline = crate::polygon::polygon(&[0.0, 0.0, 900.0, 900.0], &[0.0, 900.0, 900.0, 0.0]);
    let info = ImageInfo::plane(9, 9, 100.0, 0.0, 0.0);
    let regions = [
        outline.expect("valid"),
        mask(&info, &[1.0; 81]).expect("valid"),
    ];
    let points = uniform(&plane, 2000, &mut stream(4, 0));
    let axes = points.each_ref().map(Vec::as_slice);
    let bins = Bins::up_to(20.0, 20);
    for edges in [Edges::Isotropic, Edges::Translation] {
        let expected = curves(axes, &plane, edges, &bins);
        for region in &regions {
            let found = curves(axes, region, edges, &bins);
            for (found, expected) in found.k.iter().zip(&expected.k) {
                assert!((found / expected - 1.0).abs() < 1e-10, "{found} {expected}");
            }
        }
    }
}

#[test]
fn weights_are_those_of_the_definition() {
    let plane = Flat::rectangle([0.0, 0.0], [100.0, 60.0]);
    let points = uniform(&plane, 200, &mut stream(8, 0));
    let [x, y] = &points;
    let bins = Bins::up_to(5.0, 10);
    let count = 200.0;
    let (mut isotropic, mut shifted) = (vec![0.0; 10], vec![0.0; 10]);
    for i in 0..200 {
        for j in (0..200).filter(|j| *j != i) {
            let (dx, dy) = (x[j] - x[i], y[j] - y[i]);
            let squared: f64 = dx * dx + dy * dy;
            let bin = bins.bin(squared);
            if bin < 10 {
                // Share of the circle by the angles at which it leaves the rectangle.
                let d = squared.sqrt();
                let out = |h: f64| if h < d { (h / d).acos() } else { 0.0 };
                let mut beyond = 0.0;
                for h in [x[i], 100.0 - x[i]] {
                    beyond += 2.0 * out(h);
                    for v in [y[i], 60.0 - y[i]] {
                        if h * h + v * v < squared {
                            beyond -= out(h) + out(v) - std::f64::consts::FRAC_PI_2;
                        }
                    }
                }
                beyond += [y[i], 60.0 - y[i]]
                    .map(|v| 2.0 * out(v))
                    .iter()
                    .sum::<f64>();
                isotropic[bin] += 1.0 / (1.0 - beyond / (2.0 * PI));
                shifted[bin] += 6000.0 / ((100.0 - dx.abs()) * (60.0 - dy.abs()));
            }
        }
    }
    let sets = Sets {
        one: [x, y],
        two: None,
    };
    for (edges, sums) in [(Edges::Isotropic, isotropic), (Edges::Translation, shifted)] {
        let rings = rings(&sets, &plane, edges, &bins, &Threads(2)).expect("valid");
        for (ring, sum) in rings.iter().zip(sums) {
            let expected = 6000.0 / (count * (count - 1.0)) * sum;
            assert!(
                (ring / expected - 1.0).abs() < 1e-9,
                "{edges:?} {ring} {expected}"
            );
        }
    }
}

/// A pattern with clusters, in a square of side 1000 from the origin.
fn clustered() -> [Vec<f64>; 2] {
    let plane = Flat::rectangle([0.0, 0.0], [1000.0, 1000.0]);
    let mut random = stream(11, 0);
    let mut points: [Vec<f64>; 2] = Default::default();
    for _ in 0..60 {
        let centre = plane.draw(&mut random);
        for _ in 0..20 {
            let place = centre.map(|c| c + 60.0 * (random.unit() + random.unit() - 1.0));
            if plane.holds(&place) {
                points
                    .iter_mut()
                    .zip(place)
                    .for_each(|(axis, x)| axis.push(x));
            }
        }
    }
    points
}

#[test]
fn scale_shift_turn_and_order_do_not_matter() {
    let [x, y] = clustered();
    let bins = Bins::up_to(8.0, 25);
    let square = Flat::rectangle([0.0, 0.0], [1000.0, 1000.0]);
    let all =
        |f: &dyn Fn(f64) -> f64, axis: &[f64]| axis.iter().map(|x| f(*x)).collect::<Vec<f64>>();
    for edges in [Edges::None, Edges::Isotropic, Edges::Translation] {
        let base = curves([&x, &y], &square, edges, &bins);
        assert!(base.h[5] > 20.0, "clusters are seen");
        let same = |found: &Curves, factor: f64, tolerance: f64, what: &str| {
            for (found, base) in found.k.iter().zip(&base.k) {
                let ratio = found / (base * factor * factor);
                assert!((ratio - 1.0).abs() <= tolerance, "{what} {edges:?} {ratio}");
            }
        };
        let thrice = Flat::rectangle([0.0, 0.0], [3000.0, 3000.0]);
        let (x3, y3) = (all(&|x| 3.0 * x, &x), all(&|y| 3.0 * y, &y));
        let wide = Bins::up_to(24.0, 25);
        same(
            &curves([&x3, &y3], &thrice, edges, &wide),
            3.0,
            1e-9,
            "scaled",
        );
        let far = Flat::rectangle([1e7, 1e7], [1e7 + 1000.0, 1e7 + 1000.0]);
        let (xf, yf) = (all(&|x| x + 1e7, &x), all(&|y| y + 1e7, &y));
        same(
            &curves([&xf, &yf], &far, edges, &bins),
            1.0,
            1e-6,
            "shifted",
        );
        let quarter = Flat::rectangle([-1000.0, 0.0], [0.0, 1000.0]);
        let turned = all(&|y| -y, &y);
        same(
            &curves([&turned, &x], &quarter, edges, &bins),
            1.0,
            1e-9,
            "turned",
        );
        let back = |axis: &[f64]| axis.iter().rev().copied().collect::<Vec<f64>>();
        same(
            &curves([&back(&x), &back(&y)], &square, edges, &bins),
            1.0,
            1e-12,
            "permuted",
        );
    }
}

#[test]
fn a_copy_far_away_adds_its_own_pairs_only() {
    let [x, y] = clustered();
    let bins = Bins::up_to(8.0, 25);
    let square = Flat::rectangle([0.0, 0.0], [1000.0, 1000.0]);
    let both = Flat::rectangle([0.0, 0.0], [1e7 + 1000.0, 1000.0]);
    let twice: Vec<f64> = x.iter().copied().chain(x.iter().map(|x| x + 1e7)).collect();
    let same: Vec<f64> = y.iter().chain(&y).copied().collect();
    let sum = |axes: [&[f64]; 2], window: &Flat| {
        let sets = Sets {
            one: axes,
            two: None,
        };
        let rings = rings(&sets, window, Edges::None, &bins, &Threads(2)).expect("valid");
        let factor = sets.pairs() / window.volume();
        rings
            .iter()
            .map(|ring| (ring * factor).round())
            .collect::<Vec<f64>>()
    };
    let doubled: Vec<f64> = sum([&x, &y], &square).iter().map(|n| 2.0 * n).collect();
    assert_eq!(sum([&twice, &same], &both), doubled);
}

#[test]
fn the_same_bits_for_any_number_of_threads() {
    let plane = Flat::rectangle([0.0, 0.0], [1000.0, 1000.0]);
    let points = uniform(&plane, 30_000, &mut stream(2, 0));
    let sets = Sets {
        one: points.each_ref().map(Vec::as_slice),
        two: None,
    };
    let bins = Bins::up_to(5.0, 10);
    for edges in [Edges::Isotropic, Edges::Translation] {
        let one = rings(&sets, &plane, edges, &bins, &Threads(1)).expect("valid");
        for threads in [2, 3, 7] {
            assert_eq!(
                rings(&sets, &plane, edges, &bins, &Threads(threads)),
                Ok(one.clone())
            );
        }
    }
}

#[test]
fn slopes_and_pair_correlation() {
    let bins = Bins::up_to(10.0, 4);
    // K = pi r^2: L = r, g = 1.
    let rings: Vec<f64> = (0..4).map(|k| PI * 100.0 * f64::from(2 * k + 1)).collect();
    let found = Curves::new(&rings, &bins, 2);
    let near = |values: &[f64], expected: f64| values.iter().all(|v| (v - expected).abs() < 1e-12);
    assert!(near(&found.h, 0.0) && near(&found.dl, 1.0) && near(&found.dh, 0.0));
    assert!(near(&found.g, 1.0));
    assert!((l_of_k(ball(3) * 27.0, 3) - 3.0).abs() < 1e-12);
}

/// Expected values: a tree of another program without edge correction, area of the bounding box,
/// n (n - 1), printed to four places.
#[test]
fn real_localisations_as_another_program_sees_them() {
    let root = concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/data/");
    let files: [(&str, [&str; 2], f64, [f64; 6]); 6] = [
        (
            "pyme-smlm-import-tests/ThunderSTORM_TS3D.csv",
            ["x [nm]", "y [nm]"],
            10.0,
            [36.7413, 70.7214, 161.4461, 297.0015, 520.2378, 850.7026],
        ),
        (
            "colicoords/01_storm.csv",
            ["x [nm]", "y [nm]"],
            10.0,
            [
                166.2815, 284.1618, 628.2761, 1058.2031, 1535.9484, 2364.9195,
            ],
        ),
        (
            "smlm-clustering/Training_MEDIUM.csv",
            ["x [nm]", "y [nm]"],
            10.0,
            [23.4374, 47.3448, 121.359, 243.2571, 476.0049, 1040.3121],
        ),
        (
            "smlm-clustering/Training_EASY.csv",
            ["x [nm]", "y [nm]"],
            10.0,
            [71.3254, 139.6811, 353.8893, 672.3099, 1128.2954, 1523.2134],
        ),
        (
            "mean-shift-drift/NPCdata_meanshift_example.csv",
            ["0", "1"],
            10.0,
            [141.3157, 220.0438, 283.1621, 287.2354, 284.4157, 310.2625],
        ),
        (
            "frc-resolution/TestData01.txt",
            ["0", "1"],
            0.1,
            [0.0213, 0.1017, 0.2577, 0.5263, 1.0936, 2.6184],
        ),
    ];
    for (file, names, step, expected) in files {
        let Some([x, y]) = crate::testing::columns(&format!("{root}{file}"), names) else {
            continue;
        };
        let end =
            |axis: &[f64], pick: fn(f64, f64) -> f64| axis.iter().copied().fold(axis[0], pick);
        let low = [&x, &y].map(|axis| end(axis, f64::min));
        let high = [&x, &y].map(|axis| end(axis, f64::max));
        let plane = Flat::rectangle(low, high);
        let found = curves([&x, &y], &plane, Edges::None, &Bins::up_to(step, 50));
        for (place, expected) in [0, 1, 4, 9, 19, 49].into_iter().zip(expected) {
            let h = found.h[place];
            assert!(
                (h - expected).abs() < 6e-5,
                "{file} r {} h {h} {expected}",
                found.r[place]
            );
        }
    }
}
