use super::super::testing::{Random, value};
use super::*;
use puncta_testkit::{Call, Table as Rows};

/// `repeats` localisations with error `sigma` of each of `emitters` emitters at random places.
fn emitters(emitters: usize, repeats: usize, sigma: f64, side: f64, seed: u64) -> [Vec<f64>; 4] {
    let mut random = Random(seed);
    let mut out = [vec![], vec![], vec![], vec![]];
    for emitter in 0..emitters {
        let centre = [random.unit() * side, random.unit() * side];
        for _ in 0..repeats {
            out[0].push(centre[0] + sigma * random.normal());
            out[1].push(centre[1] + sigma * random.normal());
            out[2].push((random.unit() * 10_000.0).floor());
            out[3].push(emitter as f64 + 1.0);
        }
    }
    out
}

fn table(rows: &[Vec<f64>; 4]) -> Rows {
    Rows::new("locs")
        .f64("x", "nm", &rows[0])
        .f64("y", "nm", &rows[1])
        .f64("t", "frame", &rows[2])
}

fn frc(rows: &[Vec<f64>; 4]) -> Call {
    let call = Call::of::<Table>().input("table", table(rows));
    call.set("pixel_size", 5)
        .set("split", "random")
        .set("repeats", 3)
}

/// Emitters at random places with m localisations each: the expected correlation is
/// a E / (1 + a E) with E = exp(-4 pi^2 sigma^2 q^2), a = (m - 1) / 2; it is 1/7 where a E = 1/6.
#[test]
fn a_planted_sigma_is_found() {
    for (m, sigma, seed) in [(20, 10.0, 1), (8, 15.0, 2), (40, 8.0, 3)] {
        let rows = emitters(3000, m, sigma, 5000.0, seed);
        let done = frc(&rows).run().unwrap();
        let a = (m as f64 - 1.0) / 2.0;
        let truth = std::f64::consts::TAU * sigma / (6.0 * a).ln().sqrt();
        let found = value(&done, "resolution");
        assert!((found / truth - 1.0).abs() < 0.04, "{found} {truth}");
        assert!(value(&done, "split_sd") < 0.05 * truth);
        // The whole curve, too.
        let curve = done.output("curve").unwrap();
        let pairs = curve.f64("frequency").unwrap().into_iter();
        let smooth = curve.f64("frc_smooth").unwrap();
        for (q, c) in pairs.zip(smooth).skip(20).take(300) {
            let e = a * (-(std::f64::consts::TAU * sigma * q).powi(2)).exp();
            assert!((c - e / (1.0 + e)).abs() < 0.06, "{q} {c}");
        }
    }
}

#[test]
fn complete_randomness_has_no_resolution() {
    let mut spreads = 0.0;
    for seed in 10..20 {
        let rows = emitters(20_000, 1, 0.0, 4000.0, seed);
        let done = frc(&rows).set("repeats", 1).run().unwrap();
        assert!(value(&done, "resolution").is_nan(), "{seed}");
        assert!(done.text().contains("no more than noise"));
        assert!(done.messages.iter().any(|(_, m)| m.contains("Not reached")));
        // 3 sigma: a normal value exceeds it in 0.13 % of rings, both sides 0.27 %.
        let curve = done.output("curve").unwrap();
        let limits = curve.f64("three_sigma").unwrap();
        let values = curve.f64("frc").unwrap();
        let beyond = values
            .iter()
            .zip(limits)
            .skip(3)
            .filter(|(c, l)| c.abs() > *l)
            .count();
        assert!(beyond <= 6, "{beyond} of {}", values.len());
        // The spread of all rings in units of the expected one.
        let n = curve
            .f64("three_sigma")
            .unwrap()
            .into_iter()
            .map(|l| (3.0 / l).powi(2));
        let spread: f64 = values.iter().zip(n).skip(3).map(|(c, n)| c * c * n).sum();
        spreads += spread / (values.len() - 3) as f64;
    }
    assert!((0.92..1.08).contains(&(spreads / 10.0)), "{spreads}");
}

#[test]
fn molecules_kept_together_take_the_correlation_of_their_repeats_away() {
    let rows = emitters(3000, 10, 10.0, 4000.0, 5);
    let chained = table(&rows).f64("clumpIndex", "1", &rows[3]);
    let call = || {
        Call::of::<Table>()
            .input("table", chained.clone())
            .set("pixel_size", 5)
            .set("split", "random")
            .set("repeats", 2)
    };
    assert!(value(&call().run().unwrap(), "resolution").is_nan());
    let apart = call().set("molecule", puncta_sdk::serde_json::Value::Null);
    assert!(value(&apart.run().unwrap(), "resolution") > 10.0);
    assert_eq!(value(&call().run().unwrap(), "units"), 3000.0);
    let blocks = call().set("split", "random_blocks").set("block", 100);
    assert!(value(&blocks.run().unwrap(), "resolution").is_nan());
    let missing = call().set("molecule", "chain").prepare().unwrap_err();
    assert_eq!(missing.parameter.as_deref(), Some("molecule"));
}

