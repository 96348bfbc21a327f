//! DBSCAN, exact (Ester et al., KDD 1996), with cells whose points are all neighbours of each other
//! (Gunawan 2013; de Berg, Gunawan and Roeloffzen 2017).
//!
//! A point is a core point when at least `min_points` points, itself included, lie within eps
//! (<=). Core points within eps of each other are in one cluster. A cluster's number is its rank by
//! its first core point in the table. Any other point within eps of a core point belongs to the
//! cluster with the lowest number of those that it could belong to; this is what expanding the
//! clusters in the order of the rows gives.

use crate::cells::Cells;
use crate::union::Union;
use puncta_sdk::{Cancelled, Failure, Run};
use std::ops::Range;
use std::sync::{Mutex, PoisonError};

/// Points of a task.
const TASK: usize = 1 << 13;
/// Not a cell of a cluster.
const NONE: u32 = u32::MAX;

/// What DBSCAN found.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Found {
    /// Number of clusters.
    pub clusters: u32,
    /// Number of core points.
    pub core: u64,
    /// Points of each cluster.
    pub sizes: Vec<u64>,
}

/// Writes the cluster of each row to `labels`: 1 to the number of clusters, 0 for noise and for rows
/// whose position is not finite. `at` must be scaled so that eps is the same along all axes.
///
/// # Errors
/// When cancelled, or when the positions span too many cells of the size of eps.
pub fn dbscan<const D: usize>(
    at: [&[f64]; D],
    eps: f64,
    min_points: usize,
    labels: &mut [i32],
    run: &dyn Run,
) -> Result<Found, Failure> {
    // A little smaller than eps / sqrt(D), so that rounding does not matter.
    let side = eps / (D as f64).sqrt() * (1.0 - 1e-6);
    let cells = Cells::new(at, [side; D], 2, run)?;
    let search = Search {
        cells: &cells,
        square: eps * eps,
        min_points,
        tasks: cells.tasks(TASK),
        run,
    };
    run.progress(0.3, "finding core points")?;
    let core = search.core()?;
    run.progress(0.6, "joining clusters")?;
    let union = search.join(&core)?;
    run.progress(0.8, "numbering clusters")?;
    let (clusters, of_cell) = number(&cells, &core, &union);
    drop(union);
    let borders = search.borders(&core, &of_cell)?;
    let mut found = Found {
        clusters,
        core: core.iter().filter(|core| **core).count() as u64,
        sizes: vec![0; clusters as usize],
    };
    labels.fill(0);
    let mut set = |point: usize, cluster: u32| {
        found.sizes[cluster as usize] += 1;
        labels[cells.order[point] as usize] = cluster.cast_signed() + 1;
    };
    for (cell, cluster) in of_cell.iter().enumerate() {
        if *cluster != NONE {
            let points = cells.points(cell);
            points
                .filter(|point| core[*point])
                .for_each(|point| set(point, *cluster));
        }
    }
    for (point, cluster) in borders.into_iter().flatten() {
        set(point as usize, cluster);
    }
    Ok(found)
}

struct Search<'a, const D: usize> {
    cells: &'a Cells<D>,
    square: f64,
    min_points: usize,
    tasks: Vec<Range<usize>>,
    run: &'a dyn Run,
}

