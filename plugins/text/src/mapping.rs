//! From the columns of a file to those of the table: names, units, types.

use crate::dialect::{Dialect, Flavour};
use crate::names::{self, Named};
use crate::options::{Columns, Options};
use crate::sample::Tally;
use crate::schema::{ColumnPlan, Kind, Plan};
use crate::units::{self, UNKNOWN, Unit};
use crate::wording::quoted;
use puncta_sdk::Failure;

/// Plans the columns of a file. `tallies` has one entry a column of the file; `data_bytes` is
/// the length of the data; `line_bytes` that of an average row.
pub fn plan(
    dialect: &Dialect,
    tallies: &[Tally],
    data_bytes: u64,
    line_bytes: f64,
    options: &Options,
) -> Result<Plan, Failure> {
    options.check()?;
    check_mapping(dialect, options)?;
    let mut columns = Vec::new();
    for (field, source) in dialect.names.iter().enumerate() {
        let Some(named) = name_of(dialect, field, source, options) else {
            continue;
        };
        let tally = tallies.get(field).copied().unwrap_or_default();
        let kind = dialect.types.get(field).copied();
        let twin = named.twin;
        let column = column(dialect, field, source, named, (tally, kind), options)?;
        if let Some(twin) = twin {
            let copy_of = Some(columns.len());
            let copy = ColumnPlan {
                name: twin.to_owned(),
                copy_of,
                ..column.clone()
            };
            columns.push(column);
            columns.push(copy);
        } else {
            columns.push(column);
        }
    }
    let mut columns = distinct(columns, dialect)?;
    exchange(&mut columns, options);
    if columns.is_empty() {
        let message = format!("the names leave no column of {}", dialect.file);
        return Err(Failure::bad_parameter("columns", message));
    }
    let fields = dialect.names.len();
    let max_rows = (data_bytes + 1) / fields.max(2) as u64;
    let expected = (data_bytes as f64 / line_bytes.max(2.0)).ceil() as u64;
    Ok(Plan {
        columns,
        fields,
        max_rows,
        expected_rows: expected.min(max_rows),
    })
}

/// Refuses a mapping that speaks of columns that are not there.
fn check_mapping(dialect: &Dialect, options: &Options) -> Result<(), Failure> {
    let mut wanted: Vec<&str> = Vec::new();
    if let Columns::Pairs(pairs) = &options.columns {
        wanted.extend(pairs.iter().map(|(source, _)| source.as_str()));
    }
    wanted.extend(options.text.iter().map(String::as_str));
    wanted.extend(options.units.iter().map(|(name, _)| name.as_str()));
    for name in wanted {
        let there = dialect.names.iter().enumerate().any(|(field, source)| {
            let named = name_of(dialect, field, source, options);
            is_called(source, name) || named.is_some_and(|n| n.name == name || n.twin == Some(name))
        });
        if !there {
            let message = format!("{} has no column {}", dialect.file, quoted(name.as_bytes()));
            let names: Vec<String> = dialect.names.iter().map(|n| quoted(n.as_bytes())).collect();
            return Err(Failure::bad_parameter("columns", message)
                .remedy(format!("name one of {}", names.join(", "))));
        }
    }
    Ok(())
}

/// Whether a person's `name` means the file's column `source`.
fn is_called(source: &str, name: &str) -> bool {
    source == name || names::split_unit(source).0 == name
}

/// The host's name for a column of the file; `None` leaves it out.
fn name_of(dialect: &Dialect, field: usize, source: &str, options: &Options) -> Option<Named> {
    if dialect.listed {
        return if source == "-" {
            None
        } else {
            names::exact(source).or_else(|| unnamed(field))
        };
    }
    if let Columns::Pairs(pairs) = &options.columns
        && let Some((_, target)) = pairs.iter().find(|(name, _)| is_called(source, name))
    {
        if target == "-" {
            return None;
        }
        let mut named = names::exact(target).or_else(|| unnamed(field))?;
        named.unit = named.unit.or_else(|| names::split_unit(source).1);
        return Some(named);
    }
    let named = match dialect.flavour {
        Flavour::Typed => verbatim(source),
        Flavour::Pyme => names::exact(source).map(|mut named| {
            named.unit = named.unit.or_else(|| names::pyme_unit(&named.name));
            named
        }),
        Flavour::Elyra => elyra(source).or_else(|| names::named(source)),
        _ => names::named(source),
    };
    named.or_else(|| unnamed(field))
}

