use super::*;
use crate::testing::planted;
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
    let both = Call::of::<Measures>().set("axial", true).set("alpha", 10);
    let done = both.input("table", table).run().unwrap();
    assert!((f64s(&done, "alpha_volume")[0] - 1000.0).abs() < 1e-9);
    assert!((f64s(&done, "alpha_surface")[0] - 600.0).abs() < 1e-9);
    assert!((f64s(&done, "alpha_density")[0] - 8e-3).abs() < 1e-12);
    assert_eq!(f64s(&done, "alpha_volume")[1], 0.0);
    assert!(f64s(&done, "alpha_density")[1].is_nan());
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

#[test]
fn changes_of_the_data_change_the_measures_as_they_must() {
    let (at, labels) = planted(9, 60, 20.0, 100);
    let order: Vec<usize> = (0..labels.len()).map(|i| i * 7 % labels.len()).collect();
    let run = |at: &[Vec<f64>; 3], order: &[usize], alpha: f64, axial: bool| {
        let [x, y, z] = at
            .each_ref()
            .map(|v| order.iter().map(|i| v[*i]).collect::<Vec<f64>>());
        let of: Vec<i32> = order.iter().map(|i| labels[*i]).collect();
        let table = Table::new("locs").f64("x", "nm", &x).f64("y", "nm", &y);
        let table = table.f64("z", "nm", &z).i32("dbscanClumpID", "1", &of);
        let call = Call::of::<Measures>()
            .set("axial", axial)
            .set("alpha", alpha);
        call.input("table", table).run().unwrap()
    };
    let plain: Vec<usize> = (0..labels.len()).collect();
    for (axial, sizes) in [
        (
            false,
            [
                "hull_area",
                "hull_perimeter",
                "alpha_area",
                "alpha_perimeter",
            ],
        ),
        (
            true,
            [
                "hull_volume",
                "hull_surface",
                "alpha_volume",
                "alpha_surface",
            ],
        ),
    ] {
        let one = run(&at, &plain, 40.0, axial);
        let same = |other: &Done, factor: f64| {
            let close = |name: &str, power: i32| {
                for (a, b) in f64s(&one, name).iter().zip(f64s(other, name)) {
                    assert!(
                        (b / a / factor.powi(power) - 1.0).abs() < 1e-5,
                        "{name} {a} {b}"
                    );
                }
            };
            for (k, name) in sizes.into_iter().enumerate() {
                close(name, if axial { 3 } else { 2 } - (k % 2) as i32);
            }
            close("gyration_radius", 1);
            close("sigma_0", 1);
            close("anisotropy", 0);
        };
        same(&run(&at, &order, 40.0, axial), 1.0);
        let changed = |change: &dyn Fn(f64) -> f64| {
            at.each_ref()
                .map(|v| v.iter().map(|x| change(*x)).collect())
        };
        same(&run(&changed(&|x| 3.0 * x), &plain, 120.0, axial), 3.0);
        same(&run(&changed(&|x| x + 1e7), &plain, 40.0, axial), 1.0);
        let mut turned = at.clone();
        turned.swap(0, 1);
        turned[0].iter_mut().for_each(|x| *x = -*x);
        same(&run(&turned, &plain, 40.0, axial), 1.0);
    }
}
