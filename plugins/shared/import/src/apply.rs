//! From the columns of a file to those of a table: names, units, roles, and the way to them.

use crate::mapping::{Columns, Mapping};
use crate::names::{self, Named};
use crate::units::{self, UNKNOWN, Unit};
use puncta_sdk::Failure;

/// What a format says of one of its columns.
#[derive(Debug, Clone, PartialEq)]
pub struct Source {
    /// Its name in the file.
    pub name: String,
    /// The host's name and the unit in the file (`px` for camera pixels); `None` for a column
    /// without a usable name.
    pub named: Option<Named>,
    /// Frames: the number of the first one by the format.
    pub frame_base: u8,
    /// Frames: a frame 0 was seen, so that the format's word is wrong here.
    pub has_zero: bool,
    /// The format's own description; may be empty.
    pub description: String,
}

impl Source {
    /// A column that a format names so.
    pub fn new(name: &str, named: Option<Named>) -> Source {
        Source {
            name: name.to_owned(),
            named,
            frame_base: 0,
            has_zero: false,
            description: String::new(),
        }
    }

    /// With the number of the first frame.
    #[must_use]
    pub fn frames_from(mut self, base: u8) -> Source {
        self.frame_base = base;
        self
    }

    /// With a description.
    #[must_use]
    pub fn described(mut self, text: &str) -> Source {
        self.description = text.to_owned();
        self
    }
}

/// A column of the table to be.
#[derive(Debug, Clone, PartialEq)]
pub struct Mapped {
    /// Its name.
    pub name: String,
    /// Its name in the file.
    pub source: String,
    /// The place of its source in the list.
    pub field: usize,
    /// Its unit, or `unknown`.
    pub unit: String,
    /// Nobody said a unit.
    pub silent: bool,
    /// The file counts camera pixels of unknown size.
    pub pixels: bool,
    /// `position`, `error`, `time`, `group`, `probability:<channel>` or none.
    pub role: Option<String>,
    /// One line on it, with what was done to the file's values.
    pub description: String,
    /// Values are those of the file times 10^shift ...
    pub shift: i32,
    /// ... times this factor ...
    pub factor: f64,
    /// ... minus this.
    pub base: u8,
    /// The base is the format's word, not the person's.
    pub base_guessed: bool,
    /// The column has the values of this earlier column.
    pub copy_of: Option<usize>,
}

impl Mapped {
    /// What values are multiplied with; 1 where they stay.
    pub fn scale(&self) -> f64 {
        if self.shift == 0 {
            self.factor
        } else {
            // Two powers of ten are exact where one below 1 is not.
            let power = 10f64.powi(self.shift.abs());
            if self.shift > 0 {
                self.factor * power
            } else {
                self.factor / power
            }
        }
    }

    /// Whether values change on the way.
    pub fn converts(&self) -> bool {
        self.shift != 0 || self.factor != 1.0 || self.base != 0
    }

    /// The sentence for an operation that needs the unit; `None` where the unit is known.
    pub fn remedy(&self) -> Option<String> {
        (self.unit == UNKNOWN).then(|| remedy(&self.name, self.pixels))
    }
}

/// How to say the unit of a column that has none, with the exact option.
pub fn remedy(name: &str, pixels: bool) -> String {
    if pixels {
        "its file counts camera pixels: give their size when the file is read, by --in-pixel_size \
         SIZE (in a recipe options.pixel_size), such as --in-pixel_size 100nm"
            .to_owned()
    } else {
        format!(
            "say its unit when the file is read, by --in-units {name}=nm (in a recipe \
             options.units = \"{name}=nm\"), or {name}=px with --in-pixel_size SIZE"
        )
    }
}

impl Mapping {
    /// Maps the columns of `file`. Twins follow the column whose values they have.
    ///
    /// # Errors
    /// A mapping that speaks of columns that are not there, or names two columns alike.
    pub fn apply(&self, file: &str, sources: &[Source]) -> Result<Vec<Mapped>, Failure> {
        self.check()?;
        self.check_list(file, sources)?;
        let called: Vec<Option<Named>> = sources
            .iter()
            .enumerate()
            .map(|(field, source)| self.name(field, source))
            .collect();
        self.check_names(file, sources, &called)?;
        let mut columns: Vec<Mapped> = Vec::new();
        for ((field, source), named) in sources.iter().enumerate().zip(called) {
            let Some(named) = named else { continue };
            let column = self.column(field, source, &named);
            let first = columns.len();
            columns.push(column.clone());
            if let Some(twin) = named.twin {
                columns.push(Mapped {
                    name: twin.to_owned(),
                    role: names::role(twin),
                    copy_of: Some(first),
                    ..column
                });
            }
        }
        distinct(&mut columns, file)?;
        if self.swap_xy {
            exchange(&mut columns);
        }
        Ok(columns)
    }

