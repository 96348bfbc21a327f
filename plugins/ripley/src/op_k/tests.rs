use super::*;
use crate::flat::Flat;
use crate::simulate::{stream, uniform};
use puncta_testkit::{Call, Done, Object, Table};

fn table(x: &[f64], y: &[f64]) -> Table {
    Table::new("localisations")
        .f64("x", "nm", x)
        .f64("y", "nm", y)
}

fn random(count: usize, seed: u64) -> [Vec<f64>; 2] {
    uniform(
        &Flat::rectangle([0.0, 0.0], [1000.0, 1000.0]),
        count,
        &mut stream(seed, 0),
    )
}

fn curve(done: &Done, name: &str) -> Vec<f64> {
    done.output("curve")
        .expect("finished")
        .f64(name)
        .expect("there")
}

#[test]
fn a_curve_a_figure_and_a_report() {
    let [x, y] = random(3000, 1);
    let call = Call::of::<Ripley>()
        .input("table", table(&x, &y))
        .set("r_max", 200);
    let done = call.set("simulations", 39).run().expect("valid");
    let (r, h) = (curve(&done, "r"), curve(&done, "h"));
    assert_eq!((r.len(), r[19]), (20, 200.0));
    assert!(h.iter().zip(&r).skip(2).all(|(h, r)| (h / r).abs() < 0.1));
    let (low, high) = (curve(&done, "h_low"), curve(&done, "h_high"));
    assert!(low.iter().zip(&high).all(|(low, high)| low < high));
    let text = done.text();
    for part in [
        "bounding box",
        "isotropic",
        "p_largest",
        "p_summed",
        "39 simulations",
        "band",
    ] {
        assert!(text.contains(part), "{part}: {text}");
    }
}

#[test]
fn regions_by_outline_mask_and_bounds() {
    let [x, y] = random(2000, 2);
    let call = |x: &[f64], y: &[f64]| {
        Call::of::<Ripley>()
            .input("table", table(x, y))
            .set("r_max", 100)
    };
    let bounds = call(&x, &y)
        .set("x_min", 0)
        .set("x_max", 500)
        .set("y_min", 0)
        .set("y_max", 500);
    let bounds = bounds.run().expect("valid");
    let outline = table(&[0.0, 500.0, 500.0, 0.0], &[0.0, 0.0, 500.0, 500.0]);
    let outline = call(&x, &y).input("outline", outline).run().expect("valid");
    let info = ImageInfo::plane(2, 2, 500.0, 0.0, 0.0);
    let mask = Object::image("mask", info, &[1.0, 0.0, 0.0, 0.0]);
    let mask = call(&x, &y).input("mask", mask).run().expect("valid");
    let expected = curve(&bounds, "k");
    for done in [outline, mask] {
        for (found, expected) in curve(&done, "k").iter().zip(&expected) {
            assert!((found / expected - 1.0).abs() < 1e-9, "{found} {expected}");
        }
    }
}

#[test]
fn from_one_table_to_another() {
    let ([x, y], [u, v]) = (random(2000, 3), random(1000, 4));
    let call = || {
        let call = Call::of::<Ripley>()
            .input("table", table(&x, &y))
            .set("r_max", 200);
        call.input("other", table(&u, &v)).set("simulations", 39)
    };
    for null in ["uniform", "labels", "shift"] {
        let done = call().set("null", null).run().expect(null);
        let (r, h) = (curve(&done, "r"), curve(&done, "h"));
        assert!(
            h.iter().zip(&r).skip(3).all(|(h, r)| (h / r).abs() < 0.1),
            "{null} {h:?}"
        );
    }
    // The same places in both tables: all pairs at distance 0 come first.
    let same = Call::of::<Ripley>()
        .input("table", table(&x, &y))
        .input("other", table(&x, &y));
    assert!(curve(&same.run().expect("valid"), "h")[0] > 5.0);
}

