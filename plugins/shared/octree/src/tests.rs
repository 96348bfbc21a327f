use crate::{BITS, Cube, Limits, NONE, Octree, Points, Tree, bounds, decode, encode};
use puncta_sdk::run::Serial;
use puncta_testkit::Threads;

const CUBE: Cube = Cube {
    low: [-100.0, 50.0, 0.0],
    side: 1024.0,
};

/// Points of which some coincide, some lie on a lattice, and some have no place.
fn cloud(count: usize) -> [Vec<f64>; 3] {
    let mut state = 7u64;
    let mut next = || {
        state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1u64 << 53) as f64
    };
    let mut columns: [Vec<f64>; 3] = Default::default();
    for i in 0..count {
        let mut point = [next(), next(), next()].map(|u| 300.0 * u * u + 100.0);
        match i % 10 {
            0 => point = point.map(|x| (x / 16.0).floor() * 16.0),
            1 => point = [333.0, 222.0, 111.0],
            2 if i % 100 == 2 => point[i / 100 % 3] = f64::NAN,
            _ => {}
        }
        for axis in 0..3 {
            columns[axis].push(point[axis] + CUBE.low[axis]);
        }
    }
    columns
}

fn points(count: usize) -> Points {
    let [x, y, z] = cloud(count);
    Points::new([&x, &y, &z], CUBE, &Serial).expect("points")
}

fn limits(capacity: u32) -> Limits {
    Limits {
        capacity,
        max_level: 12,
    }
}

#[test]
fn keys_interleave_the_bits() {
    assert_eq!(encode([1, 0, 0]), 1);
    assert_eq!(encode([0, 1, 0]), 2);
    assert_eq!(encode([0, 0, 1]), 4);
    assert_eq!(encode([3, 0, 1]), 0b001_101);
    let most = (1 << BITS) - 1;
    for place in [[most, 0, 5], [12345, 1 << 19, most], [0, 77, 999_999]] {
        assert_eq!(decode(encode(place)), place);
    }
}

#[test]
fn points_are_sorted_whatever_the_threads() {
    let [x, y, z] = cloud(200_001);
    let one = Points::new([&x, &y, &z], CUBE, &Serial).expect("points");
    assert_eq!(one.left_out(), 2_001 - 1);
    assert_eq!(one.len() + one.left_out(), 200_001);
    assert!(one.keys().is_sorted());
    let mut keys: Vec<u64> = (0..x.len())
        .filter_map(|i| CUBE.place([x[i], y[i], z[i]]).map(encode))
        .collect();
    keys.sort_unstable();
    assert_eq!(one.keys(), keys);
    let three = Points::new([&x, &y, &z], CUBE, &Threads(3)).expect("points");
    assert_eq!(one.keys(), three.keys());
    let (a, b) = (
        Octree::new(&one, limits(20), &Serial).expect("octree"),
        Octree::new(&one, limits(20), &Threads(3)).expect("octree"),
    );
    assert_eq!(
        (&a.keys, &a.levels, &a.starts),
        (&b.keys, &b.levels, &b.starts)
    );
}

#[test]
fn leaves_fill_the_cube_and_hold_their_points() {
    let points = points(20_000);
    let octree = Octree::new(&points, limits(20), &Serial).expect("octree");
    let mut volume = 0.0;
    let mut next = 0;
    for leaf in 0..octree.len() {
        assert_eq!(octree.key(leaf), next, "no gap before leaf {leaf}");
        next += 1 << (3 * (BITS - octree.level(leaf)));
        volume += octree.size(leaf).powi(3);
        assert!(octree.count(leaf) <= 20 || octree.level(leaf) == 12);
        let (centre, half) = (octree.centre(leaf), octree.size(leaf) / 2.0);
        assert_eq!(octree.leaf_at(centre), Some(leaf));
        for i in octree.points(leaf) {
            let place = points.place(i);
            assert!((0..3).all(|a| (place[a] - centre[a]).abs() <= half));
        }
    }
    assert!((volume / 1024f64.powi(3) - 1.0).abs() < 1e-12);
    let boxes = octree.boxes();
    let total: f64 = (0..octree.len())
        .map(|i| boxes.density[i] * boxes.size[i].powi(3))
        .sum();
    assert!((total - points.len() as f64).abs() < 1e-6);
    assert_eq!(boxes.count.iter().sum::<u32>() as usize, points.len());
    assert_eq!(octree.leaf_at([-101.0, 60.0, 1.0]), None);
    assert_eq!(octree.leaf_at([f64::NAN, 60.0, 1.0]), None);
}

