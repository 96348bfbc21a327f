//! An octree with inner nodes.

use crate::linear::{Octree, shifted};
use crate::morton::{BITS, decode, encode};
use crate::points::{Cube, Points};
use puncta_sdk::run::{Cancelled, Run};

/// No child.
pub const NONE: u32 = u32::MAX;

/// A node: a cell of the octree.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Node {
    /// Coordinates of its low corner, in units of the finest cells.
    pub place: [u32; 3],
    /// Level; the root's is 0.
    pub level: u32,
    /// The first of eight children in the order of their keys, [`NONE`] of a leaf.
    pub child: u32,
    /// First of its points among the sorted points.
    pub begin: u32,
    /// End of its points.
    pub end: u32,
}

impl Node {
    /// Whether it has no children.
    #[must_use]
    #[inline]
    pub fn is_leaf(&self) -> bool {
        self.child == NONE
    }

    /// Whether it touches the border of the cube.
    #[must_use]
    pub fn at_border(&self) -> bool {
        let size = 1u32 << (BITS - self.level);
        self.place
            .into_iter()
            .any(|x| x == 0 || x + size == 1 << BITS)
    }
}

/// Nodes of an octree; the root is node 0.
#[derive(Clone, Debug)]
pub struct Tree {
    cube: Cube,
    nodes: Vec<Node>,
}

impl Tree {
    /// The nodes above an octree's leaves.
    #[must_use]
    pub fn new(octree: &Octree) -> Tree {
        let root = Node {
            place: [0; 3],
            level: 0,
            child: NONE,
            begin: 0,
            end: octree.starts.last().copied().unwrap_or(0),
        };
        let mut tree = Tree {
            cube: octree.cube,
            nodes: Vec::with_capacity(octree.len() + octree.len() / 7 + 1),
        };
        tree.nodes.push(root);
        // Leaves below each node, parallel to the nodes.
        let mut leaves = vec![(0, octree.len())];
        let mut i = 0;
        while i < tree.nodes.len() {
            let (node, (mut begin, end)) = (tree.nodes[i], leaves[i]);
            if end - begin > 1 {
                tree.nodes[i].child = tree.nodes.len() as u32;
                for child in children(node.place, node.level) {
                    let last = encode(child) + (1 << (3 * (BITS - node.level - 1)));
                    let below = octree.keys[begin..end].partition_point(|k| *k < last);
                    tree.nodes.push(Node {
                        place: child,
                        level: node.level + 1,
                        child: NONE,
                        begin: octree.starts[begin],
                        end: octree.starts[begin + below],
                    });
                    leaves.push((begin, begin + below));
                    begin += below;
                }
            }
            i += 1;
        }
        tree
    }

    /// The cube.
    #[must_use]
    pub fn cube(&self) -> Cube {
        self.cube
    }

    /// The nodes.
    #[must_use]
    pub fn nodes(&self) -> &[Node] {
        &self.nodes
    }

    /// Side of a node, nm.
    ///
    /// # Panics
    /// When there is no such node; so do the other functions that take a node's number.
    #[must_use]
    pub fn size(&self, node: u32) -> f64 {
        self.cube.cell(self.nodes[node as usize].level)
    }

    /// Centre of a node.
    #[must_use]
    #[inline]
    pub fn centre(&self, node: u32) -> [f64; 3] {
        let node = &self.nodes[node as usize];
        let (unit, half) = (self.cube.cell(BITS), self.cube.cell(node.level) / 2.0);
        std::array::from_fn(|a| self.cube.low[a] + f64::from(node.place[a]) * unit + half)
    }

    /// The smallest node, not below a level, that holds a place.
    #[must_use]
    #[inline]
    pub fn node_at(&self, place: [u32; 3], level: u32) -> u32 {
        let mut at = 0u32;
        loop {
            let node = &self.nodes[at as usize];
            if node.child == NONE || node.level >= level {
                return at;
            }
            let bit = BITS - 1 - node.level;
            let [x, y, z] = place.map(|x| x >> bit & 1);
            at = node.child + (x | y << 1 | z << 2);
        }
    }

