//! Sites on a membrane by Monte-Carlo sampling on an octree (thesis, appendix C, "Point cloud
//! simulation").
//!
//! The octree is refined where it may straddle the surface, down to boxes of side `dx`; the centre
//! of each smallest box nearer than `dx` to the surface is a candidate. "Nearer" is
//! `|f| / max(|grad f|, 0.3) < dx`: the first-order distance, because the function of a smooth join
//! is not a distance. A surface of area A thus has 2 A / dx^2 candidates.

use std::sync::Mutex;

use crate::random::{Purpose, stream, unit};
use crate::sdf::Solid;
use puncta_sdk::{Failure, Run};
use puncta_shared_vector::{Point, norm, scale};

/// Side of the boxes that are refined in parallel, in units of `dx`: 4096 smallest boxes.
const TASK: u32 = 16;
/// Candidates in a chunk of random numbers.
const CHUNK: usize = 1 << 13;
/// The smallest slope that the distance is divided by, so that a crease gives no far candidates.
const LEAST_SLOPE: f64 = 0.3;

/// The centre of a smallest box near the surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Candidate {
    /// Position, nm.
    pub position: Point,
    /// Outward unit normal of the membrane there.
    pub normal: [f32; 3],
}

/// The candidates of `solid`, whose surface lies within `bounds`, in octree order.
///
/// # Errors
/// When cancelled.
pub fn candidates(
    solid: &Solid,
    bounds: [Point; 2],
    dx: f64,
    run: &dyn Run,
) -> Result<Vec<Candidate>, Failure> {
    let octree = Octree { solid, dx };
    let boxes = octree.coarse(bounds, run)?;
    let found: Vec<Mutex<Vec<Candidate>>> = boxes.iter().map(|_| Mutex::default()).collect();
    // Batches, so that progress and cancel are seen between them.
    let batch = 64 * run.threads().max(1);
    for start in (0..boxes.len()).step_by(batch) {
        run.progress(
            0.3 * start as f64 / boxes.len() as f64,
            "Sampling the surface",
        )?;
        run.parallel(batch.min(boxes.len() - start), &|i| {
            let (Some(centre), Some(slot)) = (boxes.get(start + i), found.get(start + i)) else {
                return;
            };
            let mut here = Vec::new();
            octree.refine(*centre, TASK, &mut here);
            if let Ok(mut slot) = slot.lock() {
                *slot = here;
            }
        });
    }
    Ok(found
        .into_iter()
        .flat_map(|slot| slot.into_inner().unwrap_or_default())
        .collect())
}

struct Octree<'a> {
    solid: &'a Solid,
    dx: f64,
}

impl Octree<'_> {
    /// Centres of the boxes of side `TASK dx` that may hold candidates, in octree order.
    fn coarse(&self, bounds: [Point; 2], run: &dyn Run) -> Result<Vec<Point>, Failure> {
        let [low, high] = bounds;
        let extent = (0..3).map(|i| high[i] - low[i]).fold(0.0, f64::max) + 2.0 * self.dx;
        let mut side = TASK;
        while f64::from(side) * self.dx < extent {
            side *= 2;
        }
        let mut boxes = vec![[0, 1, 2].map(|i| (low[i] + high[i]) / 2.0)];
        while side > TASK {
            run.progress(0.0, "Sampling the surface")?;
            side /= 2;
            boxes = boxes
                .iter()
                .flat_map(|centre| self.children(*centre, side))
                .filter(|centre| self.straddles(*centre, side))
                .collect();
        }
        Ok(boxes)
    }

    /// Adds the candidates of the box of side `side dx` about `centre`.
    fn refine(&self, centre: Point, side: u32, found: &mut Vec<Candidate>) {
        if side == 1 {
            found.extend(self.candidate(centre));
            return;
        }
        for child in self.children(centre, side / 2) {
            if self.straddles(child, side / 2) {
                self.refine(child, side / 2, found);
            }
        }
    }

    /// Centres of the eight children of side `side dx`.
    fn children(&self, centre: Point, side: u32) -> [Point; 8] {
        let half = f64::from(side) * self.dx / 2.0;
        std::array::from_fn(|child| {
            [0, 1, 2].map(|i| centre[i] + if child >> i & 1 == 1 { half } else { -half })
        })
    }

    /// Whether a point nearer than `dx` to the surface may lie among the centres of the smallest
    /// boxes: no function of a solid is steeper than 1.
    fn straddles(&self, centre: Point, side: u32) -> bool {
        let reach = f64::from(side - 1) * 3f64.sqrt() / 2.0;
        self.solid.value(centre).abs() < (reach + 1.0) * self.dx
    }

    fn candidate(&self, p: Point) -> Option<Candidate> {
        let (value, gradient) = self.solid.gradient(p);
        let slope = norm(gradient);
        let normal = || scale(gradient, 1.0 / slope.max(1e-9)).map(|c| c as f32);
        let near = value.abs() < self.dx * slope.max(LEAST_SLOPE);
        near.then(|| Candidate {
            position: p,
            normal: normal(),
        })
    }
}