impl<const D: usize> Search<'_, D> {
    /// Runs `work` for the rows of each task on all threads.
    fn each<T: Send>(
        &self,
        work: &(dyn Fn(Range<usize>) -> Result<T, Cancelled> + Sync),
    ) -> Result<Vec<T>, Cancelled> {
        let results = puncta_sdk::run::map(self.run, self.tasks.len(), &|task| {
            if self.run.cancelled() {
                return Err(Cancelled);
            }
            work(self.tasks[task].clone())
        });
        results.into_iter().collect()
    }

    /// Whether each point is a core point.
    fn core(&self) -> Result<Vec<bool>, Cancelled> {
        let mut core = vec![false; self.cells.len()];
        let mut parts: Vec<Mutex<&mut [bool]>> = Vec::new();
        let mut rest = &mut core[..];
        for task in &self.tasks {
            let cells = self.cells.of_task(task);
            let points = self.cells.starts[cells.end] - self.cells.starts[cells.start];
            let (part, after) = rest.split_at_mut(points as usize);
            parts.push(Mutex::new(part));
            rest = after;
        }
        self.run.parallel(parts.len(), &|task| {
            let mut part = parts[task].lock().unwrap_or_else(PoisonError::into_inner);
            let rows = self.tasks[task].clone();
            let first = self.cells.starts[self.cells.of_task(&rows).start] as usize;
            // A cancelled sweep leaves the rest as it is: nobody will look.
            let _: Result<(), Cancelled> = self.cells.sweep(rows, |cell, near| {
                let points = self.cells.points(cell);
                let all = points.len() >= self.min_points;
                if !all && self.run.cancelled() {
                    return Err(Cancelled);
                }
                for point in points {
                    part[point - first] = all || self.is_core(point, near);
                }
                Ok(())
            });
        });
        drop(parts);
        if self.run.cancelled() {
            Err(Cancelled)
        } else {
            Ok(core)
        }
    }

    fn is_core(&self, point: usize, near: &[Range<usize>]) -> bool {
        let from = self.cells.position(point);
        let mut count = 0;
        for cells in near {
            let (begin, end) = (self.cells.starts[cells.start], self.cells.starts[cells.end]);
            count += self.count(&from, begin as usize..end as usize);
            if count >= self.min_points {
                return true;
            }
        }
        false
    }

    /// Number of points of a run within eps.
    fn count(&self, from: &[f64; D], points: Range<usize>) -> usize {
        let mut count = 0_usize;
        let [x, y] = [0, 1].map(|axis| &self.cells.at[axis][points.clone()]);
        // Written out for each number of axes, so that the compiler makes vectors of it.
        match D {
            2 => {
                for (x, y) in x.iter().zip(y) {
                    let (dx, dy) = (from[0] - x, from[1] - y);
                    count += usize::from(dx * dx + dy * dy <= self.square);
                }
            }
            _ => {
                let z = &self.cells.at[D - 1][points];
                for ((x, y), z) in x.iter().zip(y).zip(z) {
                    let (dx, dy, dz) = (from[0] - x, from[1] - y, from[D - 1] - z);
                    count += usize::from(dx * dx + dy * dy + dz * dz <= self.square);
                }
            }
        }
        count
    }

    /// Joins the cells whose core points are within eps.
    fn join(&self, core: &[bool]) -> Result<Union, Cancelled> {
        let union = Union::new(self.cells.count());
        let boxes = self.each(&|rows| {
            let cells = self.cells.of_task(&rows);
            Ok(cells
                .map(|cell| self.bounds(cell, core))
                .collect::<Vec<_>>())
        })?;
        let boxes: Vec<Bounds<D>> = boxes.into_iter().flatten().collect();
        self.each(&|rows| {
            self.cells.sweep(rows, |cell, near| {
                if boxes[cell].is_empty() {
                    return Ok(());
                }
                if self.run.cancelled() {
                    return Err(Cancelled);
                }
                for other in near
                    .iter()
                    .flat_map(Clone::clone)
                    .filter(|other| *other > cell)
                {
                    let far = boxes[cell].square(&boxes[other]) > self.square;
                    if !far
                        && !union.joined(cell, other)
                        && self.touch([cell, other], [&boxes[cell], &boxes[other]], core)?
                    {
                        union.join(cell, other);
                    }
                }
                Ok(())
            })
        })?;
        Ok(union)
    }

    fn bounds(&self, cell: usize, core: &[bool]) -> Bounds<D> {
        let mut bounds = Bounds::EMPTY;
        for point in self.cells.points(cell).filter(|point| core[*point]) {
            bounds.add(&self.cells.position(point));
        }
        bounds
    }

    /// Whether any core points of two cells are within eps.
    fn touch(
        &self,
        cells: [usize; 2],
        boxes: [&Bounds<D>; 2],
        core: &[bool],
    ) -> Result<bool, Cancelled> {
        let close = |cell: usize, bounds: &Bounds<D>| -> Vec<usize> {
            let points = self.cells.points(cell).filter(|point| core[*point]);
            let near = |point: &usize| {
                bounds.square_from(&self.cells.position(*point)) <= self.square * (1.0 + 1e-9)
            };
            points.filter(near).collect()
        };
        let (first, second) = (close(cells[0], boxes[1]), close(cells[1], boxes[0]));
        for a in &first {
            if second.len() > 512 && self.run.cancelled() {
                return Err(Cancelled);
            }
            let from = self.cells.position(*a);
            if second
                .iter()
                .any(|b| self.cells.square_from(&from, *b) <= self.square)
            {
                return Ok(true);
            }
        }
        Ok(false)
    }

    /// Points near core points that are none themselves, with the lowest cluster.
    fn borders(&self, core: &[bool], of_cell: &[u32]) -> Result<Vec<Vec<(u32, u32)>>, Cancelled> {
        self.each(&|rows| {
            let mut found = Vec::new();
            self.cells.sweep(rows, |cell, near| {
                let points = self.cells.points(cell);
                if points.len() >= self.min_points {
                    return Ok(());
                }
                if self.run.cancelled() {
                    return Err(Cancelled);
                }
                for point in points.filter(|point| !core[*point]) {
                    let from = self.cells.position(point);
                    let mut lowest = NONE;
                    for other in near.iter().flat_map(Clone::clone) {
                        let within =
                            |p: usize| core[p] && self.cells.square_from(&from, p) <= self.square;
                        if of_cell[other] < lowest && self.cells.points(other).any(within) {
                            lowest = of_cell[other];
                        }
                    }
                    if lowest != NONE {
                        #[allow(clippy::cast_possible_truncation)]
                        found.push((point as u32, lowest));
                    }
                }
                Ok(())
            })?;
            Ok(found)
        })
    }
}

