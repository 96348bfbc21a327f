//! The minimum spanning tree of mutual reachability distances, by Boruvka's rounds on a k-d tree.
//!
//! The core distance of a point is that to its `min_samples`-th neighbour, itself included
//! (Campello, Moulavi and Sander, PAKDD 2013, definition 1); the mutual reachability distance of two
//! points is the largest of their distance and their core distances. In each round every component
//! finds its shortest edge to another; equal ones by the rows of their ends, so that the tree does
//! not depend on threads.

use crate::tree::{Node, Tree, square};
use crate::union::Union;
use puncta_sdk::{Cancelled, Run};
use std::sync::atomic::{AtomicU64, Ordering};

/// Not a component.
const MIXED: u32 = u32::MAX;

/// An edge between two points of a tree.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Edge {
    /// Square of the mutual reachability distance.
    pub square: f64,
    /// One end.
    pub from: u32,
    /// The other.
    pub to: u32,
}

/// Squares of the core distances.
///
/// # Errors
/// When cancelled.
pub fn core_squares<const D: usize>(
    tree: &Tree<D>,
    min_samples: usize,
    run: &dyn Run,
) -> Result<Vec<f64>, Cancelled> {
    let k = min_samples.min(tree.len());
    tree.each(run, &|point, found| {
        tree.nearest(&tree.at[point], k, found);
        found.last().map_or(0.0, |pair| pair.0)
    })
}

/// The edges of the minimum spanning tree, shortest first, equal ones by rows.
///
/// # Errors
/// When cancelled.
pub fn spanning_tree<const D: usize>(
    tree: &Tree<D>,
    core: &[f64],
    run: &dyn Run,
) -> Result<Vec<Edge>, Cancelled> {
    let count = tree.len();
    let union = Union::new(count);
    let mut edges: Vec<Edge> = Vec::with_capacity(count);
    let mut search = Search {
        tree,
        core,
        least_core: least_core(tree, core),
        component: vec![0; count],
        of_node: vec![MIXED; tree.nodes.len()],
        bounds: (0..count)
            .map(|_| AtomicU64::new(f64::INFINITY.to_bits()))
            .collect(),
    };
    while edges.len() + 1 < count {
        run.progress(
            edges.len() as f64 / count as f64,
            "joining nearest components",
        )?;
        search.label(&union);
        let found = tree.each(run, &|point, _| search.shortest(point))?;
        let mut best: Vec<Option<Edge>> = vec![None; count];
        for edge in found.into_iter().flatten() {
            let slot = &mut best[search.component[edge.from as usize] as usize];
            if slot.is_none_or(|best| search.key(&edge) < search.key(&best)) {
                *slot = Some(edge);
            }
        }
        for edge in best.into_iter().flatten() {
            let ends = [edge.from as usize, edge.to as usize];
            // Two components may have chosen the same edge.
            if !union.joined(ends[0], ends[1]) {
                union.join(ends[0], ends[1]);
                edges.push(edge);
            }
        }
    }
    let mut keyed: Vec<_> = edges
        .into_iter()
        .map(|edge| (search.key(&edge), edge))
        .collect();
    keyed.sort_unstable_by(|(a, _), (b, _)| a.0.total_cmp(&b.0).then((a.1, a.2).cmp(&(b.1, b.2))));
    Ok(keyed.into_iter().map(|(_, edge)| edge).collect())
}

struct Search<'a, const D: usize> {
    tree: &'a Tree<D>,
    core: &'a [f64],
    /// Smallest core distance of each node.
    least_core: Vec<f64>,
    component: Vec<u32>,
    /// Component of all points of a node, if it is one.
    of_node: Vec<u32>,
    /// Square of the shortest edge of a component that any thread has seen, as bits.
    bounds: Vec<AtomicU64>,
}

fn least_core<const D: usize>(tree: &Tree<D>, core: &[f64]) -> Vec<f64> {
    let mut least = vec![0.0; tree.nodes.len()];
    for (place, Node { points, second, .. }) in tree.nodes.iter().enumerate().rev() {
        least[place] = if *second == 0 {
            core[points.clone()]
                .iter()
                .copied()
                .fold(f64::INFINITY, f64::min)
        } else {
            f64::min(least[place + 1], least[*second])
        };
    }
    least
}

impl<const D: usize> Search<'_, D> {
    /// Edges in the order in which they are preferred.
    fn key(&self, edge: &Edge) -> (f64, u32, u32) {
        let row = |point: u32| self.tree.order[point as usize];
        let (a, b) = (row(edge.from), row(edge.to));
        (edge.square, a.min(b), a.max(b))
    }

    /// Takes over the components of `union`.
    fn label(&mut self, union: &Union) {
        for (point, component) in self.component.iter_mut().enumerate() {
            #[allow(clippy::cast_possible_truncation)]
            let root = union.root(point) as u32;
            *component = root;
        }
        for (place, Node { points, second, .. }) in self.tree.nodes.iter().enumerate().rev() {
            self.of_node[place] = if *second == 0 {
                let first = self.component[points.start];
                let same = self.component[points.clone()]
                    .iter()
                    .all(|other| *other == first);
                if same { first } else { MIXED }
            } else {
                let (a, b) = (self.of_node[place + 1], self.of_node[*second]);
                if a == b { a } else { MIXED }
            };
        }
        for bound in &self.bounds {
            bound.store(f64::INFINITY.to_bits(), Ordering::Relaxed);
        }
    }

    /// The shortest edge of a point to another component, unless its component has a shorter one.
    fn shortest(&self, point: usize) -> Option<Edge> {
        let component = self.component[point];
        let bound = &self.bounds[component as usize];
        let mut best = None;
        self.descend(0, point, component, bound, &mut best);
        best
    }

    fn descend(
        &self,
        node: usize,
        point: usize,
        component: u32,
        bound: &AtomicU64,
        best: &mut Option<Edge>,
    ) {
        let limit = || f64::from_bits(bound.load(Ordering::Relaxed));
        let (from, core) = (&self.tree.at[point], self.core[point]);
        let Node { points, second, .. } = &self.tree.nodes[node];
        let least = |node: usize| {
            self.tree.nodes[node]
                .square(from)
                .max(core)
                .max(self.least_core[node])
        };
        if self.of_node[node] == component || core > limit() {
            return;
        }
        if *second != 0 {
            let children = [node + 1, *second];
            let [a, b] = children.map(least);
            let near = usize::from(b < a);
            for (child, least) in [(children[near], a.min(b)), (children[1 - near], a.max(b))] {
                if least <= limit() {
                    self.descend(child, point, component, bound, best);
                }
            }
            return;
        }
        for other in points.clone() {
            if self.component[other] == component {
                continue;
            }
            let reach = square(from, &self.tree.at[other])
                .max(core)
                .max(self.core[other]);
            #[allow(clippy::cast_possible_truncation)]
            let edge = Edge {
                square: reach,
                from: point as u32,
                to: other as u32,
            };
            if reach <= limit() && best.is_none_or(|best| self.key(&edge) < self.key(&best)) {
                *best = Some(edge);
                // Numbers that are not negative are in the order of their bits.
                bound.fetch_min(reach.to_bits(), Ordering::Relaxed);
            }
        }
    }
}

#[cfg(test)]
mod tests;
