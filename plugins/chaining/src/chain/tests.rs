use super::*;
use crate::spots::{Radius, spots};
use crate::testing::{Random, Set, canonical};
use puncta_sdk::run::Serial;
use puncta_testkit::{Stopped, Threads};

/// The rule as it is stated, for every pair of rows of a set that is sorted by frame.
fn brute(set: &Set, radius: Radius<'_>, axial: bool, gap: u64) -> Vec<u32> {
    let rows = set.rows(radius, axial);
    let spots = spots(&rows, &Serial).unwrap();
    assert!(spots.order.is_none(), "sorted and all placed");
    let count = set.x.len();
    let mut labels = vec![0_u32; count];
    let mut last = vec![true; count];
    let mut chains = 0;
    let mut frames: Vec<i64> = spots.frames.clone();
    frames.dedup();
    for frame in frames {
        let now: Vec<usize> = (0..count).filter(|i| spots.frames[*i] == frame).collect();
        let mut pairs = vec![];
        for &new in &now {
            for (old, open) in last.iter().enumerate() {
                let back = frame - spots.frames[old];
                let distance = spots.distance(old, new);
                if back >= 1 && back <= 1 + gap as i64 && *open && distance <= 1.0 {
                    pairs.push((distance, old, new));
                }
            }
        }
        pairs.sort_by(|a, b| a.partial_cmp(b).unwrap());
        for (_, old, new) in pairs {
            if last[old] && labels[new] == 0 {
                last[old] = false;
                labels[new] = labels[old];
            }
        }
        for new in now {
            if labels[new] == 0 {
                chains += 1;
                labels[new] = chains;
            }
        }
    }
    labels
}

#[test]
fn chains_are_those_of_brute_force() {
    for seed in 0..6 {
        let set = Set::bursts(150, 800.0, 30.0, seed).by_frame();
        for gap in [0, 1, 3, 100] {
            for axial in [false, true] {
                for radius in [Radius::Constant(40.0), set.combined(3.5)] {
                    let (_, labels) = set.chain(radius, axial, gap);
                    assert_eq!(labels, brute(&set, radius, axial, gap), "{seed} {gap}");
                }
            }
        }
    }
}

#[test]
fn lattices_and_coincident_localisations_are_chained_in_the_order_of_rows() {
    let mut set = Set::default();
    for t in 0..5 {
        for k in 0..36 {
            set.x.push(f64::from(k % 6) * 10.0);
            set.y.push(f64::from(k / 6 % 3) * 10.0);
            set.t.push(f64::from(t));
        }
    }
    set.z = vec![0.0; set.x.len()];
    set.sigma = vec![3.0; set.x.len()];
    for radius in [0.0, 10.0, 25.0, 1e12] {
        let radius = Radius::Constant(radius);
        let (chains, labels) = set.chain(radius, false, 0);
        assert_eq!(labels, brute(&set, radius, false, 0));
        // Every place has two localisations in each frame, at distance 0 from two of the last.
        assert_eq!(chains.sizes, vec![5; 36]);
    }
}

#[test]
fn the_closest_pair_is_joined_first_and_the_other_starts_anew() {
    let set = Set {
        x: vec![0.0, 10.0, 9.0],
        y: vec![0.0; 3],
        z: vec![0.0; 3],
        t: vec![0.0, 1.0, 1.0],
        sigma: vec![1.0; 3],
    };
    let (chains, labels) = set.chain(Radius::Constant(20.0), false, 1);
    assert_eq!(labels, [1, 2, 1]);
    assert_eq!(chains.sizes, [2, 1]);
    // In units of the radius the farther one is the closer.
    let wide = Set {
        sigma: vec![1.0, 9.0, 1.0],
        ..set
    };
    assert_eq!(wide.chain(wide.combined(20.0), false, 1).1, [1, 1, 2]);
}

#[test]
fn a_chain_is_compared_with_its_last_position_and_may_be_dark() {
    let at = |t: &[f64]| Set {
        x: (0..t.len()).map(|k| k as f64 * 9.0).collect(),
        y: vec![0.0; t.len()],
        z: vec![0.0; t.len()],
        t: t.to_vec(),
        sigma: vec![1.0; t.len()],
    };
    let radius = Radius::Constant(10.0);
    assert_eq!(
        at(&[0.0, 1.0, 2.0, 3.0]).chain(radius, false, 0).0.sizes,
        [4]
    );
    assert_eq!(
        at(&[0.0, 2.0, 4.0]).chain(radius, false, 0).0.sizes,
        [1, 1, 1]
    );
    assert_eq!(at(&[0.0, 2.0, 4.0]).chain(radius, false, 1).0.sizes, [3]);
    let far = at(&[0.0, 1e6, 2e6, 2e6 + 1.0]);
    assert_eq!(far.chain(radius, false, 1).0.sizes, [1, 1, 2]);
    assert_eq!(far.chain(radius, false, 1_000_000_000).0.sizes, [4]);
    assert_eq!(
        at(&[-1e300, 0.0, 1e300]).chain(radius, false, 1).0.sizes,
        [1, 1, 1]
    );
    // Both at the same time are two molecules.
    assert_eq!(
        at(&[5.0, 5.0])
            .chain(Radius::Constant(1e9), false, 9)
            .0
            .sizes,
        [1, 1]
    );
}

