//! What several tests of this plugin need.

use crate::chain::{Chains, chain};
use crate::spots::{Radius, Rows, spots};
pub use puncta_testkit::Random;
use puncta_testkit::Threads;

/// Localisations of a test.
#[derive(Clone, Default)]
pub struct Set {
    pub x: Vec<f64>,
    pub y: Vec<f64>,
    pub z: Vec<f64>,
    pub t: Vec<f64>,
    pub sigma: Vec<f64>,
}

impl Set {
    /// Bursts of molecules in a square, with some far and some wide localisations.
    pub fn bursts(molecules: usize, side: f64, frames: f64, seed: u64) -> Set {
        let mut random = Random(seed);
        let mut set = Set::default();
        for _ in 0..molecules {
            let (x, y) = (random.unit() * side, random.unit() * side);
            let mut t = (random.unit() * frames).floor();
            while random.unit() < 0.75 {
                let wide = if random.unit() < 0.01 { 30.0 } else { 1.0 };
                let sigma = (4.0 + 12.0 * random.unit()) * wide;
                set.x.push(x + random.normal() * sigma);
                set.y.push(y + random.normal() * sigma);
                set.z.push(random.normal() * 3.0 * sigma);
                set.t.push(t);
                set.sigma.push(sigma);
                t += 1.0 + (random.unit() * 1.4).floor();
            }
        }
        set.x.push(1e9);
        set.y.push(-1e9);
        set.z.push(0.0);
        set.t.push(3.0);
        set.sigma.push(1.0);
        set.shuffled(seed)
    }

    /// The rows in a random order.
    pub fn shuffled(&self, seed: u64) -> Set {
        let mut random = Random(seed ^ 0x5555);
        let mut order: Vec<(u64, usize)> =
            (0..self.x.len()).map(|row| (random.next(), row)).collect();
        order.sort_unstable();
        self.picked(&order.iter().map(|pair| pair.1).collect::<Vec<_>>())
    }

    /// These rows.
    pub fn picked(&self, rows: &[usize]) -> Set {
        let pick = |values: &[f64]| rows.iter().map(|row| values[*row]).collect();
        Set {
            x: pick(&self.x),
            y: pick(&self.y),
            z: pick(&self.z),
            t: pick(&self.t),
            sigma: pick(&self.sigma),
        }
    }

    /// By frame; rows of a frame keep their order.
    pub fn by_frame(&self) -> Set {
        let mut rows: Vec<usize> = (0..self.x.len()).collect();
        rows.sort_by(|a, b| self.t[*a].total_cmp(&self.t[*b]));
        self.picked(&rows)
    }

    pub fn rows<'a>(&'a self, radius: Radius<'a>, axial: bool) -> Rows<'a> {
        Rows {
            x: &self.x,
            y: &self.y,
            t: &self.t,
            radius,
            axial: axial.then_some((&self.z[..], Radius::Constant(100.0))),
        }
    }

    pub fn combined(&self, scale: f64) -> Radius<'_> {
        Radius::Combined {
            sigma: &self.sigma,
            scale,
        }
    }

    /// The chains, with the label of each row.
    pub fn chain(&self, radius: Radius<'_>, axial: bool, gap: u64) -> (Chains, Vec<u32>) {
        let rows = self.rows(radius, axial);
        let spots = spots(&rows, &Threads(2)).unwrap();
        let chains = chain(&spots, gap, &Threads(2)).unwrap();
        let mut labels = vec![0; self.x.len()];
        for (place, label) in chains.labels.iter().enumerate() {
            labels[spots.row(place)] = *label;
        }
        (chains, labels)
    }
}

/// Renumbers groups by their first row, so that two groupings can be compared.
pub fn canonical(labels: &[u32]) -> Vec<u32> {
    let mut known = std::collections::HashMap::new();
    let number = |label: &u32| {
        let next = known.len() as u32;
        *known.entry(*label).or_insert(next)
    };
    labels.iter().map(number).collect()
}