/// The numbers of those of `count` candidates that copy `copy` keeps with probability `p`,
/// increasing. A larger `p` keeps all that a smaller one keeps.
///
/// # Errors
/// When cancelled.
pub fn keep(
    count: usize,
    p: f64,
    seed: u64,
    copy: usize,
    run: &dyn Run,
) -> Result<Vec<u32>, Failure> {
    let mut kept = Vec::with_capacity((count as f64 * p * 1.1) as usize + 16);
    for (chunk, start) in (0..count).step_by(CHUNK).enumerate() {
        if run.cancelled() {
            return Err(Failure::cancelled());
        }
        let mut random = stream(
            seed,
            Purpose::Keep,
            false,
            ((copy as u64) << 32) | chunk as u64,
        );
        let candidates = start..count.min(start + CHUNK);
        kept.extend(
            candidates
                .filter(|_| unit(&mut random) < p)
                .map(|i| i as u32),
        );
    }
    Ok(kept)
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::sdf::tests::project;
    use crate::shape::{Shape, tests::ALL};
    use puncta_shared_vector::sub;
    use puncta_testkit::{Stopped, Threads};

    const DX: f64 = 1.66;

    /// The signed distance to the surface, to first order.
    pub(crate) fn first_order_distance(solid: &Solid, p: Point) -> f64 {
        let (value, gradient) = solid.gradient(p);
        value / norm(gradient).max(0.3)
    }

    fn sites(shape: Shape, dx: f64, threads: usize) -> Vec<Point> {
        let found = candidates(&shape.solid(), shape.bounds(), dx, &Threads(threads));
        found
            .expect("not cancelled")
            .into_iter()
            .map(|found| found.position)
            .collect()
    }

    #[test]
    fn candidates_fill_the_shell_of_half_thickness_dx() {
        for shape in ALL {
            let solid = shape.solid();
            let mut mean = 0.0;
            // A tubule along a lattice axis has up to 2 % more or fewer lattice points in its shell;
            // that averages out over the sampling rate.
            let rates = [1.51, DX, 1.77, 2.03];
            for dx in rates {
                let found = sites(shape, dx, 2);
                let share = found.len() as f64 * dx * dx / (2.0 * shape.area());
                assert!((share - 1.0).abs() < 0.02, "{shape:?} {dx}: {share}");
                mean += share / rates.len() as f64;
                for p in found.iter().step_by(97) {
                    let distance = norm(sub(*p, project(&solid, *p)));
                    assert!(distance < dx * 1.02, "{shape:?} {p:?}: {distance}");
                }
            }
            assert!((mean - 1.0).abs() < 0.005, "{shape:?}: {mean}");
        }
    }

    /// The octree prunes nothing that a plain scan of the lattice finds.
    #[test]
    fn candidates_are_those_of_a_plain_scan() {
        let dx = 9.0;
        for shape in ALL {
            let solid = shape.solid();
            let mut found = sites(shape, dx, 1);
            assert_eq!(found, sites(shape, dx, 2));
            let first = found[0];
            let [low, high] = shape.bounds();
            let reach = [0, 1, 2].map(|i| ((high[i] - low[i]) / dx) as i32 + 3);
            let mut plain = vec![];
            for x in -reach[0]..=reach[0] {
                for y in -reach[1]..=reach[1] {
                    for z in -reach[2]..=reach[2] {
                        let p = [x, y, z].map(f64::from);
                        let p = [0, 1, 2].map(|i| first[i] + p[i] * dx);
                        if first_order_distance(&solid, p).abs() < dx {
                            plain.push(p);
                        }
                    }
                }
            }
            let order = |a: &Point, b: &Point| {
                let key = |p: &Point| p.map(|c| (c / dx * 4.0).round() as i64);
                key(a).cmp(&key(b))
            };
            found.sort_by(order);
            plain.sort_by(order);
            // Points whose distance is dx to rounding may differ.
            assert!(found.len().abs_diff(plain.len()) <= 2, "{shape:?}");
            if found.len() == plain.len() {
                assert!(
                    found
                        .iter()
                        .zip(&plain)
                        .all(|(a, b)| norm(sub(*a, *b)) < 1e-6)
                );
            }
        }
    }

    #[test]
    fn the_kept_number_is_binomial_and_grows_with_p() {
        let count = 300_000;
        let kept = |p, copy| keep(count, p, 4, copy, &Threads(1)).expect("not cancelled");
        for p in [0.001, 0.02, 0.5] {
            let sigma = (count as f64 * p * (1.0 - p)).sqrt();
            assert!((kept(p, 0).len() as f64 - count as f64 * p).abs() < 4.0 * sigma);
        }
        let (few, many) = (kept(0.01, 0), kept(0.02, 0));
        assert!(few.iter().all(|i| many.binary_search(i).is_ok()));
        assert_ne!(few, kept(0.01, 1));
        assert_eq!(kept(1.0, 0).len(), count);
    }

    #[test]
    fn cancel_is_seen() {
        let shape = Shape::Er;
        let cancelled = candidates(&shape.solid(), shape.bounds(), DX, &Stopped);
        assert_eq!(cancelled, Err(Failure::cancelled()));
        assert_eq!(keep(10, 0.5, 1, 0, &Stopped), Err(Failure::cancelled()));
    }
}
