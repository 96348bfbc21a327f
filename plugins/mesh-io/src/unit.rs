//! Units of coordinates.

use puncta_sdk::Choice;

/// Unit of the coordinates of a file.
#[derive(Choice, Clone, Copy, Debug, PartialEq, Eq)]
pub enum Unit {
    /// As the file says; unknown if it does not
    File,
    /// Nanometres
    Nm,
    /// Micrometres
    Um,
    /// Millimetres
    Mm,
    /// Metres
    M,
    /// Ångström
    Angstrom,
}

/// The unit where a file does not say it.
pub const UNKNOWN: &str = "unknown";

/// What a comment that says the unit begins with, as the writers write it.
pub const COMMENT: &str = "puncta unit ";
/// What a comment that says the unit of a column begins with.
pub const COLUMN: &str = "puncta column ";

impl Unit {
    /// The unit's name in files.
    #[must_use]
    pub fn name(self) -> Option<&'static str> {
        Some(match self {
            Unit::File => return None,
            Unit::Nm => "nm",
            Unit::Um => "um",
            Unit::Mm => "mm",
            Unit::M => "m",
            Unit::Angstrom => "angstrom",
        })
    }
}

/// Nanometres in a unit; `None` if it is no length that is known.
#[must_use]
pub fn in_nm(unit: &str) -> Option<f64> {
    Some(match unit {
        "nm" => 1.0,
        "um" | "µm" | "μm" => 1e3,
        "mm" => 1e6,
        "m" => 1e9,
        "angstrom" | "Å" => 0.1,
        _ => return None,
    })
}

/// The unit that comments of our own writers say.
#[must_use]
pub fn of_comments<'a>(comments: impl IntoIterator<Item = &'a str>) -> Option<String> {
    comments.into_iter().find_map(|comment| {
        let unit = comment.split_once(COMMENT)?.1.split_whitespace().next()?;
        in_nm(unit).map(|_| unit.to_owned())
    })
}
