//! A hierarchy of bounding boxes over triangles, and nearest places by it.

mod tree;

use crate::blocks::by_item;
use crate::build::check_indices;
use crate::nearest::{Feature, on_triangle};
use crate::vector::{Point, finite, squared, sub};
use puncta_sdk::{Failure, Run};
use tree::{Box, Item, NOWHERE, build};
use wide::f32x8;

/// Children of a node: as many boxes as are measured at once.
const WIDTH: usize = 8;

/// The place of a mesh that is nearest to a point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Nearest {
    /// Distance squared.
    pub squared: f64,
    /// The place.
    pub place: Point,
    /// Number of its triangle: the lowest of several at the same distance.
    pub triangle: u32,
    /// Part of the triangle that it lies on.
    pub feature: Feature,
}

/// Boxes are kept in single precision, rounded outwards, as shares of half the longest side of all
/// from its middle, so that no magnitude of the coordinates overflows.
#[derive(Clone, Copy, Debug)]
struct Frame {
    origin: Point,
    scale: f64,
    /// By how much boxes are widened, for the rounding of distances.
    slack: f64,
}

/// Relative error of rounding to single precision and some more.
const ROUNDING: f64 = 2e-7;
/// The highest square of a distance that is told from higher ones.
const FAR: f32 = 1e37;

impl Frame {
    fn of(whole: &Box) -> Frame {
        let side = sub(whole.high, whole.low).into_iter().fold(0.0, f64::max);
        let scale = if side > 0.0 {
            (2.0 / side).min(1e300)
        } else {
            1.0
        };
        let corners = whole.low.into_iter().chain(whole.high);
        let largest = corners.fold(0.0, |most: f64, x| most.max(x.abs()));
        Frame {
            origin: std::array::from_fn(|axis| whole.low[axis] / 2.0 + whole.high[axis] / 2.0),
            scale,
            slack: (ROUNDING + 8.0 * f64::EPSILON * largest * scale).min(1e30),
        }
    }

    /// A place in this frame.
    #[inline]
    fn place(&self, p: Point) -> Point {
        std::array::from_fn(|axis| {
            let x = (p[axis] - self.origin[axis]) * self.scale;
            // NaN: the side of all is infinite, and all boxes are one.
            if x.is_nan() {
                0.0
            } else {
                x.clamp(-1e30, 1e30)
            }
        })
    }

    /// A number of this frame, rounded down and up.
    #[inline]
    fn around(&self, x: f64) -> [f32; 2] {
        let error = x.abs() * ROUNDING + self.slack;
        [(x - error) as f32, (x + error) as f32]
    }

    /// A squared distance, rounded up.
    #[inline]
    fn limit(&self, squared: f64) -> f32 {
        let scaled = squared * self.scale * self.scale * (1.0 + 1e-5) + 1e-37;
        if scaled.is_nan() {
            f32::INFINITY
        } else {
            scaled as f32
        }
    }
}

/// A box about triangles, turned so that one of its axes is their mean normal: it fits a piece of a
/// surface far closer than a box along x, y and z, which matters for points away from the surface.
struct Bounds {
    axes: [[f32; 3]; 3],
    /// Extent along each axis.
    low: Point,
    high: Point,
}

/// Boxes of up to eight children and where they are. A child with `count` > 0 is a leaf of that many
/// triangles from `first`.
#[derive(Clone, Copy, Debug, Default)]
struct Node {
    axes: [[[f32; WIDTH]; 3]; 3],
    low: [[f32; WIDTH]; 3],
    high: [[f32; WIDTH]; 3],
    first: [u32; WIDTH],
    count: [u8; WIDTH],
    children: u8,
}

/// A place in single precision, and the error of its product with a unit vector.
struct Place {
    at: [f32; 3],
    error: f32,
}

impl Place {
    fn new(p: Point, frame: &Frame) -> Place {
        let p = frame.place(p);
        Place {
            at: p.map(|x| x as f32),
            error: (p.iter().map(|x| x.abs()).sum::<f64>() * 4.0 * ROUNDING) as f32,
        }
    }
}

impl Node {
    /// Adds a child to fewer than eight.
    fn push(&mut self, bounds: &Bounds, frame: &Frame, first: u32, count: u8) {
        let child = usize::from(self.children);
        for k in 0..3 {
            for axis in 0..3 {
                self.axes[k][axis][child] = bounds.axes[k][axis];
            }
            self.low[k][child] = frame.around(bounds.low[k])[0];
            self.high[k][child] = frame.around(bounds.high[k])[1];
        }
        self.first[child] = first;
        self.count[child] = count;
        self.children += 1;
    }

    /// The node with its inner children `by` further on.
    fn shifted(mut self, by: u32) -> Node {
        for child in 0..usize::from(self.children) {
            if self.count[child] == 0 {
                self.first[child] += by;
            }
        }
        self
    }

    /// Squared distances of the children's boxes: none is higher than it is.
    #[inline]
    fn squared(&self, place: &Place) -> [f32; WIDTH] {
        let nothing = f32x8::splat(0.0);
        let (at, error) = (place.at.map(f32x8::splat), f32x8::splat(place.error));
        let mut sum = nothing;
        for k in 0..3 {
            let [x, y, z] = self.axes[k].map(f32x8::new);
            let along = x * at[0] + y * at[1] + z * at[2];
            let (below, above) = (
                f32x8::new(self.low[k]) - along,
                along - f32x8::new(self.high[k]),
            );
            let out = (below.fast_max(above) - error).fast_max(nothing);
            sum += out * out;
        }
        // The axes are orthonormal but for their rounding.
        let sum = sum * f32x8::splat(1.0 - 4e-6);
        sum.fast_min(f32x8::splat(FAR)).to_array()
    }
}

