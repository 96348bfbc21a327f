//! Column names as files spell them, brought to those of the host.

use crate::units::{self, Unit};

/// A name of the host and what the file's name said with it.
#[derive(Debug, Clone, PartialEq)]
pub struct Named {
    /// The host's name.
    pub name: String,
    /// The unit in the file's name.
    pub unit: Option<Unit>,
    /// A second column with the same values: one lateral uncertainty stands for x and y.
    pub twin: Option<&'static str>,
}

/// Which words for the same thing apply; `need` is a unit without which the word says too little.
struct Word {
    word: &'static str,
    need: &'static str,
    name: &'static str,
    unit: &'static str,
    twin: Option<&'static str>,
}

const fn word(word: &'static str, name: &'static str) -> Word {
    Word {
        word,
        need: "",
        name,
        unit: "",
        twin: None,
    }
}

const fn with_unit(word: &'static str, name: &'static str, unit: &'static str) -> Word {
    Word {
        word,
        need: "",
        name,
        unit,
        twin: None,
    }
}

const fn lateral(word: &'static str, unit: &'static str) -> Word {
    Word {
        word,
        need: "",
        name: "error_x",
        unit,
        twin: Some("error_y"),
    }
}

const fn needs(word: &'static str, need: &'static str, name: &'static str) -> Word {
    Word {
        word,
        need,
        name,
        unit: "",
        twin: None,
    }
}

const WORDS: &[Word] = &[
    word("x", "x"),
    word("y", "y"),
    word("z", "z"),
    word("position_x", "x"),
    word("position_y", "y"),
    word("position_z", "z"),
    with_unit("xnano", "x", "nm"),
    with_unit("ynano", "y", "nm"),
    with_unit("znano", "z", "nm"),
    with_unit("xnm", "x", "nm"),
    with_unit("ynm", "y", "nm"),
    with_unit("znm", "z", "nm"),
    with_unit("xnmerr", "error_x", "nm"),
    with_unit("ynmerr", "error_y", "nm"),
    with_unit("znmerr", "error_z", "nm"),
    with_unit("frame", "t", "frame"),
    needs("sigma", "nm", "sig"),
    word("sigma1", "sigx"),
    word("sigma2", "sigy"),
    needs("sigma_x", "nm", "sigx"),
    needs("sigma_y", "nm", "sigy"),
    needs("intensity", "photon", "nPhotons"),
    with_unit("photons", "nPhotons", "photon"),
    with_unit("nphotons", "nPhotons", "photon"),
    with_unit("number_photons", "nPhotons", "photon"),
    with_unit("phot", "nPhotons", "photon"),
    needs("offset", "photon", "background"),
    lateral("uncertainty", ""),
    lateral("uncertainty_xy", ""),
    lateral("locprecnm", "nm"),
    with_unit("locprecznm", "error_z", "nm"),
    word("uncertainty_z", "error_z"),
    needs("x_precision", "nm", "error_x"),
    needs("y_precision", "nm", "error_y"),
    needs("z_precision", "nm", "error_z"),
];

/// Splits `name [unit]`, `name (unit)` and `name_nm`.
pub fn split_unit(text: &str) -> (&str, Option<Unit>) {
    let text = text.trim();
    if let Some((stem, unit)) = text.strip_suffix(']').and_then(|t| t.rsplit_once('[')) {
        let unit = unit.trim();
        let unit = (!unit.is_empty()).then(|| units::unit(unit));
        return (stem.trim(), unit);
    }
    let bracket = text.strip_suffix(')').and_then(|t| t.rsplit_once('('));
    if let Some((stem, unit)) = bracket
        && let Some(unit) = units::known(unit)
        && !stem.trim().is_empty()
    {
        return (stem.trim(), Some(unit));
    }
    for suffix in ["_nm", "_um", "_px"] {
        if let Some(stem) = text.strip_suffix(suffix)
            && !stem.is_empty()
            && !stem.ends_with("_per")
        {
            return (stem, units::known(suffix.trim_start_matches('_')));
        }
    }
    (text, None)
}

