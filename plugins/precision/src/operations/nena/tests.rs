use super::super::testing::{Random, value};
use super::*;
use puncta_testkit::{Call, Done, Table};

/// Molecules at random places that shine for three frames each, and background.
fn molecules(count: usize, noise: usize, sigma: f64, side: f64, seed: u64) -> [Vec<f64>; 3] {
    let mut random = Random(seed);
    let mut rows = [vec![], vec![], vec![]];
    let mut push = |x: f64, y: f64, t: f64| {
        rows[0].push(x);
        rows[1].push(y);
        rows[2].push(t);
    };
    for _ in 0..count {
        let centre = [random.unit() * side, random.unit() * side];
        let start = (random.unit() * 3000.0).floor();
        for frame in 0..3 {
            let [x, y] = centre.map(|c| c + sigma * random.normal());
            push(x, y, start + f64::from(frame));
        }
    }
    for _ in 0..noise {
        let (x, y) = (random.unit() * side, random.unit() * side);
        push(x, y, (random.unit() * 3000.0).floor());
    }
    rows
}

fn call(rows: &[Vec<f64>; 3]) -> Call {
    let [x, y, t] = rows;
    let table = Table::new("locs").f64("x", "nm", x).f64("y", "nm", y);
    Call::of::<Nena>()
        .input("table", table.f64("t", "frame", t))
        .set("resamples", 40)
}

fn precision(done: &Done) -> (f64, [f64; 2]) {
    value(done, "precision")
}

#[test]
fn a_planted_precision_is_found_within_three_percent() {
    for (sigma, noise, side, seed) in [(8.0, 0, 20_000.0, 1), (12.0, 5000, 6000.0, 2)] {
        let done = call(&molecules(10_000, noise, sigma, side, seed))
            .run()
            .unwrap();
        let (found, [low, high]) = precision(&done);
        assert!((found / sigma - 1.0).abs() < 0.03, "{found} {sigma}");
        assert!(
            low < found && found < high && high - low < 0.1 * sigma,
            "{low} {high}"
        );
        let table = done.output("histogram").unwrap();
        let (counts, fit) = (table.f64("count").unwrap(), table.f64("fit").unwrap());
        let far = |(n, f): (&f64, &f64)| (n - f).abs() / (n.max(1.0)).sqrt();
        let worst = counts.iter().zip(&fit).map(far).fold(0.0, f64::max);
        assert!(worst < 6.0, "{worst}");
    }
}

#[test]
fn changes_of_the_data_that_must_not_matter() {
    let rows = molecules(4000, 500, 10.0, 10_000.0, 3);
    let (found, _) = precision(&call(&rows).run().unwrap());
    let changed = |change: &dyn Fn(&mut [Vec<f64>; 3])| {
        let mut rows = rows.clone();
        change(&mut rows);
        precision(&call(&rows).run().unwrap()).0
    };
    let scaled = changed(&|rows| rows[..2].iter_mut().flatten().for_each(|v| *v *= 3.0));
    assert!((scaled / found - 3.0).abs() < 1e-6, "{scaled} {found}");
    let moved = changed(&|rows| rows[..2].iter_mut().flatten().for_each(|v| *v += 1e7));
    assert!((moved / found - 1.0).abs() < 1e-3);
    let turned = changed(&|rows| {
        rows.swap(0, 1);
        rows[0].iter_mut().for_each(|v| *v *= -1.0);
    });
    assert_eq!(turned, found);
    // Rows in another order, and frames far from 0.
    let mixed = changed(&|rows| {
        for column in rows.iter_mut() {
            column.rotate_left(3001);
            column.reverse();
        }
        rows[2].iter_mut().for_each(|t| *t += 1e6);
    });
    assert_eq!(mixed, found);
    let texts = [1, 2, 3].map(|n| call(&rows).threads(n).run().unwrap().text());
    assert!(texts[0] == texts[1] && texts[1] == texts[2]);
    for polls in [1, 4, 30] {
        assert!(
            call(&rows)
                .cancel_after(polls)
                .run()
                .unwrap_err()
                .is_cancelled()
        );
    }
}

#[test]
fn random_molecules_are_warned_about() {
    let mut random = Random(4);
    let mut draw = |scale: f64| {
        (0..60_000)
            .map(|_| random.unit() * scale)
            .collect::<Vec<_>>()
    };
    let rows = [draw(2000.0), draw(2000.0), draw(600.0)];
    let done = call(&rows).run().unwrap();
    assert!(
        done.messages
            .iter()
            .any(|(_, m)| m.contains("random places")),
        "{}",
        done.text()
    );
}