/// Numbers the clusters by their first core point; gives the cluster of each cell.
fn number<const D: usize>(cells: &Cells<D>, core: &[bool], union: &Union) -> (u32, Vec<u32>) {
    let mut first = vec![NONE; cells.count()];
    let mut of_cell = vec![NONE; cells.count()];
    for (cell, of_cell) in of_cell.iter_mut().enumerate() {
        let rows = cells
            .points(cell)
            .filter(|p| core[*p])
            .map(|p| cells.order[p]);
        if let Some(row) = rows.min() {
            let root = union.root(cell);
            first[root] = first[root].min(row);
            #[allow(clippy::cast_possible_truncation)]
            let root = root as u32;
            *of_cell = root;
        }
    }
    let mut roots: Vec<(u32, u32)> = Vec::new();
    #[allow(clippy::cast_possible_truncation)]
    roots.extend(
        first
            .iter()
            .enumerate()
            .filter(|(_, row)| **row != NONE)
            .map(|(root, row)| (*row, root as u32)),
    );
    roots.sort_unstable();
    for (number, (_, root)) in roots.iter().enumerate() {
        #[allow(clippy::cast_possible_truncation)]
        let number = number as u32;
        first[*root as usize] = number;
    }
    for cell in of_cell.iter_mut().filter(|cell| **cell != NONE) {
        *cell = first[*cell as usize];
    }
    #[allow(clippy::cast_possible_truncation)]
    let count = roots.len() as u32;
    (count, of_cell)
}

/// The smallest box around some points.
#[derive(Clone, Copy, Debug)]
struct Bounds<const D: usize> {
    low: [f64; D],
    high: [f64; D],
}

impl<const D: usize> Bounds<D> {
    const EMPTY: Bounds<D> = Bounds {
        low: [f64::INFINITY; D],
        high: [f64::NEG_INFINITY; D],
    };

    fn is_empty(&self) -> bool {
        self.low[0] > self.high[0]
    }

    fn add(&mut self, at: &[f64; D]) {
        for (axis, at) in at.iter().enumerate() {
            self.low[axis] = self.low[axis].min(*at);
            self.high[axis] = self.high[axis].max(*at);
        }
    }

    /// Square of the distance of the boxes; infinite if one is empty.
    fn square(&self, other: &Bounds<D>) -> f64 {
        let gap = |axis: usize| {
            (self.low[axis] - other.high[axis])
                .max(other.low[axis] - self.high[axis])
                .max(0.0)
        };
        (0..D).map(|axis| gap(axis) * gap(axis)).sum()
    }

    fn square_from(&self, at: &[f64; D]) -> f64 {
        self.square(&Bounds {
            low: *at,
            high: *at,
        })
    }
}

#[cfg(test)]
mod tests;
