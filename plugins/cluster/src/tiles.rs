//! Densities from Voronoi cells, and the clusters of neighbouring dense ones.

use crate::tree::{Tree, square};
use crate::union::Union;
use crate::voronoi::{self, Cell};
use puncta_sdk::{Cancelled, Failure, Run};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

/// In no cluster.
const NONE: usize = usize::MAX;
/// Most rounds in which the background is found.
const ROUNDS: usize = 50;

/// The tessellation of a table.
#[derive(Debug)]
pub struct Tiles {
    cells: Vec<Cell>,
    /// Position of each cell's localisations; 0 along an axis that is not there.
    at: Vec<[f64; 3]>,
    /// Number of axes.
    axes: u32,
    /// Rows at each position, the first of which is in the tree.
    rows: Vec<Vec<u32>>,
    /// Density of each cell and its neighbours.
    density: Vec<f64>,
    /// Localisations for the size of the box.
    pub mean: f64,
}

impl Tiles {
    /// Cuts the box around the finite positions into cells.
    ///
    /// # Errors
    /// When cancelled, or when the positions lie on a line (in space: in a plane) along the axes.
    pub fn new<const D: usize>(at: [&[f64]; D], run: &dyn Run) -> Result<Tiles, Failure> {
        let (firsts, rows) = positions(at);
        let columns = at.map(|values| {
            firsts
                .iter()
                .map(|row| values[*row as usize])
                .collect::<Vec<f64>>()
        });
        let tree = Tree::new(columns.each_ref().map(|column| &column[..]), run)?;
        let Some(root) = tree.nodes.first() else {
            return Ok(Tiles {
                cells: Vec::new(),
                at: Vec::new(),
                axes: 0,
                rows: Vec::new(),
                density: Vec::new(),
                mean: f64::NAN,
            });
        };
        let (low, high) = (root.low, root.high);
        let volume: f64 = (0..D).map(|axis| high[axis] - low[axis]).product();
        if volume <= 0.0 {
            let what = if D == 3 { "in a plane" } else { "on a line" };
            return Err(
                Failure::bad_input(format!("all localisations lie {what}, without cells"))
                    .remedy("work in the plane, or on more localisations"),
            );
        }
        let cells = cut(&tree, low, high, run)?;
        let count: usize = rows.iter().map(Vec::len).sum();
        let place = |at: &[f64; D]| std::array::from_fn(|k| at.get(k).copied().unwrap_or(0.0));
        let mut tiles = Tiles {
            at: tree.at.iter().map(place).collect(),
            axes: if D == 3 { 3 } else { 2 },
            rows: tree
                .order
                .iter()
                .map(|place| rows[*place as usize].clone())
                .collect(),
            density: Vec::new(),
            mean: count as f64 / volume,
            cells,
        };
        tiles.density = (0..tiles.cells.len())
            .map(|point| tiles.local(point))
            .collect();
        Ok(tiles)
    }

    /// First-rank density: localisations of a cell and its neighbours over their size.
    fn local(&self, point: usize) -> f64 {
        let cell = &self.cells[point];
        let mut count = self.rows[point].len();
        let mut size = cell.size;
        for other in &cell.near {
            count += self.rows[*other as usize].len();
            size += self.cells[*other as usize].size;
        }
        count as f64 / size
    }

    /// Clusters of at least `min_size` localisations whose density is at least `least`: number of
    /// each row, from 1 by the first row, and sizes. With `border` a localisation next to a cluster
    /// joins it as [`Tiles::join_border`] says.
    #[must_use]
    pub fn clusters(
        &self,
        least: f64,
        min_size: usize,
        border: bool,
        rows: usize,
    ) -> (Vec<i32>, Vec<u64>) {
        let mut roots = self.dense(least, min_size);
        if border {
            self.join_border(least, &mut roots);
        }
        let mut of_row = vec![NONE; rows];
        for (rows, root) in self.rows.iter().zip(&roots) {
            rows.iter().for_each(|row| of_row[*row as usize] = *root);
        }
        let mut number = vec![0; self.cells.len()];
        let mut sizes: Vec<u64> = Vec::new();
        let mut label = |root: usize| {
            if root == NONE {
                return 0;
            }
            if number[root] == 0 {
                sizes.push(0);
                number[root] = sizes.len();
            }
            sizes[number[root] - 1] += 1;
            i32::try_from(number[root]).unwrap_or(i32::MAX)
        };
        let labels = of_row.into_iter().map(&mut label).collect();
        (labels, sizes)
    }

