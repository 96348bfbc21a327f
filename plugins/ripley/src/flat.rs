//! Regions of the plane: rectangles, polygons and masks, all as directed edges with the region on
//! their left.
//!
//! The part of a circle that lies in the region has the signed angle under which its centre sees
//! those parts of the edges that lie outside the circle. So one sum over the few edges that the
//! circle meets is exact for any shape, with holes and several parts.

use crate::bands::Bands;
use crate::overlap::Overlap;
use crate::window::{NearEdge, Random, Rim, Window};
use puncta_sdk::Failure;
use puncta_sdk::run::Run;
use std::f64::consts::TAU;

/// A directed edge.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Edge {
    /// Where it starts, nm.
    pub from: [f64; 2],
    /// Where it ends, nm.
    pub to: [f64; 2],
}

/// How a point is found to be inside, and how one is drawn.
#[derive(Clone, Debug)]
pub(crate) enum Inside {
    /// The whole bounding box.
    Rectangle,
    /// An odd number of edges to its right.
    Polygon,
    /// Pixels: number along x and y, side along x and y, whether each belongs, which do.
    Mask {
        shape: [usize; 2],
        side: [f64; 2],
        pixels: Vec<bool>,
        set: Vec<u32>,
    },
}

/// A region of the plane.
#[derive(Clone, Debug)]
pub struct Flat {
    pub(crate) edges: Vec<Edge>,
    pub(crate) area: f64,
    pub(crate) low: [f64; 2],
    pub(crate) high: [f64; 2],
    pub(crate) bands: Bands,
    pub(crate) inside: Inside,
}

impl Flat {
    /// The upright rectangle between two corners, its boundary included.
    #[must_use]
    pub fn rectangle(low: [f64; 2], high: [f64; 2]) -> Self {
        let corners = [low, [high[0], low[1]], high, [low[0], high[1]]];
        let edges = ring(&corners);
        Self {
            bands: Bands::new(&edges),
            edges,
            area: (high[0] - low[0]) * (high[1] - low[1]),
            low,
            high,
            inside: Inside::Rectangle,
        }
    }

    /// The edges, the region on their left.
    #[must_use]
    pub fn edges(&self) -> &[Edge] {
        &self.edges
    }
}

/// The edges of a closed chain of corners.
pub(crate) fn ring(corners: &[[f64; 2]]) -> Vec<Edge> {
    let next = corners.iter().cycle().skip(1);
    corners
        .iter()
        .zip(next)
        .map(|(&from, &to)| Edge { from, to })
        .collect()
}

impl Window<2> for Flat {
    fn volume(&self) -> f64 {
        self.area
    }

    fn bounds(&self) -> [[f64; 2]; 2] {
        [self.low, self.high]
    }

    fn holds(&self, point: &[f64; 2]) -> bool {
        if (0..2).any(|a| !(self.low[a] <= point[a] && point[a] <= self.high[a])) {
            return false;
        }
        match &self.inside {
            Inside::Rectangle => true,
            Inside::Polygon => self.bands.crossings(&self.edges, point) % 2 == 1,
            Inside::Mask {
                shape,
                side,
                pixels,
                ..
            } => {
                let place = |a: usize| ((point[a] - self.low[a]) / side[a]).floor() as usize;
                let (i, j) = (place(0), place(1));
                i < shape[0] && pixels.get(j * shape[0] + i).copied().unwrap_or(false)
            }
        }
    }

    fn sides(&self) -> Option<[f64; 2]> {
        matches!(self.inside, Inside::Rectangle)
            .then(|| std::array::from_fn(|a| self.high[a] - self.low[a]))
    }

    fn overlap(&self, reach: f64, run: &dyn Run) -> Result<Overlap<2>, Failure> {
        crate::overlap::flat(self, reach, run)
    }

    fn pieces(&self, low: &[f64; 2], high: &[f64; 2], reach: f64) -> Vec<u32> {
        let mut pieces = self.bands.between(low[1] - reach, high[1] + reach);
        pieces.retain(|&piece| {
            let Edge { from, to } = self.edges[piece as usize];
            (0..2).all(|a| {
                from[a].min(to[a]) <= high[a] + reach && from[a].max(to[a]) >= low[a] - reach
            })
        });
        pieces
    }

