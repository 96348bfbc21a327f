//! Remeshing of shapes of known curvature.

use super::*;
use crate::curvature::{Method, curvatures};
use crate::measure::{edge_lengths, volume};
use crate::sample::unit_interval;
use crate::shapes::{self, Shape};
use crate::smooth::{Fitting, fit};
use crate::topology::{describe, euler};
use puncta_sdk::run::Serial;
use puncta_testkit::{Stopped, Threads};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;

fn build(shape: Shape) -> Mesh {
    Mesh::new(shape.0, &shape.1).unwrap()
}

/// Moves vertices along the surface by up to `shake` and off it by `noise` (both nm).
fn shaken(shape: Shape, shake: f64, noise: f64, back: impl Fn(Point) -> (Point, Point)) -> Mesh {
    let mut random = ChaCha8Rng::seed_from_u64(1);
    let mut positions = shape.0;
    for p in &mut positions {
        let mut one = || 2.0 * unit_interval(&mut random) - 1.0;
        let moved = add(*p, scale([one(), one(), one()], shake));
        let (place, normal) = back(moved);
        // A sum of 12 is as good as normal.
        let normal_error: f64 = (0..12).map(|_| one()).sum::<f64>() / 2.0;
        *p = along(place, normal, noise * normal_error);
    }
    Mesh::new(positions, &shape.1).unwrap()
}

fn on_sphere(p: Point) -> (Point, Point) {
    (scale(unit(p), 100.0), unit(p))
}

const RING: f64 = 100.0;
const TUBE: f64 = 50.0;

fn on_torus(p: Point) -> (Point, Point) {
    let centre = scale(unit([p[0], p[1], 0.0]), RING);
    let normal = unit(sub(p, centre));
    (along(centre, normal, TUBE), normal)
}

/// Root mean square errors of H and K, relative to their own root mean square.
fn errors(mesh: &Mesh, truth: impl Fn(Point) -> (f64, f64)) -> (f64, f64) {
    let found = curvatures(mesh, Method::default(), &Serial).unwrap();
    let (mut h, mut k, mut hh, mut kk) = (0.0, 0.0, 0.0, 0.0);
    for (one, p) in found.iter().zip(mesh.positions()) {
        let (mean, gaussian) = truth(*p);
        h += (one.mean() - mean).powi(2);
        k += (one.gaussian() - gaussian).powi(2);
        hh += mean * mean;
        kk += gaussian * gaussian;
    }
    ((h / hh).sqrt(), (k / kk).sqrt())
}

fn of_torus(p: Point) -> (f64, f64) {
    let cos = (p[0].hypot(p[1]) - RING) / TUBE;
    let outer = RING + TUBE * cos;
    (
        (RING + 2.0 * TUBE * cos) / (2.0 * TUBE * outer),
        cos / (TUBE * outer),
    )
}

#[test]
fn curvature_after_remeshing_is_that_of_the_surface() {
    let starts = [
        shaken(shapes::sphere(100.0, 3), 4.0, 0.0, on_sphere),
        shaken(shapes::sphere(100.0, 5), 1.0, 0.0, on_sphere),
    ];
    for mut mesh in starts {
        remesh(&mut mesh, Remeshing::to(10.0), &Serial).unwrap();
        mesh.verify().unwrap();
        let (h, k) = errors(&mesh, |_| (0.01, 1e-4));
        assert!(h < 0.02 && k < 0.05, "{h} {k}");
        assert_eq!(euler(&mesh), 2);
    }
    let mut mesh = shaken(shapes::torus(RING, TUBE, 60, 30), 3.0, 0.0, on_torus);
    remesh(&mut mesh, Remeshing::to(10.0), &Serial).unwrap();
    mesh.verify().unwrap();
    let (h, k) = errors(&mesh, of_torus);
    assert!(h < 0.02 && k < 0.05, "{h} {k}");
    assert_eq!(euler(&mesh), 0);
}

