//! Units of an input's columns against those that an operation needs.

use puncta_documents::{Failure, Header, Map, Parameter, ParameterKind, Port};
use puncta_documents::{Unit, number, units};
use serde::Serialize;
use serde_json::Value;

/// The column that every table has without holding it.
const ROW: &str = "row";

/// A column that is multiplied before an operation sees it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Conversion {
    /// Part of the object.
    pub part: usize,
    /// Column.
    pub column: String,
    /// Its unit.
    pub from: String,
    /// The unit that the operation needs.
    pub to: String,
    /// What to multiply its values with.
    pub factor: f64,
}

/// Compares an object with what a port needs: which columns have to be converted.
///
/// # Errors
/// A sentence when a column is missing, or its unit is of another kind or unknown.
pub fn check_units(
    port: &Port,
    parameters: &Map,
    header: &Header,
) -> Result<Vec<Conversion>, Failure> {
    let mut conversions: Vec<Conversion> = Vec::new();
    for need in &port.columns {
        for column in needed(&need.name, parameters) {
            if let Some(found) = check_column(port, column, need.unit.as_deref(), header)?
                && !conversions.contains(&found)
            {
                conversions.push(found);
            }
        }
    }
    Ok(conversions)
}

/// The names that a need stands for: its own, or what the parameter `$name` says.
fn needed<'a>(name: &'a str, parameters: &'a Map) -> Vec<&'a str> {
    let Some(parameter) = name.strip_prefix('$') else {
        return vec![name];
    };
    match parameters.get(parameter) {
        Some(Value::String(column)) if !column.is_empty() => vec![column],
        Some(Value::Array(columns)) => columns.iter().filter_map(Value::as_str).collect(),
        Some(Value::Object(map)) => map.keys().map(String::as_str).collect(),
        _ => Vec::new(),
    }
}

fn check_column(
    port: &Port,
    column: &str,
    unit: Option<&str>,
    header: &Header,
) -> Result<Option<Conversion>, Failure> {
    let mut parts = header.parts.iter().enumerate();
    let Some((part, info)) = parts.find_map(|(at, part)| Some((at, part.column(column)?))) else {
        if column == ROW {
            return Ok(None);
        }
        return Err(missing(&port.name, column, header));
    };
    let Some(unit) = unit.filter(|unit| *unit != info.unit) else {
        return Ok(None);
    };
    if info.type_.element.is_text() {
        return Err(Failure::bad_input(format!(
            "the column {column} of {} holds texts where numbers in {unit} are needed",
            port.name
        ))
        .remedy("choose another column, or read the file with another column mapping"));
    }
    let factor = units::conversion(&info.unit, unit).map_err(|_| {
        let unknown = Unit::parse(&info.unit).is_none();
        Failure::bad_input(format!(
            "the column {column} of {} has the unit {}, which does not convert to {unit}",
            port.name, info.unit
        ))
        .remedy(if unknown {
            remedy(info).unwrap_or_else(|| {
                format!(
                    "say its unit when the file is read, by --in-units {column}={unit} (in a recipe \
                     options.units = \"{column}={unit}\")"
                )
            })
        } else {
            format!(
                "choose another column, or correct its unit by the reader's option units = \
                 \"{column}={unit}\""
            )
        })
    })?;
    // photon and photons are one unit.
    #[allow(clippy::float_cmp)]
    let same = factor == 1.0;
    Ok((!same).then(|| Conversion {
        part,
        column: column.into(),
        from: info.unit.clone(),
        to: unit.into(),
        factor,
    }))
}

/// What the column's reader says about giving it a unit.
fn remedy(info: &puncta_documents::ColumnInfo) -> Option<String> {
    let text = info.rest.get("remedy")?.as_str()?;
    Some(text.to_owned())
}

fn missing(port: &str, column: &str, header: &Header) -> Failure {
    const SHOWN: usize = 12;
    let names = || {
        let columns = header.parts.iter().flat_map(|part| &part.columns);
        columns.map(|column| column.name.as_str())
    };
    let count = names().count();
    let list: Vec<&str> = names().take(SHOWN).collect();
    let more = if count > SHOWN {
        format!(" and {} more", count - SHOWN)
    } else {
        String::new()
    };
    let remedy = match super::closest::closest(column, names()) {
        Some(near) => format!("did you mean {near}?"),
        None if count == 0 => "it has no columns".into(),
        None => format!("there are {}{more}", list.join(", ")),
    };
    Failure::bad_input(format!("{port} has no column {column}")).remedy(remedy)
}

