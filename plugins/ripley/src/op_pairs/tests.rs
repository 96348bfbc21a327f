use super::*;
use puncta_testkit::{Call, Table};

fn table(x: &[f64], y: &[f64]) -> Table {
    Table::new("localisations")
        .f64("x", "nm", x)
        .f64("y", "nm", y)
}

#[test]
fn pairs_within_and_between() {
    let one = table(&[0.0, 3.0, 100.0, f64::NAN], &[0.0, 4.0, 100.0, 0.0]);
    let call = Call::of::<Pairs>()
        .input("table", one.clone())
        .set("step", 5)
        .set("r_max", 12);
    let done = call.run().expect("valid");
    let histogram = done.output("histogram").expect("finished");
    assert_eq!(histogram.f64("pairs").expect("there"), [0.0, 1.0, 0.0]);
    assert_eq!(histogram.f64("r_low").expect("there"), [0.0, 5.0, 10.0]);
    let density = histogram.f64("density").expect("there")[1];
    assert!((density - 2.0 / 3.0 / (75.0 * std::f64::consts::PI)).abs() < 1e-12);
    assert!(
        done.messages[0].1.contains("1 rows of table"),
        "{:?}",
        done.messages
    );
    let two = table(&[0.0, 90.0], &[1.0, 100.0]);
    let call = Call::of::<Pairs>().input("table", one).input("other", two);
    let done = call.set("step", 5).set("r_max", 15).run().expect("valid");
    let pairs = done
        .output("histogram")
        .expect("finished")
        .f64("pairs")
        .expect("there");
    assert_eq!(pairs, [2.0, 0.0, 1.0]);
}

#[test]
fn space_is_another_matter() {
    let deep = table(&[0.0, 3.0], &[0.0, 4.0]).f64("z", "nm", &[0.0, 12.0]);
    let call = Call::of::<Pairs>()
        .input("table", deep)
        .set("z", "z")
        .set("r_max", 20);
    let pairs = call.run().expect("valid");
    let pairs = pairs
        .output("histogram")
        .expect("finished")
        .f64("pairs")
        .expect("there");
    assert_eq!(pairs, [0.0, 1.0]);
}

#[test]
fn what_cannot_be_counted_is_said() {
    let say = |call: Call, text: &str| {
        let failure = call.run().expect_err(text).to_string();
        assert!(failure.contains(text), "{failure}");
    };
    let call = |x: &[f64]| Call::of::<Pairs>().input("table", table(x, x));
    say(call(&[]), "no pair of localisations");
    say(call(&[1.0]), "no pair of localisations");
    say(call(&[1.0, f64::NAN]), "no pair of localisations");
    say(call(&[1.0, 2.0]).set("step", 1e-6), "steps");
    let zero = call(&[1.0, 2.0])
        .set("r_max", 0)
        .run()
        .expect_err("refused");
    assert_eq!(zero.parameter.as_deref(), Some("r_max"));
    let same = call(&[7.0; 100]).run().expect("valid");
    let pairs = same
        .output("histogram")
        .expect("finished")
        .f64("pairs")
        .expect("there");
    assert_eq!((pairs[0], pairs.iter().sum::<f64>()), (4950.0, 4950.0));
    let beyond = call(&[0.0, 8.0])
        .set("r_max", 1e6)
        .set("step", 1e6)
        .run()
        .expect("valid");
    let pairs = beyond
        .output("histogram")
        .expect("finished")
        .f64("pairs")
        .expect("there");
    assert_eq!(pairs, [1.0]);
    let stopped = call(&[0.5; 3000])
        .cancel_after(3)
        .run()
        .expect_err("cancelled");
    assert!(stopped.is_cancelled());
}

/// Expected values: pairs of a tree and their histogram in another program, with 64-bit distances;
/// a root there may move a pair that lies on an edge. The reference application's 32-bit distances
/// move up to seven pairs a bin.
#[test]
fn real_localisations_as_another_program_counts_them() {
    let root = concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/data");
    let file = format!("{root}/pyme-smlm-import-tests/ThunderSTORM_TS3D.csv");
    let Some([x, y]) = crate::testing::columns(&file, ["x [nm]", "y [nm]"]) else {
        return;
    };
    let done = Call::of::<Pairs>()
        .input("table", table(&x, &y))
        .set("r_max", 500)
        .run();
    let done = done.expect("valid");
    let pairs = done
        .output("histogram")
        .expect("finished")
        .f64("pairs")
        .expect("there");
    let expected = [
        17641.0, 48816.0, 75132.0, 98761.0, 120_661.0, 142_965.0, 163_195.0, 182_505.0, 202_629.0,
        220_334.0,
    ];
    for (pairs, expected) in pairs.iter().zip(expected) {
        assert!((pairs - expected).abs() <= 1.0, "{pairs} {expected}");
    }
    let sum = pairs.iter().sum::<f64>();
    assert!((sum - 14_731_278.0).abs() <= 10.0, "{sum}");
}
