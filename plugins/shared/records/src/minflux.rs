//! Names that MINFLUX microscopes give to what they measure, whatever file it is in.

use crate::names::Raw;
use puncta_sdk::Element;

/// The column for a field. `axis` is 0 to 2 for fields that have one value along each of x, y, z.
#[must_use]
pub fn column(field: &str, axis: Option<usize>, element: Element) -> Raw {
    const AXES: [&str; 3] = ["x", "y", "z"];
    let source = axis.map_or_else(|| field.to_owned(), |axis| format!("{field}[{axis}]"));
    let name = axis.map_or_else(
        || field.to_owned(),
        |axis| match AXES.get(axis) {
            Some(letter) => format!("{field}_{letter}"),
            None => format!("{field}_{axis}"),
        },
    );
    let (name, unit, text) = match (field, axis) {
        ("loc", Some(axis @ 0..3)) => (AXES[axis].to_owned(), "m", "Position"),
        ("lnc", Some(_)) => (name, "m", "Position before drift correction"),
        ("ext", Some(_)) => (name, "m", "Size of the beam pattern"),
        ("lcx" | "lcy" | "lcz", None) => (name, "m", "Position within the pattern"),
        ("gvx" | "gvy" | "eox" | "eoy" | "dmz", None) => (name, "m", "Place of the pattern"),
        ("tim", None) => ("t".into(), "s", "Time"),
        ("tid", None) => ("clumpIndex".into(), "1", "Trace"),
        ("eco", None) => (name, "photon", "Counts about the offset"),
        ("ecc", None) => (name, "photon", "Counts at the centre"),
        ("efo" | "efc" | "fbg", None) => (name, "1/s", "Count rate"),
        ("cfr", None) => (name, "1", "Ratio of the rates at the centre and about it"),
        ("dcr", None) => (name, "1", "Ratio of the detection channels"),
        (
            "itr" | "vld" | "fnl" | "bot" | "eot" | "sta" | "act" | "sqi" | "gri" | "thi" | "tic"
            | "dos" | "sky",
            None,
        ) => (name, "1", ""),
        _ => (identifier(&name), "", ""),
    };
    Raw::new(&source, &name, unit, element).described(text)
}

/// Letters, digits and `_`.
#[must_use]
pub fn identifier(text: &str) -> String {
    puncta_shared_import::names::identifier(text).unwrap_or_else(|| "column".into())
}

/// What is said of rows that were left out.
#[must_use]
pub fn dropped(kept: u64, rows: u64) -> Option<String> {
    let left = rows.saturating_sub(kept);
    (left > 0).then(|| {
        format!("{left} of {rows} rows are not valid final localisations and were left out.")
    })
}
