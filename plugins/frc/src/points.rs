//! Localisations in the order of the rows of voxels that hold them.

use crate::grid::Grid;
use crate::split::NONE;
use crate::window::Window;
use puncta_sdk::run::{Cancelled, Run, chunks_mut, map};
use puncta_shared_fourier::{Complex, RealFft};

/// Table rows that one task takes.
const CHUNK: usize = 1 << 15;

/// Rows of voxels that one task takes.
const LINES: usize = 16;

/// A localisation in its row of voxels.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Entry {
    x: u32,
    unit: u32,
}

/// The localisations of a field.
pub struct Points {
    starts: Vec<usize>,
    entries: Vec<Entry>,
    /// Rows outside the field.
    pub outside: u64,
    /// Rows without a finite position, or without a unit.
    pub invalid: u64,
}

/// Columns of positions in the order z, y, x; z may be empty.
pub type Positions<'a> = [&'a [f64]; 3];

/// Where a table row goes.
#[derive(Clone, Copy, Default)]
enum Place {
    #[default]
    Invalid,
    Outside,
    In(u32, u32),
}

impl Points {
    /// Sorts the localisations by their row of voxels. `units` gives each its unit, or is empty
    /// where the unit is the row.
    ///
    /// # Errors
    /// When cancelled.
    pub fn new(
        run: &dyn Run,
        grid: &Grid,
        at: Positions<'_>,
        units: &[u32],
    ) -> Result<Points, Cancelled> {
        let rows = at[1].len().min(at[2].len());
        let unit = |row: usize| {
            let unit = || units.get(row).copied().unwrap_or(NONE);
            if units.is_empty() { row as u32 } else { unit() }
        };
        let mut places = vec![Place::Invalid; rows];
        chunks_mut(run, &mut places, CHUNK, &|chunk, places| {
            if run.cancelled() {
                return;
            }
            for (i, to) in places.iter_mut().enumerate() {
                let row = chunk * CHUNK + i;
                *to = place(grid, at, row, unit(row));
            }
        });
        if run.cancelled() {
            return Err(Cancelled);
        }
        Ok(Points::sorted(grid.lines(), &places, &unit))
    }

    fn sorted(lines: usize, places: &[Place], unit: &dyn Fn(usize) -> u32) -> Points {
        let mut points = Points {
            starts: vec![0; lines + 1],
            entries: Vec::new(),
            outside: 0,
            invalid: 0,
        };
        for place in places {
            match place {
                Place::Invalid => points.invalid += 1,
                Place::Outside => points.outside += 1,
                Place::In(line, _) => points.starts[*line as usize + 1] += 1,
            }
        }
        for line in 0..lines {
            points.starts[line + 1] += points.starts[line];
        }
        let mut next = points.starts.clone();
        points.entries = vec![Entry::default(); points.starts[lines]];
        for (row, place) in places.iter().enumerate() {
            if let Place::In(line, x) = *place {
                let to = &mut next[line as usize];
                let unit = unit(row);
                points.entries[*to] = Entry { x, unit };
                *to += 1;
            }
        }
        points
    }

    /// Number of localisations in the field.
    #[must_use]
    pub fn total(&self) -> usize {
        self.entries.len()
    }

    /// Number of localisations whose unit `chosen` takes.
    #[must_use]
    pub fn count(&self, chosen: &(dyn Fn(u32) -> bool + Sync)) -> usize {
        self.entries.iter().filter(|e| chosen(e.unit)).count()
    }

    fn counts(&self, line: usize, chosen: &(dyn Fn(u32) -> bool + Sync), to: &mut [f32]) -> bool {
        let entries = &self.entries[self.starts[line]..self.starts[line + 1]];
        for entry in entries {
            if chosen(entry.unit) {
                to[entry.x as usize] += 1.0;
            }
        }
        !entries.is_empty()
    }

    /// The spectrum of the image of the localisations whose unit `chosen` takes: counts less their
    /// weighted mean, under the window. The mean would otherwise correlate as the shape of the
    /// window does.
    ///
    /// # Errors
    /// When cancelled.
    pub fn spectrum(
        &self,
        run: &dyn Run,
        plan: &RealFft<f32>,
        window: &Window,
        chosen: &(dyn Fn(u32) -> bool + Sync),
    ) -> Result<Vec<Complex<f32>>, Cancelled> {
        let [_, height, width] = window.axes.each_ref().map(Vec::len);
        let lines = self.starts.len() - 1;
        let sums = map(run, lines.div_ceil(LINES), &|task| {
            let mut counts = vec![0.0_f32; width];
            let mut sum = 0.0;
            for line in task * LINES..lines.min((task + 1) * LINES) {
                if self.counts(line, chosen, &mut counts) {
                    let weighted = counts.iter().zip(&window.axes[2]);
                    let across: f64 = weighted.map(|(n, w)| f64::from(*n) * w).sum();
                    sum += window.line(line) * across;
                    counts.fill(0.0);
                }
            }
            sum
        });
        let mean = sums.into_iter().sum::<f64>() / window.power(1);
        let padded = plan.size()[1];
        plan.forward_rows(run, &|row, to| {
            let (z, y) = (row / padded, row % padded);
            let line = z * height + y;
            if y >= height || line >= lines || run.cancelled() {
                return false;
            }
            self.counts(line, chosen, to);
            let weight = window.line(line);
            for (value, w) in to.iter_mut().zip(&window.axes[2]) {
                *value = ((f64::from(*value) - mean) * weight * w) as f32;
            }
            true
        })
    }

    /// Sum of the squared weights of all localisations.
    #[must_use]
    pub fn squared_weights(&self, window: &Window) -> f64 {
        let line = |line: usize| {
            let entries = &self.entries[self.starts[line]..self.starts[line + 1]];
            let across: f64 = entries
                .iter()
                .map(|e| window.axes[2][e.x as usize].powi(2))
                .sum();
            across * window.line(line).powi(2)
        };
        (0..self.starts.len() - 1).map(line).sum()
    }
}

fn place(grid: &Grid, at: Positions<'_>, row: usize, unit: u32) -> Place {
    let [z, y, x] = at.map(|column| column.get(row).copied().unwrap_or(0.0));
    let finite = x.is_finite() && y.is_finite() && z.is_finite();
    if !finite || unit == NONE {
        return Place::Invalid;
    }
    let flat = grid.size[0] == 1;
    let depth = if flat { Some(0) } else { grid.place(0, z) };
    match (depth, grid.place(1, y), grid.place(2, x)) {
        (Some(z), Some(y), Some(x)) => Place::In((z * grid.size[1] + y) as u32, x as u32),
        _ => Place::Outside,
    }
}