/// The host's name for a column of a file with named columns. `None` for a name without letters.
pub fn named(text: &str) -> Option<Named> {
    let (stem, unit) = split_unit(text);
    let plain = identifier(stem)?;
    let lower = plain.to_lowercase();
    let is = |w: &&Word| {
        w.word == lower && (w.need.is_empty() || unit.as_ref().is_some_and(|u| u.name == w.need))
    };
    let Some(word) = WORDS.iter().find(is) else {
        return Some(Named {
            name: plain,
            unit,
            twin: None,
        });
    };
    let unit = unit.or_else(|| (!word.unit.is_empty()).then(|| Unit::plain(word.unit)));
    Some(Named {
        name: word.name.to_owned(),
        unit,
        twin: word.twin,
    })
}

/// A name taken as it stands, with its unit split off (names that a person or PYME gives).
pub fn exact(text: &str) -> Option<Named> {
    let (stem, unit) = split_unit(text);
    Some(Named {
        name: identifier(stem)?,
        unit,
        twin: None,
    })
}

/// Letters, digits and `_`; a name that needs a change is lower case with `_` between its words.
pub fn identifier(text: &str) -> Option<String> {
    let text = text.trim();
    let fits = |c: char| c.is_alphanumeric() || c == '_';
    let name = if text.chars().all(fits) {
        text.to_owned()
    } else {
        let words = text.split(|c: char| !fits(c)).filter(|w| !w.is_empty());
        words.collect::<Vec<_>>().join("_").to_lowercase()
    };
    match name.as_str() {
        "" => None,
        // Every table has a virtual column of this name.
        "row" => Some("row_in_file".to_owned()),
        _ => Some(name),
    }
}

/// The unit that PYME's files imply by the name of a column.
pub fn pyme_unit(name: &str) -> Option<Unit> {
    let unit = match name {
        "x" | "y" | "z" | "x_raw" | "y_raw" | "z_raw" | "focus" | "sig" | "sigx" | "sigy" => "nm",
        "error_x" | "error_y" | "error_z" => "nm",
        "t" | "tIndex" => "frame",
        "nPhotons" => "photon",
        _ => {
            let stem = name
                .strip_prefix("fitResults_")
                .or(name.strip_prefix("fitError_"))?;
            match stem {
                "x0" | "y0" | "z0" | "sigma" | "sigmax" | "sigmay" => "nm",
                _ => return None,
            }
        }
    };
    Some(Unit::plain(unit))
}

/// The role of a column: `position`, `error`, `time`, `group`, `probability:<channel>` or none.
pub fn role(name: &str) -> Option<String> {
    let role = match name {
        "x" | "y" | "z" => "position",
        "error_x" | "error_y" | "error_z" => "error",
        "t" => "time",
        "clumpIndex" | "dbscanClumpID" | "objectID" | "track" | "track_id" | "trajectory"
        | "cluster_id" | "cluster_label" => "group",
        _ => {
            let channel = name.strip_prefix("p_").filter(|c| !c.is_empty())?;
            return Some(format!("probability:{channel}"));
        }
    };
    Some(role.to_owned())
}

/// One line on a well-known column.
pub fn description(name: &str) -> &'static str {
    match name {
        "x" | "y" | "z" => "Position",
        "t" => "Frame number, from 0",
        "error_x" | "error_y" | "error_z" => "Localisation precision",
        "sig" => "Standard deviation of the fitted spot",
        "sigx" | "sigy" => "Standard deviation of the fitted spot along one axis",
        "nPhotons" => "Photons of the spot",
        "background" => "Background photons a pixel",
        "bkgstd" => "Standard deviation of the background",
        "detections" => "Frames merged into this localisation",
        "chi2" => "Residual of the fit",
        _ => "",
    }
}

/// Whether values are a length (positions, errors, widths), so that a general length unit applies.
pub fn is_length(name: &str) -> bool {
    matches!(
        name,
        "x" | "y" | "z" | "error_x" | "error_y" | "error_z" | "sig" | "sigx" | "sigy"
    )
}

