//! A hierarchy of bounding boxes over triangles, and nearest places by it.

use crate::blocks::by_item;
use crate::build::check_indices;
use crate::nearest::{Feature, on_triangle};
use crate::vector::{Point, finite, squared, sub};
use puncta_sdk::run::map;
use puncta_sdk::{Cancelled, Failure, Run};

/// Most triangles of a leaf.
const LEAF: usize = 4;
/// Subtrees of at most this many triangles are built by one task.
const TASK: usize = 8192;

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

#[derive(Clone, Copy, Debug)]
struct Box {
    low: Point,
    high: Point,
}

const NOWHERE: Box = Box {
    low: [f64::INFINITY; 3],
    high: [f64::NEG_INFINITY; 3],
};

/// An inner node: boxes of both children and where they are. A child with `count` > 0 is a leaf of
/// that many triangles from `first`.
#[derive(Clone, Copy, Debug)]
struct Node {
    boxes: [Box; 2],
    first: [u32; 2],
    count: [u32; 2],
}

/// Triangles in a hierarchy of bounding boxes, for nearest places. It holds copies of their
/// corners; it does not depend on the number of threads that build it.
#[derive(Clone, Debug)]
pub struct Bvh {
    nodes: Vec<Node>,
    corners: Vec<[Point; 3]>,
    numbers: Vec<u32>,
}

impl Box {
    #[inline]
    fn with(&mut self, other: &Box) {
        for axis in 0..3 {
            self.low[axis] = self.low[axis].min(other.low[axis]);
            self.high[axis] = self.high[axis].max(other.high[axis]);
        }
    }

    fn of(corners: &[Point; 3]) -> Box {
        let mut whole = NOWHERE;
        for &corner in corners {
            whole.with(&Box {
                low: corner,
                high: corner,
            });
        }
        whole
    }

    /// Squared distance from a point, 0 inside.
    #[inline]
    fn squared(&self, p: Point) -> f64 {
        let mut sum = 0.0;
        for ((low, high), x) in self.low.iter().zip(&self.high).zip(p) {
            let out = (low - x).max(x - high).max(0.0);
            sum += out * out;
        }
        sum
    }
}

/// A triangle while the tree is built.
#[derive(Clone, Copy)]
struct Item {
    bounds: Box,
    number: u32,
}

impl Item {
    /// Twice the middle of its box.
    #[inline]
    fn middle(&self, axis: usize) -> f64 {
        self.bounds.low[axis] + self.bounds.high[axis]
    }
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
        let nodes = build(&mut items, run)?;
        let numbers: Vec<u32> = items.iter().map(|item| item.number).collect();
        let corners = numbers.iter().map(|&i| corners_of(i as usize)).collect();
        Ok(Bvh {
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
        self.nearest_from(p, f64::INFINITY)
    }

    /// As [`Bvh::nearest`], but only places at a squared distance of at most `limit`.
    #[must_use]
    pub fn nearest_from(&self, p: Point, limit: f64) -> Option<Nearest> {
        if self.is_empty() || !finite(p) {
            return None;
        }
        let mut best = Nearest {
            squared: limit,
            place: p,
            triangle: u32::MAX,
            feature: Feature::Face,
        };
        let mut stack = [(0.0, 0_u32); 192];
        let mut depth = 1;
        while depth > 0 {
            depth -= 1;
            let (bound, node) = stack[depth];
            if bound > best.squared {
                continue;
            }
            let node = &self.nodes[node as usize];
            let bounds = [node.boxes[0].squared(p), node.boxes[1].squared(p)];
            // The nearer child last, so that it is looked at first.
            let far = usize::from(bounds[0] <= bounds[1]);
            for child in [far, 1 - far] {
                if node.count[child] == 0 && bounds[child] <= best.squared {
                    // A tree of less than 2^32 triangles is never so deep that this is full.
                    if let Some(slot) = stack.get_mut(depth) {
                        *slot = (bounds[child], node.first[child]);
                        depth += 1;
                    }
                }
            }
            for child in [1 - far, far] {
                if node.count[child] > 0 && bounds[child] <= best.squared {
                    self.leaf(p, node.first[child], node.count[child], &mut best);
                }
            }
        }
        (best.triangle != u32::MAX).then_some(best)
    }

    #[inline]
    fn leaf(&self, p: Point, first: u32, count: u32, best: &mut Nearest) {
        for i in first as usize..(first + count) as usize {
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
            }
        }
    }

