//! Names of columns as programs spell them, brought to those of the host, and units brought to nm.

use puncta_sdk::documents::Unit;
use puncta_sdk::{ColumnInfo, Element};

/// Where the source does not say.
pub const UNKNOWN: &str = "unknown";

/// Name in files in lower case, host's name, unit that the name implies.
const WORDS: &[(&str, &str, &str)] = &[
    ("x", "x", ""),
    ("y", "y", ""),
    ("z", "z", ""),
    ("position_x", "x", ""),
    ("position_y", "y", ""),
    ("position_z", "z", ""),
    ("xnm", "x", "nm"),
    ("ynm", "y", "nm"),
    ("znm", "z", "nm"),
    ("xnano", "x", "nm"),
    ("ynano", "y", "nm"),
    ("znano", "z", "nm"),
    ("frame", "t", "frame"),
    ("t", "t", ""),
    ("error_x", "error_x", ""),
    ("error_y", "error_y", ""),
    ("error_z", "error_z", ""),
    ("uncertainty_x", "error_x", ""),
    ("uncertainty_y", "error_y", ""),
    ("uncertainty_z", "error_z", ""),
    ("xnmerr", "error_x", "nm"),
    ("ynmerr", "error_y", "nm"),
    ("znmerr", "error_z", "nm"),
    ("xerrnm", "error_x", "nm"),
    ("yerrnm", "error_y", "nm"),
    ("locprecnm", "error_x", "nm"),
    ("locprecznm", "error_z", "nm"),
    ("psfxnm", "sigx", "nm"),
    ("psfynm", "sigy", "nm"),
    ("phot", "nPhotons", "photon"),
    ("photons", "nPhotons", "photon"),
    ("nphotons", "nPhotons", "photon"),
    ("bg", "background", "photon"),
    ("channel", "probe", "1"),
    ("numberingroup", "clumpSize", "1"),
    ("groupindex", "clumpIndex", "1"),
    ("original_index", "original_index", "1"),
];

/// What the host calls a column, and the unit that its name implies.
#[must_use]
pub fn known(source: &str) -> Option<(&'static str, Option<&'static str>)> {
    let lower = source.to_lowercase();
    let word = WORDS.iter().find(|(word, ..)| *word == lower)?;
    Some((word.1, Some(word.2).filter(|unit| !unit.is_empty())))
}

/// Splits `name [unit]` and `name (unit)`; the second only for a unit that the host knows.
#[must_use]
pub fn split_unit(text: &str) -> (&str, Option<&str>) {
    let text = text.trim();
    let square = text.strip_suffix(']').and_then(|t| t.rsplit_once('['));
    let round = text.strip_suffix(')').and_then(|t| t.rsplit_once('('));
    let round = round.filter(|(_, unit)| Unit::parse(unit).is_some());
    match square.or(round) {
        Some((stem, unit)) if !stem.trim().is_empty() && !unit.trim().is_empty() => {
            (stem.trim(), Some(unit.trim()))
        }
        _ => (text, None),
    }
}

/// Letters, digits and `_`; what else there is becomes `_`.
#[must_use]
pub fn identifier(text: &str) -> String {
    let fits = |c: char| c.is_alphanumeric() || c == '_';
    let words = text
        .split(|c: char| !fits(c))
        .filter(|word| !word.is_empty());
    let name = words.collect::<Vec<_>>().join("_");
    match name.as_str() {
        "" => "column".into(),
        // Every table has a virtual column of this name.
        "row" => "row_in_file".into(),
        _ => name,
    }
}

/// The role of a column of the host.
#[must_use]
pub fn role(name: &str) -> Option<&'static str> {
    match name {
        "x" | "y" | "z" => Some("position"),
        "error_x" | "error_y" | "error_z" => Some("error"),
        "t" => Some("time"),
        "clumpIndex" | "dbscanClumpID" | "objectID" | "track" => Some("group"),
        _ => None,
    }
}

/// Whether values are lengths, so that one unit for all lengths applies.
#[must_use]
pub fn is_length(name: &str) -> bool {
    matches!(
        name,
        "x" | "y" | "z" | "error_x" | "error_y" | "error_z" | "sig" | "sigx" | "sigy"
    )
}

