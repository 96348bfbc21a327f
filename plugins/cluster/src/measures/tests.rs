use super::*;
use puncta_testkit::{Call, Done, Table};

fn f64s(done: &Done, name: &str) -> Vec<f64> {
    done.output("clusters").unwrap().f64(name).unwrap()
}

#[test]
fn a_square_a_line_and_a_point_have_the_measures_worked_out_by_hand() {
    let table = Table::new("locs")
        .f64(
            "x",
            "nm",
            &[0.0, 4.0, 4.0, 0.0, 10.0, 11.0, 12.0, 50.0, f64::NAN, 9.0],
        )
        .f64(
            "y",
            "nm",
            &[0.0, 0.0, 2.0, 2.0, 10.0, 11.0, 12.0, 60.0, 0.0, 9.0],
        )
        .i64("objectID", "1", &[2, 2, 2, 2, 5, 5, 5, 7, 7, 0]);
    let call = Call::of::<Measures>()
        .set("group", "objectID")
        .set("alpha", 100);
    let done = call.input("table", table).run().unwrap();
    let out = done.output("clusters").unwrap();
    assert_eq!(out.i32("cluster").unwrap(), [2, 5, 7]);
    assert_eq!(out.u32("count").unwrap(), [4, 3, 1]);
    assert_eq!(f64s(&done, "x"), [2.0, 11.0, 50.0]);
    assert_eq!(f64s(&done, "y"), [1.0, 11.0, 60.0]);
    assert_eq!(f64s(&done, "hull_area"), [8.0, 0.0, 0.0]);
    assert_eq!(f64s(&done, "hull_perimeter")[0], 12.0);
    assert_eq!(f64s(&done, "density")[0], 0.5);
    assert!(f64s(&done, "density")[1].is_nan());
    assert!((f64s(&done, "alpha_area")[0] - 8.0).abs() < 1e-12);
    assert_eq!(f64s(&done, "alpha_area")[2], 0.0);
    assert_eq!(f64s(&done, "gyration_radius")[0], 5.0_f64.sqrt());
    // Squares 4 d^2 / (n - 1) of the sides of the square; a line has one axis.
    let (long, short) = (f64s(&done, "sigma_0"), f64s(&done, "sigma_1"));
    assert!((long[0] - (16.0_f64 / 3.0).sqrt()).abs() < 1e-12);
    assert!((short[0] - (4.0_f64 / 3.0).sqrt()).abs() < 1e-12);
    assert!((long[1] - 2.0_f64.sqrt()).abs() < 1e-12 && short[1].abs() < 1e-7);
    assert!((f64s(&done, "anisotropy")[0] - 0.6).abs() < 1e-12);
    assert!((f64s(&done, "anisotropy")[1] - 1.0).abs() < 1e-12);
    let axis = f64s(&done, "axis_0");
    assert_eq!(axis[..2], [1.0, 0.0]);
    assert!((axis[2] - 0.5_f64.sqrt()).abs() < 1e-12 && (axis[3] - 0.5_f64.sqrt()).abs() < 1e-12);
}

#[test]
fn a_box_in_space_and_one_without_depth() {
    let corner = |bit: i32| -> Vec<f64> {
        (0..16)
            .map(|k| if k >> bit & 1 == 1 { 10.0 } else { 0.0 })
            .collect()
    };
    let z: Vec<f64> = corner(2)
        .iter()
        .enumerate()
        .map(|(k, z)| if k < 8 { *z } else { 3.0 })
        .collect();
    let table = Table::new("locs")
        .f64("x", "nm", &corner(0))
        .f64("y", "nm", &corner(1))
        .f64("z", "um", &z.iter().map(|z| z * 1e-3).collect::<Vec<_>>())
        .i32(
            "dbscanClumpID",
            "1",
            &[1, 1, 1, 1, 1, 1, 1, 1, 2, 2, 2, 2, 2, 2, 2, 2],
        );
    let call = Call::of::<Measures>().set("axial", true);
    let done = call.input("table", table.clone()).run().unwrap();
    let volumes = f64s(&done, "hull_volume");
    assert!((volumes[0] - 1000.0).abs() < 1e-9);
    assert_eq!(volumes[1], 0.0);
    assert!((f64s(&done, "hull_surface")[0] - 600.0).abs() < 1e-9);
    assert!((f64s(&done, "z")[0] - 5.0).abs() < 1e-12);
    assert!(f64s(&done, "anisotropy")[0].abs() < 1e-12);
    let both = Call::of::<Measures>()
        .set("axial", true)
        .set("alpha", 5)
        .input("table", table);
    assert_eq!(
        both.prepare().unwrap_err().parameter.as_deref(),
        Some("alpha")
    );
}

#[test]
fn an_empty_table_has_no_cluster_and_a_missing_column_is_named() {
    let none = Table::new("locs")
        .f64("x", "nm", &[])
        .f64("y", "nm", &[])
        .i32("dbscanClumpID", "1", &[]);
    let done = Call::of::<Measures>()
        .input("table", none.clone())
        .run()
        .unwrap();
    assert_eq!(done.output("clusters").unwrap().header.rows(), 0);
    let call = Call::of::<Measures>()
        .set("group", "objectID")
        .input("table", none);
    assert!(call.prepare().unwrap_err().message.contains("objectID"));
}