#[test]
fn space() {
    let cube = crate::window::Cuboid {
        low: [0.0; 3],
        high: [1000.0; 3],
    };
    let [x, y, z] = uniform(&cube, 4000, &mut stream(5, 0));
    for edges in ["isotropic", "translation"] {
        let deep = table(&x, &y).f64("z", "nm", &z);
        let call = Call::of::<Ripley>()
            .input("table", deep)
            .set("z", "z")
            .set("edges", edges);
        let done = call.set("r_max", 300).run().expect("valid");
        let (r, h) = (curve(&done, "r"), curve(&done, "h"));
        assert!(
            h.iter().zip(&r).skip(5).all(|(h, r)| (h / r).abs() < 0.03),
            "{edges} {h:?}"
        );
    }
    let flat = table(&x, &y).f64("z", "nm", &vec![5.0; 4000]);
    let flat = Call::of::<Ripley>()
        .input("table", flat)
        .set("z", "z")
        .run();
    let failure = flat.expect_err("flat").to_string();
    assert!(
        failure.contains("no width along z") && failure.contains("z_min"),
        "{failure}"
    );
}

#[test]
fn what_cannot_be_studied_is_said() {
    let say = |call: Call, text: &str| {
        let failure = call.run().expect_err(text).to_string();
        assert!(failure.contains(text), "{failure}");
    };
    let call = |x: &[f64], y: &[f64]| Call::of::<Ripley>().input("table", table(x, y));
    let [x, y] = random(100, 6);
    say(call(&[], &[]), "no row has a finite position");
    say(
        call(&[f64::NAN; 3], &[1.0; 3]),
        "no row has a finite position",
    );
    say(call(&[1.0], &[1.0]), "no width along x");
    say(call(&[1.0; 5], &[1.0; 5]), "no width along x");
    let elsewhere = call(&x, &y).set("x_min", 5000).set("x_max", 6000);
    say(elsewhere, "no pair of localisations in the bounding box");
    let bow = table(&[0.0, 9.0, 0.0, 9.0], &[0.0, 9.0, 9.0, 0.0]);
    say(
        call(&x, &y).input("outline", bow.clone()),
        "crosses or touches itself",
    );
    say(
        call(&x, &y).input("outline", bow).set("x_min", 1),
        "leave out z and the bounds",
    );
    say(
        call(&x, &y).set("r_max", 2000).set("edges", "translation"),
        "reaches across the region",
    );
    say(call(&x, &y).set("simulations", 10), "take 39 or more");
    say(
        call(&x, &y).set("simulations", 39).set("null", "labels"),
        "second table",
    );
    say(call(&x, &y).set("x_min", 9).set("x_max", 9), "not above");
    say(call(&x, &y).set("x_min", "-inf"), "cannot end at");
    let zero = call(&x, &y).set("r_max", 0).run().expect_err("refused");
    assert_eq!(zero.parameter.as_deref(), Some("r_max"));
    let beyond = call(&x, &y)
        .set("r_max", 5000)
        .set("step", 100)
        .run()
        .expect("defined");
    assert!(
        beyond
            .messages
            .iter()
            .any(|m| m.1.contains("half the shortest side"))
    );
    assert!(curve(&beyond, "k").iter().all(|k| k.is_finite()));
    let stopped = call(&x, &y)
        .set("simulations", 99)
        .cancel_after(20)
        .run()
        .expect_err("stopped");
    assert!(stopped.is_cancelled());
}

#[test]
fn all_rows_equal_in_a_region_are_one_place() {
    let call = Call::of::<Ripley>().input("table", table(&[5.0; 20], &[5.0; 20]));
    let call = call
        .set("x_min", 0)
        .set("x_max", 10)
        .set("y_min", 0)
        .set("y_max", 10);
    let done = call.set("r_max", 4).set("step", 1).run().expect("defined");
    assert_eq!(curve(&done, "k"), [100.0; 4]);
}
