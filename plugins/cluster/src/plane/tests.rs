use super::*;
use crate::testing::{Random, real};

#[test]
fn hulls_of_real_tables_are_those_of_another_program() {
    let names = ["x [nm]", "y [nm]", "-"];
    let cases = [
        (
            "pyme-smlm-import-tests/ThunderSTORM_TS3D.csv",
            names,
            20_388_687.311,
            16_807.73,
            14,
        ),
        (
            "colicoords/01_storm.csv",
            names,
            949_163_558.524,
            119_217.564,
            22,
        ),
        (
            "smlm-clustering/Training_MEDIUM.csv",
            names,
            720_340_897.302,
            105_919.505,
            13,
        ),
        (
            "smlm-clustering/Training_EASY.csv",
            names,
            693_894_680.407,
            101_320.041,
            17,
        ),
        (
            "mean-shift-drift/NPCdata_meanshift_example.csv",
            ["0", "1", "2"],
            805_143_468.662,
            111_339.566,
            19,
        ),
    ];
    for (file, columns, wanted, length, vertices) in cases {
        let Some([x, y, _]) = real(file, columns) else {
            continue;
        };
        let points: Vec<[f64; 2]> = x.into_iter().zip(y).map(|(x, y)| [x, y]).collect();
        let ring = hull(&points);
        assert_eq!(ring.len(), vertices, "{file}");
        assert!((area(&ring) - wanted).abs() < 1e-3, "{file}");
        assert!((perimeter(&ring) - length).abs() < 1e-3, "{file}");
    }
}

#[test]
fn hulls_of_few_points_and_lines() {
    assert_eq!(hull(&[]), Ring::new());
    assert_eq!(hull(&[[1.0, 2.0]; 5]), [[1.0, 2.0]]);
    assert_eq!(hull(&[[0.0, 0.0], [2.0, 2.0], [1.0, 1.0]]).len(), 2);
    let square = [
        [0.0, 0.0],
        [1.0, 0.0],
        [1.0, 1.0],
        [0.0, 1.0],
        [0.5, 0.0],
        [0.5, 0.5],
    ];
    assert_eq!(
        hull(&square),
        [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]
    );
    assert_eq!(perimeter(&hull(&square)), 4.0);
}

#[test]
fn the_alpha_shape_of_a_ring_has_its_hole_and_its_area() {
    let mut random = Random(4);
    let mut points = vec![];
    while points.len() < 4000 {
        let at = [random.unit() * 200.0 - 100.0, random.unit() * 200.0 - 100.0];
        let radius = at[0].hypot(at[1]);
        if radius < 100.0 && radius > 50.0 {
            points.push([at[0] + 1e7, at[1]]);
        }
    }
    let rings = alpha_shape(&points, 10.0).unwrap();
    let mut areas: Vec<f64> = rings.iter().map(|ring| area(ring)).collect();
    areas.sort_by(f64::total_cmp);
    assert_eq!(areas.len(), 2, "{areas:?}");
    assert!(areas[0] < 0.0 && areas[1] > 0.0);
    let truth = std::f64::consts::PI * 7500.0;
    assert!((areas.iter().sum::<f64>() / truth - 1.0).abs() < 0.03);
    // With a large alpha it is the hull, with a small one nothing.
    let all = alpha_shape(&points, 1e9).unwrap();
    assert!((area(&all[0]) - area(&hull(&points))).abs() < 1e-3);
    assert!(alpha_shape(&points, 1e-3).unwrap().is_empty());
    assert!(alpha_shape(&[[1.0, 1.0]; 4], 10.0).unwrap().is_empty());
    assert!(alpha_shape(&[], 10.0).unwrap().is_empty());
}