    /// [`Bvh::nearest`] of many points, in parallel.
    ///
    /// # Errors
    /// When cancelled.
    pub fn nearest_all(
        &self,
        points: [&[f64]; 3],
        run: &dyn Run,
    ) -> Result<Vec<Option<Nearest>>, Cancelled> {
        let count = points.iter().map(|axis| axis.len()).min().unwrap_or(0);
        by_item(run, count, |i| self.nearest(points.map(|axis| axis[i])))
    }
}

/// A subtree that is still to be built: items, and the child slot of the node that it hangs on.
struct Pending {
    begin: usize,
    end: usize,
    slot: Option<(u32, usize)>,
}

/// Sorts the items into leaves and gives the nodes; the root is node 0. Large ranges are split one
/// after the other, those of at most `TASK` items in parallel.
fn build(items: &mut [Item], run: &dyn Run) -> Result<Vec<Node>, Cancelled> {
    let mut nodes = Vec::new();
    if items.is_empty() {
        return Ok(nodes);
    }
    let mut small = Vec::new();
    let mut stack = vec![Pending {
        begin: 0,
        end: items.len(),
        slot: None,
    }];
    while let Some(Pending { begin, end, slot }) = stack.pop() {
        if end - begin <= TASK {
            small.push(Pending { begin, end, slot });
            continue;
        }
        if run.cancelled() {
            return Err(Cancelled);
        }
        let middle = begin + divide(&mut items[begin..end]);
        let node = inner(&mut nodes, &items[begin..end], middle - begin);
        connect(&mut nodes, slot, node);
        for (side, range) in [(begin, middle), (middle, end)].into_iter().enumerate() {
            stack.push(Pending {
                begin: range.0,
                end: range.1,
                slot: Some((node, side)),
            });
        }
    }
    small.sort_by_key(|pending| pending.begin);
    let trees = {
        let mut slices = Vec::new();
        let mut rest = items;
        for pending in &small {
            let (slice, more) = rest.split_at_mut(pending.end - pending.begin);
            slices.push(std::sync::Mutex::new(slice));
            rest = more;
        }
        map(run, small.len(), &|i| {
            let mut slice = slices[i]
                .lock()
                .unwrap_or_else(std::sync::PoisonError::into_inner);
            let mut tree = Vec::new();
            let begin = small[i].begin as u32;
            let bounds = subtree(&mut slice, begin, &mut tree);
            (tree, bounds)
        })
    };
    if run.cancelled() {
        return Err(Cancelled);
    }
    for (pending, (tree, _)) in small.iter().zip(trees) {
        let shift = nodes.len() as u32;
        connect(&mut nodes, pending.slot, shift);
        nodes.extend(tree.into_iter().map(|mut node: Node| {
            for side in 0..2 {
                if node.count[side] == 0 {
                    node.first[side] += shift;
                }
            }
            node
        }));
    }
    Ok(nodes)
}

fn connect(nodes: &mut [Node], slot: Option<(u32, usize)>, child: u32) {
    if let Some((parent, side)) = slot {
        nodes[parent as usize].first[side] = child;
    }
}

fn bounds(items: &[Item]) -> Box {
    let mut whole = NOWHERE;
    items.iter().for_each(|item| whole.with(&item.bounds));
    whole
}

fn inner(nodes: &mut Vec<Node>, items: &[Item], middle: usize) -> u32 {
    nodes.push(Node {
        boxes: [bounds(&items[..middle]), bounds(&items[middle..])],
        first: [0; 2],
        count: [0; 2],
    });
    nodes.len() as u32 - 1
}

