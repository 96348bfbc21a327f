use crate::extract::{Extracted, Settings, extract};
use crate::score::{Triangles, from_mesh, from_truth, quantile, truth_samples};
use crate::surface::Surface;
use crate::truth::Truth;
use puncta_sdk::run::Serial;
use puncta_shared_simulation::parameters::Parameters;
use puncta_shared_simulation::shape::Shape;
use puncta_shared_simulation::simulate::simulate;
use puncta_shared_vector::{Point, squared};
use puncta_testkit::Random;
use std::collections::HashMap;
use std::f64::consts::PI;

mod data;

/// What is wrong with a surface: edges of one triangle, of more than two, of two that face opposite
/// sides, triangles that name a vertex twice, vertices whose triangles are not one fan.
pub fn defects(surface: &Surface) -> [usize; 5] {
    let mut edges: HashMap<[u32; 2], [usize; 2]> = HashMap::new();
    let mut next: HashMap<[u32; 2], u32> = HashMap::new();
    let mut degree = vec![0usize; surface.positions.len()];
    let mut start = vec![0; surface.positions.len()];
    let mut degenerate = 0;
    for t in &surface.triangles {
        degenerate += usize::from(t[0] == t[1] || t[1] == t[2] || t[2] == t[0]);
        for k in 0..3 {
            let [a, b, c] = [t[k], t[(k + 1) % 3], t[(k + 2) % 3]];
            edges.entry([a.min(b), a.max(b)]).or_default()[usize::from(a > b)] += 1;
            next.insert([a, b], c);
            degree[a as usize] += 1;
            start[a as usize] = b;
        }
    }
    let boundary = edges.values().filter(|n| n[0] + n[1] == 1).count();
    let crowded = edges.values().filter(|n| n[0] + n[1] > 2).count();
    let flipped = edges
        .values()
        .filter(|n| n[0] + n[1] == 2 && n[0] != 1)
        .count();
    let mut pinched = 0;
    for v in 0..surface.positions.len() {
        let (mut at, mut steps) = (start[v], 0);
        loop {
            match next.get(&[v as u32, at]) {
                Some(to) if steps < degree[v] => at = *to,
                _ => break,
            }
            steps += 1;
            if at == start[v] {
                break;
            }
        }
        pinched += usize::from(degree[v] == 0 || steps != degree[v]);
    }
    [boundary, crowded, flipped, degenerate, pinched]
}

pub fn direction(random: &mut Random) -> Point {
    let z = 2.0 * random.unit() - 1.0;
    let (sin, cos) = (std::f64::consts::TAU * random.unit()).sin_cos();
    let r = (1.0 - z * z).sqrt();
    [r * cos, r * sin, z]
}

pub type Columns = [Vec<f64>; 3];

pub fn run(columns: &Columns, settings: &Settings) -> Extracted {
    extract([&columns[0], &columns[1], &columns[2]], settings, &Serial).expect("a surface")
}

pub fn push(columns: &mut Columns, point: Point) {
    for axis in 0..3 {
        columns[axis].push(point[axis]);
    }
}

fn shell(count: usize, radius: f64, sigma: f64, seed: u64) -> Columns {
    let mut random = Random(seed);
    let mut columns = Columns::default();
    for _ in 0..count {
        let direction = direction(&mut random);
        let noise = [random.normal(), random.normal(), random.normal()];
        let point = std::array::from_fn(|a| 3000.0 + radius * direction[a] + sigma * noise[a]);
        push(&mut columns, point);
    }
    columns
}

/// As many runs as the machine has time for: all when `PUNCTA_TEST_ALL` is set.
fn seeds(few: u64) -> std::ops::Range<u64> {
    0..if std::env::var_os("PUNCTA_TEST_ALL").is_some() {
        1000
    } else {
        few
    }
}

#[test]
fn a_shell_has_the_sphere_s_area_and_volume() {
    let extracted = run(&shell(200_000, 1500.0, 15.0, 3), &Settings::default());
    let surface = &extracted.surface;
    assert_eq!(defects(surface), [0; 5]);
    assert_eq!((surface.euler(), extracted.components), (2, [1, 0]));
    let area = surface.area() / (4.0 * PI * 1500f64.powi(2));
    let volume = surface.volume() / (4.0 / 3.0 * PI * 1500f64.powi(3));
    assert!((area - 1.0).abs() < 0.01, "area {area}");
    assert!((volume - 1.0).abs() < 0.01, "volume {volume}");
    assert!(extracted.median[0] < -30.0 && extracted.median[1].abs() < 0.1);
    let distances = surface
        .positions
        .iter()
        .map(|p| squared(p.map(|x| x - 3000.0)).sqrt() - 1500.0);
    let furthest = distances.fold(0.0, |most: f64, d| most.max(d.abs()));
    assert!(furthest < 45.0, "{furthest}");
}