/// A unit as the host has it, and what to multiply values with: lengths become nm. `px` and what
/// the host does not know become `unknown`, with the words of the file as the third.
#[must_use]
pub fn unit(text: &str) -> (String, f64, Option<String>) {
    let text = text.trim();
    let lower = text.to_lowercase();
    let text = match lower.as_str() {
        "micron" | "microns" | "micrometer" | "micrometre" => "um",
        "nanometer" | "nanometre" => "nm",
        "meter" | "metre" => "m",
        "sec" | "second" | "seconds" => "s",
        "photon" | "photons" => "photon",
        "dimensionless" => "1",
        _ => text,
    };
    let Some(unit) = Unit::parse(text) else {
        let words = (!text.is_empty() && lower != UNKNOWN).then(|| text.to_owned());
        return (UNKNOWN.into(), 1.0, words);
    };
    match Unit::parse("nm").and_then(|nm| unit.factor_to(nm)) {
        Some(factor) => ("nm".into(), factor, None),
        None => (text.into(), 1.0, None),
    }
}

/// A column of the host for one of a file, and the factor of its values. `stated` is the unit that
/// the file states elsewhere than in the name; `lengths` is the person's unit for lengths that have
/// none.
#[must_use]
pub fn column(
    source: &str,
    element: Element,
    stated: Option<&str>,
    lengths: &str,
) -> (ColumnInfo, f64) {
    let (stem, bracket) = split_unit(source);
    let found = known(stem);
    let name = found.map_or_else(|| identifier(stem), |(name, _)| name.to_owned());
    let stated = stated.filter(|unit| !unit.trim().is_empty());
    let implied = found.and_then(|(_, unit)| unit);
    let lengths = Some(lengths).filter(|unit| !unit.is_empty() && is_length(&name));
    let said = stated.or(bracket).or(implied).or(lengths);
    let (unit, factor, words) = said.map_or((UNKNOWN.into(), 1.0, None), unit);
    let mut info = ColumnInfo::new(&name, element, unit).source(source);
    info.role = role(&name).map(str::to_owned);
    if let Some(words) = words {
        info = info.description(format!("In {words}"));
    }
    (info, factor)
}

/// Gives every column a name of its own: the first keeps it, others get a number.
pub fn unique<'a>(columns: impl Iterator<Item = &'a mut ColumnInfo>) {
    let mut names = std::collections::HashSet::new();
    for column in columns {
        if column.name == "row" {
            column.name = "row_in_file".into();
        }
        let mut name = column.name.clone();
        let mut number = 2;
        while !names.insert(name.clone()) {
            name = format!("{}_{number}", column.name);
            number += 1;
        }
        column.name = name;
    }
}

/// Notes on what the person should know: positions without a unit.
#[must_use]
pub fn unit_note<'a>(
    file: &str,
    columns: impl Iterator<Item = &'a ColumnInfo>,
    remedy: &str,
) -> Option<String> {
    let bare: Vec<&str> = columns
        .filter(|info| info.role.as_deref() == Some("position") && info.unit == UNKNOWN)
        .map(|info| info.name.as_str())
        .collect();
    (!bare.is_empty()).then(|| {
        format!(
            "The unit of {} in {file} is unknown; give {remedy}.",
            bare.join(", ")
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_bring_their_units() {
        for (source, stated, lengths, name, its_unit, factor) in [
            ("position_x", None, "", "x", "unknown", 1.0),
            ("position_x", None, "nm", "x", "nm", 1.0),
            ("position_x", Some("um"), "nm", "x", "nm", 1000.0),
            ("x [nm]", None, "", "x", "nm", 1.0),
            ("X (um)", None, "", "x", "nm", 1000.0),
            ("width (mean)", None, "", "width_mean", "unknown", 1.0),
            ("xnm", None, "um", "x", "nm", 1.0),
            ("frame", None, "nm", "t", "frame", 1.0),
            ("y", Some("micron"), "", "y", "nm", 1000.0),
            ("x", Some("px"), "", "x", "unknown", 1.0),
            ("duration [ms]", None, "", "duration", "ms", 1.0),
        ] {
            let (info, by) = column(source, Element::F32, stated, lengths);
            let found = (info.name.as_str(), info.unit.as_str(), by);
            assert_eq!(found, (name, its_unit, factor), "{source}");
        }
    }

    #[test]
    fn equal_names_get_numbers() {
        let mut columns =
            ["x", "x", "row", "x_2"].map(|name| ColumnInfo::new(name, Element::F32, "1"));
        unique(columns.iter_mut());
        let names = columns.map(|info| info.name);
        assert_eq!(names, ["x", "x_2", "row_in_file", "x_2_2"]);
    }
}
