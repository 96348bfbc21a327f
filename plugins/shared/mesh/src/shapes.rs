//! Meshes of known shape, for examples, tests and phantoms. Each is `(positions, triangles)`,
//! anticlockwise seen from outside.

use crate::vector::{Point, scale, unit};
use std::collections::BTreeMap;
use std::f64::consts::TAU;

/// Positions and triangles.
pub type Shape = (Vec<Point>, Vec<[u32; 3]>);

/// A sphere of this radius: an icosahedron whose triangles are cut in four `levels` times (at most
/// 10), 20 x 4^levels triangles of similar size.
#[must_use]
pub fn sphere(radius: f64, levels: u32) -> Shape {
    let (mut positions, mut triangles) = icosahedron();
    for _ in 0..levels.min(10) {
        let mut middles: BTreeMap<(u32, u32), u32> = BTreeMap::new();
        let mut middle = |a: u32, b: u32| {
            *middles.entry((a.min(b), a.max(b))).or_insert_with(|| {
                let (p, q) = (positions[a as usize], positions[b as usize]);
                positions.push(unit(crate::vector::add(p, q)));
                positions.len() as u32 - 1
            })
        };
        let mut finer = Vec::with_capacity(triangles.len() * 4);
        for [a, b, c] in triangles {
            let (ab, bc, ca) = (middle(a, b), middle(b, c), middle(c, a));
            finer.extend([[a, ab, ca], [b, bc, ab], [c, ca, bc], [ab, bc, ca]]);
        }
        triangles = finer;
    }
    (
        positions.iter().map(|p| scale(*p, radius)).collect(),
        triangles,
    )
}

fn icosahedron() -> Shape {
    let golden = f64::midpoint(1.0, 5f64.sqrt());
    let mut positions = Vec::new();
    for (a, b) in [
        (1.0, golden),
        (-1.0, golden),
        (1.0, -golden),
        (-1.0, -golden),
    ] {
        positions.extend([unit([a, b, 0.0]), unit([0.0, a, b]), unit([b, 0.0, a])]);
    }
    // Three corners at the shortest distance of one another are a triangle.
    let near = |a: usize, b: usize| crate::vector::distance(positions[a], positions[b]) < 1.2;
    let mut triangles = Vec::new();
    for a in 0..12 {
        for b in (a + 1..12).filter(|&b| near(a, b)) {
            for c in (b + 1..12).filter(|&c| near(a, c) && near(b, c)) {
                let [p, q, r] = [a, b, c].map(|i| positions[i]);
                let outward = crate::vector::dot(crate::vector::area_vector([p, q, r]), p) > 0.0;
                let [a, b, c] = [a, b, c].map(|i| i as u32);
                triangles.push(if outward { [a, b, c] } else { [a, c, b] });
            }
        }
    }
    (positions, triangles)
}

/// A torus around the z axis: `ring` is the radius of its centre line, `tube` that of the tube;
/// `around` x `across` vertices (at least 3 each).
#[must_use]
pub fn torus(ring: f64, tube: f64, around: u32, across: u32) -> Shape {
    let (around, across) = (around.max(3), across.max(3));
    let mut positions = Vec::with_capacity((around * across) as usize);
    let mut triangles = Vec::with_capacity(2 * (around * across) as usize);
    for i in 0..around {
        let (sin, cos) = (TAU * f64::from(i) / f64::from(around)).sin_cos();
        for j in 0..across {
            let (up, out) = (TAU * f64::from(j) / f64::from(across)).sin_cos();
            let r = ring + tube * out;
            positions.push([r * cos, r * sin, tube * up]);
            let at = |i: u32, j: u32| (i % around) * across + j % across;
            let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
            triangles.extend([[a, b, c], [a, c, d]]);
        }
    }
    (positions, triangles)
}

/// A cube of this edge around the origin, each face cut into `cells` x `cells` squares.
#[must_use]
pub fn cube(edge: f64, cells: u32) -> Shape {
    let cells = cells.max(1);
    let mut places: BTreeMap<[u32; 3], u32> = BTreeMap::new();
    let mut triangles = Vec::new();
    for axis in 0..3 {
        for high in [false, true] {
            for (i, j) in (0..cells).flat_map(|i| (0..cells).map(move |j| (i, j))) {
                let corners = [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)].map(|(u, v)| {
                    let mut place = [0; 3];
                    place[axis] = if high { cells } else { 0 };
                    place[(axis + 1) % 3] = u;
                    place[(axis + 2) % 3] = v;
                    let count = places.len() as u32;
                    *places.entry(place).or_insert(count)
                });
                let [a, b, c, d] = corners;
                triangles.extend(if high {
                    [[a, b, c], [a, c, d]]
                } else {
                    [[a, c, b], [a, d, c]]
                });
            }
        }
    }
    let mut positions = vec![[0.0; 3]; places.len()];
    let coordinate = |i: u32| edge * (f64::from(i) / f64::from(cells) - 0.5);
    for (place, i) in places {
        positions[i as usize] = place.map(coordinate);
    }
    (positions, triangles)
}

/// A flat sheet in z = 0 of `columns` x `rows` squares of this edge, from the origin.
#[must_use]
pub fn grid(columns: u32, rows: u32, edge: f64) -> Shape {
    let mut positions = Vec::new();
    let mut triangles = Vec::new();
    for j in 0..=rows {
        for i in 0..=columns {
            positions.push([edge * f64::from(i), edge * f64::from(j), 0.0]);
            if i < columns && j < rows {
                let a = j * (columns + 1) + i;
                let d = a + columns + 1;
                triangles.extend([[a, a + 1, d + 1], [a, d + 1, d]]);
            }
        }
    }
    (positions, triangles)
}

/// A Moebius strip, which has one side only: its centre line has radius `ring`, its width is
/// `width`, with `around` x `across` squares (`around` at least 4).
#[must_use]
pub fn moebius(ring: f64, width: f64, around: u32, across: u32) -> Shape {
    let (around, across) = (around.max(4), across.max(1));
    let mut positions = Vec::new();
    let mut triangles = Vec::new();
    for i in 0..around {
        let turn = TAU * f64::from(i) / f64::from(around);
        let (sin, cos) = turn.sin_cos();
        let (half_sin, half_cos) = (turn / 2.0).sin_cos();
        for j in 0..=across {
            let s = width * (f64::from(j) / f64::from(across) - 0.5);
            let r = ring + s * half_cos;
            positions.push([r * cos, r * sin, s * half_sin]);
            if j < across {
                let at = |i: u32, j: u32| {
                    let j = if i == around { across - j } else { j };
                    (i % around) * (across + 1) + j
                };
                let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
                triangles.extend([[a, b, c], [a, c, d]]);
            }
        }
    }
    (positions, triangles)
}