/// Builds the tree of a slice that begins at item `begin`; its root is the first node. A slice that
/// fits a leaf gets a root with that leaf and an empty one.
fn subtree(items: &mut [Item], begin: u32, nodes: &mut Vec<Node>) -> u32 {
    let place = nodes.len() as u32;
    if items.len() <= LEAF {
        nodes.push(Node {
            boxes: [bounds(items), NOWHERE],
            first: [begin; 2],
            count: [items.len() as u32, 0],
        });
        return place;
    }
    let middle = divide(items);
    inner(nodes, items, middle);
    let (left, right) = items.split_at_mut(middle);
    let halves = [(left, begin), (right, begin + middle as u32)];
    for (side, (half, begin)) in halves.into_iter().enumerate() {
        let count = half.len();
        let (first, count) = if count <= LEAF {
            half.sort_unstable_by_key(|item| item.number);
            (begin, count as u32)
        } else {
            (subtree(half, begin, nodes), 0)
        };
        nodes[place as usize].first[side] = first;
        nodes[place as usize].count[side] = count;
    }
    place
}

/// Bins of a split.
const BINS: usize = 16;

/// Parts items in two by the surface area heuristic over bins (Wald, 2007) and gives where the
/// second part begins: neither is empty. Items whose middles coincide are parted by number.
fn divide(items: &mut [Item]) -> usize {
    let mut low = [f64::INFINITY; 3];
    let mut high = [f64::NEG_INFINITY; 3];
    for item in items.iter() {
        for axis in 0..3 {
            low[axis] = low[axis].min(item.middle(axis));
            high[axis] = high[axis].max(item.middle(axis));
        }
    }
    let width = |axis: usize| high[axis] - low[axis];
    let mut best = (f64::INFINITY, 0, 0);
    for axis in (0..3).filter(|&axis| width(axis) > 0.0) {
        let (cost, bin) = sweep(items, axis, low[axis], width(axis));
        if cost < best.0 {
            best = (cost, axis, bin);
        }
    }
    let (cost, axis, bin) = best;
    let half = items.len() / 2;
    if cost.is_finite() {
        let middle = part(items, |item| {
            place(item, axis, low[axis], width(axis)) <= bin
        });
        // Not more than an eighth of the items aside, so that the tree stays shallow.
        if middle >= items.len() / 8 && middle <= items.len() - items.len() / 8 && middle > 0 {
            return middle;
        }
    }
    let key = |item: &Item| (item.middle(axis), item.number);
    items.select_nth_unstable_by(half, |a, b| {
        let ((a, i), (b, j)) = (key(a), key(b));
        a.total_cmp(&b).then(i.cmp(&j))
    });
    half
}

#[inline]
fn place(item: &Item, axis: usize, low: f64, width: f64) -> usize {
    (((item.middle(axis) - low) / width * BINS as f64) as usize).min(BINS - 1)
}

/// Cost of the best split along an axis and the last bin of its first part.
fn sweep(items: &[Item], axis: usize, low: f64, width: f64) -> (f64, usize) {
    let mut boxes = [NOWHERE; BINS];
    let mut counts = [0_usize; BINS];
    for item in items {
        let bin = place(item, axis, low, width);
        boxes[bin].with(&item.bounds);
        counts[bin] += 1;
    }
    let mut above = [(NOWHERE, 0); BINS];
    let mut running = (NOWHERE, 0);
    for bin in (0..BINS).rev() {
        running.0.with(&boxes[bin]);
        running.1 += counts[bin];
        above[bin] = running;
    }
    let mut below = (NOWHERE, 0);
    let mut best = (f64::INFINITY, 0);
    for bin in 0..BINS - 1 {
        below.0.with(&boxes[bin]);
        below.1 += counts[bin];
        let (rest, more) = above[bin + 1];
        if below.1 == 0 || more == 0 {
            continue;
        }
        let cost = surface(&below.0) * below.1 as f64 + surface(&rest) * more as f64;
        if cost < best.0 {
            best = (cost, bin);
        }
    }
    best
}

fn surface(bounds: &Box) -> f64 {
    let [x, y, z] = sub(bounds.high, bounds.low);
    x * y + y * z + z * x
}

/// Moves the items for which `first` holds before the others, in their order; gives their number.
fn part(items: &mut [Item], first: impl Fn(&Item) -> bool) -> usize {
    let others: Vec<Item> = items.iter().filter(|item| !first(item)).copied().collect();
    let mut kept = 0;
    for i in 0..items.len() {
        if first(&items[i]) {
            items[kept] = items[i];
            kept += 1;
        }
    }
    items[kept..].copy_from_slice(&others);
    kept
}
