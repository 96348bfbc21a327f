//! The density of localisations on the leaves of a balanced octree, and which side of the surface
//! each leaf is on.

use puncta_sdk::run::{Cancelled, Run, chunks_mut};
use puncta_shared_mesh::Groups;
use puncta_shared_octree::{NONE, Tree};

/// Nodes that a task works on.
pub const CHUNK: usize = 1 << 13;
/// A node has leaves outside.
pub const OUTSIDE: u8 = 1;
/// A node has leaves inside.
pub const INSIDE: u8 = 2;

/// Steps to the six neighbours: direction 2 a is down along axis a, 2 a + 1 up.
const STEPS: [[i32; 3]; 6] = [
    [-1, 0, 0],
    [1, 0, 0],
    [0, -1, 0],
    [0, 1, 0],
    [0, 0, -1],
    [0, 0, 1],
];

/// Values on the nodes of a tree.
pub struct Field<'t> {
    /// The tree, balanced.
    pub tree: &'t Tree,
    /// Localisations per nm^3 of each node, 0 at the border of the cube.
    pub values: Vec<f64>,
    /// The nodes beside each node: of its size, or a larger leaf; [`NONE`] at the border.
    pub beside: Vec<[u32; 6]>,
}

/// Calls `task` for each item with its number, in parallel.
pub fn each_mut<T: Send>(
    run: &dyn Run,
    items: &mut [T],
    task: &(dyn Fn(usize, &mut T) + Sync),
) -> Result<(), Cancelled> {
    chunks_mut(run, items, CHUNK, &|chunk, items| {
        if !run.cancelled() {
            for (i, item) in items.iter_mut().enumerate() {
                task(chunk * CHUNK + i, item);
            }
        }
    });
    if run.cancelled() {
        Err(Cancelled)
    } else {
        Ok(())
    }
}

impl<'t> Field<'t> {
    /// The densities, smoothed so many times: each pass gives a node half of its own density and a
    /// twelfth of that of each of its six neighbours.
    ///
    /// # Errors
    /// When cancelled.
    pub fn new(tree: &'t Tree, passes: u32, run: &dyn Run) -> Result<Field<'t>, Cancelled> {
        let nodes = tree.nodes();
        let mut beside = vec![[NONE; 6]; nodes.len()];
        each_mut(run, &mut beside, &|at, beside| {
            for (other, step) in beside.iter_mut().zip(STEPS) {
                *other = tree.neighbour(at as u32, step).unwrap_or(NONE);
            }
        })?;
        let at_border = |at: usize| nodes[at].is_leaf() && nodes[at].at_border();
        let mut values = vec![0.0; nodes.len()];
        each_mut(run, &mut values, &|at, value| {
            if !at_border(at) {
                let count = nodes[at].end - nodes[at].begin;
                *value = f64::from(count) / tree.size(at as u32).powi(3);
            }
        })?;
        for _ in 0..passes {
            let old = values.clone();
            each_mut(run, &mut values, &|at, value| {
                if !at_border(at) {
                    let near = beside[at].iter().filter(|other| **other != NONE);
                    let sum: f64 = near.map(|other| old[*other as usize]).sum();
                    *value = old[at] / 2.0 + sum / 12.0;
                }
            })?;
        }
        Ok(Field {
            tree,
            values,
            beside,
        })
    }

    /// The density at the leaf of a localisation, for each of some shares (0 to 1) of all
    /// localisations: so many have a lower one. NaN without localisations.
    #[must_use]
    pub fn quantiles<const N: usize>(&self, shares: [f64; N]) -> [f64; N] {
        let nodes = self.tree.nodes().iter().zip(&self.values);
        let mut leaves: Vec<(f64, u32)> = nodes
            .filter(|(node, _)| node.is_leaf() && node.end > node.begin)
            .map(|(node, value)| (*value, node.end - node.begin))
            .collect();
        leaves.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        let total: f64 = leaves.iter().map(|(_, count)| f64::from(*count)).sum();
        shares.map(|share| {
            let mut below = 0.0;
            let found = leaves.iter().find(|(_, count)| {
                below += f64::from(*count);
                below >= share * total
            });
            found.map_or(f64::NAN, |(value, _)| *value)
        })
    }

    /// The highest density of a leaf.
    #[must_use]
    pub fn highest(&self) -> f64 {
        let leaves = self.tree.nodes().iter().zip(&self.values);
        leaves
            .filter(|(node, _)| node.is_leaf())
            .fold(0.0, |most, (_, value)| value.max(most))
    }

    /// Which sides the leaves below each node lie on: inside at a density not below the threshold.
    /// With `fill`, hollows that are closed all round count as inside.
    ///
    /// # Errors
    /// When cancelled.
    pub fn sides(&self, threshold: f64, fill: bool, run: &dyn Run) -> Result<Vec<u8>, Cancelled> {
        let nodes = self.tree.nodes();
        let mut sides = vec![0; nodes.len()];
        each_mut(run, &mut sides, &|at, side| {
            if nodes[at].is_leaf() {
                let inside = self.values[at] >= threshold;
                *side = if inside { INSIDE } else { OUTSIDE };
            }
        })?;
        if fill {
            self.fill(&mut sides, run)?;
        }
        // Children come after their parent.
        for at in (0..nodes.len()).rev() {
            if !nodes[at].is_leaf() {
                let child = nodes[at].child as usize;
                sides[at] = sides[child..child + 8].iter().fold(0, |all, one| all | one);
            }
        }
        Ok(sides)
    }

    /// Puts leaves inside that no path through faces of leaves outside joins to the border.
    fn fill(&self, sides: &mut [u8], run: &dyn Run) -> Result<(), Cancelled> {
        let nodes = self.tree.nodes();
        let mut groups = Groups::new(nodes.len() + 1);
        let border = nodes.len() as u32;
        for (at, node) in nodes.iter().enumerate() {
            if at & 0xffff == 0 && run.cancelled() {
                return Err(Cancelled);
            }
            if sides[at] != OUTSIDE {
                continue;
            }
            for other in self.beside[at] {
                if other == NONE {
                    groups.join(at as u32, border);
                } else if nodes[other as usize].is_leaf() && sides[other as usize] == OUTSIDE {
                    groups.join(at as u32, other);
                }
            }
            debug_assert!(node.is_leaf());
        }
        let outside = groups.find(border);
        for (at, side) in sides.iter_mut().enumerate() {
            if *side == OUTSIDE && groups.find(at as u32) != outside {
                *side = INSIDE;
            }
        }
        Ok(())
    }
}
