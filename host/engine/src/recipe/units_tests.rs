use super::*;
use puncta_documents::{ColumnInfo, Element};
use serde_json::json;

fn header() -> Header {
    let columns = [
        ("x", "um"),
        ("y", "nm"),
        ("A", "photons"),
        ("q", "unknown"),
        ("t", "frame"),
    ];
    let mut columns: Vec<ColumnInfo> = columns
        .iter()
        .map(|(name, unit)| ColumnInfo::new(*name, Element::F32, *unit))
        .collect();
    columns.push(ColumnInfo::new("label", Element::Utf8, "1"));
    Header::table("locs", 5, columns)
}

fn port(columns: Value) -> Port {
    serde_json::from_value(json!({"name": "table", "kind": "table", "columns": columns})).unwrap()
}

fn map(value: Value) -> Map {
    value.as_object().cloned().unwrap()
}

#[test]
fn columns_of_another_unit_are_converted() {
    let port = port(json!([
        {"name": "x", "unit": "nm"}, {"name": "y", "unit": "nm"}, {"name": "A", "unit": "photon"},
        {"name": "t"}, {"name": "row", "unit": "1"}, {"name": "q"}
    ]));
    let found = check_units(&port, &Map::new(), &header()).unwrap();
    let wanted = Conversion {
        part: 0,
        column: "x".into(),
        from: "um".into(),
        to: "nm".into(),
        factor: 1e3,
    };
    assert_eq!(found, [wanted]);
}

#[test]
fn columns_that_cannot_be_used_are_named_with_both_units() {
    for (column, unit, wanted) in [
        (
            "q",
            "nm",
            "the column q of table has the unit unknown, which does not convert to nm; say its \
                     unit when the file is read, by --in-units q=nm (in a recipe options.units = \
                     \"q=nm\")",
        ),
        (
            "t",
            "nm",
            "the column t of table has the unit frame, which does not convert to nm; choose",
        ),
        (
            "label",
            "nm",
            "the column label of table holds texts where numbers in nm are needed",
        ),
        ("X1", "nm", "table has no column X1; did you mean x?"),
        (
            "error",
            "nm",
            "table has no column error; there are x, y, A, q, t, label",
        ),
    ] {
        let port = port(json!([{"name": column, "unit": unit}]));
        let failure = check_units(&port, &Map::new(), &header())
            .unwrap_err()
            .to_string();
        assert!(failure.contains(wanted), "{failure}");
    }
}

#[test]
fn parameters_name_columns() {
    let port = port(json!([{"name": "$by", "unit": "nm"}, {"name": "x", "unit": "nm"}]));
    let check = |by: Value| check_units(&port, &map(json!({"by": by})), &header());
    assert_eq!(
        check(json!("x")).unwrap().len(),
        1,
        "asked for twice, converted once"
    );
    assert_eq!(check(json!(["x", "y"])).unwrap().len(), 1);
    assert_eq!(check(json!(null)).unwrap().len(), 1);
    assert!(check(json!(["x", "t"])).is_err());
    assert!(check(json!({"t": [0, 1]})).is_err());
}

#[test]
fn columns_of_the_second_part_are_found() {
    let mesh = Header::mesh("m", vec![ColumnInfo::new("x", Element::F64, "nm")], 3, 1);
    let port = port(json!([{"name": "x", "unit": "um"}, {"name": "a"}]));
    let found = check_units(&port, &Map::new(), &mesh).unwrap();
    assert_eq!((found[0].part, found[0].factor), (0, 0.001));
}

fn ranges() -> Vec<Parameter> {
    vec![Parameter::new("ranges", ParameterKind::Ranges)]
}

#[test]
fn limits_with_units_have_one_spelling() {
    let spell = |text: &str| {
        let mut map = map(json!({"ranges": {"x": [text, "inf"]}}));
        normalise_limits(&ranges(), &mut map).map(|()| map["ranges"]["x"][0].clone())
    };
    for (text, wanted) in [
        ("15 nm", "15 nm"),
        ("0.015 um", "15 nm"),
        (" 1.5e1nm", "15 nm"),
        ("0.3 um", "300 nm"),
        ("11 nm", "11 nm"),
        ("-2 ms", "-0.002 s"),
        ("5 photons/um^2", "0.000005 nm^-2*photon"),
    ] {
        assert_eq!(spell(text), Ok(json!(wanted)), "{text}");
    }
    for text in ["15 parsec", "nm", "x", "", "5 px"] {
        let failure = spell(text).unwrap_err();
        assert_eq!(failure.parameter.as_deref(), Some("ranges"), "{text}");
    }
}

#[test]
fn limits_come_to_the_unit_of_their_column() {
    let header = header();
    let resolve = |ranges_: Value| {
        let mut map = map(json!({"ranges": ranges_}));
        resolve_limits(&ranges(), &mut map, &|_| Some(&header)).map(|()| map["ranges"].clone())
    };
    assert_eq!(
        resolve(json!({"x": ["15 nm", "inf"], "y": [1, "2 nm"]})),
        Ok(json!({"x": [0.015, "inf"], "y": [1, 2]}))
    );
    for (ranges, word) in [
        (
            json!({"t": ["15 nm", 20]}),
            "nm is no unit of the same kind as frame",
        ),
        (json!({"q": ["15 nm", 20]}), "unknown"),
        (json!({"w": ["15 nm", 20]}), "which the input has not"),
    ] {
        let failure = resolve(ranges).unwrap_err().to_string();
        assert!(failure.contains(word), "{failure}");
    }
    let mut both = map(json!({"ranges": {"x": [1, 2]}}));
    assert!(!has_limits(&ranges(), &both));
    both["ranges"]["x"][1] = json!("2 nm");
    assert!(has_limits(&ranges(), &both));
}
