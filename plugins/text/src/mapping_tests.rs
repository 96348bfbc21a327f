use super::*;
use crate::table::Table;

fn open(text: &str, set: impl FnOnce(&mut Options)) -> Result<Table, Failure> {
    let mut options = Options::default();
    set(&mut options);
    Table::from_source(Box::new(text.as_bytes().to_vec()), "f.csv", &options)
}

/// Name, unit and type of each column.
fn columns(table: &Table) -> Vec<(&str, &str, Kind)> {
    table
        .plan
        .columns
        .iter()
        .map(|c| (c.name.as_str(), c.unit.as_str(), c.kind))
        .collect()
}

#[test]
fn thunderstorm() {
    let table = open(
        "id,frame,x [nm],uncertainty [nm],chi2\n1.0,1.0,2,3,4\n",
        |_| {},
    )
    .unwrap();
    assert_eq!(
        columns(&table),
        [
            ("id", "1", Kind::I32),
            ("t", "frame", Kind::I32),
            ("x", "nm", Kind::F64),
            ("error_x", "nm", Kind::F64),
            ("error_y", "nm", Kind::F64),
            ("chi2", "unknown", Kind::F64),
        ]
    );
    let plan = &table.plan.columns;
    assert_eq!((plan[1].base, plan[1].base_guessed), (1, true));
    assert_eq!(
        (plan[4].copy_of, plan[4].source.as_str()),
        (Some(3), "uncertainty [nm]")
    );
    assert_eq!(plan[2].role.as_deref(), Some("position"));
}

#[test]
fn a_frame_zero_in_the_sample_says_where_frames_start() {
    let table = open("frame,x [nm]\n3,1\n0,2\n", |_| {}).unwrap();
    assert_eq!(
        (
            table.plan.columns[0].base,
            table.plan.columns[0].base_guessed
        ),
        (0, false)
    );
    let table = open("frame,x [nm]\n3,1\n0,2\n", |o| {
        o.mapping.frame_base = Some(1)
    })
    .unwrap();
    assert_eq!(
        (
            table.plan.columns[0].base,
            table.plan.columns[0].base_guessed
        ),
        (1, false)
    );
}

#[test]
fn units() {
    let table = open("x [um],y (px),z,sig [furlong]\n1,2,3,4\n", |_| {}).unwrap();
    let units: Vec<_> = table
        .plan
        .columns
        .iter()
        .map(|c| (c.unit.as_str(), c.shift))
        .collect();
    assert_eq!(
        units,
        [("nm", 3), ("unknown", 0), ("unknown", 0), ("unknown", 0)]
    );
    let table = open("x [um],y (px),z,n\n1,2,3,4\n", |o| {
        o.mapping.pixel_size = Some(160.0);
        o.mapping.z_factor = 0.7;
        o.mapping.set_units("nm").unwrap();
    })
    .unwrap();
    let units: Vec<_> = table
        .plan
        .columns
        .iter()
        .map(|c| (c.unit.as_str(), c.factor))
        .collect();
    assert_eq!(
        units,
        [("nm", 1.0), ("nm", 160.0), ("nm", 0.7), ("unknown", 1.0)]
    );
    let table = open("x,y [nm]\n1,2\n", |o| {
        o.mapping.set_units("x=m, y=um").unwrap()
    })
    .unwrap();
    let units: Vec<_> = table
        .plan
        .columns
        .iter()
        .map(|c| (c.unit.as_str(), c.shift))
        .collect();
    assert_eq!(units, [("nm", 9), ("nm", 3)]);
}

#[test]
fn an_explicit_mapping_wins() {
    let table = open("frame,x [nm],b,c\n1,2,3,4\n", |o| {
        o.mapping.set_columns("b=y [um], c=-, x [nm]=z").unwrap();
        o.mapping.frame_base = Some(0);
    })
    .unwrap();
    assert_eq!(
        columns(&table),
        [
            ("t", "frame", Kind::I32),
            ("z", "nm", Kind::F64),
            ("y", "nm", Kind::F64)
        ]
    );
    assert_eq!(table.plan.columns[0].base, 0);
    let table = open("1,2,3\n", |o| {
        o.mapping.set_columns("-,x [nm],frame").unwrap()
    })
    .unwrap();
    assert_eq!(
        columns(&table),
        [("x", "nm", Kind::F64), ("frame", "unknown", Kind::I32)]
    );
    let table = open("x,y,error_x\n1,2,3\n", |o| o.mapping.swap_xy = true).unwrap();
    let names: Vec<_> = columns(&table).into_iter().map(|c| c.0).collect();
    assert_eq!(names, ["y", "x", "error_y"]);
}

#[test]
fn a_mapping_of_absent_columns_is_refused() {
    for set in ["q=x", "x=a, q=y"] {
        let failure = open("x,y\n1,2\n", |o| o.mapping.set_columns(set).unwrap())
            .err()
            .unwrap();
        assert!(failure.to_string().contains("\"q\""), "{failure}");
    }
    assert!(open("x,y\n1,2\n", |o| o.mapping.set_units("q=nm").unwrap()).is_err());
    assert!(open("x,y\n1,2\n", |o| o.text = vec!["q".into()]).is_err());
}

#[test]
fn names_that_meet() {
    let table = open("X (px),X (nm),frame,t\n1,2,3,4.5\n", |_| {}).unwrap();
    let names: Vec<_> = columns(&table).into_iter().map(|c| c.0).collect();
    assert_eq!(names, ["x_px", "x", "frame", "t"]);
    let failure = open("a b,a-b\n1,2\n", |_| {}).err().unwrap();
    assert!(failure.to_string().contains("a_b"), "{failure}");
}

#[test]
fn types_from_values() {
    let text = "id,x,name,mixed,track,big,none\n1,1,a,1,1,1,None\n2,2,b,c,,3000000000,None\n";
    let table = open(text, |_| {}).unwrap();
    let kinds: Vec<_> = columns(&table).into_iter().map(|c| c.2).collect();
    let wanted = [
        Kind::I32,
        Kind::F64,
        Kind::Text,
        Kind::Text,
        Kind::F64,
        Kind::F64,
        Kind::Text,
    ];
    assert_eq!(kinds, wanted);
    let table = open("id,x\n", |_| {}).unwrap();
    assert_eq!(
        columns(&table),
        [("id", "1", Kind::I32), ("x", "unknown", Kind::F64)]
    );
    let table = open("id,x\n3000000000,1\n", |o| o.text = vec!["x".into()]).unwrap();
    assert_eq!(
        columns(&table),
        [("id", "1", Kind::I64), ("x", "1", Kind::Text)]
    );
}

#[test]
fn pyme_names_stay_and_are_nm() {
    let table = open("#x, y, sig, t, A\n1, 2, 3, 4, 5\n", |_| {}).unwrap();
    assert_eq!(
        columns(&table),
        [
            ("x", "nm", Kind::F64),
            ("y", "nm", Kind::F64),
            ("sig", "nm", Kind::F64),
            ("t", "frame", Kind::I32),
            ("A", "unknown", Kind::F64),
        ]
    );
    assert_eq!(table.plan.columns[3].base, 0);
}
