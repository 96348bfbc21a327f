//! What a person may say about the columns of a file; it always wins over what the file seems to say.

use crate::units;
use puncta_sdk::Failure;

/// Names given by the person.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub enum Columns {
    /// The file's own names.
    #[default]
    Own,
    /// The names of all columns in order; `-` leaves a column out.
    List(Vec<String>),
    /// Pairs of the name in the file and the name to take.
    Pairs(Vec<(String, String)>),
}

/// An explicit mapping of a file.
#[derive(Debug, Clone, PartialEq)]
pub struct Mapping {
    /// Column names.
    pub columns: Columns,
    /// Units by column name (in the file, or the one it gets).
    pub units: Vec<(String, String)>,
    /// The unit of positions and their errors where the file gives none.
    pub length_unit: Option<String>,
    /// The size of a camera pixel in nm, for columns in px.
    pub pixel_size: Option<f64>,
    /// The number of the first frame in the file: 0 or 1.
    pub frame_base: Option<u8>,
    /// Exchanges x and y, and their errors and widths.
    pub swap_xy: bool,
    /// Multiplies z and its error (refractive index mismatch).
    pub z_factor: f64,
}

impl Default for Mapping {
    fn default() -> Mapping {
        Mapping {
            columns: Columns::Own,
            units: Vec::new(),
            length_unit: None,
            pixel_size: None,
            frame_base: None,
            swap_xy: false,
            z_factor: 1.0,
        }
    }
}

impl Mapping {
    /// Takes `columns`: a list `x,y,t` of all columns in order, or pairs `Position X=x, Frame=t`.
    pub fn set_columns(&mut self, text: &str) -> Result<(), Failure> {
        let parts = parts(text);
        let paired = parts.iter().filter(|p| p.contains('=')).count();
        self.columns = if parts.is_empty() {
            Columns::Own
        } else if paired == 0 {
            Columns::List(parts)
        } else if paired == parts.len() {
            Columns::Pairs(parts.iter().filter_map(|p| pair(p)).collect())
        } else {
            let message = format!("the columns {text:?} mix names and source=name pairs");
            return Err(Failure::bad_parameter("columns", message)
                .remedy("give all columns in order, or only pairs"));
        };
        Ok(())
    }

    /// Takes `units`: `x=um, y=um`, or one unit for all positions and errors without a unit.
    pub fn set_units(&mut self, text: &str) -> Result<(), Failure> {
        for part in parts(text) {
            let (name, unit) = match pair(&part) {
                Some((name, unit)) => (Some(name), unit),
                None => (None, part),
            };
            if units::known(&unit).is_none() {
                let message = format!("the unit {unit:?} is not known");
                let known = "give nm, um, mm, m, px, frame, s, ms, rad, deg, photon, ADU, V or 1";
                return Err(Failure::bad_parameter("units", message).remedy(known));
            }
            match name {
                Some(name) => self.units.push((name, unit)),
                None => self.length_unit = Some(unit),
            }
        }
        Ok(())
    }

    /// Whether the numbers make sense.
    pub fn check(&self) -> Result<(), Failure> {
        if self.pixel_size.is_some_and(|p| !(p.is_finite() && p > 0.0)) {
            let message = "the pixel size must be a positive number of nm";
            return Err(Failure::bad_parameter("pixel_size", message));
        }
        if !(self.z_factor.is_finite() && self.z_factor != 0.0) {
            let message = "the z factor must be a finite number other than 0";
            return Err(Failure::bad_parameter("z_factor", message));
        }
        if self.frame_base.is_some_and(|b| b > 1) {
            let message = "the number of the first frame must be 0 or 1";
            return Err(Failure::bad_parameter("frame_base", message));
        }
        Ok(())
    }
}

/// Splits at commas outside brackets, without blanks around the parts.
pub fn parts(text: &str) -> Vec<String> {
    let mut depth = 0usize;
    let split = text.split(move |c: char| {
        match c {
            '[' | '(' => depth += 1,
            ']' | ')' => depth = depth.saturating_sub(1),
            _ => {}
        }
        c == ',' && depth == 0
    });
    let parts: Vec<String> = split.map(|p| p.trim().to_owned()).collect();
    if parts.iter().all(String::is_empty) {
        Vec::new()
    } else {
        parts
    }
}

fn pair(text: &str) -> Option<(String, String)> {
    let (a, b) = text.rsplit_once('=')?;
    Some((a.trim().to_owned(), b.trim().to_owned()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_as_list_or_pairs() {
        let mut o = Mapping::default();
        o.set_columns("x [nm], y [nm],t").unwrap();
        assert_eq!(
            o.columns,
            Columns::List(vec!["x [nm]".into(), "y [nm]".into(), "t".into()])
        );
        o.set_columns("Position X [nm]=x, Frame = t").unwrap();
        let pairs = vec![
            ("Position X [nm]".into(), "x".into()),
            ("Frame".into(), "t".into()),
        ];
        assert_eq!(o.columns, Columns::Pairs(pairs));
        o.set_columns("").unwrap();
        assert_eq!(o.columns, Columns::Own);
        assert!(o.set_columns("x=a, y").is_err());
    }

    #[test]
    fn units_by_column_or_for_all_lengths() {
        let mut o = Mapping::default();
        o.set_units("x=um, y = px").unwrap();
        o.set_units("nm").unwrap();
        assert_eq!(
            o.units,
            [("x".into(), "um".into()), ("y".into(), "px".into())]
        );
        assert_eq!(o.length_unit.as_deref(), Some("nm"));
        assert!(o.set_units("x=furlong").is_err());
    }

    #[test]
    fn nonsense_is_refused() {
        assert!(
            Mapping {
                pixel_size: Some(-1.0),
                ..Mapping::default()
            }
            .check()
            .is_err()
        );
        assert!(
            Mapping {
                z_factor: f64::NAN,
                ..Mapping::default()
            }
            .check()
            .is_err()
        );
        assert!(
            Mapping {
                frame_base: Some(2),
                ..Mapping::default()
            }
            .check()
            .is_err()
        );
    }
}
