use super::*;
use crate::testing::Set;
use puncta_testkit::{Call, Done, Table};

fn table(set: &Set) -> Table {
    Table::new("locs")
        .f64("x", "nm", &set.x)
        .f64("y", "nm", &set.y)
        .f64("z", "nm", &set.z)
        .f64("t", "frame", &set.t)
        .f64("error_x", "nm", &set.sigma)
}

fn index(done: &Done) -> Vec<u32> {
    done.output("table").unwrap().u32("clumpIndex").unwrap()
}

#[test]
fn the_columns_are_the_chains_and_their_sizes() {
    let set = Set::bursts(200, 2000.0, 50.0, 3);
    let (chains, labels) = set.chain(set.combined(3.5), false, 1);
    for threads in 1..=3 {
        let call = Call::of::<Find>()
            .input("table", table(&set))
            .threads(threads);
        let done = call.run().unwrap();
        assert_eq!(index(&done), labels);
        let sizes: Vec<u32> = labels
            .iter()
            .map(|label| chains.sizes[*label as usize - 1])
            .collect();
        assert_eq!(
            done.output("table").unwrap().u32("clumpSize").unwrap(),
            sizes
        );
    }
}

#[test]
fn a_constant_radius_needs_no_errors_and_z_counts_only_if_it_is_asked_for() {
    let two = Table::new("two")
        .f32("x", "nm", &[0.0, 5.0])
        .f32("y", "nm", &[0.0, 0.0])
        .f32("z", "nm", &[0.0, 90.0])
        .i32("t", "frame", &[7, 8]);
    let with = |name: &str, value: f64| {
        let call = Call::of::<Find>().set("radius", 10.0).set(name, value);
        index(&call.input("table", two.clone()).run().unwrap())
    };
    assert_eq!(with("scale", 1.0), [1, 1]);
    assert_eq!(with("radius_z", 80.0), [1, 2]);
    // (5 / 10)^2 + (90 / 100)^2 is above 1, (5 / 10)^2 + (90 / 105)^2 is below.
    assert_eq!(with("radius_z", 100.0), [1, 2]);
    assert_eq!(with("radius_z", 105.0), [1, 1]);
}

#[test]
fn units_are_converted_and_missing_columns_named() {
    let micrometres = Table::new("locs")
        .f64("x", "nm", &[0.0, 30.0])
        .f64("y", "nm", &[0.0, 0.0])
        .i32("t", "frame", &[0, 1])
        .f64("error_x", "um", &[0.01, 0.01]);
    let call = Call::of::<Find>().input("table", micrometres.clone());
    assert_eq!(index(&call.run().unwrap()), [1, 1]);
    let failure = Call::of::<Find>()
        .set("sigma", "lpx")
        .input("table", micrometres.clone())
        .prepare()
        .unwrap_err();
    assert_eq!(
        failure.to_string(),
        "there is no column lpx in locs; name another, or give a constant radius"
    );
    let no_z = Call::of::<Find>()
        .set("radius_z", 5.0)
        .input("table", micrometres);
    assert!(no_z.prepare().unwrap_err().message.contains("no column z"));
}

#[test]
fn empty_and_single_tables_have_a_result_and_no_time_is_an_error() {
    let none = Set::default();
    let done = Call::of::<Find>()
        .input("table", table(&none))
        .run()
        .unwrap();
    assert_eq!(index(&done), [0; 0]);
    let one = Set::bursts(0, 1.0, 1.0, 1);
    let done = Call::of::<Find>()
        .input("table", table(&one))
        .run()
        .unwrap();
    assert_eq!(index(&done), [1]);
    let timeless = Table::new("locs")
        .f64("x", "nm", &[1.0])
        .f64("y", "nm", &[1.0]);
    let call = Call::of::<Find>()
        .set("radius", 1.0)
        .input("table", timeless);
    assert!(call.run().unwrap_err().message.contains('t'));
}

#[test]
fn the_reference_application_s_rule_links_to_the_earliest_within_twice_the_radius() {
    let set = Set {
        // The second lies within twice the radius of the first, the third in the same frame too.
        x: vec![0.0, 15.0, 30.0, 31.0, 500.0, 509.0],
        y: vec![0.0; 6],
        z: vec![0.0; 6],
        t: vec![0.0, 0.0, 1.0, 9.0, 9.0, 11.0],
        sigma: vec![10.0, 10.0, 10.0, 10.0, 10.0, 4.0],
    };
    let run = |gap: u64| {
        let call = Call::of::<Find>()
            .set("rule", "pyme")
            .set("scale", 1.0)
            .set("gap", gap);
        index(&call.input("table", table(&set)).run().unwrap())
    };
    // The last one's own radius decides: 9 is not below 8.
    assert_eq!(run(1), [1, 1, 1, 2, 3, 4]);
    assert_eq!(run(7), [1, 1, 1, 1, 2, 3]);
}

#[test]
fn the_reference_application_s_rule_is_that_of_brute_force() {
    let set = Set::bursts(300, 900.0, 40.0, 5).by_frame();
    let brute: Vec<u32> = {
        let mut labels: Vec<u32> = vec![];
        let mut most = 0;
        for new in 0..set.x.len() {
            let radius = 2.0 * (0.7 * set.sigma[new]) as f32;
            let earlier = (0..new).find(|&old| {
                let (dx, dy) = (
                    set.x[new] as f32 - set.x[old] as f32,
                    set.y[new] as f32 - set.y[old] as f32,
                );
                set.t[new] - set.t[old] <= 3.0 && dx * dx + dy * dy < radius * radius
            });
            if earlier.is_none() {
                most += 1;
            }
            labels.push(earlier.map_or(most, |old| labels[old]));
        }
        labels
    };
    let call = Call::of::<Find>()
        .set("rule", "pyme")
        .set("scale", 0.7)
        .set("gap", 2);
    assert_eq!(
        index(&call.input("table", table(&set)).run().unwrap()),
        brute
    );
}
