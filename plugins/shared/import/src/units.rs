//! Units as files spell them, brought to those of the host: nm, frame, s, rad, photon, V, 1.

/// A unit of the host and the way to it from the file's.
#[derive(Debug, Clone, PartialEq)]
pub struct Unit {
    /// The host's unit; a unit that is not known stays as the file spells it.
    pub name: String,
    /// The file's values times 10^shift are in `name`.
    pub shift: i32,
    /// A further factor that is no power of ten.
    pub factor: f64,
}

/// The unit of values of which the file does not say it.
pub const UNKNOWN: &str = "unknown";

impl Unit {
    /// The same unit on both sides.
    pub fn plain(name: &str) -> Unit {
        Unit {
            name: name.to_owned(),
            shift: 0,
            factor: 1.0,
        }
    }

    /// Whether values change on the way.
    pub fn converts(&self) -> bool {
        self.shift != 0 || self.factor != 1.0
    }

    /// Whether the file counts camera pixels.
    pub fn is_pixel(&self) -> bool {
        self.name == "px"
    }
}

const BASE: &[(&str, &str, i32)] = &[
    ("nm", "nm", 0),
    ("nanometer", "nm", 0),
    ("nanometre", "nm", 0),
    ("um", "nm", 3),
    ("µm", "nm", 3),
    ("μm", "nm", 3),
    ("micron", "nm", 3),
    ("micrometer", "nm", 3),
    ("micrometre", "nm", 3),
    ("mm", "nm", 6),
    ("m", "nm", 9),
    ("meter", "nm", 9),
    ("metre", "nm", 9),
    ("pm", "nm", -3),
    ("å", "nm", -1),
    ("angstrom", "nm", -1),
    ("px", "px", 0),
    ("pixel", "px", 0),
    ("photon", "photon", 0),
    ("ph", "photon", 0),
    ("frame", "frame", 0),
    ("fr", "frame", 0),
    ("s", "s", 0),
    ("sec", "s", 0),
    ("second", "s", 0),
    ("ms", "s", -3),
    ("us", "s", -6),
    ("µs", "s", -6),
    ("μs", "s", -6),
    ("ns", "s", -9),
    ("rad", "rad", 0),
    ("v", "V", 0),
    ("mv", "V", -3),
    ("1", "1", 0),
    ("adu", "ADU", 0),
    ("count", "ADU", 0),
];

/// Reads a unit such as `nm`, `µm^2`, `photons` or `px²`; `None` when it is not in the list.
pub fn known(text: &str) -> Option<Unit> {
    let text = text.trim();
    let (stem, power) = if let Some(stem) = text.strip_suffix('²') {
        (stem, 2)
    } else if let Some(stem) = text.strip_suffix('³') {
        (stem, 3)
    } else if let Some((stem, power)) = text.split_once('^') {
        (
            stem,
            power.trim().parse().ok().filter(|p| (-4..5).contains(p))?,
        )
    } else {
        (text, 1)
    };
    let stem = stem.trim().to_lowercase();
    if stem == "deg" || stem == "degree" || stem == "degrees" || stem == "°" {
        let factor = std::f64::consts::PI / 180.0;
        return (power == 1).then(|| Unit {
            name: "rad".into(),
            shift: 0,
            factor,
        });
    }
    let find = |stem: &str| BASE.iter().find(|(spelling, ..)| *spelling == stem);
    let long = |stem: &str| find(stem).filter(|(spelling, ..)| spelling.len() > 2);
    let (_, name, shift) = find(&stem).or_else(|| long(stem.strip_suffix('s')?))?;
    let name = if power == 1 {
        (*name).to_owned()
    } else {
        format!("{name}^{power}")
    };
    Some(Unit {
        name,
        shift: shift * power,
        factor: 1.0,
    })
}

/// Like [`known`]; a unit outside the list is kept as it is.
pub fn unit(text: &str) -> Unit {
    known(text).unwrap_or_else(|| Unit::plain(text.trim()))
}

/// Whether the host knows this unit.
pub fn of_host(text: &str) -> bool {
    text == UNKNOWN || puncta_sdk::documents::units::Unit::parse(text).is_some()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spellings_of_lengths() {
        for (text, shift) in [
            ("nm", 0),
            ("um", 3),
            ("µm", 3),
            ("μm", 3),
            ("m", 9),
            ("Å", -1),
        ] {
            assert_eq!(
                known(text),
                Some(Unit {
                    name: "nm".into(),
                    shift,
                    factor: 1.0
                }),
                "{text}"
            );
        }
        assert_eq!(
            known("um^2"),
            Some(Unit {
                name: "nm^2".into(),
                shift: 6,
                factor: 1.0
            })
        );
        assert_eq!(
            known("nm²"),
            Some(Unit {
                name: "nm^2".into(),
                shift: 0,
                factor: 1.0
            })
        );
        assert!(known("px").is_some_and(|u| u.is_pixel()));
    }

    #[test]
    fn other_units() {
        assert_eq!(known("photons"), Some(Unit::plain("photon")));
        assert_eq!(
            known("ms"),
            Some(Unit {
                name: "s".into(),
                shift: -3,
                factor: 1.0
            })
        );
        assert!(known("deg").is_some_and(|u| u.name == "rad" && u.converts()));
        assert_eq!(known("furlong"), None);
        assert_eq!(unit(" furlong "), Unit::plain("furlong"));
        assert_eq!(known(""), None);
        assert_eq!(known("nm^x"), None);
    }
}
