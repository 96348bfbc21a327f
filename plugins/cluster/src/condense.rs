//! The condensed tree of a hierarchy, and the clusters that are chosen from it.
//!
//! Campello, Moulavi and Sander (PAKDD 2013): going down the hierarchy, a component that falls apart
//! into parts of which at most one has `min_size` points keeps its name; two such parts are two new
//! clusters. Edges of equal length count as one fall. lambda = 1 / distance; the stability of a cluster is the sum of lambda at which its
//! points leave it, minus that at which it was born. Outlier scores are GLOSH (Campello et al., ACM
//! TKDD 10:5, 2015).

use crate::spanning::Edge;

/// lambda of coincident points: finite, so that sums of it are.
const MOST: f64 = 1e290;
/// No cluster.
const NONE: u32 = u32::MAX;

/// A cluster of the condensed tree; the first is all points.
#[derive(Clone, Debug)]
struct Cluster {
    parent: u32,
    birth: f64,
    stability: f64,
    children: Vec<u32>,
    /// Largest lambda at which a point or a part leaves it.
    leaves: f64,
}

/// The condensed tree.
#[derive(Clone, Debug)]
pub struct Condensed {
    clusters: Vec<Cluster>,
    /// For each point, the cluster that it leaves last, and lambda then.
    points: Vec<(u32, f64)>,
}

/// A chosen cluster for each point.
#[derive(Clone, Debug)]
pub struct Chosen {
    /// Cluster, from 0; None for noise.
    pub cluster: Vec<Option<u32>>,
    /// lambda of the point over the largest of its cluster, 0 for noise.
    pub probability: Vec<f64>,
    /// GLOSH outlier score, 0 to 1.
    pub outlier: Vec<f64>,
    /// Number of clusters.
    pub count: u32,
}

/// A node of the hierarchy: its two parts, lambda, and its number of points.
struct Merge {
    parts: [u32; 2],
    lambda: f64,
    size: u32,
}

/// Single linkage of `edges`, shortest first; nodes `count..` are the merges.
fn hierarchy(edges: &[Edge], count: usize) -> Vec<Merge> {
    let mut parent: Vec<u32> = (0..count).map(index).collect();
    let mut node: Vec<u32> = (0..count).map(index).collect();
    let mut merges: Vec<Merge> = Vec::with_capacity(edges.len());
    for edge in edges {
        let roots = [edge.from, edge.to].map(|end| {
            let mut at = end as usize;
            while parent[at] as usize != at {
                parent[at] = parent[parent[at] as usize];
                at = parent[at] as usize;
            }
            at
        });
        let parts = roots.map(|root| node[root]);
        let size = |part: u32| match (part as usize).checked_sub(count) {
            None => 1,
            Some(merge) => merges[merge].size,
        };
        let sizes = parts.map(size);
        let distance = edge.square.sqrt();
        let lambda = if distance > 1.0 / MOST {
            1.0 / distance
        } else {
            MOST
        };
        // The larger part keeps its root, so that paths stay short.
        let (keep, hang) = if sizes[0] < sizes[1] {
            (roots[1], roots[0])
        } else {
            (roots[0], roots[1])
        };
        parent[hang] = index(keep);
        node[keep] = index(count + merges.len());
        merges.push(Merge {
            parts,
            lambda,
            size: sizes[0] + sizes[1],
        });
    }
    merges
}

#[allow(clippy::cast_possible_truncation)]
fn index(value: usize) -> u32 {
    value as u32
}

impl Condensed {
    /// Condenses the hierarchy of `count` points joined by `edges`, shortest first.
    #[must_use]
    pub fn new(edges: &[Edge], count: usize, min_size: usize) -> Condensed {
        let merges = hierarchy(edges, count);
        let mut tree = Condensed {
            clusters: vec![Cluster::new(NONE, 0.0)],
            points: vec![(0, 0.0); count],
        };
        let size = |part: u32| match (part as usize).checked_sub(count) {
            None => 1,
            Some(merge) => merges[merge].size as usize,
        };
        // What is left to do: a part, and the cluster that it belongs to.
        let mut waiting = vec![];
        if let Some(last) = merges.len().checked_sub(1) {
            waiting.push((index(count + last), 0));
        }
        let (mut parts, mut open) = (vec![], vec![]);
        while let Some((part, cluster)) = waiting.pop() {
            let Some(merge) = (part as usize).checked_sub(count) else {
                continue;
            };
            let lambda = merges[merge].lambda;
            // All that falls apart at the same distance does so at once: which of several equal
            // edges the spanning tree holds must not matter.
            parts.clear();
            open.push(part);
            while let Some(part) = open.pop() {
                match (part as usize)
                    .checked_sub(count)
                    .map(|merge| &merges[merge])
                {
                    #[allow(clippy::float_cmp)]
                    Some(merge) if merge.lambda == lambda => open.extend(merge.parts),
                    _ => parts.push(part),
                }
            }
            let large = parts.iter().filter(|part| size(**part) >= min_size).count();
            for part in parts.drain(..) {
                if size(part) < min_size {
                    open.push(part);
                    while let Some(part) = open.pop() {
                        match (part as usize).checked_sub(count) {
                            None => tree.leave(part as usize, cluster, lambda),
                            Some(merge) => open.extend(merges[merge].parts),
                        }
                    }
                } else if large > 1 {
                    let new = tree.add(cluster, lambda, size(part));
                    waiting.push((part, new));
                } else {
                    waiting.push((part, cluster));
                }
            }
        }
        tree
    }