/// Gives limits that are texts, such as "0.015 um", one spelling: a number in base units.
///
/// # Errors
/// A sentence that names the parameter, when a limit is no quantity.
pub(crate) fn normalise_limits(schema: &[Parameter], parameters: &mut Map) -> Result<(), Failure> {
    each_limit(schema, parameters, &mut |parameter, column, text| {
        let found = split_quantity(text).ok_or_else(|| {
            let message = format!(
                "parameter {} has the limit \"{text}\" of {column}, which is no number with a unit",
                parameter.name
            );
            Failure::bad_parameter(&parameter.name, message).remedy("write it as 15 or \"15 nm\"")
        })?;
        Ok(found.into())
    })
}

/// Brings limits that are texts to the units of the columns they limit.
///
/// # Errors
/// A sentence that names both units, when they do not convert.
pub(crate) fn resolve_limits<'a>(
    schema: &[Parameter],
    parameters: &mut Map,
    header: &dyn Fn(Option<&str>) -> Option<&'a Header>,
) -> Result<(), Failure> {
    each_limit(schema, parameters, &mut |parameter, column, text| {
        let info = header(parameter.input.as_deref()).and_then(|header| header.column(column));
        let unit = match info {
            Some(info) => info.unit.as_str(),
            None if column == ROW => "1",
            None => {
                let name = &parameter.name;
                let message = format!("parameter {name} limits {column}, which the input has not");
                return Err(Failure::bad_parameter(name, message).remedy("remove the limits"));
            }
        };
        units::quantity(text, unit)
            .map(number::to_value)
            .map_err(|why| {
                let name = &parameter.name;
                let message =
                    format!("parameter {name} has the limit \"{text}\" of {column}: {why}");
                Failure::bad_parameter(name, message).remedy(format!("write it in {unit}"))
            })
    })
}

/// Whether a limit is a text that needs the column's unit.
pub(crate) fn has_limits(schema: &[Parameter], parameters: &Map) -> bool {
    let mut copy = parameters.clone();
    let found = |_: &Parameter, _: &str, _: &str| Err(Failure::internal(""));
    each_limit(schema, &mut copy, &mut { found }).is_err()
}

/// Parameter, column and text of a limit to its new value.
type Limit<'a> = dyn FnMut(&Parameter, &str, &str) -> Result<Value, Failure> + 'a;

fn each_limit(
    schema: &[Parameter],
    parameters: &mut Map,
    change: &mut Limit<'_>,
) -> Result<(), Failure> {
    for parameter in schema
        .iter()
        .filter(|one| one.kind == ParameterKind::Ranges)
    {
        let Some(Value::Object(ranges)) = parameters.get_mut(&parameter.name) else {
            continue;
        };
        for (column, limits) in ranges.iter_mut() {
            for limit in limits.as_array_mut().into_iter().flatten() {
                if let Value::String(text) = limit
                    && number::from_value(&text.as_str().into()).is_none()
                {
                    *limit = change(parameter, column, text)?;
                }
            }
        }
    }
    Ok(())
}

/// "0.015 um" as "15 nm".
fn split_quantity(text: &str) -> Option<String> {
    let text = text.trim();
    let mut letters = text
        .char_indices()
        .skip(1)
        .filter(|(_, c)| c.is_alphabetic());
    letters.find_map(|(at, _)| {
        let (digits, unit) = text.split_at(at);
        let found: f64 = digits
            .trim()
            .parse()
            .ok()
            .filter(|found: &f64| !found.is_nan())?;
        let unit = Unit::parse(unit)?;
        let base = unit.to_string();
        let factor = unit.factor_to(Unit::parse(&base)?)?;
        // Past 15 digits two spellings of one limit differ by rounding only.
        let value: f64 = format!("{:.14e}", found * factor).parse().ok()?;
        Some(format!("{value} {base}"))
    })
}

#[cfg(test)]
#[path = "units_tests.rs"]
mod tests;
