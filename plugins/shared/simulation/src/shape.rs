//! The test structures: surfaces whose topology and area are known.

use std::f64::consts::PI;

use crate::sdf::{Axis, Solid};
use puncta_shared_vector::Point;

/// A test structure. Lengths in nm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Shape {
    /// Two touching tori, rings in the x z plane: tube radius 30, ring radius 100, centres at
    /// x = -100 and 100.
    Tori,
    /// The same with the rings in the x y plane.
    ToriFlat,
    /// A three-way junction in the plane z = 0: capsules of radius 30 and length 250 at 90, 210 and
    /// 330 degrees, smooth union of width 15.
    Junction,
    /// A piece of endoplasmic reticulum: a rounded plate with two holes, three tubules that close a
    /// loop and one free tubule.
    Er,
    /// A sphere about the origin.
    Sphere {
        /// Radius, nm.
        radius: f64,
    },
    /// A torus about the z axis.
    Torus {
        /// Radius of the ring, nm.
        ring: f64,
        /// Radius of the tube, nm.
        tube: f64,
    },
}

impl Shape {
    /// The shape's short name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Tori => "tori",
            Self::ToriFlat => "tori_flat",
            Self::Junction => "junction",
            Self::Er => "er",
            Self::Sphere { .. } => "sphere",
            Self::Torus { .. } => "torus",
        }
    }

    /// The signed distance function whose zero set is the membrane.
    pub fn solid(self) -> Solid {
        match self {
            Self::Tori => tori(Axis::Y),
            Self::ToriFlat => tori(Axis::Z),
            Self::Junction => junction(),
            Self::Er => er(),
            Self::Sphere { radius } => Solid::Sphere { radius },
            Self::Torus { ring, tube } => torus(Axis::Z, ring, tube),
        }
    }

    /// The low and high corner of a box that holds the surface, nm.
    pub fn bounds(self) -> [Point; 2] {
        match self {
            Self::Tori => [[-235.0, -35.0, -135.0], [235.0, 35.0, 135.0]],
            Self::ToriFlat => [[-235.0, -135.0, -35.0], [235.0, 135.0, 35.0]],
            Self::Junction => [[-260.0, -170.0, -40.0], [260.0, 290.0, 40.0]],
            Self::Er => [[-500.0, -210.0, -45.0], [470.0, 230.0, 75.0]],
            Self::Sphere { radius } => [[-radius; 3], [radius; 3]],
            Self::Torus { ring, tube } => {
                let out = ring + tube;
                [[-out, -out, -tube], [out, out, tube]]
            }
        }
    }

    /// The surface's Euler characteristic, vertices - edges + faces.
    pub fn euler(self) -> i32 {
        match self {
            Self::Tori | Self::ToriFlat => -2,
            Self::Junction | Self::Sphere { .. } => 2,
            Self::Er => -4,
            Self::Torus { .. } => 0,
        }
    }

    /// The surface's area, nm^2, to four digits.
    pub fn area(self) -> f64 {
        match self {
            Self::Tori | Self::ToriFlat => 211_830.0,
            Self::Junction => 152_420.0,
            Self::Er => 516_070.0,
            Self::Sphere { radius } => 4.0 * PI * radius * radius,
            Self::Torus { ring, tube } => 4.0 * PI * PI * ring * tube,
        }
    }
}

fn torus(axis: Axis, ring: f64, tube: f64) -> Solid {
    Solid::Torus { axis, ring, tube }
}

fn tori(axis: Axis) -> Solid {
    let one = |x| torus(axis, 100.0, 30.0).moved([x, 0.0, 0.0]);
    one(-100.0).union(one(100.0))
}

fn junction() -> Solid {
    let arm = |degrees: f64| {
        let (sin, cos) = degrees.to_radians().sin_cos();
        Solid::Capsule {
            from: [0.0; 3],
            to: [250.0 * cos, 250.0 * sin, 0.0],
            radius: 30.0,
        }
    };
    arm(90.0)
        .smooth_union(arm(210.0), 15.0)
        .smooth_union(arm(330.0), 15.0)
}