/// A child that is still to be looked at.
#[derive(Clone, Copy)]
struct Visit {
    squared: f32,
    first: u32,
    count: u8,
}

/// Triangles in a hierarchy of bounding boxes, for nearest places. It holds copies of their
/// corners; it does not depend on the number of threads that build it.
#[derive(Clone, Debug)]
pub struct Bvh {
    frame: Frame,
    nodes: Vec<Node>,
    corners: Vec<[Point; 3]>,
    numbers: Vec<u32>,
}

impl Bvh {
    /// Sorts triangles into boxes. Triangles with a corner that is no finite place are left out.
    ///
    /// # Errors
    /// When a triangle names a vertex that does not exist; or cancelled.
    pub fn new(positions: &[Point], triangles: &[[u32; 3]], run: &dyn Run) -> Result<Bvh, Failure> {
        check_indices(positions.len(), triangles)?;
        let corners_of = |i: usize| triangles[i].map(|v| positions[v as usize]);
        let items = by_item(run, triangles.len(), |i| {
            let corners = corners_of(i);
            corners.iter().all(|c| finite(*c)).then(|| Item {
                bounds: Box::of(&corners),
                number: i as u32,
            })
        })?;
        let mut items: Vec<Item> = items.into_iter().flatten().collect();
        let mut whole = NOWHERE;
        items.iter().for_each(|item| whole.with(&item.bounds));
        let frame = Frame::of(&whole);
        let nodes = build(&mut items, &frame, &corners_of, run)?;
        let numbers: Vec<u32> = items.iter().map(|item| item.number).collect();
        let corners = by_item(run, numbers.len(), |i| corners_of(numbers[i] as usize))?;
        Ok(Bvh {
            frame,
            nodes,
            corners,
            numbers,
        })
    }

    /// Number of triangles.
    #[must_use]
    pub fn len(&self) -> usize {
        self.numbers.len()
    }

    /// Whether there is no triangle.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.numbers.is_empty()
    }

    /// The place nearest to `p`. `None` if there is no triangle, or `p` is no finite place.
    #[must_use]
    pub fn nearest(&self, p: Point) -> Option<Nearest> {
        let mut hint = u32::MAX;
        self.nearest_by(p, &mut hint)
    }

    /// As [`Bvh::nearest`], and faster if the nearest triangle of a point close by is known: `hint`
    /// holds what an earlier call left there, or any number.
    #[must_use]
    pub fn nearest_by(&self, p: Point, hint: &mut u32) -> Option<Nearest> {
        if self.is_empty() || !finite(p) {
            return None;
        }
        let mut best = Nearest {
            squared: f64::INFINITY,
            place: p,
            triangle: u32::MAX,
            feature: Feature::Face,
        };
        if (*hint as usize) < self.corners.len() {
            self.leaf(p, *hint, 1, &mut best, hint);
        }
        self.search(p, &mut best, hint);
        (best.triangle != u32::MAX).then_some(best)
    }

    fn search(&self, p: Point, best: &mut Nearest, at: &mut u32) {
        let place = Place::new(p, &self.frame);
        let mut limit = self.frame.limit(best.squared);
        let mut stack = Vec::with_capacity(64);
        stack.push(Visit {
            squared: 0.0,
            first: 0,
            count: 0,
        });
        while let Some(visit) = stack.pop() {
            if visit.squared > limit {
                continue;
            }
            if visit.count > 0 {
                self.leaf(p, visit.first, visit.count, best, at);
                limit = self.frame.limit(best.squared);
                continue;
            }
            let node = &self.nodes[visit.first as usize];
            let squares = node.squared(&place);
            let begin = stack.len();
            let children = usize::from(node.children);
            let near = squares.iter().zip(node.first.iter().zip(&node.count));
            for (squared, (first, count)) in near.take(children) {
                if *squared <= limit {
                    stack.push(Visit {
                        squared: *squared,
                        first: *first,
                        count: *count,
                    });
                }
            }
            // The nearest last, so that it is looked at first.
            farthest_first(&mut stack[begin..]);
        }
    }

    #[inline]
    fn leaf(&self, p: Point, first: u32, count: u8, best: &mut Nearest, at: &mut u32) {
        for i in first as usize..first as usize + usize::from(count) {
            let (place, feature) = on_triangle(p, self.corners[i]);
            let squared = squared(sub(p, place));
            let number = self.numbers[i];
            if squared < best.squared || (squared == best.squared && number < best.triangle) {
                *best = Nearest {
                    squared,
                    place,
                    triangle: number,
                    feature,
                };
                *at = i as u32;
            }
        }
    }
}

/// Sorts at most eight.
#[inline]
fn farthest_first(visits: &mut [Visit]) {
    for i in 1..visits.len() {
        let visit = visits[i];
        let mut to = i;
        while to > 0 && visits[to - 1].squared < visit.squared {
            visits[to] = visits[to - 1];
            to -= 1;
        }
        visits[to] = visit;
    }
}
