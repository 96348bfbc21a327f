//! The leaves of an octree, in the order of their keys.

use crate::morton::{BITS, Key, decode, encode, span};
use crate::points::{Cube, Points};
use puncta_sdk::Failure;
use puncta_sdk::run::{Cancelled, Run, map};
use std::ops::Range;

/// When a cell is cut into eight.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limits {
    /// Cells with more points than this are cut.
    pub capacity: u32,
    /// Deepest level, at most 20; the cube is level 0.
    pub max_level: u32,
}

/// The leaves of an octree: cubes that fill the whole cube, those without points too.
///
/// Cells at the border of the cube are cut further until they hold no point, as far as the deepest
/// level allows, so that a field that follows the points falls to nothing before it leaves the cube.
#[derive(Clone, Debug)]
pub struct Octree {
    pub(crate) cube: Cube,
    pub(crate) keys: Vec<Key>,
    pub(crate) levels: Vec<u8>,
    /// Where each leaf's points start among the sorted points; one entry more than leaves.
    pub(crate) starts: Vec<u32>,
}

/// A cell whose points are known, while the octree is built.
#[derive(Clone)]
struct Cell {
    key: Key,
    level: u32,
    points: Range<u32>,
}

impl Cell {
    fn is_leaf(&self, limits: Limits) -> bool {
        let count = self.points.end - self.points.start;
        self.level >= limits.max_level.min(BITS)
            || count <= limits.capacity && (count == 0 || !self.at_border())
    }

    fn at_border(&self) -> bool {
        let size = 1u32 << (BITS - self.level);
        decode(self.key)
            .into_iter()
            .any(|x| x == 0 || x + size == 1 << BITS)
    }

    fn children(&self, keys: &[Key]) -> [Cell; 8] {
        let step = 1 << span(self.level + 1);
        let mut begin = self.points.start;
        std::array::from_fn(|child| {
            let key = self.key + child as u64 * step;
            let rest = keys.get(begin as usize..self.points.end as usize);
            let inside = rest
                .unwrap_or_default()
                .partition_point(|k| *k < key + step);
            let points = begin..begin + inside as u32;
            begin = points.end;
            Cell {
                key,
                level: self.level + 1,
                points,
            }
        })
    }
}

impl Octree {
    /// Cuts the cube about the points.
    ///
    /// # Errors
    /// When cancelled.
    pub fn new(points: &Points, limits: Limits, run: &dyn Run) -> Result<Octree, Failure> {
        let keys = points.keys();
        let root = Cell {
            key: 0,
            level: 0,
            points: 0..keys.len() as u32,
        };
        let tasks = tasks(root, keys, limits);
        let parts = map(run, tasks.len(), &|i| {
            let (mut leaves, mut stack) = (Vec::new(), vec![tasks[i].clone()]);
            while let Some(cell) = stack.pop() {
                if cell.is_leaf(limits) || leaves.len() & 0xfff == 0xfff && run.cancelled() {
                    leaves.push(cell);
                } else {
                    stack.extend(cell.children(keys).into_iter().rev());
                }
            }
            leaves
        });
        if run.cancelled() {
            return Err(Cancelled.into());
        }
        let count = parts.iter().map(Vec::len).sum::<usize>();
        let mut octree = Octree {
            cube: points.cube(),
            keys: Vec::with_capacity(count),
            levels: Vec::with_capacity(count),
            starts: Vec::with_capacity(count + 1),
        };
        for leaf in parts.into_iter().flatten() {
            octree.push(leaf.key, leaf.level, leaf.points.start);
        }
        octree.starts.push(keys.len() as u32);
        Ok(octree)
    }

    pub(crate) fn push(&mut self, key: Key, level: u32, start: u32) {
        self.keys.push(key);
        self.levels.push(level as u8);
        self.starts.push(start);
    }

    /// The cube.
    #[must_use]
    pub fn cube(&self) -> Cube {
        self.cube
    }

    /// Number of leaves, at least 1.
    #[must_use]
    pub fn len(&self) -> usize {
        self.keys.len()
    }