fn er() -> Solid {
    let plate = Solid::RoundedBox {
        half: [200.0, 150.0, 28.0],
        rounding: 28.0,
    };
    let hole = |x| Solid::Cylinder { radius: 45.0 }.moved([x, 0.0, 0.0]);
    let sheet = plate
        .smooth_difference(hole(-85.0), 20.0)
        .smooth_difference(hole(85.0), 20.0);
    let tubules = [
        ([180.0, 100.0, 0.0], [420.0, 180.0, 0.0]),
        ([180.0, -100.0, 0.0], [420.0, -160.0, 0.0]),
        ([420.0, 180.0, 0.0], [420.0, -160.0, 0.0]),
        ([-180.0, 0.0, 0.0], [-450.0, 40.0, 30.0]),
    ];
    tubules.into_iter().fold(sheet, |solid, (from, to)| {
        solid.smooth_union(
            Solid::Capsule {
                from,
                to,
                radius: 35.0,
            },
            25.0,
        )
    })
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::sdf::tests::project;
    use puncta_shared_vector::{dot, norm, sub};

    pub(crate) const ALL: [Shape; 6] = [
        Shape::Tori,
        Shape::ToriFlat,
        Shape::Junction,
        Shape::Er,
        Shape::Sphere { radius: 80.0 },
        Shape::Torus {
            ring: 90.0,
            tube: 40.0,
        },
    ];

    /// A file of the shared simulated membranes, if they are there: rows of numbers.
    pub(crate) fn shared(name: &str) -> Option<Vec<Vec<f64>>> {
        let path = format!("{SHARED}/simulated-membranes/{name}");
        let text = std::fs::read_to_string(path).ok()?;
        let row = |line: &str| {
            line.split(',')
                .map(|v| v.parse().expect("a number"))
                .collect()
        };
        Some(text.lines().skip(1).map(row).collect())
    }

    /// Data beside the workspace.
    const SHARED: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../../../shared/data");

    #[test]
    fn the_surface_lies_inside_the_bounds() {
        for shape in ALL {
            let solid = shape.solid();
            let [low, high] = shape.bounds();
            // Every face of the box lies outside the solid.
            for axis in 0..3 {
                for side in [low[axis] - 1e-9, high[axis] + 1e-9] {
                    for i in 0..100 * 100 {
                        let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
                        let mut p = [side; 3];
                        p[u] = low[u] + (high[u] - low[u]) * f64::from(i % 100) / 99.0;
                        p[v] = low[v] + (high[v] - low[v]) * f64::from(i / 100) / 99.0;
                        assert!(solid.value(p) > 0.0, "{shape:?} {p:?}");
                    }
                }
            }
        }
    }

    /// Euler characteristic of the solid's voxels, chi(solid) = chi(surface) / 2: vertices - edges +
    /// faces - cells of the cubical complex.
    #[test]
    fn the_euler_characteristic_is_that_of_the_voxelised_solid() {
        for shape in ALL {
            let solid = shape.solid();
            let [low, high] = shape.bounds();
            let step = 8.0;
            let size = [0, 1, 2].map(|i| ((high[i] - low[i]) / step) as usize + 3);
            let mut filled = vec![false; size[0] * size[1] * size[2]];
            let index = |c: [usize; 3]| (c[2] * size[1] + c[1]) * size[0] + c[0];
            let cells = |size: [usize; 3]| {
                (0..size[0] * size[1] * size[2])
                    .map(move |i| [i % size[0], i / size[0] % size[1], i / size[0] / size[1]])
            };
            for c in cells(size) {
                let p = [0, 1, 2].map(|i| low[i] + (c[i] as f64 - 0.77) * step);
                filled[index(c)] = solid.value(p) < 0.0;
            }
            // Each face of the complex is the corner with the largest indices of its cells.
            let mut euler = 0;
            for corner in cells(size.map(|n| n - 1)) {
                let c = corner.map(|i| i + 1);
                for kind in 0..8usize {
                    // Bit set: the face spans the whole cell along that axis.
                    let spans = [0, 1, 2].map(|i| kind >> i & 1 == 1);
                    let touched = (0..8usize).any(|n| {
                        let back = [0, 1, 2].map(|i| n >> i & 1);
                        (0..3).all(|i| !spans[i] || back[i] == 0)
                            && filled[index([0, 1, 2].map(|i| c[i] - back[i]))]
                    });
                    let sign = if kind.count_ones() % 2 == 0 { 1 } else { -1 };
                    euler += sign * i32::from(touched);
                }
            }
            assert_eq!(2 * euler, shape.euler(), "{shape:?}");
        }
    }

    #[test]
    fn points_and_normals_of_the_reference_surfaces_agree() {
        for (shape, name) in [
            (Shape::Tori, "truth_tori.csv"),
            (Shape::Junction, "truth_junction.csv"),
            (Shape::Er, "truth_er.csv"),
        ] {
            let Some(rows) = shared(name) else { return };
            let solid = shape.solid();
            for row in rows {
                let (value, gradient) = solid.gradient([row[0], row[1], row[2]]);
                // Written with two decimals; normals with four.
                assert!(value.abs() < 0.01, "{shape:?} {row:?} {value}");
                assert!(
                    dot(gradient, [row[3], row[4], row[5]]) > 0.999 * norm(gradient),
                    "{row:?}"
                );
                let surface = project(&solid, [row[0], row[1], row[2]]);
                assert!(norm(sub(surface, [row[0], row[1], row[2]])) < 0.02);
            }
        }
    }
}
