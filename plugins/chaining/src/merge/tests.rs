use super::*;
use puncta_testkit::{Call, Done, Table};

fn merged(table: Table) -> Done {
    Call::of::<Merge>().input("table", table).run().unwrap()
}

fn f64s(done: &Done, name: &str) -> Vec<f64> {
    done.output("table").unwrap().f64(name).unwrap()
}

#[test]
fn positions_are_weighted_with_their_inverse_variances() {
    // 0 +- 1 and 10 +- 2: 2.0 +- 0.894.
    let done = merged(
        Table::new("locs")
            .f64("x", "nm", &[0.0, 10.0])
            .f64("error_x", "nm", &[1.0, 2.0])
            .i32("t", "frame", &[4, 3])
            .u32("clumpIndex", "1", &[1, 1]),
    );
    assert_eq!(f64s(&done, "x"), [2.0]);
    assert!((f64s(&done, "error_x")[0] - 0.8_f64.sqrt()).abs() < 1e-15);
    let out = done.output("table").unwrap();
    assert_eq!(out.i32("t").unwrap(), [3]);
    assert_eq!(out.i32("t_last").unwrap(), [4]);
    assert_eq!(out.u32("clumpSize").unwrap(), [2]);
}

#[test]
fn each_column_follows_its_rule_and_no_row_is_made_up() {
    let table = Table::new("locs")
        .f64("x", "nm", &[1.0, 2.0, 100.0, 3.0])
        .f32("nPhotons", "photon", &[10.0, 20.0, 7.0, 30.0])
        .f32("error_nPhotons", "photon", &[3.0, 4.0, 1.0, 12.0])
        .f32("sig", "nm", &[100.0, 110.0, 90.0, f32::NAN])
        .u8("probe", "1", &[2, 1, 5, 1])
        .texts("note", &["a", "b", "c", "d"])
        .i32("t", "frame", &[9, 5, 1, 7])
        .i64(
            "clumpIndex",
            "1",
            &[700_000_000_000, 700_000_000_000, 0, 700_000_000_000],
        );
    let call = Call::of::<Merge>().input("table", table);
    assert_eq!(
        call.prepare().unwrap().notes,
        ["note is left out: texts are not merged"]
    );
    let done = call.run().unwrap();
    let out = done.output("table").unwrap();
    assert_eq!(f64s(&done, "x"), [2.0]);
    assert_eq!(out.f32("nPhotons").unwrap(), [60.0]);
    assert_eq!(out.f32("error_nPhotons").unwrap(), [13.0]);
    assert_eq!(out.f32("sig").unwrap(), [105.0]);
    assert_eq!(out.bytes("probe").unwrap(), [1]);
    assert_eq!(out.i64("clumpIndex").unwrap(), [700_000_000_000]);
    assert!(out.texts("note").is_err());
    let report = done.documents[0].to_string();
    assert!(report.contains("left out"), "{report}");
}

#[test]
fn errors_that_are_missing_or_zero_have_a_defined_result() {
    let nan = f64::NAN;
    let done = merged(
        Table::new("locs")
            .f64("x", "nm", &[0.0, 10.0, 4.0, 6.0, 1.0, 3.0])
            .f64("error_x", "nm", &[0.0, 2.0, nan, -1.0, nan, 1e-200])
            .u32("clumpIndex", "1", &[1, 1, 2, 2, 3, 3]),
    );
    assert_eq!(f64s(&done, "x"), [0.0, 5.0, 3.0]);
    let errors = f64s(&done, "error_x");
    assert_eq!(errors[0], 0.0);
    assert!(errors[1].is_nan());
    assert_eq!(errors[2], 1e-200);
}

#[test]
fn the_floor_holds_for_errors_of_positions() {
    let table = Table::new("locs")
        .f64("x", "nm", &[0.0, 0.0])
        .f64("error_x", "nm", &[1.0, 1.0])
        .u32("clumpIndex", "1", &[1, 1]);
    let call = Call::of::<Merge>()
        .set("error_floor", 0.9)
        .input("table", table);
    assert_eq!(f64s(&call.run().unwrap(), "error_x"), [0.9]);
}

#[test]
fn a_shift_of_everything_shifts_the_result() {
    let errors: Vec<f64> = (0..1000).map(|k| 5.0 + f64::from(k % 7)).collect();
    let groups: Vec<u32> = (0..1000).map(|k| 1 + k % 50).collect();
    let at = |shift: f64| {
        let x: Vec<f64> = (0..1000).map(|k| f64::from(k * k % 101) + shift).collect();
        let table = Table::new("locs")
            .f64("x", "nm", &x)
            .f64("error_x", "nm", &errors)
            .u32("clumpIndex", "1", &groups);
        f64s(&merged(table), "x")
    };
    for (here, there) in at(0.0).iter().zip(at(1e7)) {
        assert!((here - (there - 1e7)).abs() < 1e-8);
    }
}

#[test]
fn lists_empty_tables_and_missing_groups() {
    let empty = Table::new("locs")
        .f64("x", "nm", &[])
        .u32("clumpIndex", "1", &[]);
    assert_eq!(f64s(&merged(empty), "x"), [0.0; 0]);
    let none = Table::new("locs").f64("x", "nm", &[1.0]);
    let failure = Call::of::<Merge>()
        .input("table", none)
        .prepare()
        .unwrap_err();
    assert_eq!(failure.parameter.as_deref(), Some("group"));
    let stopped = Table::new("locs").u32("clumpIndex", "1", &[1]);
    let call = Call::of::<Merge>().input("table", stopped).cancel_after(1);
    assert!(call.run().unwrap_err().is_cancelled());
}

#[test]
fn merging_is_the_same_on_any_number_of_threads() {
    let count = 50_000_u32;
    let x: Vec<f64> = (0..count)
        .map(|k| f64::from(k.wrapping_mul(2_654_435_761)) * 1e-3)
        .collect();
    let errors: Vec<f64> = (0..count).map(|k| 1.0 + f64::from(k % 13)).collect();
    let groups: Vec<u32> = (0..count)
        .map(|k| k.wrapping_mul(40_503) % 20_000)
        .collect();
    let run = |threads| {
        let table = Table::new("locs")
            .f64("x", "nm", &x)
            .f64("error_x", "nm", &errors)
            .u32("clumpIndex", "1", &groups);
        let done = Call::of::<Merge>()
            .input("table", table)
            .threads(threads)
            .run()
            .unwrap();
        (f64s(&done, "x"), f64s(&done, "error_x"))
    };
    let one = run(1);
    assert_eq!(one.0.len(), 19_999);
    assert_eq!(run(2), one);
    assert_eq!(run(3), one);
}
