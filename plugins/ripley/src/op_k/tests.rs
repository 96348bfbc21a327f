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
        "leave out the bounds",
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

#[test]
fn a_mask_in_space_is_a_region() {
    use puncta_sdk::ImageInfo;
    use puncta_testkit::Random;
    // Half a box of 1000 x 1000 x 500 nm, with points in all of it.
    let mut info = ImageInfo::plane(20, 20, 50.0, 0.0, 0.0);
    (info.size[2], info.voxel[0]) = (5, 100.0);
    let values: Vec<f32> = (0..2000)
        .map(|i| if i % 20 < 10 { 1.0 } else { 0.0 })
        .collect();
    let mask = puncta_testkit::Object::image("mask", info, &values);
    let mut random = Random(3);
    let mut axis = |side: f64| {
        (0..8000)
            .map(|_| side * random.unit())
            .collect::<Vec<f64>>()
    };
    let (x, y, z) = (axis(1000.0), axis(1000.0), axis(500.0));
    let inside = x.iter().filter(|x| **x < 500.0).count() as f64;
    let locs = table(&x, &y).f64("z", "nm", &z);
    let call = |edges: &str| {
        let call = Call::of::<Ripley>().input("table", locs.clone());
        let call = call.input("mask", mask.clone()).set("z", "z");
        call.set("edges", edges).set("r_max", 150).set("step", 15)
    };
    let done = call("translation").run().expect("valid");
    assert_eq!(done.value("localisations"), Some(inside));
    let curve = done.output("curve").expect("finished");
    let (r, h) = (
        curve.f64("r").expect("there"),
        curve.f64("h").expect("there"),
    );
    let worst = r.iter().zip(&h).skip(1).map(|(r, h)| (h / r).abs());
    assert!(worst.fold(0.0, f64::max) < 0.02);
    let refused = call("isotropic").run().expect_err("refused");
    assert_eq!(refused.parameter.as_deref(), Some("edges"));
    let outline = table(&[0.0, 9.0, 9.0], &[0.0, 0.0, 9.0]);
    let both = Call::of::<Ripley>().input("table", locs).set("z", "z");
    let refused = both.input("outline", outline).run().expect_err("refused");
    assert!(
        refused.to_string().contains("region of the plane"),
        "{refused}"
    );
}