    fn add(&mut self, parent: u32, lambda: f64, size: usize) -> u32 {
        let new = index(self.clusters.len());
        self.clusters.push(Cluster::new(parent, lambda));
        let parent = &mut self.clusters[parent as usize];
        parent.stability += (lambda - parent.birth) * size as f64;
        parent.leaves = parent.leaves.max(lambda);
        parent.children.push(new);
        new
    }

    fn leave(&mut self, point: usize, cluster: u32, lambda: f64) {
        self.points[point] = (cluster, lambda);
        let cluster = &mut self.clusters[cluster as usize];
        cluster.stability += lambda - cluster.birth;
        cluster.leaves = cluster.leaves.max(lambda);
    }

    /// The clusters with the largest sum of stabilities, none within another; the whole table is
    /// one of the candidates if `whole`.
    #[must_use]
    pub fn excess(&self, whole: bool) -> Vec<bool> {
        let mut chosen = vec![false; self.clusters.len()];
        let mut best: Vec<f64> = self
            .clusters
            .iter()
            .map(|cluster| cluster.stability)
            .collect();
        for (place, cluster) in self.clusters.iter().enumerate().rev() {
            let below: f64 = cluster
                .children
                .iter()
                .map(|child| best[*child as usize])
                .sum();
            if place == 0 && !whole || below > best[place] {
                best[place] = below;
            } else {
                chosen[place] = true;
            }
        }
        // From the top: whatever lies within a chosen cluster is not.
        let mut within = vec![false; self.clusters.len()];
        for (place, cluster) in self.clusters.iter().enumerate() {
            let above = cluster.parent as usize;
            within[place] = place > 0 && (within[above] || chosen[above]);
            if within[place] {
                chosen[place] = false;
            }
        }
        chosen
    }

    /// The clusters without clusters within.
    #[must_use]
    pub fn leaves(&self, whole: bool) -> Vec<bool> {
        let leaf = |(place, cluster): (usize, &Cluster)| {
            cluster.children.is_empty() && (place > 0 || whole)
        };
        self.clusters.iter().enumerate().map(leaf).collect()
    }

    /// The cluster of each point, when these are chosen.
    #[must_use]
    pub fn choose(&self, chosen: &[bool]) -> Chosen {
        let mut number = vec![None; self.clusters.len()];
        let mut top = vec![None; self.clusters.len()];
        let mut count = 0;
        for (place, cluster) in self.clusters.iter().enumerate() {
            if chosen[place] {
                number[place] = Some(count);
                top[place] = Some(place);
                count += 1;
            } else if place > 0 {
                number[place] = number[cluster.parent as usize];
                top[place] = top[cluster.parent as usize];
            }
        }
        let mut deepest: Vec<f64> = self.clusters.iter().map(|cluster| cluster.leaves).collect();
        for (place, cluster) in self.clusters.iter().enumerate().skip(1).rev() {
            let above = cluster.parent as usize;
            deepest[above] = deepest[above].max(deepest[place]);
        }
        let share = |part: f64, whole: f64| {
            if whole > 0.0 {
                (part / whole).min(1.0)
            } else {
                1.0
            }
        };
        let probability = |&(cluster, lambda): &(u32, f64)| match top[cluster as usize] {
            Some(top) => share(lambda, self.clusters[top].leaves),
            None => 0.0,
        };
        let outlier =
            |&(cluster, lambda): &(u32, f64)| 1.0 - share(lambda, deepest[cluster as usize]);
        Chosen {
            cluster: self
                .points
                .iter()
                .map(|(cluster, _)| number[*cluster as usize])
                .collect(),
            probability: self.points.iter().map(probability).collect(),
            outlier: self.points.iter().map(outlier).collect(),
            count,
        }
    }
}

impl Cluster {
    fn new(parent: u32, birth: f64) -> Cluster {
        Cluster {
            parent,
            birth,
            stability: 0.0,
            children: Vec::new(),
            leaves: 0.0,
        }
    }
}
