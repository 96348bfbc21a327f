use super::*;
use crate::testing::{Random, real};

#[test]
fn hulls_of_real_tables_are_those_of_another_program() {
    let names = ["x [nm]", "y [nm]", "z [nm]"];
    let cases = [
        (
            "pyme-smlm-import-tests/ThunderSTORM_TS3D.csv",
            names,
            8_376_222_125.3,
            43_179_926.3,
        ),
        (
            "smolr/3d_localizations.csv",
            names,
            13_483_337_440_487.2,
            5_666_196_017.5,
        ),
        (
            "pyme-smlm-import-tests/CaulobacterC_2_R09_MoernerLab.csv",
            ["x", "y", "z"],
            4_303_993_297.8,
            18_219_391.8,
        ),
    ];
    for (file, columns, volume, surface) in cases {
        let Some([x, y, z]) = real(file, columns) else {
            continue;
        };
        let points: Vec<[f64; 3]> = x
            .into_iter()
            .zip(y)
            .zip(z)
            .map(|((x, y), z)| [x, y, z])
            .collect();
        let found = hull(&points);
        assert!(
            (found.volume / volume - 1.0).abs() < 1e-9,
            "{file} {found:?}"
        );
        assert!(
            (found.surface / surface - 1.0).abs() < 1e-8,
            "{file} {found:?}"
        );
    }
}

#[test]
fn cubes_spheres_and_flat_points() {
    let mut lattice = vec![];
    for k in 0..216 {
        let side = |k: i32| f64::from(k % 6) * 20.0;
        lattice.push([1e6 + side(k), side(k / 6), side(k / 36)]);
    }
    let cube = hull(&lattice);
    assert!((cube.volume - 1e6).abs() < 1e-3 && (cube.surface - 6e4).abs() < 1e-5);
    let mut random = Random(6);
    let sphere: Vec<[f64; 3]> = (0..20_000)
        .map(|_| [random.normal(), random.normal(), random.normal()])
        .map(|p| p.map(|v| v / dot(p, p).sqrt()))
        .collect();
    let ball = hull(&sphere);
    assert!((ball.volume / (4.0 / 3.0 * std::f64::consts::PI) - 1.0).abs() < 2e-3);
    let flat: Vec<[f64; 3]> = sphere.iter().map(|p| [p[0], p[1], 5.0]).collect();
    assert_eq!(hull(&flat), Hull::default());
    assert_eq!(hull(&[[1.0; 3]; 9]), Hull::default());
    assert_eq!(hull(&[]), Hull::default());
}
