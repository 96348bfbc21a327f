//! Building the hierarchy: items are cut into up to eight parts, and those again.

use super::{Bounds, Frame, Node, WIDTH};
use crate::vector::{Point, add, area_vector, dot, frame, sub, unit};
use puncta_sdk::run::map;
use puncta_sdk::{Cancelled, Run};
use std::ops::Range;
use std::sync::{Mutex, PoisonError};

/// Most triangles of a leaf.
const LEAF: usize = 3;
/// Subtrees of at most this many triangles are built by one task.
const TASK: usize = 8192;
/// Bins of a split.
const BINS: usize = 16;
/// Parts of at most so many items are cut at the median.
const FEW: usize = 24;
/// More triangles than this have no normal in common.
const PIECE: usize = 1 << 14;

/// A box along the axes.
#[derive(Clone, Copy, Debug)]
pub(super) struct Box {
    pub low: Point,
    pub high: Point,
}

pub(super) const NOWHERE: Box = Box {
    low: [f64::INFINITY; 3],
    high: [f64::NEG_INFINITY; 3],
};

impl Box {
    #[inline]
    pub fn with(&mut self, other: &Box) {
        for axis in 0..3 {
            self.low[axis] = self.low[axis].min(other.low[axis]);
            self.high[axis] = self.high[axis].max(other.high[axis]);
        }
    }

    pub fn of(corners: &[Point; 3]) -> Box {
        let mut whole = NOWHERE;
        for &corner in corners {
            whole.with(&Box {
                low: corner,
                high: corner,
            });
        }
        whole
    }
}

/// A triangle while the tree is built.
#[derive(Clone, Copy)]
pub(super) struct Item {
    pub bounds: Box,
    pub number: u32,
}

impl Item {
    /// Twice the middle of its box.
    #[inline]
    fn middle(&self, axis: usize) -> f64 {
        self.bounds.low[axis] + self.bounds.high[axis]
    }
}

/// What a tree is built of: corners of triangles by number, and the frame of the boxes.
struct Source<'a> {
    corners: &'a (dyn Fn(usize) -> [Point; 3] + Sync),
    frame: &'a Frame,
}

impl Source<'_> {
    fn bounds(&self, items: &[Item]) -> Bounds {
        let corners = || {
            items
                .iter()
                .map(|item| (self.corners)(item.number as usize))
        };
        let mut axes = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        if items.len() <= PIECE {
            let normal = unit(corners().map(area_vector).fold([0.0; 3], add));
            if normal != [0.0; 3] {
                let [u, v] = frame(normal);
                axes = [normal, u, v];
            }
        }
        let mut bounds = Bounds {
            axes: axes.map(|axis| axis.map(|x| x as f32)),
            low: [f64::INFINITY; 3],
            high: [f64::NEG_INFINITY; 3],
        };
        let axes = bounds.axes.map(|axis| axis.map(f64::from));
        for corner in corners().flatten() {
            let corner = self.frame.place(corner);
            for (k, axis) in axes.iter().enumerate() {
                let along = dot(corner, *axis);
                bounds.low[k] = bounds.low[k].min(along);
                bounds.high[k] = bounds.high[k].max(along);
            }
        }
        bounds
    }
}

/// Items that are still to become a node, and the child that it will be; none for the root.
struct Pending {
    range: Range<usize>,
    child: Option<(u32, usize)>,
}

/// What a task makes: nodes that begin with its root, and the children of the root that are not
/// built yet.
#[derive(Default)]
struct Piece {
    nodes: Vec<Node>,
    open: Vec<(usize, Range<usize>)>,
}

/// Puts the items into the order of the leaves and gives the nodes; the root is node 0. Large parts
/// are cut level by level, all of a level in parallel; smaller ones whole, each by one task.
pub(super) fn build(
    items: &mut [Item],
    frame: &Frame,
    corners: &(dyn Fn(usize) -> [Point; 3] + Sync),
    run: &dyn Run,
) -> Result<Vec<Node>, Cancelled> {
    let source = Source { corners, frame };
    let mut nodes: Vec<Node> = Vec::new();
    let mut pending = Vec::new();
    if !items.is_empty() {
        pending.push(Pending {
            range: 0..items.len(),
            child: None,
        });
    }
    while !pending.is_empty() {
        let slices = parted(items, &pending);
        let pieces = map(run, pending.len(), &|i| {
            let mut piece = Piece::default();
            if !run.cancelled() {
                let mut slice = slices[i].lock().unwrap_or_else(PoisonError::into_inner);
                let begin = pending[i].range.start;
                if slice.len() > TASK {
                    let (node, open) = cut(&mut slice, begin, &source);
                    piece.nodes.push(node);
                    piece.open = open;
                } else {
                    subtree(&mut slice, begin, &source, &mut piece.nodes);
                }
            }
            piece
        });
        if run.cancelled() {
            return Err(Cancelled);
        }
        let mut next = Vec::new();
        for (parent, piece) in pending.iter().zip(pieces) {
            let root = nodes.len() as u32;
            if let Some((node, child)) = parent.child {
                nodes[node as usize].first[child] = root;
            }
            nodes.extend(piece.nodes.into_iter().map(|node| node.shifted(root)));
            next.extend(piece.open.into_iter().map(|(child, range)| Pending {
                range,
                child: Some((root, child)),
            }));
        }
        pending = next;
    }
    Ok(nodes)
}

