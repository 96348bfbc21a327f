//! A k-d tree: nearest neighbours, and the boxes that other searches prune by.

use puncta_sdk::run::map;
use puncta_sdk::{Cancelled, Run};
use std::ops::Range;

/// Most points of a leaf.
const LEAF: usize = 12;
/// Points of a task.
const CHUNK: usize = 1 << 12;

/// Points that a search found: square of the distance, and place.
pub type Found = Vec<(f64, u32)>;

/// A node; its first child follows it.
#[derive(Clone, Debug)]
pub struct Node<const D: usize> {
    /// Smallest position along each axis.
    pub low: [f64; D],
    /// Largest position along each axis.
    pub high: [f64; D],
    /// Its points.
    pub points: Range<usize>,
    /// Place of the second child; 0 in a leaf.
    pub second: usize,
}

/// Points in the order of a k-d tree.
#[derive(Clone, Debug)]
pub struct Tree<const D: usize> {
    /// Row of the table of each point.
    pub order: Vec<u32>,
    /// Position of each point.
    pub at: Vec<[f64; D]>,
    /// The root first; none if there are no points.
    pub nodes: Vec<Node<D>>,
}

/// Square of the distance between two positions.
#[inline]
#[must_use]
pub fn square<const D: usize>(a: &[f64; D], b: &[f64; D]) -> f64 {
    let mut sum = 0.0;
    for axis in 0..D {
        let d = a[axis] - b[axis];
        sum += d * d;
    }
    sum
}

impl<const D: usize> Node<D> {
    /// Square of the distance of a position from the box.
    #[inline]
    #[must_use]
    pub fn square(&self, from: &[f64; D]) -> f64 {
        let mut sum = 0.0;
        for (axis, from) in from.iter().enumerate() {
            let d = (self.low[axis] - from).max(from - self.high[axis]).max(0.0);
            sum += d * d;
        }
        sum
    }
}

impl<const D: usize> Tree<D> {
    /// The tree of the rows whose position is finite.
    ///
    /// # Errors
    /// When cancelled.
    pub fn new(columns: [&[f64]; D], run: &dyn Run) -> Result<Tree<D>, Cancelled> {
        run.progress(0.0, "building a tree")?;
        let position = |row: usize| -> [f64; D] { columns.map(|values| values[row]) };
        let finite = |row: &usize| position(*row).iter().all(|value| value.is_finite());
        #[allow(clippy::cast_possible_truncation)]
        let mut points: Vec<([f64; D], u32)> = (0..columns[0].len())
            .filter(finite)
            .map(|row| (position(row), row as u32))
            .collect();
        let mut nodes = Vec::new();
        if !points.is_empty() {
            split(&mut points, 0, &mut nodes, run)?;
        }
        let (at, order) = points.into_iter().unzip();
        Ok(Tree { order, at, nodes })
    }

    /// Number of points.
    #[must_use]
    pub fn len(&self) -> usize {
        self.at.len()
    }

    /// Whether there is no point.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.at.is_empty()
    }

    /// The `k` points nearest to a position as (square of the distance, place), nearest first, equal
    /// ones by row.
    pub fn nearest(&self, from: &[f64; D], k: usize, found: &mut Found) {
        found.clear();
        if k > 0 && !self.nodes.is_empty() {
            self.search(0, self.nodes[0].square(from), from, k, found);
        }
    }

    fn search(&self, node: usize, square_to: f64, from: &[f64; D], k: usize, found: &mut Found) {
        if found.len() == k && square_to > found[k - 1].0 {
            return;
        }
        let Node { points, second, .. } = &self.nodes[node];
        if *second == 0 {
            for point in points.clone() {
                #[allow(clippy::cast_possible_truncation)]
                let new = (square(from, &self.at[point]), point as u32);
                self.offer(new, k, found);
            }
            return;
        }
        let children = [node + 1, *second];
        let [a, b] = children.map(|child| self.nodes[child].square(from));
        let near = usize::from(b < a);
        self.search(children[near], a.min(b), from, k, found);
        self.search(children[1 - near], a.max(b), from, k, found);
    }

    #[inline]
    fn offer(&self, new: (f64, u32), k: usize, found: &mut Found) {
        let key = |pair: &(f64, u32)| (pair.0, self.order[pair.1 as usize]);
        let before = |a: &(f64, u32), b: &(f64, u32)| key(a) < key(b);
        if found.len() == k {
            if !before(&new, &found[k - 1]) {
                return;
            }
            found.pop();
        }
        let mut at = found.len();
        while at > 0 && before(&new, &found[at - 1]) {
            at -= 1;
        }
        found.insert(at, new);
    }

    /// Calls `value` for each point, on all threads.
    ///
    /// # Errors
    /// When cancelled.
    pub fn each<T: Send>(
        &self,
        run: &dyn Run,
        value: &(dyn Fn(usize, &mut Found) -> T + Sync),
    ) -> Result<Vec<T>, Cancelled> {
        let parts = map(run, self.len().div_ceil(CHUNK), &|chunk| {
            let mut found = Vec::new();
            let end = self.len().min((chunk + 1) * CHUNK);
            let mut out = Vec::with_capacity(CHUNK.min(end));
            for point in chunk * CHUNK..end {
                if point % 64 == 0 && run.cancelled() {
                    break;
                }
                out.push(value(point, &mut found));
            }
            out
        });
        if run.cancelled() {
            return Err(Cancelled);
        }
        Ok(parts.into_iter().flatten().collect())
    }
}

/// Adds the node of these points, which start at `first`, and those below it.
fn split<const D: usize>(
    points: &mut [([f64; D], u32)],
    first: usize,
    nodes: &mut Vec<Node<D>>,
    run: &dyn Run,
) -> Result<(), Cancelled> {
    let (mut low, mut high) = ([f64::INFINITY; D], [f64::NEG_INFINITY; D]);
    for (at, _) in points.iter() {
        for axis in 0..D {
            low[axis] = low[axis].min(at[axis]);
            high[axis] = high[axis].max(at[axis]);
        }
    }
    let here = nodes.len();
    nodes.push(Node {
        low,
        high,
        points: first..first + points.len(),
        second: 0,
    });
    if points.len() <= LEAF {
        return Ok(());
    }
    if points.len() > 1 << 14 && run.cancelled() {
        return Err(Cancelled);
    }
    let widest = (0..D).max_by(|a, b| (high[*a] - low[*a]).total_cmp(&(high[*b] - low[*b])));
    let axis = widest.unwrap_or(0);
    let middle = points.len() / 2;
    let key = |point: &([f64; D], u32)| (point.0[axis], point.1);
    points.select_nth_unstable_by(middle, |a, b| {
        let ((a, i), (b, j)) = (key(a), key(b));
        a.total_cmp(&b).then(i.cmp(&j))
    });
    let (left, right) = points.split_at_mut(middle);
    split(left, first, nodes, run)?;
    nodes[here].second = nodes.len();
    split(right, first + middle, nodes, run)
}
