use super::*;
use crate::testing::{Random, real};
use puncta_sdk::run::Serial;

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
    assert_eq!(hull(&flat), Solid::default());
    assert_eq!(hull(&[[1.0; 3]; 9]), Solid::default());
    assert_eq!(hull(&[]), Solid::default());
}

/// The points of a cubic lattice of 10 nm whose places pass.
fn lattice(side: i32, keep: impl Fn([i32; 3]) -> bool) -> Vec<[f64; 3]> {
    let places = (0..side * side * side).map(|k| [k % side, k / side % side, k / side / side]);
    let point = |place: [i32; 3]| place.map(|k| 1e5 + 10.0 * f64::from(k));
    places.filter(|place| keep(*place)).map(point).collect()
}

fn near(found: Solid, volume: f64, surface: f64) {
    let close = |a: f64, b: f64| (a - b).abs() <= 1e-6 * b.max(1.0);
    assert!(
        close(found.volume, volume) && close(found.surface, surface),
        "{found:?}, not {volume} and {surface}"
    );
}

#[test]
fn alpha_shapes_of_known_solids() {
    // The sphere about a cube of 10 nm has the radius 8.66 nm.
    let shape = |points: &[[f64; 3]], alpha| alpha_shape(points, alpha, &Serial).unwrap();
    near(shape(&lattice(6, |_| true), 8.7), 125e3, 15e3);
    near(shape(&lattice(6, |_| true), 8.6), 0.0, 0.0);
    // Two slabs of 1 x 5 x 5 cells, 30 nm apart: a larger radius joins them.
    let slabs = lattice(6, |[x, _, _]| !(2..=3).contains(&x));
    near(shape(&slabs, 8.7), 50e3, 2.0 * (5e3 + 2e3));
    near(shape(&slabs, 1e3), 125e3, 15e3);
    // An L: in the concave edge the triangle of half a cell has no point in its circle.
    let bracket = lattice(6, |[x, y, _]| x < 3 || y < 3);
    let (area, length) = (1600.0 + 50.0, 200.0 - 20.0 + 200.0_f64.sqrt());
    near(
        shape(&bracket, 8.7),
        50.0 * area,
        2.0 * area + 50.0 * length,
    );
    // A regular tetrahedron of edge a has a sphere of radius a sqrt(6) / 4.
    let corners = [[0., 0., 0.], [1., 1., 0.], [1., 0., 1.], [0., 1., 1.]];
    let edge = 2f64.sqrt();
    near(shape(&corners, 0.867), 1.0 / 3.0, 3f64.sqrt() * edge * edge);
    near(shape(&corners, 0.865), 0.0, 0.0);
    near(shape(&corners[..3], 1e3), 0.0, 0.0);
    near(shape(&[], 1e3), 0.0, 0.0);
}

#[test]
fn a_wide_alpha_shape_is_the_convex_hull_and_a_narrow_one_the_ball() {
    let mut random = Random(8);
    let mut ball = Vec::new();
    while ball.len() < 20_000 {
        let p: [f64; 3] = std::array::from_fn(|_| 2.0 * random.unit() - 1.0);
        if (0.25..=1.0).contains(&dot(p, p)) {
            ball.push(p.map(|v| 500.0 * v));
        }
    }
    let whole = alpha_shape(&ball, 1e9, &Serial).unwrap();
    let outer = hull(&ball);
    near(whole, outer.volume, outer.surface);
    // Points in a shell from 250 to 500 nm; their distance is about 29 nm, the shape's skin.
    let shell = alpha_shape(&ball, 60.0, &Serial).unwrap();
    let full = 4.0 / 3.0 * std::f64::consts::PI * (500f64.powi(3) - 250f64.powi(3));
    let share = shell.volume / full;
    assert!(share > 0.92 && share < 1.0, "{share}");
    let turned: Vec<[f64; 3]> = ball
        .iter()
        .rev()
        .map(|p| [-3.0 * p[1], 3.0 * p[0], 3.0 * p[2] + 1e7])
        .collect();
    let other = alpha_shape(&turned, 180.0, &Serial).unwrap();
    assert!((other.volume / shell.volume / 27.0 - 1.0).abs() < 1e-6);
    assert!((other.surface / shell.surface / 9.0 - 1.0).abs() < 1e-6);
    assert!(alpha_shape(&ball, 60.0, &puncta_testkit::Stopped).is_err());
}
