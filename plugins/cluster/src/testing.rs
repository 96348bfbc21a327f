//! What several tests of this plugin need.

pub use puncta_testkit::Random;
use std::collections::HashMap;
use std::path::PathBuf;

/// Gaussian clusters in a cube of side 1 um per cluster's root, with noise of label 0.
pub fn planted(
    clusters: usize,
    size: usize,
    sigma: f64,
    noise: usize,
) -> ([Vec<f64>; 3], Vec<i32>) {
    planted_by(clusters as u64, clusters, size, sigma, noise)
}

/// As [`planted`], with a seed.
pub fn planted_by(
    seed: u64,
    clusters: usize,
    size: usize,
    sigma: f64,
    noise: usize,
) -> ([Vec<f64>; 3], Vec<i32>) {
    let mut random = Random(seed);
    let side = 1000.0 * (clusters as f64).sqrt().ceil();
    let columns = (clusters as f64).sqrt().ceil() as usize;
    let (mut at, mut labels) = ([vec![], vec![], vec![]], vec![]);
    for cluster in 0..clusters {
        let centre = [
            (cluster % columns) as f64 * 1000.0 + 300.0 + 400.0 * random.unit(),
            (cluster / columns) as f64 * 1000.0 + 300.0 + 400.0 * random.unit(),
            400.0 * random.unit(),
        ];
        for _ in 0..size {
            for axis in 0..3 {
                at[axis].push(centre[axis] + sigma * random.normal());
            }
            labels.push(cluster as i32 + 1);
        }
    }
    for _ in 0..noise {
        at[0].push(side * random.unit());
        at[1].push(side * random.unit());
        at[2].push(400.0 * random.unit());
        labels.push(0);
    }
    (at, labels)
}

/// Hubert and Arabie's adjusted Rand index.
pub fn adjusted_rand(a: &[i32], b: &[i32]) -> f64 {
    let pairs = |counts: &HashMap<(i32, i32), u64>| -> f64 {
        counts
            .values()
            .map(|n| (n * (n.max(&1) - 1)) as f64 / 2.0)
            .sum()
    };
    let count = |key: &dyn Fn(usize) -> (i32, i32)| {
        let mut counts = HashMap::new();
        (0..a.len()).for_each(|row| *counts.entry(key(row)).or_insert(0) += 1);
        counts
    };
    let both = pairs(&count(&|row| (a[row], b[row])));
    let (first, second) = (
        pairs(&count(&|row| (a[row], 0))),
        pairs(&count(&|row| (b[row], 0))),
    );
    let all = (a.len() * (a.len() - 1)) as f64 / 2.0;
    let expected = first * second / all;
    (both - expected) / (0.5 * (first + second) - expected)
}

/// Renumbers groups above 0 by their first row, so that two groupings can be compared.
pub fn canonical(labels: &[i32]) -> Vec<i32> {
    let mut known = HashMap::new();
    let number = |label: &i32| {
        if *label <= 0 {
            return 0;
        }
        let next = known.len() as i32 + 1;
        *known.entry(*label).or_insert(next)
    };
    labels.iter().map(number).collect()
}

/// Columns of a real data file with commas, by header name or place; None where it is not there.
pub fn real(file: &str, columns: [&str; 3]) -> Option<[Vec<f64>; 3]> {
    let root = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../..");
    let text = std::fs::read_to_string(root.join("../shared/data").join(file)).ok()?;
    let mut lines = text.lines();
    let head: Vec<String> = lines
        .next()?
        .split(',')
        .map(|name| name.trim_matches('"').to_owned())
        .collect();
    let place = |name: &str| head.iter().position(|known| known == name);
    let places = columns.map(|name| name.parse().ok().or_else(|| place(name)));
    let mut out = [vec![], vec![], vec![]];
    let headless = head[0].parse::<f64>().is_ok();
    let first = if headless { text.lines().next() } else { None };
    for line in first.into_iter().chain(lines) {
        let fields: Vec<&str> = line.split(',').collect();
        for (values, place) in out.iter_mut().zip(places) {
            if let Some(place) = place {
                values.push(fields.get(place)?.trim().parse().ok()?);
            }
        }
    }
    Some(out)
}
