//! Positions of a table, scaled so that one radius holds along all axes.

use puncta_sdk::Input;
use puncta_sdk::documents::{Read, units};
use puncta_sdk::operation::{Operation, default_plan};
use puncta_sdk::prelude::*;
use std::borrow::Cow;

/// Most rows that can be clustered: row numbers and clusters are 32 bits.
pub const MOST_ROWS: u64 = i32::MAX as u64;

/// Plans a call that reads x, y, further columns, and z in nm if `axial`.
///
/// # Errors
/// When there is no such column, or there are too many rows.
pub fn plan<O: Operation>(
    request: &Request,
    axial: bool,
    more: &[&str],
    bytes_a_row: u64,
) -> Result<Plan, Failure> {
    let mut plan = default_plan::<O>(request);
    let Some(input) = request.inputs.first() else {
        return Ok(plan);
    };
    let header = &input.header;
    let mut columns = vec!["x", "y"];
    if axial {
        factor(header, "z")?;
        columns.push("z");
    }
    for name in more {
        if header.column(name).is_none() {
            let message = format!("there is no column {name} in {}", header.name);
            return Err(Failure::bad_input(message).remedy("name another column"));
        }
        if !columns.contains(name) {
            columns.push(name);
        }
    }
    if header.rows() > MOST_ROWS {
        let message = format!("{} has more than {MOST_ROWS} rows", header.name);
        return Err(Failure::bad_input(message).remedy("split it, for instance by a rectangle"));
    }
    plan.read.retain(|read| read.input != 0);
    plan.read.push(Read {
        input: 0,
        part: 0,
        columns: columns.into_iter().map(Into::into).collect(),
    });
    plan.memory = header.rows() * bytes_a_row + (64 << 20);
    Ok(plan)
}

fn factor(header: &Header, name: &str) -> Result<f64, Failure> {
    let info = header.column(name).ok_or_else(|| {
        Failure::bad_input(format!("there is no column {name} in {}", header.name))
            .remedy("work in the plane, or on a table with z")
    })?;
    units::conversion(&info.unit, "nm")
        .map_err(|why| Failure::bad_input(format!("column {name} is no position: {why}")))
}

/// z in nm, times `scale`.
///
/// # Errors
/// When the plan does not read it.
pub fn depth<'a>(table: &Input<'a>, scale: f64) -> Result<Cow<'a, [f64]>, Failure> {
    let factor = factor(table.header(), "z")? * scale;
    let mut z = table.f64("z")?;
    #[allow(clippy::float_cmp)]
    if factor != 1.0 {
        z.to_mut().iter_mut().for_each(|z| *z *= factor);
    }
    Ok(z)
}

/// Tells the person of rows without a finite position.
pub fn warn_of_missing(job: &Job, missing: u64) {
    if missing > 0 {
        job.warn(&format!(
            "{missing} rows without a finite position are in no cluster"
        ));
    }
}

/// Number of rows of which some position is not finite.
#[must_use]
pub fn missing<const D: usize>(at: [&[f64]; D]) -> u64 {
    let broken = |row: &usize| at.iter().any(|values| !values[*row].is_finite());
    (0..at[0].len()).filter(broken).count() as u64
}