#[test]
fn equal_halves_correlate_completely() {
    let rows = emitters(500, 5, 10.0, 2000.0, 6);
    let call = frc(&rows)
        .input("second", table(&rows))
        .set("pixel_size", 10);
    let done = call.run().unwrap();
    let curve = done.output("curve").unwrap();
    assert!(curve.f64("frc").unwrap().iter().skip(1).all(|c| *c == 1.0));
    assert!(value(&done, "resolution").is_nan());
    assert!(
        done.text().contains("finest period of 2"),
        "{}",
        done.text()
    );
}

#[test]
fn turned_moved_scaled_and_mixed_data() {
    let mut rows = emitters(1500, 10, 12.0, 3000.0, 7);
    let call = |rows: &[Vec<f64>; 4]| {
        let call = Call::of::<Table>()
            .input("table", table(rows))
            .set("pixel_size", 6);
        call.set("split", "random_blocks").set("repeats", 2)
    };
    let curve = |call: Call| {
        call.run()
            .unwrap()
            .output("curve")
            .unwrap()
            .f64("frc")
            .unwrap()
    };
    let far = |a: &[f64], b: &[f64]| {
        assert_eq!(a.len(), b.len());
        a.iter()
            .zip(b)
            .skip(1)
            .fold(0.0_f64, |far, (a, b)| far.max((a - b).abs()))
    };
    let original = curve(call(&rows));
    let resolution = value(&call(&rows).run().unwrap(), "resolution");
    // A quarter turn: (x, y) to (-y, x).
    let turned = [
        rows[1].iter().map(|y| -y).collect(),
        rows[0].clone(),
        rows[2].clone(),
        vec![],
    ];
    assert!(far(&original, &curve(call(&turned))) < 2e-3);
    // Far away. Positions keep about 2e-9 nm there.
    let moved = |by: f64| {
        rows[..2]
            .iter()
            .map(move |c| c.iter().map(|v| v + by).collect())
    };
    let mut away = rows.clone();
    for (to, from) in away.iter_mut().zip(moved(1e7)) {
        *to = from;
    }
    assert!(far(&original, &curve(call(&away))) < 1e-3);
    // Three times as large, with pixels three times as large.
    let mut large = rows.clone();
    for column in &mut large[..2] {
        column.iter_mut().for_each(|v| *v *= 3.0);
    }
    let done = call(&large).set("pixel_size", 18).run().unwrap();
    assert!((value(&done, "resolution") / resolution - 3.0).abs() < 0.01);
    // Rows in another order, split by blocks: the same bits.
    let mut order: Vec<usize> = (0..rows[0].len()).collect();
    order.sort_by_key(|i| i.wrapping_mul(7919) % 15013);
    for column in &mut rows {
        *column = order.iter().map(|i| column[*i]).collect();
    }
    assert_eq!(original, curve(call(&rows)));
}

#[test]
fn threads_do_not_change_a_bit_and_a_stop_stops() {
    let rows = emitters(1000, 5, 12.0, 3000.0, 8);
    let outputs = [1, 2, 3].map(|n| {
        let done = frc(&rows).threads(n).run().unwrap();
        (
            done.output("curve").unwrap().f64("frc").unwrap(),
            done.text(),
        )
    });
    assert!(outputs[0] == outputs[1] && outputs[1] == outputs[2]);
    for polls in [1, 5, 40] {
        assert!(
            frc(&rows)
                .cancel_after(polls)
                .run()
                .unwrap_err()
                .is_cancelled()
        );
    }
}

