//! Merging vertices that lie at the same place.

use crate::mesh::NONE;
use crate::vector::{Point, squared, sub};
use std::collections::HashMap;

/// For each position the lowest-numbered one that stands for it: the same place (`tolerance` 0), or
/// the first that is kept within `tolerance`. Positions that are not finite stand for themselves.
#[must_use]
pub fn weld(positions: &[Point], tolerance: f64) -> Vec<u32> {
    if tolerance > 0.0 {
        within(positions, tolerance)
    } else {
        same(positions)
    }
}

fn same(positions: &[Point]) -> Vec<u32> {
    // Adding 0 makes the two zeros one.
    let key = |i: u32| positions[i as usize].map(|x| (x + 0.0).to_bits());
    let mut order: Vec<u32> = (0..positions.len() as u32).collect();
    order.sort_unstable_by_key(|&i| (key(i), i));
    let mut stands: Vec<u32> = (0..positions.len() as u32).collect();
    for group in order.chunk_by(|&a, &b| key(a) == key(b)) {
        for &i in group {
            stands[i as usize] = group[0];
        }
    }
    stands
}

fn within(positions: &[Point], tolerance: f64) -> Vec<u32> {
    let cell = |p: Point| p.map(|x| (x / tolerance).floor().clamp(-9e15, 9e15) as i64);
    let mut kept: HashMap<[i64; 3], u32> = HashMap::new();
    // Kept positions of one cell are a chain.
    let mut chain = vec![NONE; positions.len()];
    let mut stands: Vec<u32> = (0..positions.len() as u32).collect();
    for (i, &p) in positions.iter().enumerate() {
        if !crate::vector::finite(p) {
            continue;
        }
        let [x, y, z] = cell(p);
        let mut best = NONE;
        for step in 0..27 {
            let near = [x + step % 3 - 1, y + step / 3 % 3 - 1, z + step / 9 - 1];
            let mut other = kept.get(&near).copied().unwrap_or(NONE);
            while other != NONE {
                let apart = squared(sub(positions[other as usize], p));
                if apart <= tolerance * tolerance {
                    best = best.min(other);
                }
                other = chain[other as usize];
            }
        }
        if best == NONE {
            let first = kept.insert([x, y, z], i as u32);
            chain[i] = first.unwrap_or(NONE);
        } else {
            stands[i] = best;
        }
    }
    stands
}

/// Vertices and triangles of a list of triangles as STL files have it, each with three corners of
/// its own: equal places become one vertex, in the order in which they first come.
#[must_use]
pub fn index(corners: &[Point]) -> (Vec<Point>, Vec<[u32; 3]>) {
    let stands = same(corners);
    let mut number = vec![NONE; corners.len()];
    let mut positions = Vec::new();
    let mut indices = Vec::with_capacity(corners.len());
    for (i, &first) in stands.iter().enumerate() {
        if number[first as usize] == NONE {
            number[first as usize] = positions.len() as u32;
            positions.push(corners[i]);
        }
        indices.push(number[first as usize]);
    }
    (positions, indices.as_chunks::<3>().0.to_vec())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_and_near_places_are_one() {
        let points = [
            [0.0, 0.0, 0.0],
            [1.0, 0.0, 0.0],
            [-0.0, 0.0, 0.0],
            [1.0, 0.0, 1e-3],
            [f64::NAN; 3],
        ];
        assert_eq!(weld(&points, 0.0), [0, 1, 0, 3, 4]);
        assert_eq!(weld(&points, 0.01), [0, 1, 0, 1, 4]);
        assert!(weld(&[], 0.0).is_empty());
    }

    #[test]
    fn triangle_lists_get_indices() {
        let (a, b, c, d) = ([0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0; 3]);
        let (positions, triangles) = index(&[a, b, c, c, b, d]);
        assert_eq!(positions, [a, b, c, d]);
        assert_eq!(triangles, [[0, 1, 2], [2, 1, 3]]);
    }
}
