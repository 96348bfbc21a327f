use super::*;
use crate::flat::Flat;
use crate::flat::tests::letter;
use crate::simulate::{stream, uniform};
use crate::window::{Cuboid, Random};
use puncta_testkit::{Stopped, Threads};

fn simulation(count: usize, seed: u64) -> Simulation {
    Simulation {
        null: Null::Uniform,
        count,
        significance: 0.05,
        seed,
    }
}

/// Largest distance of the shares of p-values from uniform over the possible values, times the root
/// of their number (Kolmogorov): below 1.95 with probability 0.999.
fn distance_from_uniform(p: &[f64], all: usize) -> f64 {
    let share = |k: usize| {
        let limit = (k as f64 + 0.5) / all as f64;
        p.iter().filter(|p| **p <= limit).count() as f64 / p.len() as f64
    };
    let largest = (1..=all)
        .map(|k| (share(k) - k as f64 / all as f64).abs())
        .fold(0.0, f64::max);
    largest * (p.len() as f64).sqrt()
}

fn p_values<const D: usize>(
    window: &dyn Window<D>,
    repeats: usize,
    count: usize,
    seed: u64,
    edges: Edges,
) -> [Vec<f64>; 2] {
    let bins = Bins::up_to(10.0, 10);
    let mut p = [Vec::new(), Vec::new()];
    for repeat in 0..repeats {
        let points = uniform(window, 60, &mut stream(1000 + seed, repeat as u64));
        let sets = Sets {
            one: points.each_ref().map(Vec::as_slice),
            two: None,
        };
        let run = Threads(2);
        let simulation = simulation(count, (seed << 32) + repeat as u64);
        let others = simulated(&sets, window, edges, &bins, &simulation, &run).expect("valid");
        let rings = rings(&sets, window, edges, &bins, &run).expect("valid");
        let found = envelope(&Curves::new(&rings, &bins, D).h, &others, 0.05).expect("valid");
        p[0].push(found.p_largest);
        p[1].push(found.p_summed);
    }
    p
}

#[test]
fn p_values_without_structure_are_uniform() {
    let long = std::env::var_os("PUNCTA_TEST_ALL").is_some();
    let (repeats, count) = if long { (1000, 99) } else { (150, 39) };
    let plane = Flat::rectangle([0.0, 0.0], [400.0, 300.0]);
    for seed in 1..=3 {
        let mut all = vec![p_values(&plane, repeats, count, seed, Edges::Isotropic)];
        if long {
            all.push(p_values(&plane, repeats, count, seed + 10, Edges::None));
            all.push(p_values(
                &letter(0.0),
                repeats,
                count,
                seed,
                Edges::Isotropic,
            ));
            let cube = Cuboid {
                low: [0.0; 3],
                high: [300.0, 300.0, 300.0],
            };
            all.push(p_values(&cube, repeats, count, seed, Edges::Translation));
        }
        for p in all.iter().flatten() {
            let distance = distance_from_uniform(p, count + 1);
            assert!(distance < 1.95, "seed {seed}: {distance}");
        }
    }
}

