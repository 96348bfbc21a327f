//! Lists of the neighbours of each localisation, in the order of a grid, so that what is near in
//! space is near in memory.

use puncta_sdk::{Failure, Run};

use crate::grid::Grid;

/// Directed pairs of a list; beyond it localisations are thinned.
const MOST_PAIRS: f64 = 2e7;
/// Tasks among which the localisations are divided; the same for any number of threads.
pub const TASKS: usize = 32;

/// Neighbours of each localisation, without those of its own group. Symmetric.
#[derive(Debug, Default)]
pub struct Pairs {
    /// Localisations in the order of the grid.
    pub order: Vec<u32>,
    /// Tasks: first place in `order`, and the neighbours of its localisations.
    pub tasks: Vec<Task>,
}

/// Neighbours of the localisations of one task.
#[derive(Debug, Default)]
pub struct Task {
    /// Place in `order` of the first.
    pub first: usize,
    /// End of the neighbours of each.
    pub ends: Vec<u32>,
    /// Places in `order`.
    pub others: Vec<u32>,
}

impl Pairs {
    /// Finds all pairs of different groups that are at most `radius` nm apart.
    ///
    /// # Errors
    /// When cancelled.
    pub fn new(
        at: &[[f32; 3]],
        group: &[u32],
        radius: f32,
        run: &dyn Run,
    ) -> Result<Self, Failure> {
        let grid = Grid::new(at, radius);
        let sorted: Vec<([f32; 3], u32)> = grid
            .order
            .iter()
            .map(|i| (at[*i as usize], group[*i as usize]))
            .collect();
        let share = |task: usize| sorted.len() * task / TASKS;
        let tasks = puncta_sdk::run::map(run, TASKS, &|task| {
            let mut out = Task {
                first: share(task),
                ..Task::default()
            };
            for (k, (p, own)) in sorted[share(task)..share(task + 1)].iter().enumerate() {
                if k % 1024 == 0 && run.cancelled() {
                    break;
                }
                for range in grid.around(*p) {
                    for (place, (q, group)) in range.clone().zip(&sorted[range]) {
                        let d = [p[0] - q[0], p[1] - q[1], p[2] - q[2]];
                        let square = d[0] * d[0] + d[1] * d[1] + d[2] * d[2];
                        if square < radius * radius && group != own {
                            out.others.push(place as u32);
                        }
                    }
                }
                out.ends.push(out.others.len() as u32);
            }
            out
        });
        if run.cancelled() {
            return Err(Failure::cancelled());
        }
        Ok(Self {
            order: grid.order,
            tasks,
        })
    }

    /// Number of directed pairs.
    pub fn len(&self) -> usize {
        self.tasks.iter().map(|task| task.others.len()).sum()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

/// How many localisations may be taken, so that the pairs within `radius` stay affordable. Counts
/// the neighbours of about 2000 localisations.
pub fn affordable(at: &[[f32; 3]], radius: f32, run: &dyn Run) -> usize {
    let grid = Grid::new(at, radius);
    let step = (at.len() / 2000).max(1);
    let (mut seen, mut pairs) = (0.0, 0.0);
    for p in at.iter().step_by(step) {
        if run.cancelled() {
            break;
        }
        seen += 1.0;
        // A third of the points of the 3 x 3 cells, pi / 9, lies in the circle.
        let around: usize = grid.around(*p).iter().map(std::ops::Range::len).sum();
        pairs += around as f64 * std::f64::consts::PI / 9.0;
    }
    let total = pairs / f64::max(seen, 1.0) * at.len() as f64;
    let share = (MOST_PAIRS / total.max(1.0)).sqrt().min(1.0);
    (at.len() as f64 * share) as usize
}
