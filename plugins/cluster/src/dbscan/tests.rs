use super::*;
use puncta_testkit::{Call, Table};

fn table() -> Table {
    Table::new("locs")
        .f64("x", "nm", &[0.0, 1.0, 100.0, 2.0, f64::NAN])
        .f32("y", "nm", &[0.0; 5])
        .f64("z", "nm", &[0.0, 0.0, 0.0, 30.0, 0.0])
}

fn labels(call: Call) -> Vec<i32> {
    let done = call
        .set("min_points", 2)
        .input("table", table())
        .run()
        .unwrap();
    done.output("table").unwrap().i32("dbscanClumpID").unwrap()
}

#[test]
fn the_column_holds_the_clusters_in_the_plane_or_in_space() {
    assert_eq!(labels(Call::of::<Dbscan>().set("eps", 5)), [1, 1, 0, 1, 0]);
    assert_eq!(
        labels(Call::of::<Dbscan>().set("eps", 5).set("eps_z", 5)),
        [1, 1, 0, 0, 0]
    );
    assert_eq!(
        labels(Call::of::<Dbscan>().set("eps", 5).set("eps_z", 40)),
        [1, 1, 0, 1, 0]
    );
}

#[test]
fn the_report_counts_and_the_figure_shows() {
    let call = Call::of::<Dbscan>()
        .set("eps", 5)
        .set("min_points", 3)
        .input("table", table());
    let done = call.run().unwrap();
    let value = |name: &str| done.value(name).unwrap();
    assert_eq!(value("clusters"), 1.0);
    assert_eq!(value("core"), 3.0);
    assert_eq!(value("noise"), 1.0);
    assert_eq!(value("left out"), 1.0);
    assert_eq!(done.documents[1]["series"][0]["style"], "bars");
    assert!(
        done.messages
            .iter()
            .any(|(_, text)| text.contains("1 rows without"))
    );
}

#[test]
fn a_table_without_z_or_rows_and_a_radius_of_zero() {
    let flat = Table::new("flat").f64("x", "nm", &[]).f64("y", "nm", &[]);
    let call = Call::of::<Dbscan>().input("table", flat.clone());
    let done = call.run().unwrap();
    assert_eq!(
        done.output("table").unwrap().i32("dbscanClumpID").unwrap(),
        [0; 0]
    );
    let deep = Call::of::<Dbscan>()
        .set("eps_z", 5)
        .input("table", flat.clone());
    assert!(deep.prepare().unwrap_err().message.contains("no column z"));
    let zero = Call::of::<Dbscan>().set("eps", 0).input("table", flat);
    assert_eq!(
        zero.prepare().unwrap_err().parameter.as_deref(),
        Some("eps")
    );
}
