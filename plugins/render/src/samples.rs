//! Random samples of positions, for renderings that average over them.

use crate::grid::Axis;
use crate::spots::ONE;
use puncta_sdk::{Cancelled, Failure, Run};
use puncta_shared_neighbours::Grid;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use rand_distr::{Distribution, StandardNormal};

/// Rows between two looks at cancel.
const BATCH: usize = 1 << 14;

/// How the samples are drawn.
#[derive(Debug, Clone, Copy)]
pub struct Sampling {
    /// Number of samples.
    pub samples: u32,
    /// Probability that a localisation is in a sample.
    pub keep: f64,
    /// Seed.
    pub seed: u64,
}

/// Localisations inside the grid: positions in pixels from its corner, and the standard deviation of
/// their jitter along each axis, in pixels.
#[derive(Debug, Clone)]
pub struct Cloud<const D: usize> {
    /// Positions.
    pub points: Vec<[f64; D]>,
    /// Jitter.
    pub spread: Vec<[f64; D]>,
    /// Rows with a position or jitter that is NaN or infinite, or a negative jitter.
    pub invalid: u64,
}

impl<const D: usize> Cloud<D> {
    /// The localisations of columns in nm. `jitter` (nm) is multiplied by `scale` and raised to
    /// `least`. Localisations outside the grid are kept: their triangles may reach into it.
    pub fn new(
        columns: [&[f64]; D],
        jitter: &[f64],
        scale: f64,
        least: f64,
        axes: &[Axis; D],
    ) -> Self {
        let rows = columns
            .iter()
            .map(|c| c.len())
            .min()
            .unwrap_or(0)
            .min(jitter.len());
        let mut cloud = Cloud {
            points: Vec::with_capacity(rows),
            spread: Vec::with_capacity(rows),
            invalid: 0,
        };
        for i in 0..rows {
            let fixed: [Option<i64>; D] = std::array::from_fn(|a| axes[a].fixed(columns[a][i]));
            let sigma = (jitter[i] * scale).max(least);
            let valid =
                fixed.iter().all(Option::is_some) && jitter[i] >= 0.0 && sigma < f64::INFINITY;
            if !valid {
                cloud.invalid += 1;
                continue;
            }
            cloud
                .points
                .push(fixed.map(|u| u.unwrap_or(0) as f64 / ONE));
            cloud
                .spread
                .push(std::array::from_fn(|a| sigma / axes[a].size()));
        }
        cloud
    }

    /// The positions of a sample; the same whatever the number of threads and other samples.
    ///
    /// # Errors
    /// When cancelled.
    pub fn sample(
        &self,
        sampling: &Sampling,
        number: u32,
        run: &dyn Run,
    ) -> Result<Vec<[f64; D]>, Cancelled> {
        let mut key = [0; 32];
        key[..8].copy_from_slice(&sampling.seed.to_le_bytes());
        key[8..12].copy_from_slice(&number.to_le_bytes());
        let mut random = ChaCha8Rng::from_seed(key);
        let room = self.points.len() as f64 * sampling.keep;
        let mut out = Vec::with_capacity(room as usize + 1);
        for (i, (point, spread)) in self.points.iter().zip(&self.spread).enumerate() {
            if i % BATCH == 0 && run.cancelled() {
                return Err(Cancelled);
            }
            if sampling.keep < 1.0 {
                let uniform = (random.next_u64() >> 11) as f64 / (1_u64 << 53) as f64;
                if uniform >= sampling.keep {
                    continue;
                }
            }
            out.push(std::array::from_fn(|a| {
                if spread[a] == 0.0 {
                    return point[a];
                }
                let by: f64 = StandardNormal.sample(&mut random);
                point[a] + spread[a] * by
            }));
        }
        Ok(out)
    }
}

/// Points without repeats, in order of their coordinates, and how often each was there.
pub(crate) fn distinct<const D: usize>(mut points: Vec<[f64; D]>) -> (Vec<[f64; D]>, Vec<u32>) {
    let order = |a: &[f64; D], b: &[f64; D]| {
        let each = a.iter().zip(b).map(|(a, b)| a.total_cmp(b));
        each.fold(std::cmp::Ordering::Equal, std::cmp::Ordering::then)
    };
    points.sort_unstable_by(order);
    let mut counts: Vec<u32> = Vec::with_capacity(points.len());
    let mut out: Vec<[f64; D]> = Vec::with_capacity(points.len());
    for point in points {
        // As near as a triangulation takes for the same.
        let near = |last: &[f64; D]| last.iter().zip(&point).all(|(a, b)| (a - b).abs() < 1e-12);
        match (out.last(), counts.last_mut()) {
            (Some(last), Some(count)) if near(last) => *count += 1,
            _ => {
                out.push(point);
                counts.push(1);
            }
        }
    }
    (out, counts)
}

/// Distance from the k-th nearest neighbour of each row, in nm; from the farthest where there are
/// fewer. NaN for rows without a position.
///
/// # Errors
/// When there are more rows than can be numbered; when cancelled.
pub fn neighbour_distances<const D: usize>(
    columns: [&[f64]; D],
    k: usize,
    run: &dyn Run,
) -> Result<Vec<f64>, Failure> {
    let finite = |i: usize| columns.iter().all(|c| c[i].is_finite());
    let rows = columns.iter().map(|c| c.len()).min().unwrap_or(0);
    let count = (0..rows).filter(|i| finite(*i)).count();
    let k = k.min(count.saturating_sub(1)).max(1);
    let grid = Grid::for_nearest(columns, [1.0; D], k, run)?;
    Ok(grid.nearest_distances(k, run)?)
}
