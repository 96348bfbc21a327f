//! Edges by bands of y: which lie near a place, and which lie to the right of it.

use crate::flat::Edge;

/// Edges by bands of y.
#[derive(Clone, Debug)]
pub(crate) struct Bands {
    low: f64,
    inverse: f64,
    lists: Vec<Vec<u32>>,
}

impl Bands {
    pub(crate) fn new(edges: &[Edge]) -> Self {
        let ends = edges.iter().flat_map(|edge| [edge.from[1], edge.to[1]]);
        let (low, high) = ends.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), y| {
            (low.min(y), high.max(y))
        });
        let count = edges.len().clamp(1, 4096);
        let mut bands = Self {
            low,
            inverse: count as f64 / (high - low),
            lists: vec![Vec::new(); count],
        };
        for (number, edge) in (0..).zip(edges) {
            let (from, to) = (edge.from[1].min(edge.to[1]), edge.from[1].max(edge.to[1]));
            for band in bands.band(from)..=bands.band(to) {
                bands.lists[band].push(number);
            }
        }
        bands
    }

    fn band(&self, y: f64) -> usize {
        (((y - self.low) * self.inverse) as usize).min(self.lists.len() - 1)
    }

    /// Edges that may have a part between two heights, increasing.
    pub(crate) fn between(&self, from: f64, to: f64) -> Vec<u32> {
        let mut found: Vec<u32> = self.lists[self.band(from)..=self.band(to)]
            .iter()
            .flatten()
            .copied()
            .collect();
        found.sort_unstable();
        found.dedup();
        found
    }

    /// How many edges a ray from a point along x crosses.
    pub(crate) fn crossings(&self, edges: &[Edge], point: &[f64; 2]) -> usize {
        let crossed = |edge: &Edge| {
            let above = |end: &[f64; 2]| end[1] > point[1];
            above(&edge.from) != above(&edge.to) && {
                let share = (point[1] - edge.from[1]) / (edge.to[1] - edge.from[1]);
                point[0] < edge.from[0] + share * (edge.to[0] - edge.from[0])
            }
        };
        let list = &self.lists[self.band(point[1])];
        list.iter()
            .filter(|edge| crossed(&edges[**edge as usize]))
            .count()
    }
}
