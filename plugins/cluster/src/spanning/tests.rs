use super::*;
use crate::testing::Random;
use puncta_sdk::run::Serial;
use puncta_testkit::{Stopped, Threads};

/// The lengths of the tree by Prim's algorithm on all pairs, shortest first.
fn brute<const D: usize>(at: &[[f64; D]], min_samples: usize) -> Vec<f64> {
    let core: Vec<f64> = at
        .iter()
        .map(|a| {
            let mut all: Vec<f64> = at.iter().map(|b| square(a, b)).collect();
            all.sort_by(f64::total_cmp);
            all[min_samples.min(at.len()) - 1]
        })
        .collect();
    let mut reach = vec![f64::INFINITY; at.len()];
    let mut done = vec![false; at.len()];
    let (mut last, mut lengths) = (0, vec![]);
    for _ in 1..at.len() {
        done[last] = true;
        for other in (0..at.len()).filter(|other| !done[*other]) {
            let distance = square(&at[last], &at[other])
                .max(core[last])
                .max(core[other]);
            reach[other] = reach[other].min(distance);
        }
        let open = (0..at.len()).filter(|other| !done[*other]);
        last = open.min_by(|a, b| reach[*a].total_cmp(&reach[*b])).unwrap();
        lengths.push(reach[last]);
    }
    lengths.sort_by(f64::total_cmp);
    lengths
}

fn check<const D: usize>(at: &[[f64; D]], min_samples: usize) {
    let columns: [Vec<f64>; D] = std::array::from_fn(|axis| at.iter().map(|p| p[axis]).collect());
    let tree = Tree::new(columns.each_ref().map(|c| &c[..]), &Serial).unwrap();
    let core = core_squares(&tree, min_samples, &Threads(2)).unwrap();
    let edges = spanning_tree(&tree, &core, &Threads(2)).unwrap();
    let lengths: Vec<f64> = edges.iter().map(|edge| edge.square).collect();
    assert_eq!(lengths, brute(at, min_samples));
    let again = spanning_tree(&tree, &core, &Threads(3)).unwrap();
    assert_eq!(again, edges);
    assert_eq!(spanning_tree(&tree, &core, &Serial).unwrap(), edges);
}

#[test]
fn the_tree_is_minimal_on_random_lattice_and_coincident_points() {
    let mut random = Random(5);
    for min_samples in [1, 2, 5, 1000] {
        let plane: Vec<[f64; 2]> = (0..400).map(|_| [random.unit(), random.unit()]).collect();
        check(&plane, min_samples);
        let space: Vec<[f64; 3]> = (0..300)
            .map(|_| [random.normal(), random.normal(), random.normal()])
            .collect();
        check(&space, min_samples);
        let lattice: Vec<[f64; 2]> = (0..256)
            .map(|k| [f64::from(k % 16), f64::from(k / 16)])
            .collect();
        check(&lattice, min_samples);
        check(&vec![[3.0, 4.0]; 100], min_samples);
        check(&[[1.0, 1.0]], min_samples);
    }
}

#[test]
fn nearest_neighbours_are_those_of_brute_force() {
    let mut random = Random(2);
    let at: Vec<[f64; 2]> = (0..500)
        .map(|_| {
            [
                (random.unit() * 40.0).floor(),
                (random.unit() * 40.0).floor(),
            ]
        })
        .collect();
    let columns = [0, 1].map(|axis| at.iter().map(|p: &[f64; 2]| p[axis]).collect::<Vec<_>>());
    let tree = Tree::new([&columns[0], &columns[1]], &Serial).unwrap();
    let mut found = vec![];
    for from in &at {
        tree.nearest(from, 9, &mut found);
        let rows: Vec<(f64, u32)> = found
            .iter()
            .map(|(d, point)| (*d, tree.order[*point as usize]))
            .collect();
        let mut all: Vec<(f64, u32)> = at
            .iter()
            .enumerate()
            .map(|(row, to)| (square(from, to), row as u32))
            .collect();
        all.sort_by(|a, b| a.partial_cmp(b).unwrap());
        assert_eq!(rows, all[..9]);
    }
    assert!(Tree::new([&columns[0], &columns[1]], &Stopped).is_err());
}