#[test]
fn neighbours_touch() {
    let octree = Octree::new(&points(5_000), limits(20), &Serial).expect("octree");
    for leaf in 0..octree.len() {
        for step in [[1, 0, 0], [0, -1, 0], [1, 1, -1]] {
            let found = octree.neighbours(leaf, step);
            let (centre, size) = (octree.centre(leaf), octree.size(leaf));
            let there: [f64; 3] = std::array::from_fn(|a| centre[a] + f64::from(step[a]) * size);
            match octree.leaf_at(there) {
                None => assert!(found.is_empty()),
                Some(other) => assert!(found.contains(&other)),
            }
            for other in found {
                let (c, s) = (octree.centre(other), octree.size(other));
                let reach = (size + s) / 2.0 + 1e-9;
                assert!((0..3).all(|a| (c[a] - there[a]).abs() < reach));
            }
        }
    }
}

#[test]
fn a_balanced_tree_keeps_points_and_differs_by_one_level() {
    let points = points(20_000);
    let octree = Octree::new(&points, limits(5), &Serial).expect("octree");
    let mut tree = Tree::new(&octree);
    assert_eq!(tree.leaves().keys, octree.keys);
    tree.balance(&points, &Serial).expect("balanced");
    let leaves = tree.leaves();
    assert!(leaves.len() > octree.len());
    assert_eq!(leaves.starts.last(), octree.starts.last());
    for (at, node) in tree.nodes().iter().enumerate() {
        if node.child != NONE {
            let children = &tree.nodes()[node.child as usize..node.child as usize + 8];
            assert_eq!((children[0].begin, children[7].end), (node.begin, node.end));
            continue;
        }
        assert!(leaves.leaf_at(tree.centre(at as u32)).is_some());
        for i in 0..27 {
            let step = [i % 3 - 1, i / 3 % 3 - 1, i / 9 - 1];
            if let Some(other) = tree.neighbour(at as u32, step) {
                assert!(tree.nodes()[other as usize].level + 1 >= node.level);
            }
        }
    }
}

#[test]
fn border_cells_hold_no_points() {
    let x = [0.0, 10.0, 100.0];
    let cube = Cube {
        low: [-20.0; 3],
        side: 140.0,
    };
    let points = Points::new([&x, &x, &x], cube, &Serial).expect("points");
    let octree = Octree::new(&points, limits(50), &Serial).expect("octree");
    let tree = Tree::new(&octree);
    let border = tree.nodes().iter().filter(|n| n.is_leaf() && n.at_border());
    assert!(border.into_iter().all(|n| n.begin == n.end));
    assert!(tree.nodes().iter().any(|n| n.is_leaf() && n.begin < n.end));
}

#[test]
fn bad_points_are_refused_or_left_out() {
    let (two, three) = ([1.0, 2.0], [1.0, 2.0, 3.0]);
    assert!(Points::new([&two, &three, &two], CUBE, &Serial).is_err());
    for side in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        let cube = Cube { side, ..CUBE };
        assert!(Points::new([&two, &two, &two], cube, &Serial).is_err());
    }
    let none = Points::new([&[], &[], &[]], CUBE, &Serial).expect("no points");
    assert!(none.is_empty());
    assert_eq!(
        Octree::new(&none, limits(1), &Serial)
            .expect("one cell")
            .len(),
        1
    );
    let nan = [f64::NAN, 1.0];
    assert_eq!(
        bounds([&nan, &two, &two], &Serial).expect("bounds"),
        ([[1.0, 2.0, 2.0], [1.0, 2.0, 2.0]], 1)
    );
    let stopped = puncta_testkit::Stopped;
    assert!(Points::new([&two, &two, &two], CUBE, &stopped).is_err());
}