    /// Whether there is no leaf, which does not happen.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.keys.is_empty()
    }

    /// Key of a leaf's low corner.
    ///
    /// # Panics
    /// When there is no such leaf; so do the other functions that take a leaf's number.
    #[must_use]
    pub fn key(&self, leaf: usize) -> Key {
        self.keys[leaf]
    }

    /// Level of a leaf, 0 to 20.
    #[must_use]
    pub fn level(&self, leaf: usize) -> u32 {
        u32::from(self.levels[leaf])
    }

    /// Points of a leaf, as places among the sorted points.
    #[must_use]
    pub fn points(&self, leaf: usize) -> Range<usize> {
        self.starts[leaf] as usize..self.starts[leaf + 1] as usize
    }

    /// Number of a leaf's points.
    #[must_use]
    pub fn count(&self, leaf: usize) -> usize {
        self.points(leaf).len()
    }

    /// Side of a leaf, nm.
    #[must_use]
    pub fn size(&self, leaf: usize) -> f64 {
        self.cube.cell(self.level(leaf))
    }

    /// Centre of a leaf.
    #[must_use]
    pub fn centre(&self, leaf: usize) -> [f64; 3] {
        let (place, half) = (decode(self.key(leaf)), self.size(leaf) / 2.0);
        let unit = self.cube.cell(BITS);
        std::array::from_fn(|a| self.cube.low[a] + f64::from(place[a]) * unit + half)
    }

    /// Points per nm^3 of a leaf.
    #[must_use]
    pub fn density(&self, leaf: usize) -> f64 {
        self.count(leaf) as f64 / self.size(leaf).powi(3)
    }

    /// The leaf that holds a point; none outside the cube.
    #[must_use]
    pub fn leaf_at(&self, point: [f64; 3]) -> Option<usize> {
        let inside = (0..3).all(|a| {
            let x = point[a] - self.cube.low[a];
            x >= 0.0 && x < self.cube.side
        });
        let place = self.cube.place(point).filter(|_| inside)?;
        Some(self.leaf_of(encode(place)))
    }

    fn leaf_of(&self, key: Key) -> usize {
        self.keys.partition_point(|k| *k <= key).saturating_sub(1)
    }

    /// The leaves that touch the place of a leaf's neighbour of equal size, one step along each axis
    /// (-1, 0 or 1): one as large or larger, or all smaller ones inside. Empty outside the cube.
    #[must_use]
    pub fn neighbours(&self, leaf: usize, step: [i32; 3]) -> Range<usize> {
        let (place, level) = (decode(self.key(leaf)), self.level(leaf));
        match shifted(place, level, step) {
            None => 0..0,
            Some(place) => {
                let key = encode(place);
                let last = key + ((1 << span(level)) - 1);
                self.leaf_of(key)..self.leaf_of(last) + 1
            }
        }
    }

    /// The leaves as columns of a table.
    #[must_use]
    pub fn boxes(&self) -> Boxes {
        let mut boxes = Boxes::default();
        for leaf in 0..self.len() {
            for (axis, x) in boxes.centre.iter_mut().zip(self.centre(leaf)) {
                axis.push(x);
            }
            boxes.size.push(self.size(leaf));
            boxes.level.push(self.levels[leaf]);
            boxes.count.push(self.count(leaf) as u32);
            boxes.density.push(self.density(leaf));
        }
        boxes
    }
}

/// Leaves as columns.
#[derive(Clone, Debug, Default)]
pub struct Boxes {
    /// Centres along x, y, z, nm.
    pub centre: [Vec<f64>; 3],
    /// Sides, nm.
    pub size: Vec<f64>,
    /// Levels.
    pub level: Vec<u8>,
    /// Numbers of points.
    pub count: Vec<u32>,
    /// Points per nm^3.
    pub density: Vec<f64>,
}

/// A cell's place moved by steps of its size; none outside the cube.
pub(crate) fn shifted(place: [u32; 3], level: u32, step: [i32; 3]) -> Option<[u32; 3]> {
    let size = 1i64 << (BITS - level);
    let mut to = [0; 3];
    for axis in 0..3 {
        let x = i64::from(place[axis]) + i64::from(step[axis]) * size;
        if !(0..1 << BITS).contains(&x) {
            return None;
        }
        to[axis] = x as u32;
    }
    Some(to)
}

/// The cells of a few levels, in order: enough of them for all threads. Their number depends on the
/// points alone.
fn tasks(root: Cell, keys: &[Key], limits: Limits) -> Vec<Cell> {
    let large = (keys.len() / 256).max(4096) as u32;
    let mut tasks = vec![root];
    loop {
        let mut cut = false;
        let next = tasks.iter().flat_map(|cell| {
            if cell.is_leaf(limits) || cell.points.end - cell.points.start <= large {
                vec![cell.clone()]
            } else {
                cut = true;
                cell.children(keys).to_vec()
            }
        });
        tasks = next.collect();
        if !cut || tasks.len() > 4096 {
            return tasks;
        }
    }
}