/// Whether a column counts or labels: stored as integers where all of its values are whole.
pub fn counts(name: &str) -> bool {
    let lower = name.to_lowercase();
    const WORDS: &[&str] = &[
        "t",
        "frame",
        "id",
        "index",
        "detections",
        "clumpindex",
        "clumpsize",
        "nevents",
        "probe",
        "channel",
        "track",
        "trajectory",
        "label",
        "group",
        "molecule",
        "layer",
        "site",
        "inside",
        "tid",
        "objectid",
        "z_slice",
        "tindex",
        "number_frames",
        "frames_missing",
        "first_frame",
        "number_of_localizations",
        "n_locs",
        "gt_id",
        "row_in_file",
        "loc_idx",
        "ground_truth",
    ];
    let endings = ["_id", "clumpid", "index", "_label", "_idx", "_count"];
    WORDS.contains(&lower.as_str()) || endings.iter().any(|e| lower.ends_with(e))
}

/// Whether the numbers of a column count or label something, other than frames.
pub fn labels(name: &str) -> bool {
    counts(name) && name != "t" && name != "tIndex" && !name.to_lowercase().contains("frame")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn name(text: &str) -> (String, String, bool) {
        let n = named(text).unwrap();
        (
            n.name,
            n.unit.map_or(String::new(), |u| u.name),
            n.twin.is_some(),
        )
    }

    #[test]
    fn thunderstorm_names() {
        for (text, host, unit) in [
            ("frame", "t", "frame"),
            ("x [nm]", "x", "nm"),
            ("sigma [nm]", "sig", "nm"),
            ("sigma1 [nm]", "sigx", "nm"),
            ("intensity [photon]", "nPhotons", "photon"),
            ("offset [photon]", "background", "photon"),
            ("bkgstd [photon]", "bkgstd", "photon"),
            ("uncertainty_z [nm]", "error_z", "nm"),
            ("chi2", "chi2", ""),
            ("detections", "detections", ""),
            ("gt_dist_xy [nm]", "gt_dist_xy", "nm"),
        ] {
            assert_eq!(name(text), (host.into(), unit.into(), false), "{text}");
        }
        assert_eq!(
            name("uncertainty [nm]"),
            ("error_x".into(), "nm".into(), true)
        );
        assert_eq!(
            name("uncertainty_xy [nm]"),
            ("error_x".into(), "nm".into(), true)
        );
    }

    #[test]
    fn other_spellings() {
        for (text, host, unit) in [
            ("X (nm)", "x", "nm"),
            ("x_nm", "x", "nm"),
            ("ynm", "y", "nm"),
            ("z_um", "z", "nm"),
            ("Position X [nm]", "x", "nm"),
            ("Number Photons", "nPhotons", "photon"),
            ("X precision (nm)", "error_x", "nm"),
            ("intensity", "intensity", ""),
            ("Chi square", "chi_square", ""),
            ("nPhotons [photon]", "nPhotons", "photon"),
            ("clumpIndex", "clumpIndex", ""),
            ("mean_curvature_per_um", "mean_curvature_per_um", ""),
            ("quality (raw)", "quality_raw", ""),
            ("row", "row_in_file", ""),
            ("width [furlong]", "width", "furlong"),
        ] {
            assert_eq!(name(text), (host.into(), unit.into(), false), "{text}");
        }
        assert_eq!(named(" [nm]"), None);
        assert_eq!(named("--"), None);
    }

    #[test]
    fn roles_and_counts() {
        assert_eq!(role("p_green").as_deref(), Some("probability:green"));
        assert_eq!(role("x").as_deref(), Some("position"));
        assert_eq!(role("p_"), None);
        assert!(counts("clumpIndex") && counts("t") && counts("track_id") && counts("ID"));
        assert!(!counts("x") && !counts("nPhotons") && !counts("sigma_grid"));
    }
}