    fn check_list(&self, file: &str, sources: &[Source]) -> Result<(), Failure> {
        let Columns::List(list) = &self.columns else {
            return Ok(());
        };
        if list.len() == sources.len() {
            return Ok(());
        }
        let (given, there) = (list.len(), sources.len());
        let message = format!("{given} column names are given, but {file} has {there} columns");
        Err(Failure::bad_parameter("columns", message)
            .remedy("give one name for each column in order, and - to leave one out"))
    }

    /// Refuses a mapping that speaks of columns that are not there.
    fn check_names(
        &self,
        file: &str,
        sources: &[Source],
        called: &[Option<Named>],
    ) -> Result<(), Failure> {
        let mut wanted: Vec<&str> = Vec::new();
        if let Columns::Pairs(pairs) = &self.columns {
            wanted.extend(pairs.iter().map(|(source, _)| source.as_str()));
        }
        wanted.extend(self.units.iter().map(|(name, _)| name.as_str()));
        for name in wanted {
            if !has(sources, called, name) {
                return Err(absent(file, sources, name));
            }
        }
        Ok(())
    }

    /// The host's name for a column; `None` leaves it out.
    fn name(&self, field: usize, source: &Source) -> Option<Named> {
        let said = match &self.columns {
            Columns::Own => None,
            Columns::List(list) => list.get(field).map(String::as_str),
            Columns::Pairs(pairs) => pairs
                .iter()
                .find(|(name, _)| is_called(&source.name, name))
                .map(|(_, target)| target.as_str()),
        };
        let Some(target) = said else {
            return source.named.clone().or_else(|| Some(unnamed(field)));
        };
        if target == "-" {
            return None;
        }
        let mut named = names::exact(target).unwrap_or_else(|| unnamed(field));
        let own = || source.named.as_ref().and_then(|own| own.unit.clone());
        if matches!(self.columns, Columns::Pairs(_)) {
            named.unit = named
                .unit
                .or_else(own)
                .or_else(|| names::split_unit(&source.name).1);
        }
        Some(named)
    }

    /// The unit of a column: the person's word, the file's, the general one.
    fn unit(&self, source: &str, named: &Named) -> Option<Unit> {
        let name = named.name.as_str();
        let twin = |who: &str| named.twin == Some(who);
        let said = self
            .units
            .iter()
            .find(|(who, _)| is_called(source, who) || who == name || twin(who));
        let general = || {
            let unit = self.length_unit.as_deref();
            unit.filter(|_| names::is_length(name))
                .and_then(units::known)
        };
        said.and_then(|(_, unit)| units::known(unit))
            .or_else(|| named.unit.clone())
            .or_else(general)
    }

    fn column(&self, field: usize, source: &Source, named: &Named) -> Mapped {
        let unit = self.unit(&source.name, named);
        let mut notes = vec![if source.description.is_empty() {
            names::description(&named.name).to_owned()
        } else {
            source.description.clone()
        }];
        let silent = unit.is_none();
        let pixels = self.pixel_size.is_none()
            && unit
                .as_ref()
                .is_some_and(|unit| pixel_power(unit).is_some());
        let (unit, shift, mut factor) = self.convert(unit, &mut notes);
        if matches!(named.name.as_str(), "z" | "error_z") && self.z_factor != 1.0 {
            factor *= self.z_factor;
            notes.push(format!("times {}", self.z_factor));
        }
        let frames = named.name == "t" && unit == "frame";
        let base = match self.frame_base {
            _ if !frames => 0,
            Some(base) => base,
            None if source.has_zero => 0,
            None => source.frame_base,
        };
        if base > 0 {
            notes.push("counted from 1 in the file".to_owned());
        }
        notes.retain(|note| !note.is_empty());
        Mapped {
            name: named.name.clone(),
            source: source.name.clone(),
            field,
            unit,
            silent,
            pixels,
            role: names::role(&named.name),
            description: notes.join("; "),
            shift,
            factor,
            base,
            base_guessed: base > 0 && self.frame_base.is_none(),
            copy_of: None,
        }
    }