    /// The node one step of its size along each axis (-1, 0 or 1), or the larger leaf that covers
    /// its place. None outside the cube.
    #[must_use]
    #[inline]
    pub fn neighbour(&self, node: u32, step: [i32; 3]) -> Option<u32> {
        let node = &self.nodes[node as usize];
        shifted(node.place, node.level, step).map(|place| self.node_at(place, node.level))
    }

    /// Cuts leaves until leaves that share a face, an edge or a corner differ by one level at most.
    /// New leaves get their own points.
    ///
    /// # Errors
    /// When cancelled.
    pub fn balance(&mut self, points: &Points, run: &dyn Run) -> Result<(), Cancelled> {
        // A node with children wants neighbours of its own size. Nodes that are cut on the way come
        // later in the list, or are looked at again.
        let mut again: Vec<u32> = Vec::new();
        let mut next = 0;
        loop {
            let at = match again.pop() {
                Some(at) => at,
                None if next < self.nodes.len() => {
                    next += 1;
                    next as u32 - 1
                }
                None => return Ok(()),
            };
            if at & 0x3fff == 0 && run.cancelled() {
                return Err(Cancelled);
            }
            let node = self.nodes[at as usize];
            if node.is_leaf() {
                continue;
            }
            for step in STEPS {
                let Some(place) = shifted(node.place, node.level, step) else {
                    continue;
                };
                loop {
                    let other = self.node_at(place, node.level);
                    if self.nodes[other as usize].level >= node.level {
                        break;
                    }
                    self.cut(other, points);
                    again.push(other);
                }
            }
        }
    }

    fn cut(&mut self, at: u32, points: &Points) {
        let node = self.nodes[at as usize];
        if !node.is_leaf() || node.level >= BITS {
            return;
        }
        self.nodes[at as usize].child = self.nodes.len() as u32;
        let mut begin = node.begin;
        for place in children(node.place, node.level) {
            let last = encode(place) + (1 << (3 * (BITS - node.level - 1)));
            let rest = points.keys().get(begin as usize..node.end as usize);
            let inside = rest.unwrap_or_default().partition_point(|k| *k < last);
            let end = begin + inside as u32;
            self.nodes.push(Node {
                place,
                level: node.level + 1,
                child: NONE,
                begin,
                end,
            });
            begin = end;
        }
    }

    /// The leaves alone.
    #[must_use]
    pub fn leaves(&self) -> Octree {
        let mut octree = Octree {
            cube: self.cube,
            keys: Vec::new(),
            levels: Vec::new(),
            starts: Vec::new(),
        };
        let mut stack = vec![0u32];
        while let Some(at) = stack.pop() {
            let node = &self.nodes[at as usize];
            if node.is_leaf() {
                octree.push(encode(node.place), node.level, node.begin);
            } else {
                stack.extend((node.child..node.child + 8).rev());
            }
        }
        octree.starts.push(self.nodes[0].end);
        octree
    }
}

/// The 26 neighbours.
const STEPS: [[i32; 3]; 26] = {
    let mut steps = [[0; 3]; 26];
    let (mut i, mut n) = (0, 0);
    while i < 27 {
        if i != 13 {
            steps[n] = [i % 3 - 1, i / 3 % 3 - 1, i / 9 - 1];
            n += 1;
        }
        i += 1;
    }
    steps
};

/// Low corners of the children of a cell, in the order of their keys.
fn children(place: [u32; 3], level: u32) -> [[u32; 3]; 8] {
    let half = 1u32 << (BITS - level - 1);
    debug_assert_eq!(decode(encode(place)), place);
    std::array::from_fn(|child| {
        std::array::from_fn(|axis| place[axis] + (child as u32 >> axis & 1) * half)
    })
}