fn unnamed(field: usize) -> Option<Named> {
    let name = if field == 0 {
        "index".to_owned()
    } else {
        format!("column_{}", field + 1)
    };
    Some(Named {
        name,
        unit: None,
        twin: None,
    })
}

/// A name of our own file: nothing in it is changed.
fn verbatim(source: &str) -> Option<Named> {
    let (name, unit) = names::split_unit(source);
    (!name.is_empty()).then(|| Named {
        name: name.to_owned(),
        unit,
        twin: None,
    })
}

fn elyra(source: &str) -> Option<Named> {
    let (name, unit, twin) = match source {
        "First Frame" => ("t", "frame", None),
        "Precision [nm]" => ("error_x", "nm", Some("error_y")),
        "Channel" => ("probe", "1", None),
        _ => return None,
    };
    Some(Named {
        name: name.to_owned(),
        unit: Some(Unit::plain(unit)),
        twin,
    })
}

/// The unit of a column: the person's word, the file's, the kind of file.
fn unit_of(source: &str, named: &Named, options: &Options) -> Option<Unit> {
    let name = named.name.as_str();
    let said = options
        .units
        .iter()
        .find(|(who, _)| is_called(source, who) || who == name);
    let said = said.and_then(|(_, unit)| units::known(unit));
    let general = || {
        options
            .length_unit
            .as_deref()
            .filter(|_| names::is_length(name))
    };
    said.or_else(|| named.unit.clone())
        .or_else(|| general().and_then(units::known))
}

fn column(
    dialect: &Dialect,
    field: usize,
    source: &str,
    named: Named,
    (tally, listed): (Tally, Option<Kind>),
    options: &Options,
) -> Result<ColumnPlan, Failure> {
    let unit = unit_of(source, &named, options);
    let silent = unit.is_none();
    let mut notes = vec![names::description(&named.name).to_owned()];
    let (unit, shift, mut factor) = convert(unit, options, &mut notes);
    if matches!(named.name.as_str(), "z" | "error_z") && options.z_factor != 1.0 {
        factor *= options.z_factor;
        notes.push(format!("times {}", options.z_factor));
    }
    let frames = named.name == "t" && unit == "frame";
    let guessed = options.frame_base.is_none();
    let base = match options.frame_base {
        _ if !frames => 0,
        Some(base) => base,
        None if tally.below_one => 0,
        None => dialect.flavour.frame_base(),
    };
    if base > 0 {
        notes.push("counted from 1 in the file".to_owned());
    }
    let text = options
        .text
        .iter()
        .any(|t| is_called(source, t) || *t == named.name);
    let kind = match listed {
        Some(kind) => kind,
        None if text => Kind::Text,
        None => kind_of(&named.name, tally, shift != 0 || factor != 1.0),
    };
    // Words, and numbers that count or label, have none.
    let bare = kind == Kind::Text || kind != Kind::F64 && names::labels(&named.name);
    let unit = if bare && silent { "1".to_owned() } else { unit };
    notes.retain(|n| !n.is_empty());
    Ok(ColumnPlan {
        role: names::role(&named.name),
        name: named.name,
        source: source.to_owned(),
        field,
        unit,
        description: notes.join("; "),
        kind,
        shift,
        factor,
        base: i32::from(base),
        base_guessed: base > 0 && guessed,
        copy_of: None,
        settled: listed.is_some(),
    })
}