#[test]
fn tables_without_repeats_are_refused() {
    let refused = |x: &[f64], t: &[f64]| {
        let error = call(&[x.to_vec(), x.to_vec(), t.to_vec()])
            .run()
            .unwrap_err();
        let sentence = error.to_string();
        assert!(
            sentence.contains("neighbour in the next frame"),
            "{sentence}"
        );
    };
    refused(&[], &[]);
    refused(&[1.0], &[0.0]);
    refused(&[1.0; 100], &[0.0; 100]);
    let gaps: Vec<f64> = (0..100).map(|i| f64::from(i) * 1e6).collect();
    refused(&gaps, &gaps);
    let frames: Vec<f64> = (0..100).map(f64::from).collect();
    refused(&[7.0; 100], &frames);
    refused(&[f64::NAN; 100], &frames);
    refused(&frames, &[f64::NAN; 100]);
    let table = Table::new("locs")
        .f64("x", "nm", &[1.0])
        .f64("y", "nm", &[1.0]);
    assert!(Call::of::<Nena>().input("table", table).run().is_err());
    // A longest distance beyond the field, and one below all distances.
    let rows = molecules(2000, 0, 10.0, 5000.0, 5);
    let wide = call(&rows).set("longest", 1e6).run();
    assert!(wide.is_ok());
    let error = call(&rows).set("longest", 1e-3).run().unwrap_err();
    assert!(error.to_string().contains("next frame"), "{error}");
}

/// Molecules in a box that shine for three frames each, and background.
fn deep(count: usize, noise: usize, sigma: [f64; 3], side: [f64; 3], seed: u64) -> [Vec<f64>; 4] {
    let mut random = Random(seed);
    let mut rows = [vec![], vec![], vec![], vec![]];
    let mut push = |at: [f64; 3], t: f64| {
        rows.iter_mut()
            .zip(at.into_iter().chain([t]))
            .for_each(|(column, value)| column.push(value));
    };
    for _ in 0..count {
        let centre = side.map(|side| random.unit() * side);
        let start = (random.unit() * 3000.0).floor();
        for frame in 0..3 {
            let at = std::array::from_fn(|axis| centre[axis] + sigma[axis] * random.normal());
            push(at, start + f64::from(frame));
        }
    }
    for _ in 0..noise {
        let at = side.map(|side| random.unit() * side);
        push(at, (random.unit() * 3000.0).floor());
    }
    rows
}

fn in_space([x, y, z, t]: &[Vec<f64>; 4]) -> Call {
    let table = Table::new("locs").f64("x", "nm", x).f64("y", "nm", y);
    let table = table.f64("z", "nm", z).f64("t", "frame", t);
    let call = Call::of::<Nena>().input("table", table);
    call.set("resamples", 40).set("z", "z")
}

#[test]
fn planted_precisions_in_space_are_found_within_three_percent() {
    let cases = [
        ([8.0, 8.0, 20.0], 0, [20_000.0, 20_000.0, 1000.0], 4),
        ([12.0, 12.0, 30.0], 5000, [5000.0, 5000.0, 1500.0], 5),
        ([10.0, 10.0, 10.0], 3000, [3000.0, 3000.0, 3000.0], 6),
    ];
    for (sigma, noise, side, seed) in cases {
        let rows = deep(10_000, noise, sigma, side, seed);
        let done = in_space(&rows).run().unwrap();
        for (name, sigma) in [("precision", sigma[0]), ("precision_z", sigma[2])] {
            let (found, [low, high]) = value(&done, name);
            assert!((found / sigma - 1.0).abs() < 0.03, "{name} {found} {sigma}");
            assert!(low < found && found < high && high - low < 0.1 * sigma);
        }
    }
}

#[test]
fn space_is_no_plane() {
    // So many molecules above each other that the plane shows neighbours only.
    let rows = deep(40_000, 0, [10.0, 10.0, 25.0], [400.0, 400.0, 20_000.0], 7);
    let (found, _) = precision(&in_space(&rows).run().unwrap());
    let [x, y, z, t] = &rows;
    let (plane, _) = precision(&call(&[x.clone(), y.clone(), t.clone()]).run().unwrap());
    assert!((found / 10.0 - 1.0).abs() < 0.05, "{found}");
    assert!((plane / 10.0 - 1.0).abs() > (found / 10.0 - 1.0).abs());
    // Other units, another place, another order.
    let change = |values: &[f64], scale: f64, shift: f64| -> Vec<f64> {
        values.iter().rev().map(|v| scale * v + shift).collect()
    };
    let other = [
        change(y, -3.0, 0.0),
        change(x, 3.0, 1e7),
        change(z, 3.0, 1e6),
        change(t, 1.0, 0.0),
    ];
    let (scaled, _) = precision(&in_space(&other).run().unwrap());
    assert!(
        (scaled / found / 3.0 - 1.0).abs() < 2e-3,
        "{scaled} {found}"
    );
    let flat = [x.clone(), y.clone(), vec![5.0; x.len()], t.clone()];
    let refused = in_space(&flat).run().unwrap_err().to_string();
    assert!(refused.contains("z"), "{refused}");
}
