//! Units of columns and parameters.
//!
//! A unit is a product of powers of base units, such as `nm`, `photon/nm^2` or `1/s`. Two units of
//! one dimension convert by a factor. `unknown` is no unit: nothing converts from or to it.

use std::fmt;

/// Base dimensions, in the order of [`Unit`]'s powers.
const BASES: [&str; 7] = ["nm", "s", "frame", "rad", "photon", "V", "ADU"];

/// Name, base and factor to the base unit.
const NAMES: &[(&str, usize, f64)] = &[
    ("pm", 0, 1e-3),
    ("angstrom", 0, 0.1),
    ("nm", 0, 1.0),
    ("um", 0, 1e3),
    ("\u{b5}m", 0, 1e3),
    ("\u{3bc}m", 0, 1e3),
    ("mm", 0, 1e6),
    ("m", 0, 1e9),
    ("us", 1, 1e-6),
    ("\u{b5}s", 1, 1e-6),
    ("ms", 1, 1e-3),
    ("s", 1, 1.0),
    ("min", 1, 60.0),
    ("h", 1, 3600.0),
    ("frame", 2, 1.0),
    ("frames", 2, 1.0),
    ("mrad", 3, 1e-3),
    ("rad", 3, 1.0),
    ("deg", 3, std::f64::consts::PI / 180.0),
    ("photon", 4, 1.0),
    ("photons", 4, 1.0),
    ("mV", 5, 1e-3),
    ("V", 5, 1.0),
    ("ADU", 6, 1.0),
];

/// A unit: a factor times powers of the base units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Unit {
    factor: f64,
    powers: [i8; BASES.len()],
}

impl Unit {
    /// The unit of pure numbers.
    pub const ONE: Unit = Unit {
        factor: 1.0,
        powers: [0; BASES.len()],
    };

    /// Reads a unit; `None` for `unknown`, `px` and everything else that is no unit here.
    #[must_use]
    pub fn parse(text: &str) -> Option<Unit> {
        let mut unit = Unit::ONE;
        let mut sign = 1;
        let mut rest = text.trim();
        if rest.is_empty() {
            return None;
        }
        loop {
            let end = rest.find(['*', '/', '\u{b7}', ' ']).unwrap_or(rest.len());
            let (name, power) = split_power(rest[..end].trim())?;
            unit = unit.times(name, power.checked_mul(sign)?)?;
            let mut tail = rest[end..].trim_start().chars();
            match tail.next() {
                None => return Some(unit),
                Some('/') => {
                    sign = -1;
                    rest = tail.as_str().trim_start();
                }
                Some('*' | '\u{b7}') => {
                    sign = 1;
                    rest = tail.as_str().trim_start();
                }
                Some(_) => {
                    sign = 1;
                    rest = rest[end..].trim_start();
                }
            }
        }
    }

    fn times(mut self, name: &str, power: i8) -> Option<Unit> {
        if name == "1" {
            return Some(self);
        }
        if name == "Hz" {
            return self.times("s", power.checked_neg()?);
        }
        let (_, base, factor) = NAMES.iter().find(|(known, _, _)| *known == name)?;
        self.powers[*base] = self.powers[*base].checked_add(power)?;
        self.factor *= factor.powi(power.into());
        Some(self)
    }

    /// Whether values in both units measure the same kind of thing.
    #[must_use]
    pub fn same_dimension(self, other: Unit) -> bool {
        self.powers == other.powers
    }

    /// What to multiply a value in `self` with to have it in `other`; `None` for another dimension.
    #[must_use]
    pub fn factor_to(self, other: Unit) -> Option<f64> {
        self.same_dimension(other)
            .then(|| self.factor / other.factor)
    }
}

fn split_power(term: &str) -> Option<(&str, i8)> {
    for (mark, power) in [('\u{b2}', 2), ('\u{b3}', 3)] {
        if let Some(name) = term.strip_suffix(mark) {
            return Some((name, power));
        }
    }
    match term.split_once('^') {
        Some((name, power)) => Some((name, power.parse().ok()?)),
        None if term.is_empty() => None,
        None => Some((term, 1)),
    }
}