#[test]
fn bad_tables_are_refused_in_one_sentence() {
    let refused = |x: &[f64], y: &[f64], t: &[f64], words: &str| {
        let rows = [x.to_vec(), y.to_vec(), t.to_vec(), vec![]];
        let error = frc(&rows).run().unwrap_err().to_string();
        assert!(error.contains(words) && !error.contains('\n'), "{error}");
    };
    refused(&[], &[], &[], "no two halves");
    refused(&[1.0], &[1.0], &[0.0], "no two halves");
    refused(&[5.0; 100], &[5.0; 100], &[0.0; 100], "must differ");
    refused(
        &[f64::NAN; 9],
        &[0.0, 99.0, 0.0, 99.0, 0.0, 99.0, 0.0, 99.0, 5.0],
        &[0.0; 9],
        "no row has a finite x",
    );
    refused(&[0.0, 40.0], &[0.0, 40.0], &[0.0, 1.0], "8 pixels of 5 nm");
    refused(&[0.0, 1e9], &[0.0, 1e9], &[0.0, 1.0], "fit into memory");
    let no_t = Rows::new("locs")
        .f64("x", "nm", &[1.0])
        .f64("y", "nm", &[1.0]);
    let error = Call::of::<Table>()
        .input("table", no_t.clone())
        .prepare()
        .unwrap_err();
    assert!(error.to_string().contains("set split to random"), "{error}");
    let seconds = no_t.f64("t", "s", &[1.0]);
    let error = Call::of::<Table>()
        .input("table", seconds)
        .prepare()
        .unwrap_err();
    assert!(
        error.to_string().contains("is in s, not in frame"),
        "{error}"
    );
    assert!(
        frc(&emitters(9, 9, 1.0, 900.0, 1))
            .set("pixel_size", 0)
            .prepare()
            .is_err()
    );
    let outside = frc(&emitters(9, 9, 1.0, 900.0, 1))
        .set("x_min", 2000)
        .set("x_max", 3000);
    let error = outside.run().unwrap_err().to_string();
    assert!(error.contains("0 and 0 localisations"), "{error}");
}

#[test]
fn frames_in_any_order_with_long_gaps_and_missing_values() {
    let mut rows = emitters(1500, 10, 12.0, 3000.0, 9);
    for (i, t) in rows[2].iter_mut().enumerate() {
        *t = *t * 1e6 + if i % 100 == 0 { f64::NAN } else { 0.0 };
    }
    rows[0][5] = f64::INFINITY;
    let call = Call::of::<Table>()
        .input("table", table(&rows))
        .set("pixel_size", 6);
    let done = call.run().unwrap();
    assert_eq!(value(&done, "invalid"), 151.0);
    assert!(value(&done, "units") > 5000.0);
    assert!(value(&done, "resolution").is_finite());
}

/// Molecules in clouds of standard deviation 100 nm, each found m times with error sigma.
fn clouds(molecules: usize, m: usize, sigma: f64, seed: u64) -> [Vec<f64>; 4] {
    let mut random = Random(seed);
    let mut out = [vec![], vec![], vec![], vec![]];
    let clouds: Vec<[f64; 2]> = (0..100)
        .map(|_| [random.unit() * 5000.0, random.unit() * 5000.0])
        .collect();
    for _ in 0..molecules {
        let cloud = clouds[(random.unit() * 100.0) as usize];
        let centre = cloud.map(|c| c + 100.0 * random.normal());
        for _ in 0..m {
            out[0].push(centre[0] + sigma * random.normal());
            out[1].push(centre[1] + sigma * random.normal());
            out[2].push((random.unit() * 10_000.0).floor());
        }
    }
    out
}

#[test]
fn repeats_are_estimated_and_taken_out() {
    let with_errors = |rows: &[Vec<f64>; 4], sigma: f64| {
        let errors = vec![sigma; rows[0].len()];
        let table = table(rows)
            .f64("error_x", "nm", &errors)
            .f64("error_y", "nm", &errors);
        let call = Call::of::<Table>()
            .input("table", table)
            .set("pixel_size", 5);
        call.set("split", "random")
            .set("repeats", 5)
            .set("spurious", true)
            .run()
            .unwrap()
    };
    // Random places: nothing is left. Each localisation has m - 1 others of its molecule.
    for m in [4, 10] {
        let done = with_errors(&emitters(6000, m, 10.0, 5000.0, 31), 10.0);
        let truth = m as f64 - 1.0;
        let found = value(&done, "repeats");
        assert!((found / truth - 1.0).abs() < 0.1, "{found} {truth}");
        assert!(value(&done, "resolution").is_finite());
        assert!(
            value(&done, "resolution_corrected").is_nan(),
            "{}",
            done.text()
        );
    }
    // Clouds: their own coarse resolution is left.
    let done = with_errors(&clouds(10_000, 5, 10.0, 32), 10.0);
    let found = value(&done, "repeats");
    assert!((found / 4.0 - 1.0).abs() < 0.1, "{found}");
    assert!(value(&done, "resolution") < 50.0);
    let corrected = value(&done, "resolution_corrected");
    assert!((150.0..400.0).contains(&corrected), "{corrected}");
    let bare = frc(&emitters(9, 9, 1.0, 900.0, 1))
        .set("spurious", true)
        .prepare();
    assert!(bare.unwrap_err().to_string().contains("no column error_x"));
}