/// The slices of ranges that follow one another.
fn parted<'a>(items: &'a mut [Item], pending: &[Pending]) -> Vec<Mutex<&'a mut [Item]>> {
    let mut slices = Vec::with_capacity(pending.len());
    let (mut rest, mut at) = (items, 0);
    for Pending { range, .. } in pending {
        let (_, from) = rest.split_at_mut(range.start - at);
        let (slice, more) = from.split_at_mut(range.len());
        slices.push(Mutex::new(slice));
        (rest, at) = (more, range.end);
    }
    slices
}

/// Builds the tree of a slice that begins at item `begin`; gives its root.
fn subtree(items: &mut [Item], begin: usize, source: &Source<'_>, nodes: &mut Vec<Node>) -> u32 {
    let place = nodes.len();
    let (node, open) = cut(items, begin, source);
    nodes.push(node);
    for (child, range) in open {
        let slice = &mut items[range.start - begin..range.end - begin];
        nodes[place].first[child] = subtree(slice, range.start, source, nodes);
    }
    place as u32
}

/// A node of items that begin at item `begin`, and those of its children that are no leaves.
fn cut(
    items: &mut [Item],
    begin: usize,
    source: &Source<'_>,
) -> (Node, Vec<(usize, Range<usize>)>) {
    let mut parts: Vec<Range<usize>> = Vec::with_capacity(WIDTH);
    if items.len() <= WIDTH {
        parts.extend((0..items.len()).map(|i| i..i + 1));
    } else {
        parts.push(0..items.len());
    }
    while parts.len() < WIDTH {
        let most = (0..parts.len()).max_by_key(|&i| (parts[i].len(), parts.len() - i));
        let Some(i) = most.filter(|&i| parts[i].len() > LEAF) else {
            break;
        };
        let part = parts[i].clone();
        let middle = part.start + divide(&mut items[part.clone()]);
        parts[i] = part.start..middle;
        parts.insert(i + 1, middle..part.end);
    }
    let mut node = Node::default();
    let mut open = Vec::new();
    for (child, part) in parts.into_iter().enumerate() {
        let bounds = source.bounds(&items[part.clone()]);
        let range = begin + part.start..begin + part.end;
        if part.len() <= LEAF {
            node.push(&bounds, source.frame, range.start as u32, part.len() as u8);
        } else {
            node.push(&bounds, source.frame, 0, 0);
            open.push((child, range));
        }
    }
    (node, open)
}

/// Parts items in two by the surface area heuristic over bins of the longest axis (Wald, 2007) and
/// gives where the second part begins: neither is empty. Items whose middles coincide are parted by
/// number.
fn divide(items: &mut [Item]) -> usize {
    let mut low = [f64::INFINITY; 3];
    let mut high = [f64::NEG_INFINITY; 3];
    for item in items.iter() {
        for axis in 0..3 {
            low[axis] = low[axis].min(item.middle(axis));
            high[axis] = high[axis].max(item.middle(axis));
        }
    }
    let width: Point = std::array::from_fn(|axis| high[axis] - low[axis]);
    let mut axis = 0;
    for other in 1..3 {
        if width[other] > width[axis] {
            axis = other;
        }
    }
    if items.len() > FEW && width[axis] > 0.0 {
        let (low, scale) = (low[axis], BINS as f64 / width[axis]);
        let bin = |item: &Item| (((item.middle(axis) - low) * scale) as usize).min(BINS - 1);
        if let Some(last) = sweep(items, bin) {
            let middle = part(items, |item| bin(item) <= last);
            // Not more than an eighth of the items aside, so that the tree stays shallow.
            if middle >= items.len() / 8 && middle <= items.len() - items.len() / 8 && middle > 0 {
                return middle;
            }
        }
    }
    let half = items.len() / 2;
    items.select_nth_unstable_by(half, |a, b| {
        let by_place = a.middle(axis).total_cmp(&b.middle(axis));
        by_place.then(a.number.cmp(&b.number))
    });
    half
}

/// The last bin of the first part of the best split.
fn sweep(items: &[Item], bin: impl Fn(&Item) -> usize) -> Option<usize> {
    let mut boxes = [NOWHERE; BINS];
    let mut counts = [0_usize; BINS];
    for item in items {
        let bin = bin(item);
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
    let mut best = (f64::INFINITY, None);
    for bin in 0..BINS - 1 {
        below.0.with(&boxes[bin]);
        below.1 += counts[bin];
        let (rest, more) = above[bin + 1];
        if below.1 == 0 || more == 0 {
            continue;
        }
        let cost = surface(&below.0) * below.1 as f64 + surface(&rest) * more as f64;
        if cost < best.0 {
            best = (cost, Some(bin));
        }
    }
    best.1
}

fn surface(bounds: &Box) -> f64 {
    let [x, y, z] = sub(bounds.high, bounds.low);
    x * y + y * z + z * x
}

/// Moves the items for which `first` holds before the others; gives their number.
fn part(items: &mut [Item], first: impl Fn(&Item) -> bool) -> usize {
    let (mut begin, mut end) = (0, items.len());
    while begin < end {
        if first(&items[begin]) {
            begin += 1;
        } else {
            end -= 1;
            items.swap(begin, end);
        }
    }
    begin
}
