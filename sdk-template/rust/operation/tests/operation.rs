//! The operation without the host.

use my_plugin::Distance;
use puncta_testkit::{Call, Table};

fn table(x: &[f64], y: &[f64]) -> Table {
    Table::new("table").f64("x", "nm", x).f64("y", "nm", y)
}

#[test]
fn distances_are_those_of_a_triangle() {
    let call = Call::of::<Distance>().set("x", 1.0);
    let done = call
        .input("table", table(&[1.0, 4.0], &[0.0, 4.0]))
        .run()
        .unwrap();
    let distances = done.output("table").unwrap().f64("distance").unwrap();
    assert_eq!(distances, [0.0, 5.0]);
}

#[test]
fn an_empty_table_gives_an_empty_column() {
    let done = Call::of::<Distance>()
        .input("table", table(&[], &[]))
        .run()
        .unwrap();
    assert!(
        done.output("table")
            .unwrap()
            .f64("distance")
            .unwrap()
            .is_empty()
    );
}

#[test]
fn a_cancelled_call_says_so() {
    let call = Call::of::<Distance>().cancel_after(1);
    let failure = call
        .input("table", table(&[1.0], &[1.0]))
        .run()
        .unwrap_err();
    assert!(failure.is_cancelled());
}
