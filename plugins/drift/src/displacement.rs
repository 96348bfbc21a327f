//! Histograms of the displacements between localisations of different groups: the correlation of
//! two point sets, counted directly, without images.

use std::sync::{Mutex, PoisonError};

use puncta_sdk::{Failure, Run};

use crate::cloud::{Cloud, hash};
use crate::grid::Grid;

/// Tasks among which the points are divided.
const TASKS: usize = 8;
/// Pairs looked at in one go; more are thinned.
const MOST_PAIRS: f64 = 1e7;
/// Points looked at in one go.
pub const MOST_POINTS: usize = 150_000;

/// Cells of a histogram of displacements: `sides` odd numbers, cell sides `cell`, about 0.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Layout {
    /// Cells along x, y, z.
    pub sides: [usize; 3],
    /// Sides of a cell, nm; infinite along an axis that is not looked at.
    pub cell: [f32; 3],
}

impl Layout {
    /// Cells of side `cell` in the x y plane up to `reach`.
    pub fn lateral(reach: f64, cell: f64) -> Self {
        let side = 2 * (reach / cell).ceil().max(1.0) as usize + 1;
        Self {
            sides: [side, side, 1],
            cell: [cell as f32, cell as f32, f32::INFINITY],
        }
    }

    /// Cells along z, of pairs that are closer than `near` in x and in y.
    pub fn axial(reach: f64, cell: f64, near: f64) -> Self {
        let side = 2 * (reach / cell).ceil().max(1.0) as usize + 1;
        let near = 2.0 * near as f32;
        Self {
            sides: [1, 1, side],
            cell: [near, near, cell as f32],
        }
    }

    /// Number of cells.
    pub fn cells(&self) -> usize {
        self.sides.iter().product()
    }

    /// Largest displacement along x or y.
    pub fn reach(&self) -> f32 {
        let half = |axis: usize| self.sides[axis] as f32 * self.cell[axis] / 2.0;
        half(0).max(half(1))
    }

    #[inline]
    fn place(&self, d: [f32; 3]) -> Option<usize> {
        let mut place = 0;
        for axis in (0..3).rev() {
            let side = self.sides[axis];
            let cell = (d[axis] / self.cell[axis] + side as f32 / 2.0).floor();
            if !(cell >= 0.0 && cell < side as f32) {
                return None;
            }
            place = place * side + cell as usize;
        }
        Some(place)
    }
}

/// How many points may be taken, so that the pairs within `reach` stay affordable.
pub fn affordable(cloud: &Cloud, reach: f32) -> usize {
    let grid = Grid::new(&cloud.at, reach);
    let step = (cloud.len() / 1000).max(1);
    let (mut seen, mut pairs) = (0.0, 0.0);
    for p in cloud.at.iter().step_by(step) {
        seen += 1.0;
        pairs += grid.around(*p).iter().map(|r| r.len() as f64).sum::<f64>();
    }
    let total = pairs / f64::max(seen, 1.0) * cloud.len() as f64;
    let share = (MOST_PAIRS / total.max(1.0)).sqrt().min(1.0);
    (cloud.len() as f64 * share) as usize
}

/// Counts the displacements `at[i] - at[j]` of all pairs for which `slot(group[i], group[j])` names
/// a histogram. Gives the `slots` histograms, one after the other.
///
/// # Errors
/// When cancelled.
pub fn histograms<S>(
    at: &[[f32; 3]],
    group: &[u32],
    layout: &Layout,
    slots: usize,
    slot: S,
    run: &dyn Run,
) -> Result<Vec<u32>, Failure>
where
    S: Fn(u32, u32) -> Option<usize> + Sync,
{
    let grid = Grid::new(at, layout.reach());
    let total: Mutex<Vec<u32>> = Mutex::new(vec![0; slots * layout.cells()]);
    run.parallel(TASKS, &|task| {
        let mut counts = vec![0u32; slots * layout.cells()];
        let share = |task: usize| grid.order.len() * task / TASKS;
        for (k, &i) in grid.order[share(task)..share(task + 1)].iter().enumerate() {
            if k % 256 == 0 && run.cancelled() {
                return;
            }
            let p = at[i as usize];
            for range in grid.around(p) {
                for &j in &grid.order[range] {
                    let q = at[j as usize];
                    let Some(place) = layout.place([p[0] - q[0], p[1] - q[1], p[2] - q[2]]) else {
                        continue;
                    };
                    if let Some(slot) = slot(group[i as usize], group[j as usize]) {
                        counts[slot * layout.cells() + place] += 1;
                    }
                }
            }
        }
        let mut total = total.lock().unwrap_or_else(PoisonError::into_inner);
        total
            .iter_mut()
            .zip(counts)
            .for_each(|(sum, count)| *sum += count);
    });
    if run.cancelled() {
        return Err(Failure::cancelled());
    }
    Ok(total.into_inner().unwrap_or_else(PoisonError::into_inner))
}

/// The highest point of a histogram of displacements.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Peak {
    /// Where it is, nm.
    pub shift: [f64; 3],
    /// Counts in the 3 x 3 cells about it, above what is usual.
    pub height: f64,
    /// Height divided by the standard deviation of what is usual.
    pub score: f64,
}

