use super::*;
use crate::flat::tests::letter;
use crate::polygon::{mask, polygon};
use puncta_sdk::ImageInfo;
use puncta_testkit::{Random, Stopped, Threads};

fn of(region: &Flat, reach: f64) -> Overlap<2> {
    flat(region, reach, &Threads(2)).unwrap()
}

/// Differences up to a length.
fn differences(reach: f64) -> Vec<[f64; 2]> {
    let mut random = Random(5);
    let one = |_| {
        let (sin, cos) = (std::f64::consts::TAU * random.unit()).sin_cos();
        let length = reach * random.unit();
        [length * cos, length * sin]
    };
    (0..500).map(one).collect()
}

#[test]
fn a_rectangle_shares_the_same_however_it_is_given() {
    let sides = of(&Flat::rectangle([5.0, -3.0], [905.0, 597.0]), 400.0);
    let corners = ([5.0, 5.0, 905.0, 905.0], [-3.0, 597.0, 597.0, -3.0]);
    let outline = of(&polygon(&corners.0, &corners.1).unwrap(), 400.0);
    let mut info = ImageInfo::plane(9, 6, 100.0, 5.0, -3.0);
    info.voxel[1] = 100.0;
    let pixels = of(&mask(&info, &[1.0; 54]).unwrap(), 400.0);
    for difference in differences(400.0) {
        let expected = sides.share(&difference);
        assert!((outline.share(&difference) - expected).abs() < 1e-12);
        assert!((pixels.share(&difference) - expected).abs() < 1e-12);
    }
}

#[test]
fn a_moved_triangle_shares_a_smaller_one() {
    let region = polygon(&[0.0, 60.0, 0.0], &[0.0, 0.0, 80.0]).unwrap();
    let edges = Sloped::all(&region.edges);
    for [dx, dy] in differences(40.0) {
        let (x, y) = (dx / 60.0, dy / 80.0);
        // The legs start at the larger of both corners, the long sides meet at the smaller one.
        let left = 1.0 + (x + y).min(0.0) - x.max(0.0) - y.max(0.0);
        let expected = 2400.0 * left.max(0.0).powi(2);
        let found = common_area(&edges, [dx, dy]);
        assert!(
            (found - expected).abs() < 1e-9,
            "{dx} {dy}: {found} {expected}"
        );
    }
    // Between the knots it is off where it bends, which is seldom.
    let table = of(&region, 40.0);
    let miss = |d: &[f64; 2]| (table.share(d) - common_area(&edges, *d) / region.area).abs();
    let misses: Vec<f64> = differences(40.0).iter().map(miss).collect();
    assert!(misses.iter().copied().fold(0.0, f64::max) < 3e-3);
    assert!(misses.iter().sum::<f64>() / 500.0 < 1e-4);
}

#[test]
fn the_letter_l_shares_the_same_as_an_outline_and_as_pixels() {
    let info = ImageInfo::plane(18, 18, 50.0, 1e5, 1e5);
    let pixel = |i: usize| if i % 18 < 9 || i / 18 < 9 { 1.0 } else { 0.0 };
    let pixels = mask(&info, &(0..324).map(pixel).collect::<Vec<f64>>()).unwrap();
    let (outline, pixels) = (of(&letter(1e5), 300.0), of(&pixels, 300.0));
    for difference in differences(300.0) {
        let (a, b) = (outline.share(&difference), pixels.share(&difference));
        assert!((a - b).abs() < 1e-3, "{difference:?} {a} {b}");
        // Moved along one axis by d: the arm that sticks out loses its end, the base one too.
        let along = pixels.share(&[difference[0].abs(), 0.0]);
        let expected = 1.0 - difference[0].abs() * 900.0 / 607_500.0;
        assert!((along - expected).abs() < 1e-12);
    }
}

#[test]
fn voxels_share_what_both_hold() {
    let mut random = Random(9);
    let shape = [7, 6, 5];
    let voxels: Vec<bool> = (0..210).map(|_| random.unit() < 0.6).collect();
    let rows = Rows::new(&voxels, shape);
    let is = |p: [i64; 3]| {
        let inside = (0..3).all(|a| p[a] >= 0 && p[a] < shape[a] as i64);
        inside && voxels[((p[2] * 6 + p[1]) * 7 + p[0]) as usize]
    };
    for by in [[0, 0, 0], [2, -1, 1], [-6, 5, 0], [7, 0, 0], [0, 0, -9]] {
        let all = (0..210).map(|i| [i % 7, i / 7 % 6, i / 42]);
        let both = all.filter(|p| is(*p) && is([p[0] - by[0], p[1] - by[1], p[2] - by[2]]));
        assert_eq!(rows.common(by), both.count() as u64, "{by:?}");
    }
    let table = super::voxels(&rows, [10.0, 10.0, 30.0], 45.0, &Threads(2)).unwrap();
    let total = rows.common([0; 3]) as f64;
    let found = table.share(&[-20.0, 10.0, 30.0]);
    assert!((found - rows.common([-2, 1, 1]) as f64 / total).abs() < 1e-12);
    let half = 0.5 * (rows.common([-2, 1, 1]) + rows.common([-2, 1, 0])) as f64 / total;
    assert!((table.share(&[-20.0, 10.0, 15.0]) - half).abs() < 1e-12);
}

#[test]
fn too_many_moves_and_cancelling_end_it() {
    let info = ImageInfo::plane(2, 2, 1e-3, 0.0, 0.0);
    let tiny = mask(&info, &[1.0; 4]).unwrap();
    let refused = flat(&tiny, 500.0, &Threads(1)).unwrap_err();
    assert_eq!(refused.parameter.as_deref(), Some("r_max"));
    assert!(
        flat(&letter(0.0), 50.0, &Stopped)
            .unwrap_err()
            .is_cancelled()
    );
}