    /// For each cell a cell that stands for its cluster, or [`NONE`]. Clusters are neighbouring
    /// cells of at least the density `least`, of at least `min_size` localisations.
    fn dense(&self, least: f64, min_size: usize) -> Vec<usize> {
        let dense = |point: usize| self.density[point] >= least;
        let union = Union::new(self.cells.len());
        for point in (0..self.cells.len()).filter(|point| dense(*point)) {
            for other in self.cells[point].near.iter().map(|other| *other as usize) {
                if other < point && dense(other) {
                    union.join(point, other);
                }
            }
        }
        let mut sizes = vec![0; self.cells.len()];
        let mut roots = vec![NONE; self.cells.len()];
        for point in (0..self.cells.len()).filter(|point| dense(*point)) {
            roots[point] = union.root(point);
            sizes[roots[point]] += self.rows[point].len();
        }
        for root in roots.iter_mut().filter(|root| **root != NONE) {
            if sizes[*root] < min_size {
                *root = NONE;
            }
        }
        roots
    }

    /// The outermost localisations of a cluster have large neighbours, so that their density is too
    /// low. One joins the cluster of the nearest neighbour in a cluster if that is so near that a
    /// disc (ball) of the density `least` about it holds one localisation.
    fn join_border(&self, least: f64, roots: &mut [usize]) {
        let disc = match self.axes {
            3 => 4.0 / 3.0 * std::f64::consts::PI,
            _ => std::f64::consts::PI,
        };
        let reach = (1.0 / (disc * least)).powf(1.0 / f64::from(self.axes));
        let inner = roots.to_vec();
        for (point, root) in roots.iter_mut().enumerate().filter(|(_, r)| **r == NONE) {
            let near = self.cells[point].near.iter().map(|other| *other as usize);
            let distance = |other: usize| square(&self.at[point], &self.at[other]).sqrt();
            let nearest = near
                .filter(|other| inner[*other] != NONE)
                .map(|other| (distance(other), other))
                .min_by(|a, b| {
                    a.0.total_cmp(&b.0)
                        .then(self.rows[a.1].cmp(&self.rows[b.1]))
                });
            if let Some((distance, other)) = nearest
                && distance <= reach
            {
                *root = inner[other];
            }
        }
    }

    /// The density outside clusters whose density is at least `factor` times this very density:
    /// localisations for their cells' size. Found by starting from the mean density.
    ///
    /// # Errors
    /// When cancelled.
    pub fn background(
        &self,
        factor: f64,
        min_size: usize,
        run: &dyn Run,
    ) -> Result<f64, Cancelled> {
        let mut density = self.mean;
        for round in 0..ROUNDS {
            run.progress(
                0.8 + 0.1 * round as f64 / ROUNDS as f64,
                "finding the background",
            )?;
            let roots = self.dense(factor * density, min_size);
            let outside = (0..roots.len()).filter(|point| roots[*point] == NONE);
            let (mut count, mut size) = (0, 0.0);
            for point in outside {
                count += self.rows[point].len();
                size += self.cells[point].size;
            }
            // The densities fall from round to round; there is no background if nothing is left.
            if count == 0 || count as f64 / size >= density {
                break;
            }
            density = count as f64 / size;
        }
        Ok(density)
    }

