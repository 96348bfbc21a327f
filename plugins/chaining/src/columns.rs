//! Columns that a parameter names, in the unit that is needed.

use puncta_sdk::Input;
use puncta_sdk::documents::units;
use puncta_sdk::prelude::*;
use std::borrow::Cow;

/// Checks that `name` is a column of single numbers of `header` in a unit of length.
///
/// # Errors
/// A sentence that names the column and the parameter.
pub fn check_length(header: &Header, name: &str, parameter: &str) -> Result<f64, Failure> {
    let info = header.column(name).ok_or_else(|| {
        Failure::bad_input(format!("there is no column {name} in {}", header.name))
            .parameter(parameter)
            .remedy("name another, or give a constant radius")
    })?;
    if info.type_.element.is_text() || info.type_.width != 1 {
        let message = format!(
            "column {name} of {} does not hold single numbers",
            header.name
        );
        return Err(Failure::bad_input(message).parameter(parameter));
    }
    units::conversion(&info.unit, "nm").map_err(|why| {
        Failure::bad_input(format!("column {name} is no length: {why}")).parameter(parameter)
    })
}

/// The column `name` in nm.
///
/// # Errors
/// As [`check_length`], and when the plan does not read it.
pub fn length<'a>(
    table: &Input<'a>,
    name: &str,
    parameter: &str,
) -> Result<Cow<'a, [f64]>, Failure> {
    let factor = check_length(table.header(), name, parameter)?;
    let mut values = table.f64(name)?;
    #[allow(clippy::float_cmp)]
    if factor != 1.0 {
        values.to_mut().iter_mut().for_each(|v| *v *= factor);
    }
    Ok(values)
}
