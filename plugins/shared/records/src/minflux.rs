//! Names that MINFLUX microscopes give to what they measure, whatever file it is in.

use puncta_sdk::{ColumnInfo, Element};

/// The column of the host for a field, and the factor of its values. `axis` is 0 to 2 for fields
/// that have one value along each of x, y, z.
#[must_use]
pub fn column(field: &str, axis: Option<usize>, element: Element) -> (ColumnInfo, f64) {
    const AXES: [&str; 3] = ["x", "y", "z"];
    let axis = axis.and_then(|axis| AXES.get(axis).copied());
    let source = axis.map_or_else(|| field.to_owned(), |axis| format!("{field}[{axis}]"));
    let (name, unit, factor, role, text) = match (field, axis) {
        ("loc", Some(axis)) => (axis.to_owned(), "nm", 1e9, Some("position"), "Position"),
        ("lnc", Some(axis)) => (
            format!("lnc_{axis}"),
            "nm",
            1e9,
            None,
            "Position before drift correction",
        ),
        ("ext", Some(axis)) => (
            format!("ext_{axis}"),
            "nm",
            1e9,
            None,
            "Size of the beam pattern",
        ),
        (_, Some(axis)) => (format!("{field}_{axis}"), "unknown", 1.0, None, ""),
        ("lcx" | "lcy" | "lcz", _) => {
            (field.into(), "nm", 1e9, None, "Position within the pattern")
        }
        ("gvx" | "gvy" | "eox" | "eoy" | "dmz", _) => {
            (field.into(), "nm", 1e9, None, "Place of the pattern")
        }
        ("tim", _) => ("t".into(), "s", 1.0, Some("time"), "Time"),
        ("tid", _) => ("clumpIndex".into(), "1", 1.0, Some("group"), "Trace"),
        ("eco" | "ecc", _) => (
            field.into(),
            "photon",
            1.0,
            None,
            "Counts about the offset and at the centre",
        ),
        ("efo" | "efc" | "fbg", _) => (field.into(), "1/s", 1.0, None, "Count rate"),
        ("cfr", _) => (
            field.into(),
            "1",
            1.0,
            None,
            "Ratio of the rates at the centre and about it",
        ),
        ("dcr", _) => (
            field.into(),
            "1",
            1.0,
            None,
            "Ratio of the detection channels",
        ),
        (
            "itr" | "vld" | "fnl" | "bot" | "eot" | "sta" | "act" | "sqi" | "gri" | "thi" | "tic"
            | "dos" | "sky",
            _,
        ) => (field.into(), "1", 1.0, None, ""),
        _ => (crate::names::identifier(field), "unknown", 1.0, None, ""),
    };
    let element = if factor == 1.0 { element } else { Element::F64 };
    let mut info = ColumnInfo::new(name, element, unit).source(source);
    info.role = role.map(str::to_owned);
    if !text.is_empty() {
        info = info.description(text);
    }
    (info, factor)
}

/// What is said of rows that were left out.
#[must_use]
pub fn dropped(kept: u64, rows: u64) -> Option<String> {
    let left = rows.saturating_sub(kept);
    (left > 0).then(|| {
        format!("{left} of {rows} rows are not valid final localisations and were left out.")
    })
}
