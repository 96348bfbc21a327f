//! The person's explicit mapping, and the units of the file, applied to the columns of all tables.

use puncta_sdk::{Element, Failure};
use puncta_shared_import::{Mapping, Named, Source, UNKNOWN, units};

use crate::info::{ColumnInfo, FileInfo, TableInfo};

/// Brings names, units, frames and axes of all tables to those of the host.
///
/// # Errors
/// A mapping that speaks of columns that are not there.
pub(crate) fn apply(info: &mut FileInfo, mapping: &Mapping, file: &str) -> Result<(), Failure> {
    let mut own = mapping.clone();
    own.pixel_size = own.pixel_size.or(info.pixel);
    // Only localisations are renamed; the other tables share the pixel size.
    let others = Mapping {
        pixel_size: own.pixel_size,
        frame_base: own.frame_base,
        ..Mapping::default()
    };
    let base = info.frame_base;
    for table in &mut info.tables {
        let main = table.port == "localisations";
        columns(table, if main { &own } else { &others }, file, base)?;
    }
    Ok(())
}

fn columns(table: &mut TableInfo, mapping: &Mapping, file: &str, base: u8) -> Result<(), Failure> {
    let old = std::mem::take(&mut table.columns);
    let twice = |column: &ColumnInfo| {
        let same = old.iter().filter(|other| other.source == column.source);
        column.name != column.source && same.count() > 1
    };
    let sources: Vec<Source> = old
        .iter()
        .map(|column| source(column, twice(column), base))
        .collect();
    let mapped = mapping.apply(file, &sources)?;
    for one in mapped {
        let Some(column) = old.get(one.field) else {
            continue;
        };
        let mut column = column.clone();
        let number = column.element != Element::Utf8;
        if one.converts() && number {
            let factor = column.factor.unwrap_or(1.0) * one.scale();
            column.factor = Some(factor);
            column.element = Element::F64;
            column.base = one.base;
        }
        column.remedy = one.remedy().filter(|_| number);
        column.name = one.name;
        column.unit = if number { one.unit } else { "1".to_owned() };
        column.role = one.role.or(column.role);
        column.description = one.description;
        table.columns.push(column);
    }
    if table.columns.is_empty() {
        let message = format!("the names leave no column of {file}");
        return Err(Failure::bad_parameter("columns", message));
    }
    Ok(())
}

/// A field that stands under two names is meant by the name that each has here.
fn source(column: &ColumnInfo, twice: bool, base: u8) -> Source {
    let name = if twice || column.source.is_empty() {
        &column.name
    } else {
        &column.source
    };
    let unit = match column.unit.as_str() {
        UNKNOWN => None,
        unit => Some(units::unit(unit)),
    };
    let named = Named {
        name: column.name.clone(),
        unit,
        twin: None,
    };
    Source::new(name, Some(named))
        .frames_from(base)
        .described(&column.description)
}