    /// Calls `visit` with each row, the size of its cell and its density.
    pub fn each_row(&self, mut visit: impl FnMut(usize, f64, f64)) {
        for (point, rows) in self.rows.iter().enumerate() {
            for row in rows {
                visit(*row as usize, self.cells[point].size, self.density[point]);
            }
        }
    }

    /// Density of each cell.
    #[cfg(test)]
    pub(crate) fn densities(&self) -> &[f64] {
        &self.density
    }
}

/// The first row at each finite position, and all rows there.
fn positions<const D: usize>(at: [&[f64]; D]) -> (Vec<u32>, Vec<Vec<u32>>) {
    let position = |row: u32| -> [f64; D] { at.map(|values| values[row as usize] + 0.0) };
    #[allow(clippy::cast_possible_truncation)]
    let mut order: Vec<u32> = (0..at[0].len() as u32)
        .filter(|row| position(*row).iter().all(|value| value.is_finite()))
        .collect();
    let compare = |a: &u32, b: &u32| {
        let (a, b) = (position(*a), position(*b));
        let axes = a.iter().zip(&b).map(|(a, b)| a.total_cmp(b));
        axes.fold(std::cmp::Ordering::Equal, std::cmp::Ordering::then)
    };
    order.sort_by(compare);
    let (mut firsts, mut rows): (Vec<u32>, Vec<Vec<u32>>) = (Vec::new(), Vec::new());
    for row in order {
        match (firsts.last(), rows.last_mut()) {
            (Some(first), Some(same)) if position(*first) == position(row) => same.push(row),
            _ => {
                firsts.push(row);
                rows.push(vec![row]);
            }
        }
    }
    (firsts, rows)
}

fn cut<const D: usize>(
    tree: &Tree<D>,
    low: [f64; D],
    high: [f64; D],
    run: &dyn Run,
) -> Result<Vec<Cell>, Cancelled> {
    // The two kinds of region have their own number of axes.
    match D {
        2 => {
            let at = tree.at.iter().map(|p| [p[0], p[1]]).collect();
            let nodes = tree.nodes.iter().map(node).collect();
            let order = tree.order.clone();
            voronoi::plane(
                &Tree { order, at, nodes },
                [low[0], low[1]],
                [high[0], high[1]],
                run,
            )
        }
        _ => {
            let at = tree.at.iter().map(|p| [p[0], p[1], p[D - 1]]).collect();
            let nodes = tree.nodes.iter().map(node).collect();
            let order = tree.order.clone();
            let (low, high) = (
                [low[0], low[1], low[D - 1]],
                [high[0], high[1], high[D - 1]],
            );
            voronoi::space(&Tree { order, at, nodes }, low, high, run)
        }
    }
}

fn node<const D: usize, const E: usize>(node: &crate::tree::Node<D>) -> crate::tree::Node<E> {
    crate::tree::Node {
        low: std::array::from_fn(|axis| node.low[axis]),
        high: std::array::from_fn(|axis| node.high[axis]),
        points: node.points.clone(),
        second: node.second,
    }
}

/// The density, over the mean, that a share `level` of localisations stays below under complete
/// spatial randomness. It depends on neither the density nor the size of the box.
///
/// # Errors
/// When cancelled.
pub fn random_factor<const D: usize>(
    count: usize,
    level: f64,
    seed: u64,
    run: &dyn Run,
) -> Result<f64, Failure> {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut unit = || (random.next_u64() >> 11) as f64 / (1_u64 << 53) as f64;
    let columns: [Vec<f64>; D] = std::array::from_fn(|_| (0..count).map(|_| unit()).collect());
    let tiles = Tiles::new(columns.each_ref().map(|column| &column[..]), run)?;
    let mut density = tiles.density;
    density.sort_by(f64::total_cmp);
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
    let place = (level * density.len() as f64) as usize;
    let at = density.get(place.min(density.len().saturating_sub(1)));
    Ok(at.copied().unwrap_or(f64::NAN) / tiles.mean)
}
