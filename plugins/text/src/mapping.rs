//! From the columns of a file to those of the table: names, units, types.

use crate::dialect::Dialect;
use crate::flavours::{Flavour, pixels, positional};
use crate::options::Options;
use crate::sample::Tally;
use crate::schema::{ColumnPlan, Kind, Plan};
use puncta_sdk::Failure;
use puncta_shared_import::apply::{absent, is_called};
use puncta_shared_import::{Mapped, Named, Source, Unit, names, units};

/// Plans the columns of a file. `tallies` has one entry a column of the file; `data_bytes` is
/// the length of the data; `line_bytes` that of an average row.
pub fn plan(
    dialect: &Dialect,
    tallies: &[Tally],
    data_bytes: u64,
    line_bytes: f64,
    options: &Options,
) -> Result<Plan, Failure> {
    let tally = |field: usize| tallies.get(field).copied().unwrap_or_default();
    let source = |(field, name): (usize, &String)| Source {
        has_zero: tally(field).below_one,
        ..Source::new(name, named(dialect, field, name, options))
            .frames_from(dialect.flavour.frame_base())
    };
    let sources: Vec<Source> = dialect.names.iter().enumerate().map(source).collect();
    check_text(dialect, &sources, options)?;
    let mapped = options.mapping.apply(&dialect.file, &sources)?;
    let mut columns: Vec<ColumnPlan> = Vec::with_capacity(mapped.len());
    for one in mapped {
        let listed = dialect.types.get(one.field).copied();
        let kind = match one.copy_of.and_then(|first| columns.get(first)) {
            Some(first) => first.kind,
            None => listed.unwrap_or_else(|| kind(&one, tally(one.field), options)),
        };
        columns.push(column(one, kind, listed.is_some()));
    }
    if columns.is_empty() {
        let message = format!("the names leave no column of {}", dialect.file);
        return Err(Failure::bad_parameter("columns", message));
    }
    let fields = dialect.names.len();
    // A row that is too short is found after the rows were counted, so that it needs room as well.
    let max_rows = data_bytes / 2 + 1;
    let expected = (data_bytes as f64 / line_bytes.max(2.0)).ceil() as u64;
    Ok(Plan {
        columns,
        fields,
        max_rows,
        expected_rows: expected.min(max_rows),
    })
}

/// Refuses columns of words that are not there.
fn check_text(dialect: &Dialect, sources: &[Source], options: &Options) -> Result<(), Failure> {
    for name in &options.text {
        let there = sources.iter().any(|source| {
            let named = source.named.as_ref();
            is_called(&source.name, name) || named.is_some_and(|n| n.name == *name)
        });
        if !there {
            return Err(absent(&dialect.file, sources, name));
        }
    }
    Ok(())
}

/// The host's name for a column by the kind of file.
fn named(dialect: &Dialect, field: usize, source: &str, options: &Options) -> Option<Named> {
    if dialect.listed {
        return names::exact(source);
    }
    if let Some(positions) = dialect.positions
        && let Some(named) = positional(positions, field, dialect.assumed)
    {
        return Some(named);
    }
    let mut named = dialect.flavour.named(source)?;
    if dialect.flavour == Flavour::Decode && named.unit.is_none() {
        named.unit = decode_unit(dialect, &named.name, options);
    }
    Some(named)
}

/// DECODE: z in nm, x and y as the file's own lines say.
fn decode_unit(dialect: &Dialect, name: &str, options: &Options) -> Option<Unit> {
    let axis = match name {
        "x" | "error_x" => 0,
        "y" | "error_y" => 1,
        "z" | "error_z" => return units::known("nm"),
        _ => return None,
    };
    let said = units::known(dialect.lateral_unit.as_deref()?)?;
    let size = dialect.pixel.and_then(|pixel| pixel.get(axis).copied());
    match size.filter(|_| said.is_pixel() && options.mapping.pixel_size.is_none()) {
        Some(size) => Some(pixels(size)),
        None => Some(said),
    }
}

fn kind(mapped: &Mapped, tally: Tally, options: &Options) -> Kind {
    let words = |t: &String| is_called(&mapped.source, t) || *t == mapped.name;
    if options.text.iter().any(words) {
        Kind::Text
    } else {
        kind_of(
            &mapped.name,
            tally,
            mapped.shift != 0 || mapped.factor != 1.0,
        )
    }
}

fn column(mapped: Mapped, kind: Kind, settled: bool) -> ColumnPlan {
    // Words, and numbers that count or label, have no unit.
    let bare = kind == Kind::Text || kind != Kind::F64 && names::labels(&mapped.name);
    let bare = bare && mapped.silent;
    let remedy = mapped.remedy().filter(|_| !bare);
    ColumnPlan {
        role: mapped.role,
        name: mapped.name,
        source: mapped.source,
        field: mapped.field,
        unit: if bare { "1".to_owned() } else { mapped.unit },
        remedy,
        description: mapped.description,
        kind,
        shift: mapped.shift,
        factor: mapped.factor,
        base: i32::from(mapped.base),
        base_guessed: mapped.base_guessed,
        copy_of: mapped.copy_of,
        settled,
    }
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

#[cfg(test)]
#[path = "mapping_tests.rs"]
mod tests;