/// Noise of 3 % of the later edges; smoothed where the vertices are many, and after remeshing.
#[test]
fn curvature_from_a_noisy_irregular_start() {
    type Truth = fn(Point) -> (f64, f64);
    let sphere = shaken(shapes::sphere(100.0, 5), 1.0, 0.3, on_sphere);
    let torus = shaken(shapes::torus(RING, TUBE, 100, 50), 2.0, 0.3, on_torus);
    for (mut mesh, truth) in [
        (sphere, (|_| (0.01, 1e-4)) as Truth),
        (torus, of_torus as Truth),
    ] {
        fit(&mut mesh, Fitting::default(), &Serial).unwrap();
        remesh(&mut mesh, Remeshing::to(10.0), &Serial).unwrap();
        fit(&mut mesh, Fitting::default(), &Serial).unwrap();
        let (h, k) = errors(&mesh, truth);
        assert!(h < 0.02 && k < 0.05, "{h} {k}");
    }
}

#[test]
fn edges_get_the_length_and_the_volume_stays() {
    let mut mesh = build(shapes::torus(RING, TUBE, 200, 20));
    let truth = 2.0 * std::f64::consts::PI.powi(2) * RING * TUBE * TUBE;
    remesh(&mut mesh, Remeshing::to(7.0), &Serial).unwrap();
    let lengths = edge_lengths(&mesh, &Serial).unwrap();
    assert!((lengths.mean / 7.0 - 1.0).abs() < 0.1, "{lengths:?}");
    assert!(lengths.deviation < 0.2 * lengths.mean && lengths.most < 4.0 / 3.0 * 7.0 * 1.2);
    let found = volume(&mesh, &Serial).unwrap();
    assert!((found / truth - 1.0).abs() < 0.01, "{found} {truth}");
    let six = mesh
        .live_vertices()
        .filter(|&v| mesh.valence(v) == 6)
        .count();
    assert!(2 * six > mesh.vertex_count());
}

#[test]
fn sheets_keep_rim_and_area() {
    let mut mesh = build(shapes::grid(10, 10, 1.0));
    for edge in [0.4, 2.5] {
        remesh(&mut mesh, Remeshing::to(edge), &Serial).unwrap();
        mesh.verify().unwrap();
        assert!((area(&mesh, &Serial).unwrap() - 100.0).abs() < 1e-9);
        let one = describe(&mesh).0[0];
        assert_eq!((one.loops, one.euler), (1, 1));
    }
    assert!(mesh.triangle_count() < 120);
}

#[test]
fn any_mesh_and_any_length() {
    for shape in [
        shapes::sphere(1.0, 0),
        shapes::cube(3.0, 1),
        shapes::torus(3.0, 1.0, 3, 3),
    ] {
        for edge in [0.3, 1.0, 50.0] {
            for project in [false, true] {
                let mut mesh = build(shape.clone());
                let chi = euler(&mesh);
                let how = Remeshing {
                    project,
                    ..Remeshing::to(edge)
                };
                remesh(&mut mesh, how, &Serial).unwrap();
                mesh.verify().unwrap();
                assert_eq!(euler(&mesh), chi);
            }
        }
    }
    let mut mesh = build(shapes::sphere(1.0, 0));
    for edge in [0.0, -1.0, f64::NAN, 1e-9] {
        assert!(remesh(&mut mesh, Remeshing::to(edge), &Serial).is_err());
    }
    let mut none = Mesh::default();
    remesh(&mut none, Remeshing::to(1.0), &Serial).unwrap();
    assert!(remesh(&mut mesh, Remeshing::to(0.1), &Stopped).is_err());
}

#[test]
fn threads_change_no_bit() {
    let at = |run: &dyn Run| {
        let mut mesh = shaken(shapes::sphere(100.0, 4), 2.0, 0.5, on_sphere);
        remesh(&mut mesh, Remeshing::to(8.0), run).unwrap();
        mesh.to_triangles()
    };
    assert_eq!(at(&Serial), at(&Threads(3)));
}