#[test]
fn clusters_leave_the_envelope() {
    let plane = Flat::rectangle([0.0, 0.0], [1000.0, 1000.0]);
    let mut random = stream(3, 0);
    let mut points: [Vec<f64>; 2] = Default::default();
    for _ in 0..30 {
        let centre = [0, 1].map(|_| 50.0 + 900.0 * random.unit());
        for _ in 0..10 {
            let place = centre.map(|c| c + 40.0 * (random.unit() - 0.5));
            points
                .iter_mut()
                .zip(place)
                .for_each(|(axis, x)| axis.push(x));
        }
    }
    let sets = Sets {
        one: points.each_ref().map(Vec::as_slice),
        two: None,
    };
    let bins = Bins::up_to(10.0, 20);
    let run = Threads(2);
    let others = simulated(
        &sets,
        &plane,
        Edges::Isotropic,
        &bins,
        &simulation(99, 1),
        &run,
    )
    .expect("valid");
    let rings = rings(&sets, &plane, Edges::Isotropic, &bins, &run).expect("valid");
    let h = Curves::new(&rings, &bins, 2).h;
    let found = envelope(&h, &others, 0.05).expect("valid");
    assert_eq!((found.p_largest, found.p_summed), (0.01, 0.01));
    assert!(h[3] > found.global_high[3] && found.global_high[3] >= found.high[3]);
    let one = simulated(
        &sets,
        &plane,
        Edges::None,
        &bins,
        &simulation(20, 1),
        &Threads(1),
    );
    let three = simulated(
        &sets,
        &plane,
        Edges::None,
        &bins,
        &simulation(20, 1),
        &Threads(3),
    );
    assert_eq!(one, three);
    let other = simulated(
        &sets,
        &plane,
        Edges::None,
        &bins,
        &simulation(20, 2),
        &Threads(3),
    );
    assert_ne!(one, other);
    let stopped = simulated(
        &sets,
        &plane,
        Edges::None,
        &bins,
        &simulation(20, 1),
        &Stopped,
    );
    assert!(stopped.is_err_and(|failure| failure.is_cancelled()));
}

#[test]
fn ranks_and_p_values_as_by_hand() {
    let others: Vec<Vec<f64>> = (1..=39)
        .map(|i| vec![f64::from(i), -f64::from(i)])
        .collect();
    let found = envelope(&[60.0, 0.0], &others, 0.05).expect("valid");
    assert_eq!(
        (&found.low[..], &found.high[..]),
        (&[1.0, -39.0][..], &[39.0, -1.0][..])
    );
    assert_eq!(found.p_largest, 1.0 / 40.0);
    let inside = envelope(&[20.0, -20.0], &others, 0.05).expect("valid");
    assert_eq!((inside.p_largest, inside.p_summed), (1.0, 1.0));
    // The second largest deviation, of 2 in 40, is the limit for all radii.
    assert_eq!((inside.global_low[0], inside.global_high[0]), (1.0, 39.0));
    assert!(envelope(&[0.0], &others[..38], 0.05).is_err());
}

#[test]
fn labels_and_shifts_keep_the_places() {
    let plane = Flat::rectangle([0.0, 0.0], [100.0, 50.0]);
    let one = uniform(&plane, 30, &mut stream(1, 0));
    let two = uniform(&plane, 50, &mut stream(1, 1));
    let sets = Sets {
        one: one.each_ref().map(Vec::as_slice),
        two: Some(two.each_ref().map(Vec::as_slice)),
    };
    let sorted = |a: &[f64], b: &[f64]| {
        let mut all: Vec<f64> = a.iter().chain(b).copied().collect();
        all.sort_by(f64::total_cmp);
        all
    };
    let labels = draw(Null::Labels, &sets, &plane, 5, 0, &|| true);
    let drawn = labels.sets();
    let second = drawn.two.expect("two sets");
    assert_eq!((drawn.one[0].len(), second[0].len()), (30, 50));
    assert_eq!(sorted(drawn.one[0], second[0]), sorted(&one[0], &two[0]));
    assert_ne!(drawn.one[0], &one[0][..]);
    let shifted = draw(Null::Shift, &sets, &plane, 5, 0, &|| true);
    let drawn = shifted.sets();
    let second = drawn.two.expect("two sets");
    assert_eq!(drawn.one[0], &one[0][..]);
    let shift = |a: usize, side: f64, i: usize| (second[a][i] - two[a][i]).rem_euclid(side);
    let places = second[0].iter().zip(second[1]).enumerate();
    for (i, (x, y)) in places {
        assert!(plane.holds(&[*x, *y]));
        assert!((shift(0, 100.0, i) - shift(0, 100.0, 0)).abs() < 1e-9);
        assert!((shift(1, 50.0, i) - shift(1, 50.0, 0)).abs() < 1e-9);
    }
}
