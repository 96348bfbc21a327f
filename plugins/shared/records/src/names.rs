//! Columns as a file has them, brought to those of the host by the rules that all readers share.

use crate::split::Field;
use puncta_sdk::{ColumnInfo, Element, Failure};
pub use puncta_shared_import::UNKNOWN;
use puncta_shared_import::names::{Named, named};
use puncta_shared_import::{Mapping, Source, Unit, units};

/// Names in lower case that binary formats have besides those of text files, the host's name, and
/// the unit that the name implies.
const WORDS: &[(&str, &str, &str)] = &[
    ("uncertainty_x", "error_x", ""),
    ("uncertainty_y", "error_y", ""),
    ("xerrnm", "error_x", "nm"),
    ("yerrnm", "error_y", "nm"),
    ("psfxnm", "sigx", "nm"),
    ("psfynm", "sigy", "nm"),
    ("bg", "background", "photon"),
    ("channel", "probe", "1"),
    ("numberingroup", "clumpSize", "1"),
    ("groupindex", "clumpIndex", "1"),
    ("original_index", "original_index", "1"),
];

/// A column as the file has it.
#[derive(Clone, Debug)]
pub struct Raw {
    /// Name in the file.
    pub source: String,
    /// Type in the file, and what a row has of it.
    pub type_: puncta_sdk::ColumnType,
    /// The host's name, and the unit in the file.
    pub named: Named,
    /// Number of the first frame, for frames.
    pub first_frame: u8,
    /// One line; may be empty.
    pub description: String,
}

/// A column of the host: where its values come from and what is done to them.
#[derive(Clone, Debug)]
pub struct Placed {
    /// What it is, with the type in the file.
    pub info: ColumnInfo,
    /// Place of the column of the file.
    pub place: usize,
    /// Values are multiplied with this ...
    pub factor: f64,
    /// ... and then this is taken away.
    pub minus: f64,
}

impl Raw {
    /// A column whose name the host has for it, with the unit in the file; an empty one is unknown.
    #[must_use]
    pub fn new(source: &str, name: &str, unit: &str, element: Element) -> Raw {
        let named = Named {
            name: name.to_owned(),
            unit: known_unit(unit),
            twin: None,
        };
        Raw {
            source: source.to_owned(),
            type_: puncta_sdk::ColumnType::scalar(element),
            named,
            first_frame: 0,
            description: String::new(),
        }
    }

    /// A column by the name that it has in the file; `stated` is the unit that the file states
    /// elsewhere.
    #[must_use]
    pub fn named(source: &str, element: Element, stated: Option<&str>) -> Raw {
        let lower = source.to_lowercase();
        let word = WORDS.iter().find(|(word, ..)| *word == lower);
        let mut raw = match word {
            Some((_, name, unit)) => Raw::new(source, name, unit, element),
            None => {
                let mut raw = Raw::new(source, "column", "", element);
                raw.named = named(source).unwrap_or(raw.named);
                raw
            }
        };
        if let Some(unit) = stated.and_then(known_unit) {
            raw.named.unit = Some(unit);
        }
        raw
    }

    /// With a description.
    #[must_use]
    pub fn described(mut self, text: &str) -> Raw {
        self.description = text.to_owned();
        self
    }

    /// Frames that are counted from 1.
    #[must_use]
    pub fn from_one(mut self) -> Raw {
        self.first_frame = 1;
        self
    }
}

fn known_unit(text: &str) -> Option<Unit> {
    let text = text.trim();
    (!text.is_empty() && text != UNKNOWN).then(|| units::known(text).unwrap_or(units::unit(text)))
}

impl Placed {
    /// Whether values become f64: positions and their errors, and what is converted.
    #[must_use]
    pub fn converts(&self) -> bool {
        let role = self.info.role.as_deref();
        self.factor != 1.0 || matches!(role, Some("position" | "error"))
    }
}