/// The host's unit, and the way to it.
fn convert(unit: Option<Unit>, options: &Options, notes: &mut Vec<String>) -> (String, i32, f64) {
    let Some(unit) = unit else {
        return (UNKNOWN.to_owned(), 0, 1.0);
    };
    if let Some(power) = unit
        .name
        .strip_prefix("px")
        .map(|p| p.strip_prefix('^').unwrap_or("1"))
    {
        let power: i32 = power.parse().unwrap_or(1);
        let Some(size) = options.pixel_size else {
            notes.push("camera pixels in the file; give pixel_size to have nm".to_owned());
            return (UNKNOWN.to_owned(), 0, 1.0);
        };
        notes.push(format!("from camera pixels of {size} nm"));
        let name = if power == 1 {
            "nm".to_owned()
        } else {
            format!("nm^{power}")
        };
        return (name, 0, size.powi(power));
    }
    if unit.converts() {
        let by = if unit.shift == 0 {
            unit.factor.to_string()
        } else {
            format!("1e{}", unit.shift)
        };
        notes.push(format!("converted to {} (times {by})", unit.name));
    }
    if !units::of_host(&unit.name) {
        notes.push(format!("the unit {} of the file is not known", unit.name));
        return (UNKNOWN.to_owned(), 0, 1.0);
    }
    (unit.name, unit.shift, unit.factor)
}

fn kind_of(name: &str, tally: Tally, converts: bool) -> Kind {
    let number = names::is_length(name) || name == "t";
    let words = tally.words + tally.nothing;
    if words > 0 && (tally.numbers == 0 || tally.words >= tally.numbers) && !number {
        return Kind::Text;
    }
    let whole = tally.whole && tally.missing == 0 && tally.words == 0 && !converts;
    if whole && names::counts(name) && !names::is_length(name) {
        let small = tally.low > i64::from(i32::MIN) && tally.high <= i64::from(i32::MAX);
        if small { Kind::I32 } else { Kind::I64 }
    } else {
        Kind::F64
    }
}

/// Gives columns of the same name different ones: the one in nm keeps it.
fn distinct(mut columns: Vec<ColumnPlan>, dialect: &Dialect) -> Result<Vec<ColumnPlan>, Failure> {
    let rank = |c: &ColumnPlan| (c.source == c.name, c.unit == "nm", c.copy_of.is_none());
    for k in 0..columns.len() {
        let Some(this) = columns.get(k) else { break };
        let rivals = columns
            .iter()
            .enumerate()
            .filter(|(i, c)| *i != k && c.name == this.name);
        let loses = rivals
            .into_iter()
            .any(|(i, c)| (rank(c), k) > (rank(this), i));
        if !loses {
            continue;
        }
        let own = names::identifier(&this.source).unwrap_or_else(|| format!("column_{}", k + 1));
        if own == this.name || columns.iter().any(|c| c.name == own) {
            let message = format!(
                "{} has two columns that would be called {}",
                dialect.file, this.name
            );
            return Err(Failure::bad_file(message).remedy(format!(
                "say which is which, such as columns = \"{}=other\"",
                this.source
            )));
        }
        let copies = this.copy_of.is_some();
        if let Some(this) = columns.get_mut(k) {
            this.role = names::role(&own);
            if this.name == "t" {
                this.description.clear();
            }
            this.name = own;
            if !copies {
                this.base = 0;
                this.base_guessed = false;
            }
        }
    }
    Ok(columns)
}

fn exchange(columns: &mut [ColumnPlan], options: &Options) {
    if !options.swap_xy {
        return;
    }
    for (a, b) in [("x", "y"), ("error_x", "error_y"), ("sigx", "sigy")] {
        for column in columns.iter_mut() {
            if column.name == a {
                column.name = b.to_owned();
            } else if column.name == b {
                column.name = a.to_owned();
            } else {
                continue;
            }
            column.description.push_str("; x and y exchanged");
        }
    }
}

#[cfg(test)]
#[path = "mapping_tests.rs"]
mod tests;
