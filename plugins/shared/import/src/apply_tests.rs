use super::*;

fn source(name: &str, host: &str, unit: &str) -> Source {
    let unit = (!unit.is_empty()).then(|| units::unit(unit));
    Source::new(
        name,
        Some(Named {
            name: host.into(),
            unit,
            twin: None,
        }),
    )
}

fn mapping(columns: &str, units: &str) -> Mapping {
    let mut mapping = Mapping::default();
    mapping.set_columns(columns).unwrap();
    mapping.set_units(units).unwrap();
    mapping
}

/// Name, unit, factor and base of each column.
fn all(mapping: &Mapping, sources: &[Source]) -> Vec<(String, String, f64, u8)> {
    let mapped = mapping.apply("f", sources).unwrap();
    mapped
        .into_iter()
        .map(|c| (c.name.clone(), c.unit.clone(), c.scale(), c.base))
        .collect()
}

fn column(name: &str, unit: &str, scale: f64, base: u8) -> (String, String, f64, u8) {
    (name.into(), unit.into(), scale, base)
}

#[test]
fn the_format_says_and_the_person_wins() {
    let sources = [
        source("xpos", "x", "px"),
        source("ypos", "y", "px"),
        source("frame", "t", "frame").frames_from(1),
        source("odd", "odd", ""),
    ];
    assert_eq!(
        all(&Mapping::default(), &sources),
        [
            column("x", "unknown", 1.0, 0),
            column("y", "unknown", 1.0, 0),
            column("t", "frame", 1.0, 1),
            column("odd", "unknown", 1.0, 0),
        ]
    );
    let mut said = mapping("odd=z", "x=um, z=m");
    said.pixel_size = Some(160.0);
    said.frame_base = Some(0);
    said.swap_xy = true;
    said.z_factor = 0.5;
    assert_eq!(
        all(&said, &sources),
        [
            column("y", "nm", 1e3, 0),
            column("x", "nm", 160.0, 0),
            column("t", "frame", 1.0, 0),
            column("z", "nm", 0.5e9, 0),
        ]
    );
}

#[test]
fn lists_leave_out_and_must_be_complete() {
    let sources = [source("a", "a", ""), source("b", "b", "")];
    assert_eq!(
        all(&mapping("-,x [nm]", ""), &sources),
        [column("x", "nm", 1.0, 0)]
    );
    let failure = mapping("x", "").apply("f", &sources).unwrap_err();
    assert!(failure.to_string().contains("f has 2 columns"), "{failure}");
    let failure = mapping("c=x", "").apply("f", &sources).unwrap_err();
    assert!(
        failure
            .to_string()
            .contains("no column \"c\"; name one of \"a\", \"b\""),
        "{failure}"
    );
    assert!(mapping("", "c=nm").apply("f", &sources).is_err());
    assert!(mapping("a=x, b=x", "").apply("f", &sources).is_ok());
}

#[test]
fn a_column_without_a_unit_says_how_to_give_one() {
    let mapped = Mapping::default()
        .apply("f", &[source("x", "x", "px"), source("y", "y", "")])
        .unwrap();
    assert!(mapped[0].pixels && !mapped[1].pixels);
    assert!(
        mapped[0]
            .remedy()
            .unwrap()
            .contains("--in-pixel_size 100nm")
    );
    assert!(mapped[1].remedy().unwrap().contains("--in-units y=nm"));
}

#[test]
fn conversions_are_one_rounding_where_they_can_be() {
    let nm = |unit: &str| {
        let mapped = Mapping::default().apply("f", &[source("x", "x", unit)]);
        mapped.unwrap()[0].scale()
    };
    assert_eq!(nm("um"), 1000.0);
    assert_eq!(nm("angstrom"), 0.1);
    assert_eq!(nm("m"), 1e9);
}