/// The columns of the host, and what the person should know of them.
///
/// # Errors
/// A mapping that speaks of columns that are not there.
pub fn place(
    file: &str,
    mapping: &Mapping,
    columns: &[Raw],
) -> Result<(Vec<Placed>, Vec<String>), Failure> {
    let sources: Vec<Source> = columns
        .iter()
        .map(|raw| {
            Source::new(&raw.source, Some(raw.named.clone()))
                .frames_from(raw.first_frame)
                .described(&raw.description)
        })
        .collect();
    let mapped = mapping.apply(file, &sources)?;
    let (mut placed, mut bare, mut pixels) = (Vec::new(), Vec::new(), false);
    for one in mapped {
        if one.role.as_deref() == Some("position") && one.unit == UNKNOWN {
            bare.push(one.name.clone());
            pixels |= one.pixels;
        }
        let mut info = ColumnInfo::new(&one.name, Element::F64, &one.unit).source(&one.source);
        info.type_ = columns.get(one.field).map_or(info.type_, |raw| raw.type_);
        info.role.clone_from(&one.role);
        if !one.description.is_empty() {
            info = info.description(&one.description);
        }
        // An operation that needs the unit says how to give it.
        if let Some(remedy) = one.remedy().filter(|_| !info.type_.element.is_text()) {
            info.rest.insert("remedy".into(), remedy.into());
        }
        placed.push(Placed {
            info,
            place: one.field,
            factor: one.scale(),
            minus: f64::from(one.base),
        });
    }
    let mut notes = Vec::new();
    if !bare.is_empty() {
        let remedy = if pixels {
            "pixel_size"
        } else {
            "units, such as nm or um"
        };
        let list = bare.join(", ");
        notes.push(format!(
            "The unit of {list} in {file} is unknown; give {remedy}."
        ));
    }
    Ok((placed, notes))
}

/// Stored fields as columns of the host. `raw` describes them in the same order.
///
/// # Errors
/// A mapping that speaks of columns that are not there.
pub fn fields(
    file: &str,
    mapping: &Mapping,
    raw: &[Raw],
    stored: &[Field],
) -> Result<(Vec<Field>, Vec<String>), Failure> {
    let (placed, notes) = place(file, mapping, raw)?;
    let fields = placed.into_iter().filter_map(|one| {
        let mut field = stored.get(one.place)?.clone();
        let (type_, converts) = (field.info.type_, one.converts());
        field.info = one.info;
        field.info.type_ = type_;
        if converts {
            field.shift = field.shift * one.factor - one.minus;
            field = field.scaled(one.factor);
        } else if field.shift != 0.0 {
            field.shift -= one.minus;
            field = field.scaled(1.0);
        } else if one.minus > 0.0 {
            field = field.from_one();
        }
        Some(field)
    });
    Ok((fields.collect(), notes))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_bring_their_units() {
        for (source, stated, name, unit, factor) in [
            ("position_x", None, "x", "unknown", 1.0),
            ("position_x", Some("um"), "x", "nm", 1000.0),
            ("x [nm]", None, "x", "nm", 1.0),
            ("X (um)", None, "x", "nm", 1000.0),
            ("xnm", None, "x", "nm", 1.0),
            ("frame", None, "t", "frame", 1.0),
            ("y", Some("micron"), "y", "nm", 1000.0),
            ("x", Some("pixel"), "x", "unknown", 1.0),
            ("uncertainty_x", Some("nm"), "error_x", "nm", 1.0),
            ("channel", None, "probe", "1", 1.0),
        ] {
            let raw = Raw::named(source, Element::F32, stated);
            let (placed, _) = place("a", &Mapping::default(), &[raw]).unwrap();
            let one = &placed[0];
            let found = (one.info.name.as_str(), one.info.unit.as_str(), one.factor);
            assert_eq!(found, (name, unit, factor), "{source}");
        }
    }

    #[test]
    fn what_the_person_says_wins() {
        let mut mapping = Mapping::default();
        mapping.set_units("x=nm").unwrap();
        mapping.z_factor = 0.5;
        let raw = [
            Raw::new("loc[0]", "x", "m", Element::F64),
            Raw::new("loc[2]", "z", "m", Element::F64),
            Raw::new("fr", "t", "frame", Element::I32).from_one(),
        ];
        let (placed, notes) = place("a", &mapping, &raw).unwrap();
        assert_eq!(
            (placed[0].factor, placed[1].factor, placed[2].minus),
            (1.0, 5e8, 1.0)
        );
        assert!(notes.is_empty());
    }
}