#[test]
fn inner_sheets_are_kept_at_a_threshold() {
    let settings = Settings {
        threshold: Some(2e-5),
        cull: false,
        centre: false,
        smoothing: 2,
        ..Settings::default()
    };
    let surface = run(&shell(200_000, 1500.0, 15.0, 3), &settings).surface;
    assert_eq!(defects(&surface), [0; 5]);
    let area = surface.area() / (4.0 * PI * 1500f64.powi(2));
    assert!((1.7..2.6).contains(&area), "area {area}");
}

/// Coarse and fine cells side by side, single cells, checkerboards: the topology never breaks.
#[test]
fn every_surface_of_noise_is_a_closed_manifold() {
    for seed in seeds(24) {
        let mut random = Random(seed);
        let mut columns = Columns::default();
        for i in 0..3000 {
            let mut p = [random.unit(), random.unit(), random.unit()].map(|u| 1000.0 * u * u);
            if i % 3 == 0 {
                p = p.map(|x| (x / 50.0).floor() * 50.0);
            }
            push(&mut columns, p);
        }
        for cull in [true, false] {
            let settings = Settings {
                most: 3,
                smallest_cell: 1.0,
                threshold: Some(1e-5 * random.unit() + 1e-9),
                cull,
                centre: false,
                fewest_triangles: 0,
                smoothing: seed as u32 % 2,
            };
            let surface = run(&columns, &settings).surface;
            assert_eq!(defects(&surface), [0; 5], "seed {seed} cull {cull}");
            assert!(surface.triangles.len() >= 500 && surface.volume() > 0.0);
        }
    }
}

/// Localisations of a simulated membrane; some coincide, some lie on a lattice.
fn membrane(shape: Shape, seed: u64) -> Columns {
    let parameters = Parameters {
        shape,
        acceptance: 0.25,
        background: 0.02,
        fwhm: [100.0; 3],
        seed,
        ..Parameters::default()
    };
    let cloud = simulate(&parameters, &Serial).expect("a cloud");
    let mut columns = Columns::default();
    for (i, localisation) in cloud.localisations.iter().enumerate() {
        let p = localisation.position;
        match i % 20 {
            0 => {
                push(&mut columns, p);
                push(&mut columns, p);
            }
            1 => push(&mut columns, p.map(|x| (x / 4.0).round() * 4.0)),
            _ => push(&mut columns, p),
        }
    }
    columns
}

/// Closed, of enough triangles, of the right topology, and near the truth both ways.
#[test]
fn membranes_have_their_topology_and_place() {
    let torus = Shape::Torus {
        ring: 100.0,
        tube: 40.0,
    };
    let shapes = [
        Shape::Sphere { radius: 100.0 },
        torus,
        Shape::Tori,
        Shape::Er,
    ];
    for (seed, shape) in seeds(2).flat_map(|seed| shapes.map(|shape| (seed, shape))) {
        let settings = Settings {
            most: 20,
            ..Settings::default()
        };
        let surface = run(&membrane(shape, seed), &settings).surface;
        let place = format!("{shape:?} seed {seed}");
        assert_eq!(defects(&surface), [0; 5], "{place}");
        assert!(surface.triangles.len() >= 500, "{place}");
        assert_eq!(surface.euler(), i64::from(shape.euler()), "{place}");
        let truth = Truth::new(shape);
        let from = from_truth(&surface.positions, &truth, &Serial).expect("distances");
        let points = truth_samples(&truth, 8.0, seed, &Serial).expect("samples");
        let surface = Triangles::new(surface.positions, surface.triangles, &Serial);
        let to = from_mesh(&points, &surface.expect("triangles"), &Serial).expect("distances");
        for distances in [from, to] {
            let [most, all] = [0.95, 1.0].map(|share| quantile(&distances, share));
            assert!(most < 6.0 && all < 20.0, "{place}: {most} {all}");
        }
    }
}
