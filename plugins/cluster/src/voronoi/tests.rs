use super::*;
use crate::testing::Random;
use puncta_sdk::run::Serial;
use puncta_testkit::{Stopped, Threads};

fn columns<const D: usize>(at: &[[f64; D]]) -> [Vec<f64>; D] {
    std::array::from_fn(|axis| at.iter().map(|point| point[axis]).collect())
}

#[test]
fn cells_in_the_plane_fill_the_box_and_have_the_neighbours_of_delaunay() {
    use spade::{DelaunayTriangulation, Point2, Triangulation};
    let mut random = Random(21);
    let at: Vec<[f64; 2]> = (0..3000)
        .map(|_| [1e6 + 900.0 * random.unit(), 700.0 * random.unit()])
        .collect();
    let [x, y] = columns(&at);
    let tree = Tree::new([&x, &y], &Serial).unwrap();
    let (low, high) = ([1e6 - 1e5, -1e5], [1e6 + 1e5, 1e5]);
    let cells = plane(&tree, low, high, &Threads(2)).unwrap();
    let sum: f64 = cells.iter().map(|cell| cell.size).sum();
    assert!((sum / 4e10 - 1.0).abs() < 1e-12);
    let points = tree.at.iter().map(|p| Point2::new(p[0], p[1])).collect();
    let triangles: DelaunayTriangulation<Point2<f64>> =
        DelaunayTriangulation::bulk_load_stable(points).unwrap();
    for (point, cell) in cells.iter().enumerate() {
        let vertex = triangles.vertex(spade::handles::FixedVertexHandle::from_index(point));
        let mut near: Vec<u32> = vertex
            .out_edges()
            .map(|edge| edge.to().index() as u32)
            .collect();
        near.sort_unstable();
        // Near the hull the border of two cells may lie outside of the box.
        let [x, y] = tree.at[point];
        let inner = x > 1e6 + 100.0 && x < 1e6 + 800.0 && y > 100.0 && y < 600.0;
        if inner {
            assert_eq!(cell.near, near);
        }
    }
    for threads in [1, 3] {
        assert_eq!(plane(&tree, low, high, &Threads(threads)).unwrap(), cells);
    }
    assert!(plane(&tree, low, high, &Stopped).is_err());
}

#[test]
fn cells_of_lattices_are_squares_and_cubes() {
    let flat: Vec<[f64; 2]> = (0..100)
        .map(|k| [f64::from(k % 10) * 10.0, f64::from(k / 10) * 10.0])
        .collect();
    let [x, y] = columns(&flat);
    let tree = Tree::new([&x, &y], &Serial).unwrap();
    for cell in plane(&tree, [-5.0; 2], [95.0; 2], &Serial).unwrap() {
        assert!((cell.size - 100.0).abs() < 1e-9);
        assert!(cell.near.len() >= 2);
    }
    let cubes: Vec<[f64; 3]> = (0..1000)
        .map(|k| [k % 10, k / 10 % 10, k / 100].map(|k| f64::from(k) * 10.0))
        .collect();
    let [x, y, z] = columns(&cubes);
    let tree = Tree::new([&x, &y, &z], &Serial).unwrap();
    for cell in space(&tree, [-5.0; 3], [95.0; 3], &Serial).unwrap() {
        assert!((cell.size - 1000.0).abs() < 1e-8, "{}", cell.size);
        assert!(cell.near.len() >= 3);
    }
}

#[test]
fn cells_in_space_fill_the_box_and_hold_what_is_nearest() {
    let mut random = Random(9);
    let at: Vec<[f64; 3]> = (0..800)
        .map(|_| [0, 1, 2].map(|_| 100.0 * random.unit().powi(2)))
        .collect();
    let [x, y, z] = columns(&at);
    let tree = Tree::new([&x, &y, &z], &Serial).unwrap();
    let cells = space(&tree, [0.0; 3], [100.0; 3], &Threads(2)).unwrap();
    let sum: f64 = cells.iter().map(|cell| cell.size).sum();
    assert!((sum / 1e6 - 1.0).abs() < 1e-9, "{sum}");
    // The second nearest point of any position is a neighbour of the nearest.
    let mut found = vec![];
    let mut hits = vec![0.0; at.len()];
    for _ in 0..100_000 {
        tree.nearest(&[0, 1, 2].map(|_| 100.0 * random.unit()), 2, &mut found);
        assert!(cells[found[0].1 as usize].near.contains(&found[1].1));
        hits[found[0].1 as usize] += 10.0;
    }
    for (cell, hits) in cells.iter().zip(hits) {
        assert!((cell.size - hits).abs() < 60.0 + 6.0 * (10.0 * cell.size).sqrt());
    }
}