    fn about(&self, point: &[f64; 2], pieces: &[u32], reach: f64, rim: &mut Rim) {
        rim.edges.clear();
        rim.distance = f64::INFINITY;
        rim.whole = TAU;
        let mut at_corner = false;
        for &piece in pieces {
            let seen = see(&self.edges[piece as usize], point);
            if seen.near < reach * reach {
                rim.distance = rim.distance.min(seen.near.sqrt());
                if seen.blind {
                    at_corner |= seen.near == 0.0;
                } else {
                    rim.edges.push(seen);
                }
            }
        }
        if at_corner {
            // The angle of the corner: the sum over all edges but those that meet there.
            let seen = self.edges.iter().map(|edge| see(edge, point));
            rim.whole = seen
                .map(|edge| edge.side * (edge.angles[1] - edge.angles[0]))
                .sum();
        }
    }

    fn share(&self, rim: &Rim, radius: f64) -> f64 {
        let mut angle = rim.whole;
        let square = radius * radius;
        for edge in rim.edges.iter().filter(|edge| edge.near < square) {
            let half = (square - edge.line * edge.line).max(0.0).sqrt();
            let [mut from, mut to] = edge.angles;
            if edge.ends[0] < -half || edge.ends[1] > half {
                let rim = if edge.line > 0.0 {
                    (edge.line / radius).min(1.0).acos()
                } else {
                    std::f64::consts::FRAC_PI_2
                };
                from = if edge.ends[0] < -half { -rim } else { from };
                to = if edge.ends[1] > half { rim } else { to };
            }
            angle -= edge.side * (to - from);
        }
        (angle / TAU).clamp(0.0, 1.0)
    }

    fn draw(&self, random: &mut dyn Random) -> [f64; 2] {
        if let Inside::Mask {
            shape, side, set, ..
        } = &self.inside
        {
            let pixel = set.get(random.below(set.len())).copied().unwrap_or(0) as usize;
            let place = [pixel % shape[0], pixel / shape[0]];
            return std::array::from_fn(|a| {
                self.low[a] + (place[a] as f64 + random.unit()) * side[a]
            });
        }
        loop {
            let point =
                std::array::from_fn(|a| self.low[a] + random.unit() * (self.high[a] - self.low[a]));
            if self.holds(&point) {
                return point;
            }
        }
    }

    fn tries(&self) -> f64 {
        match self.inside {
            Inside::Polygon => {
                (self.high[0] - self.low[0]) * (self.high[1] - self.low[1]) / self.area
            }
            _ => 1.0,
        }
    }

    fn describe(&self) -> String {
        let [x, y] = [0, 1].map(|a| self.high[a] - self.low[a]);
        match &self.inside {
            Inside::Rectangle => format!("rectangle of {x:.6} x {y:.6} nm"),
            Inside::Polygon => {
                format!(
                    "polygon of {} corners, {:.6e} nm^2",
                    self.edges.len(),
                    self.area
                )
            }
            Inside::Mask { set, .. } => {
                format!("mask of {} pixels, {:.6e} nm^2", set.len(), self.area)
            }
        }
    }
}