/// Finds the peak: the highest sum over neighbouring cells, refined by the centroid of what lies
/// above the median within two cells.
pub fn peak(counts: &[u32], layout: &Layout) -> Peak {
    let sums = box_sums(counts, layout);
    let mut sorted = sums.clone();
    let middle = sorted.len() / 2;
    let usual = f64::from(*sorted.select_nth_unstable(middle).1);
    let best = sums
        .iter()
        .enumerate()
        .max_by(|a, b| a.1.cmp(b.1).then(b.0.cmp(&a.0)));
    let (place, top) = best.map_or((0, 0.0), |(place, top)| (place, f64::from(*top)));
    let height = top - usual;
    let cells = layout
        .sides
        .iter()
        .map(|side| if *side > 1 { 3.0 } else { 1.0 })
        .product::<f64>();
    let flat = usual / cells;
    let [nx, ny, _] = layout.sides;
    let centre = [place % nx, place / nx % ny, place / nx / ny];
    let (mut mass, mut moment) = (0.0, [0.0; 3]);
    for_near(centre, layout, 2, |cell, place| {
        let over = (f64::from(counts[place]) - flat).max(0.0);
        mass += over;
        for axis in 0..3 {
            moment[axis] += over * (cell[axis] as f64 - (layout.sides[axis] / 2) as f64);
        }
    });
    let shift = std::array::from_fn(|axis| match layout.sides[axis] {
        1 => 0.0,
        _ => moment[axis] / f64::max(mass, 1e-9) * f64::from(layout.cell[axis]),
    });
    Peak {
        shift,
        height,
        score: height / (usual + 4.0).sqrt(),
    }
}

/// The sum over the 3 x 3 cells about displacement 0, above what is usual elsewhere: with the same
/// meaning as [`Peak::height`].
pub fn box_sums(counts: &[u32], layout: &Layout) -> Vec<u32> {
    let [nx, ny, nz] = layout.sides;
    let mut sums = counts.to_vec();
    for (stride, side) in [(1, nx), (nx, ny), (nx * ny, nz)] {
        if side == 1 {
            continue;
        }
        let line = sums.clone();
        for (place, sum) in sums.iter_mut().enumerate() {
            let k = place / stride % side;
            if k > 0 {
                *sum += line[place - stride];
            }
            if k + 1 < side {
                *sum += line[place + stride];
            }
        }
    }
    sums
}

fn for_near(
    centre: [usize; 3],
    layout: &Layout,
    reach: usize,
    mut f: impl FnMut([usize; 3], usize),
) {
    let range = |axis: usize| {
        let low = centre[axis].saturating_sub(reach);
        low..(centre[axis] + reach + 1).min(layout.sides[axis])
    };
    for z in range(2) {
        for y in range(1) {
            for x in range(0) {
                f([x, y, z], (z * layout.sides[1] + y) * layout.sides[0] + x);
            }
        }
    }
}

/// A random subset that keeps the histograms affordable: the same for any order of the rows.
pub fn thin(cloud: &Cloud, reach: f32, seed: u64) -> Cloud {
    let some = cloud.thinned(MOST_POINTS, hash(1, seed));
    let count = affordable(&some, reach);
    some.thinned(count, hash(2, seed))
}

#[cfg(test)]
mod tests {
    use super::*;
    use puncta_testkit::{Stopped, Threads};

    #[test]
    fn the_shift_of_two_groups_is_found() {
        // 300 random points, and the same ones again 84 nm and -47 nm away, 30 nm higher.
        let value = |i: usize, seed| (hash(i as u64, seed) >> 40) as f32 / 16_777_216.0 * 1e4;
        let mut at: Vec<[f32; 3]> = (0..300).map(|i| [value(i, 1), value(i, 2), 0.0]).collect();
        at.extend_from_within(..);
        at[300..].iter_mut().for_each(|p| {
            p[0] += 84.0;
            p[1] -= 47.0;
            p[2] += 30.0;
        });
        let group: Vec<u32> = (0..600).map(|i| u32::from(i >= 300)).collect();
        let later = |a: u32, b: u32| (a > b).then_some(0);
        let layout = Layout::lateral(500.0, 20.0);
        assert_eq!(layout.sides, [51, 51, 1]);
        let counts = histograms(&at, &group, &layout, 1, later, &Threads(2)).unwrap();
        let found = peak(&counts, &layout);
        assert!(found.score > 20.0);
        assert!((found.shift[0] - 84.0).abs() < 10.0 && (found.shift[1] + 47.0).abs() < 10.0);
        let axial = Layout::axial(100.0, 10.0, 120.0);
        let counts = histograms(&at, &group, &axial, 1, later, &Threads(1)).unwrap();
        let found = peak(&counts, &axial);
        assert!((found.shift[2] - 30.0).abs() < 5.0 && found.shift[0] == 0.0);
        assert!(histograms(&at, &group, &axial, 1, later, &Stopped).is_err());
    }

    #[test]
    fn random_points_have_no_peak() {
        let value = |i: usize, seed| (hash(i as u64, seed) >> 40) as f32 / 16_777_216.0 * 2e4;
        let at: Vec<[f32; 3]> = (0..4000).map(|i| [value(i, 1), value(i, 2), 0.0]).collect();
        let group: Vec<u32> = (0..4000).map(|i| i % 2).collect();
        let layout = Layout::lateral(500.0, 20.0);
        let later = |a: u32, b: u32| (a > b).then_some(0);
        let counts = histograms(&at, &group, &layout, 1, later, &Threads(2)).unwrap();
        assert!(counts.iter().sum::<u32>() > 1000);
        assert!(peak(&counts, &layout).score < 5.0);
    }
}
