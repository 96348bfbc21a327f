use super::*;
use crate::testing::{adjusted_rand, canonical, planted};
use puncta_testkit::{Call, Done, Table};

fn table(at: &[Vec<f64>; 3]) -> Table {
    Table::new("locs")
        .f64("x", "nm", &at[0])
        .f64("y", "nm", &at[1])
        .f64("z", "nm", &at[2])
}

fn ids(done: &Done) -> Vec<i32> {
    done.output("table").unwrap().i32("hdbscan_id").unwrap()
}

#[test]
fn planted_clusters_are_found_in_the_plane_and_in_space() {
    let (at, truth) = planted(49, 80, 15.0, 300);
    let call = Call::of::<Hdbscan>()
        .set("min_size", 30)
        .set("min_samples", 10);
    let plane = call.input("table", table(&at)).run().unwrap();
    // Noise near a cluster belongs to it with a small probability.
    let sure = |done: &Done| -> Vec<i32> {
        let probability = done
            .output("table")
            .unwrap()
            .f32("hdbscan_probability")
            .unwrap();
        let pairs = ids(done).into_iter().zip(probability);
        pairs.map(|(id, p)| if p > 0.1 { id } else { 0 }).collect()
    };
    assert!(adjusted_rand(&sure(&plane), &truth) > 0.95);
    let call = Call::of::<Hdbscan>()
        .set("min_size", 30)
        .set("min_samples", 10);
    let space = call
        .set("z_scale", 1.0)
        .input("table", table(&at))
        .run()
        .unwrap();
    assert!(adjusted_rand(&sure(&space), &truth) > 0.95);
    let probability = plane
        .output("table")
        .unwrap()
        .f32("hdbscan_probability")
        .unwrap();
    for (id, probability) in ids(&plane).iter().zip(probability) {
        assert_eq!(*id > 0, probability > 0.0);
        assert!(probability <= 1.0);
    }
    let outliers = plane.output("table").unwrap().f32("outlier_score").unwrap();
    let mean = |inside: bool| {
        let some = truth
            .iter()
            .zip(&outliers)
            .filter(|(label, _)| (**label > 0) == inside);
        let scores: Vec<f32> = some.map(|(_, score)| *score).collect();
        scores.iter().sum::<f32>() / scores.len() as f32
    };
    assert!(mean(false) > 0.7 && mean(true) < 0.5);
}

#[test]
fn two_lines_of_points_have_the_hierarchy_worked_out_by_hand() {
    // Two groups of four at distance 1; the last point parts from both at 1/50, from the first,
    // which it belongs to a little, at 1/47.
    let x = [0.0, 1.0, 2.0, 3.0, 100.0, 101.0, 102.0, 103.0, 50.0];
    let at = [x.to_vec(), vec![0.0; 9], vec![0.0; 9]];
    let run = |selection: &str| {
        let call = Call::of::<Hdbscan>()
            .set("min_size", 3)
            .set("min_samples", 1);
        call.set("selection", selection)
            .input("table", table(&at))
            .run()
            .unwrap()
    };
    for selection in ["excess", "leaf"] {
        assert_eq!(ids(&run(selection)), [1, 1, 1, 1, 2, 2, 2, 2, 1]);
    }
    let outliers = run("excess")
        .output("table")
        .unwrap()
        .f32("outlier_score")
        .unwrap();
    assert_eq!(outliers[0], 0.0);
    let probability = run("excess")
        .output("table")
        .unwrap()
        .f32("hdbscan_probability")
        .unwrap();
    assert!((probability[8] - 1.0 / 47.0).abs() < 1e-6);
    // It leaves at 1/47, all others at 1.
    assert!((outliers[8] - (1.0 - 1.0 / 47.0)).abs() < 1e-6);
}

#[test]
fn changes_that_do_not_matter_change_nothing() {
    let (at, _) = planted(16, 60, 30.0, 200);
    let run = |at: &[Vec<f64>; 3], threads| {
        let call = Call::of::<Hdbscan>().set("min_size", 15).threads(threads);
        ids(&call.input("table", table(at)).run().unwrap())
    };
    let labels = run(&at, 1);
    assert_eq!(run(&at, 2), labels);
    assert_eq!(run(&at, 3), labels);
    let tripled = at.each_ref().map(|v| v.iter().map(|x| 3.0 * x).collect());
    assert_eq!(run(&tripled, 2), labels);
    let mut turned = at.clone();
    turned.swap(0, 1);
    turned[0].iter_mut().for_each(|x| *x = -*x);
    assert_eq!(run(&turned, 2), labels);
    let back = at.each_ref().map(|v| v.iter().rev().copied().collect());
    let mut reversed = run(&back, 2);
    reversed.reverse();
    assert_eq!(canonical(&reversed), labels);
}

#[test]
fn few_equal_and_missing_positions_have_a_defined_result() {
    let run = |x: Vec<f64>, single: bool| {
        let at = [x.clone(), vec![0.0; x.len()], vec![0.0; x.len()]];
        let call = Call::of::<Hdbscan>()
            .set("min_size", 3)
            .set("allow_single", single);
        ids(&call.input("table", table(&at)).run().unwrap())
    };
    assert_eq!(run(vec![], false), [0; 0]);
    assert_eq!(run(vec![1.0], false), [0]);
    assert_eq!(run(vec![1.0, 2.0], false), [0, 0]);
    assert_eq!(run(vec![4.0; 6], false), [0; 6]);
    assert_eq!(run(vec![4.0; 6], true), [1; 6]);
    assert_eq!(run(vec![4.0, f64::NAN, 4.0, 4.0, 5.0], true)[1], 0);
    let (at, _) = planted(4, 50, 20.0, 50);
    let call = Call::of::<Hdbscan>()
        .input("table", table(&at))
        .cancel_after(3);
    assert!(call.run().unwrap_err().is_cancelled());
}