/// An edge as a point sees it. An edge that ends at the point is seen under no angle; one on whose
/// inner part the point lies, under pi.
fn see(edge: &Edge, point: &[f64; 2]) -> NearEdge {
    let (dx, dy) = (edge.to[0] - edge.from[0], edge.to[1] - edge.from[1]);
    let length = dx.hypot(dy);
    let (ux, uy) = (dx / length, dy / length);
    let (vx, vy) = (point[0] - edge.from[0], point[1] - edge.from[1]);
    let (along, across) = (vx * ux + vy * uy, ux * vy - uy * vx);
    let ends = [-along, length - along];
    let tiny = 1e-12 * (length + vx.abs() + vy.abs());
    let outside = ends[0].max(-ends[1]);
    let outside = if outside > tiny { outside } else { 0.0 };
    let (line, side) = if across.abs() <= tiny {
        (0.0, 1.0)
    } else {
        (across.abs(), across.signum())
    };
    let blind = line == 0.0 && (ends[0] >= -tiny || ends[1] <= tiny);
    let angles = if blind {
        [0.0; 2]
    } else {
        ends.map(|t| t.atan2(line))
    };
    NearEdge {
        near: outside * outside + line * line,
        line,
        side,
        ends,
        angles,
        blind,
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::polygon::polygon;
    use rand_chacha::ChaCha8Rng;
    use rand_chacha::rand_core::SeedableRng;

    /// The letter L: a square of side 900 without its upper right quarter.
    pub(crate) fn letter(shift: f64) -> Flat {
        let x = [0.0, 900.0, 900.0, 450.0, 450.0, 0.0].map(|x| x + shift);
        let y = [0.0, 0.0, 450.0, 450.0, 900.0, 900.0].map(|y| y + shift);
        polygon(&x, &y).expect("valid")
    }

    /// Share of a circle in a region, by many directions.
    fn many(region: &Flat, centre: &[f64; 2], radius: f64) -> f64 {
        let count = 20_000;
        let inside = (0..count).filter(|i| {
            let (sin, cos) = ((f64::from(*i) + 0.5) / f64::from(count) * TAU).sin_cos();
            region.holds(&[centre[0] + radius * cos, centre[1] + radius * sin])
        });
        inside.count() as f64 / f64::from(count)
    }

    pub(crate) fn shares_are_right(region: &Flat, cases: usize) {
        let mut random = ChaCha8Rng::seed_from_u64(3);
        let mut rim = Rim::default();
        let size = region.high[0] - region.low[0];
        for _ in 0..cases {
            let centre = region.draw(&mut random);
            let radius = size * (0.01 + 0.8 * random.unit());
            let pieces = region.pieces(&centre, &centre, size);
            region.about(&centre, &pieces, size, &mut rim);
            if rim.distance < radius {
                let (found, expected) = (region.share(&rim, radius), many(region, &centre, radius));
                assert!(
                    (found - expected).abs() < 1e-3,
                    "{centre:?} {radius} {found} {expected}"
                );
            } else {
                assert_eq!(many(region, &centre, radius.min(size)), 1.0);
            }
        }
    }

    #[test]
    fn shares_of_circles_are_those_of_many_directions() {
        shares_are_right(&Flat::rectangle([-5.0, 3.0], [35.0, 20.0]), 200);
        shares_are_right(&letter(0.0), 200);
        shares_are_right(&letter(1e7), 50);
        let x = [0.0, 10.0, 4.0, 12.0, -3.0, -1.0];
        let y = [0.0, 2.0, 5.0, 11.0, 9.0, 4.0];
        shares_are_right(&polygon(&x, &y).expect("valid"), 200);
    }

    #[test]
    fn points_on_edges_and_corners_see_their_angle() {
        let square = Flat::rectangle([0.0, 0.0], [10.0, 10.0]);
        let mut rim = Rim::default();
        let mut share = |region: &Flat, point: [f64; 2], radius: f64| {
            let pieces = region.pieces(&point, &point, 50.0);
            region.about(&point, &pieces, 50.0, &mut rim);
            assert_eq!(rim.distance, 0.0);
            region.share(&rim, radius)
        };
        assert!((share(&square, [0.0, 5.0], 1.0) - 0.5).abs() < 1e-12);
        for corner in [[0.0, 0.0], [10.0, 0.0], [10.0, 10.0], [0.0, 10.0]] {
            assert!(
                (share(&square, corner, 3.0) - 0.25).abs() < 1e-12,
                "{corner:?}"
            );
        }
        let angle = (10.0_f64 / 12.0).acos() / TAU;
        assert!((share(&square, [0.0, 0.0], 12.0) - (0.25 - 2.0 * angle)).abs() < 1e-12);
        let letter = letter(0.0);
        let inner = share(&letter, [450.0, 450.0], 10.0);
        assert!((inner - 0.75).abs() < 1e-12, "{inner}");
    }
}