/// What to multiply values in unit `from` with to have them in unit `to`.
///
/// # Errors
/// A sentence that names both units when they do not convert.
pub fn conversion(from: &str, to: &str) -> Result<f64, String> {
    if from == to {
        return Ok(1.0);
    }
    let known = |text: &str| Unit::parse(text);
    match (known(from), known(to)) {
        (Some(a), Some(b)) => a
            .factor_to(b)
            .ok_or_else(|| format!("{from} is no unit of the same kind as {to}")),
        (None, _) => Err(format!("the unit \"{from}\" does not convert to {to}")),
        (_, None) => Err(format!("{from} does not convert to the unit \"{to}\"")),
    }
}

/// Reads a quantity such as `15 nm` or `0.015 um` and returns it in unit `to`.
///
/// # Errors
/// A sentence that says what was expected.
pub fn quantity(text: &str, to: &str) -> Result<f64, String> {
    let text = text.trim();
    let split = number_end(text);
    let number: f64 = text[..split]
        .trim()
        .parse()
        .map_err(|_| format!("\"{text}\" is no number with a unit"))?;
    let unit = text[split..].trim();
    if unit.is_empty() {
        return Ok(number);
    }
    Ok(number * conversion(unit, to)?)
}

/// Bytes of `text` that are the number; a unit may follow without a space.
fn number_end(text: &str) -> usize {
    let unsigned = text.trim_start_matches(['+', '-']);
    let sign = text.len() - unsigned.len();
    if unsigned.starts_with("inf") || unsigned.starts_with("nan") {
        return sign + 3;
    }
    let digits = |text: &str, more: &[char]| {
        text.find(|c: char| !c.is_ascii_digit() && !more.contains(&c))
            .unwrap_or(text.len())
    };
    let mantissa = digits(unsigned, &['.']);
    let tail = &unsigned[mantissa..];
    let exponent = tail.strip_prefix(['e', 'E']).map_or(0, |power| {
        let bare = power.trim_start_matches(['+', '-']);
        match digits(bare, &[]) {
            0 => 0,
            count => tail.len() - bare.len() + count,
        }
    });
    sign + mantissa + exponent
}

impl fmt::Display for Unit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut first = true;
        for (base, power) in BASES.iter().zip(self.powers) {
            if power != 0 {
                if !first {
                    f.write_str("*")?;
                }
                first = false;
                f.write_str(base)?;
                if power != 1 {
                    write!(f, "^{power}")?;
                }
            }
        }
        if first { f.write_str("1") } else { Ok(()) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lengths_convert() {
        assert_eq!(conversion("um", "nm"), Ok(1000.0));
        assert_eq!(conversion("\u{b5}m", "nm"), Ok(1000.0));
        assert_eq!(conversion("nm", "nm"), Ok(1.0));
        assert_eq!(conversion("um^2", "nm^2"), Ok(1e6));
        let density = conversion("photon/um\u{b2}", "photon/nm^2").unwrap();
        assert!((density - 1e-6).abs() < 1e-18);
        assert_eq!(conversion("Hz", "1/s"), Ok(1.0));
    }

    #[test]
    fn other_dimensions_and_unknown_units_are_refused() {
        assert!(conversion("frame", "s").unwrap_err().contains("frame"));
        assert!(conversion("unknown", "nm").is_err());
        assert!(conversion("px", "nm").is_err());
        assert!(Unit::parse("").is_none());
        assert!(Unit::parse("nm^").is_none());
        assert!(Unit::parse("nm^999").is_none());
        assert!(Unit::parse("/").is_none());
    }

    #[test]
    fn quantities_are_read_in_any_unit_of_the_dimension() {
        assert_eq!(quantity("15 nm", "nm"), Ok(15.0));
        assert_eq!(quantity("0.015um", "nm"), Ok(15.0));
        assert_eq!(quantity("1e3", "nm"), Ok(1000.0));
        assert_eq!(quantity("1e-3 mm", "nm"), Ok(1000.0));
        assert_eq!(quantity("-inf", "nm"), Ok(f64::NEG_INFINITY));
        assert!(quantity("3 s", "nm").is_err());
        assert!(quantity("nm", "nm").is_err());
    }

    #[test]
    fn names_are_canonical() {
        assert_eq!(
            Unit::parse("photons/\u{b5}m^2").unwrap().to_string(),
            "nm^-2*photon"
        );
        assert_eq!(Unit::ONE.to_string(), "1");
    }
}