#[test]
fn changes_that_do_not_matter_change_nothing() {
    let set = Set::bursts(400, 2000.0, 100.0, 9);
    let (_, labels) = set.chain(set.combined(3.5), true, 1);
    let reference = canonical(&labels);
    let with = |change: &dyn Fn(&mut Set)| {
        let mut other = set.clone();
        change(&mut other);
        canonical(&other.chain(other.combined(3.5), true, 1).1)
    };
    let turned = with(&|set| {
        set.y.iter_mut().for_each(|y| *y = -*y);
        std::mem::swap(&mut set.x, &mut set.y);
    });
    assert_eq!(turned, reference);
    let moved = with(&|set| {
        set.x.iter_mut().for_each(|x| *x += 1e7);
        set.y.iter_mut().for_each(|y| *y -= 1e7);
        set.t.iter_mut().for_each(|t| *t += 1e6);
    });
    assert_eq!(moved, reference);
    let order: Vec<usize> = (0..set.x.len()).rev().collect();
    let mut reversed = set
        .picked(&order)
        .chain(set.picked(&order).combined(3.5), true, 1)
        .1;
    reversed.reverse();
    assert_eq!(canonical(&reversed), reference);
    let plane = |factor: f64| {
        let mut other = set.clone();
        for values in [&mut other.x, &mut other.y, &mut other.sigma] {
            values.iter_mut().for_each(|value| *value *= factor);
        }
        canonical(&other.chain(other.combined(3.5), false, 1).1)
    };
    assert_eq!(plane(3.0), plane(1.0));
}

#[test]
fn a_copy_far_away_is_chained_in_the_same_way() {
    let set = Set::bursts(300, 1500.0, 60.0, 4);
    let mut double = set.clone();
    for (values, shift) in [
        (&mut double.x, 1e6),
        (&mut double.y, 0.0),
        (&mut double.z, 0.0),
        (&mut double.t, 0.0),
        (&mut double.sigma, 0.0),
    ] {
        let copy: Vec<f64> = values.iter().map(|value| value + shift).collect();
        values.extend(copy);
    }
    let (once, labels) = set.chain(set.combined(3.5), false, 1);
    let (twice, both) = double.chain(double.combined(3.5), false, 1);
    assert_eq!(twice.sizes.len(), 2 * once.sizes.len());
    let (first, second) = both.split_at(labels.len());
    assert_eq!(canonical(first), canonical(&labels));
    assert_eq!(canonical(second), canonical(&labels));
}

#[test]
fn rows_that_cannot_be_placed_are_in_no_chain() {
    let mut set = Set::bursts(50, 500.0, 20.0, 2).by_frame();
    let clean = set.clone();
    let nan = f64::NAN;
    for (k, row) in [
        [nan, 0.0, 1.0, 1.0],
        [0.0, nan, 1.0, 1.0],
        [0.0, 0.0, nan, 1.0],
    ]
    .into_iter()
    .chain([
        [0.0, 0.0, 1.0, nan],
        [0.0, 0.0, 1.0, -1.0],
        [0.0, 0.0, f64::INFINITY, 1.0],
    ])
    .enumerate()
    {
        set.x.insert(3 * k, row[0]);
        set.y.insert(3 * k, row[1]);
        set.t.insert(3 * k, row[2]);
        set.sigma.insert(3 * k, row[3]);
        set.z.insert(3 * k, 0.0);
    }
    let (_, labels) = set.chain(set.combined(3.5), false, 1);
    let kept: Vec<u32> = labels.iter().copied().filter(|label| *label > 0).collect();
    assert_eq!(labels.len() - kept.len(), 6);
    assert_eq!(kept, clean.chain(clean.combined(3.5), false, 1).1);
}

#[test]
fn threads_do_not_matter_and_cancel_ends_it() {
    let mut random = Random(1);
    let count = 100_000;
    let mut set = Set::default();
    for _ in 0..count {
        set.x.push(random.unit() * 20_000.0);
        set.y.push(random.unit() * 20_000.0);
        set.t.push((random.unit() * 500.0).floor());
    }
    set.z = vec![0.0; count];
    set.sigma = vec![10.0; count];
    let rows = set.rows(set.combined(3.5), false);
    let run = |threads| {
        let spots = spots(&rows, &Threads(threads)).unwrap();
        chain(&spots, 1, &Threads(threads)).unwrap()
    };
    let one = run(1);
    assert_eq!(run(2), one);
    assert_eq!(run(3), one);
    let sorted = spots(&rows, &Serial).unwrap();
    assert!(chain(&sorted, 1, &Stopped).unwrap_err().is_cancelled());
    assert!(spots(&rows, &Stopped).is_err());
}

#[test]
fn a_radius_with_too_many_pairs_is_refused_with_what_to_do() {
    let count = 10_000;
    let set = Set {
        x: vec![0.0; count],
        y: vec![0.0; count],
        z: vec![0.0; count],
        t: (0..count).map(|k| (k % 2) as f64).collect(),
        sigma: vec![1.0; count],
    };
    let rows = set.rows(Radius::Constant(1e9), false);
    let spots = spots(&rows, &Serial).unwrap();
    let failure = chain(&spots, 0, &Serial).unwrap_err();
    assert_eq!(failure.parameter.as_deref(), Some("radius"));
    assert!(failure.to_string().contains("frame 1"), "{failure}");
}