    /// The host's unit, and the way to it.
    fn convert(&self, unit: Option<Unit>, notes: &mut Vec<String>) -> (String, i32, f64) {
        let Some(unit) = unit else {
            return (UNKNOWN.to_owned(), 0, 1.0);
        };
        if let Some(power) = pixel_power(&unit) {
            let Some(size) = self.pixel_size else {
                notes.push("camera pixels in the file; give pixel_size to have nm".to_owned());
                return (UNKNOWN.to_owned(), 0, 1.0);
            };
            notes.push(format!("from camera pixels of {size} nm"));
            let name = match power {
                1 => "nm".to_owned(),
                power => format!("nm^{power}"),
            };
            return (name, 0, size.powi(power));
        }
        if unit.converts() {
            let by = match unit.shift {
                0 => unit.factor.to_string(),
                shift => format!("1e{shift}"),
            };
            notes.push(format!("converted to {} (times {by})", unit.name));
        }
        if !units::of_host(&unit.name) {
            notes.push(format!("the unit {} of the file is not known", unit.name));
            return (UNKNOWN.to_owned(), 0, 1.0);
        }
        (unit.name, unit.shift, unit.factor)
    }
}

/// The power of a unit of camera pixels.
fn pixel_power(unit: &Unit) -> Option<i32> {
    let power = unit.name.strip_prefix("px")?;
    Some(
        power
            .strip_prefix('^')
            .and_then(|p| p.parse().ok())
            .unwrap_or(1),
    )
}

/// Whether a person's `name` means the file's column `source`.
pub fn is_called(source: &str, name: &str) -> bool {
    source == name || names::split_unit(source).0 == name
}

fn has(sources: &[Source], called: &[Option<Named>], name: &str) -> bool {
    sources.iter().zip(called).any(|(source, named)| {
        let own = |named: &Named| named.name == name || named.twin == Some(name);
        is_called(&source.name, name) || named.as_ref().is_some_and(own)
    })
}

/// The failure for a column of the person's that is not there.
pub fn absent(file: &str, sources: &[Source], name: &str) -> Failure {
    const SHOWN: usize = 20;
    let quoted = |name: &str| format!("\"{}\"", name.replace(char::is_control, "\u{fffd}"));
    let names: Vec<String> = sources
        .iter()
        .take(SHOWN)
        .map(|s| quoted(&s.name))
        .collect();
    let message = format!("{file} has no column {}", quoted(name));
    Failure::bad_parameter("columns", message).remedy(format!("name one of {}", names.join(", ")))
}

fn unnamed(field: usize) -> Named {
    let name = match field {
        0 => "index".to_owned(),
        _ => format!("column_{}", field + 1),
    };
    Named {
        name,
        unit: None,
        twin: None,
    }
}

/// Gives columns of the same name different ones: the one that is called so in the file keeps it,
/// then the one in nm.
fn distinct(columns: &mut [Mapped], file: &str) -> Result<(), Failure> {
    let rank = |c: &Mapped| (c.source == c.name, c.unit == "nm", c.copy_of.is_none());
    for k in 0..columns.len() {
        let Some(this) = columns.get(k) else { break };
        let mut rivals = columns
            .iter()
            .enumerate()
            .filter(|(i, c)| *i != k && c.name == this.name);
        if !rivals.any(|(i, c)| (rank(c), k) > (rank(this), i)) {
            continue;
        }
        let own = names::identifier(&this.source).unwrap_or_else(|| format!("column_{}", k + 1));
        if own == this.name || columns.iter().any(|c| c.name == own) {
            let message = format!("{file} has two columns that would be called {}", this.name);
            let remedy = format!(
                "say which is which, such as columns = \"{}=other\"",
                this.source
            );
            return Err(Failure::bad_file(message).remedy(remedy));
        }
        if let Some(this) = columns.get_mut(k) {
            if this.name == "t" {
                this.description.clear();
            }
            this.role = names::role(&own);
            this.name = own;
            if this.copy_of.is_none() {
                this.base = 0;
                this.base_guessed = false;
            }
        }
    }
    Ok(())
}

fn exchange(columns: &mut [Mapped]) {
    for (a, b) in [("x", "y"), ("error_x", "error_y"), ("sigx", "sigy")] {
        for column in columns.iter_mut() {
            let other = match column.name.as_str() {
                name if name == a => b,
                name if name == b => a,
                _ => continue,
            };
            column.name = other.to_owned();
            column.description.push_str("; x and y exchanged");
        }
    }
}

#[cfg(test)]
#[path = "apply_tests.rs"]
mod tests;
