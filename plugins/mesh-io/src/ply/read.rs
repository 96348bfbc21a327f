//! Reading.

use super::head::{self, Element, Encoding, Head, Property, Type};
use crate::sheet::{Column, Sheet, Values, fits, poll};
use crate::text::{Words, lines};
use crate::unit::{COLUMN, UNKNOWN, of_comments};
use puncta_sdk::{Failure, Run};

/// Whether the first bytes are those of a PLY file.
///
/// # Errors
/// When they are not.
pub fn recognise(first: &[u8], _length: u64) -> Result<f64, Failure> {
    match head::read(first) {
        Err(failure) if failure.code == puncta_sdk::FailureCode::NotMine => Err(failure),
        _ => Ok(0.95),
    }
}

/// Reads a file: vertices with all of their numbers, faces as fans of triangles, strips.
///
/// # Errors
/// When it is cut off or damaged; or cancelled.
pub fn read(bytes: &[u8], run: &dyn Run) -> Result<Sheet, Failure> {
    let head = head::read(bytes)?;
    let mut sheet = Sheet::default();
    let mut body = match head.encoding {
        Encoding::Text => Body::Text(Text {
            bytes,
            at: head.end,
            line: Words::new(&[], 0),
            more: false,
        }),
        encoding => Body::Binary {
            rest: &bytes[head.end..],
            big: encoding == Encoding::Big,
        },
    };
    for element in &head.elements {
        let least = element.least(head.encoding);
        if element.properties.is_empty() {
            continue;
        }
        let rows = fits(&rows_of(element), element.count, least, body.left())?;
        match element.name.as_str() {
            "vertex" => vertices(&mut sheet, &mut body, element, rows, &head, run)?,
            "face" => faces(&mut sheet, &mut body, element, rows, run)?,
            "tristrips" => strips(&mut sheet, &mut body, element, rows, run)?,
            name => {
                for row in 0..rows {
                    poll(run, row)?;
                    body.row(name, row)?;
                    skip(&mut body, &element.properties, name, row)?;
                }
                sheet
                    .notes
                    .push(format!("The {rows} rows of {name} are not read."));
            }
        }
    }
    if !body.is_done() {
        let message = "the file goes on after the last row that its header says";
        return Err(Failure::bad_file(message).remedy("get a whole copy of the file"));
    }
    if let Body::Text(text) = &mut body
        && (text.more || text.line.next().is_some())
    {
        let note = "Rows of the file have more numbers than its header says; they are not read.";
        sheet.notes.push(note.into());
    }
    sheet.unit = of_comments(head.comments.iter().map(String::as_str));
    sheet.comments = head.comments;
    Ok(sheet)
}

fn rows_of(element: &Element) -> String {
    format!("rows of {}", element.name)
}

/// Rows as text, one a line.
struct Text<'a> {
    bytes: &'a [u8],
    at: usize,
    line: Words<'a>,
    /// Whether a line had more numbers than the header says.
    more: bool,
}

/// The rows, as text or binary.
enum Body<'a> {
    Text(Text<'a>),
    Binary { rest: &'a [u8], big: bool },
}

impl Body<'_> {
    fn left(&self) -> usize {
        match self {
            // The last number may have no blank after it.
            Body::Text(text) => text.bytes.len() - text.at + 1,
            Body::Binary { rest, .. } => rest.len(),
        }
    }

    fn is_done(&mut self) -> bool {
        match self {
            Body::Text(text) => text.bytes[text.at..].trim_ascii().is_empty(),
            Body::Binary { rest, .. } => rest.is_empty(),
        }
    }

    /// Begins a row.
    fn row(&mut self, what: &str, row: usize) -> Result<(), Failure> {
        let Body::Text(text) = self else {
            return Ok(());
        };
        text.more |= text.line.next().is_some();
        while let Some((line, end)) = lines(&text.bytes[text.at..]).next() {
            let begin = text.at;
            text.at += end;
            if !line.trim_ascii().is_empty() {
                text.line = Words::new(&text.bytes[..begin + line.len()], begin);
                return Ok(());
            }
        }
        let message = format!("the file ends before {what} {row}");
        let failure = Failure::bad_file(message).row(row as u64);
        Err(failure.remedy("get a whole copy of the file"))
    }

    fn number(&mut self, type_: Type, what: &str, row: usize) -> Result<f64, Failure> {
        match self {
            Body::Text(text) => {
                let value = text.line.number(what).map_err(|f| f.row(row as u64))?;
                if type_.holds(value) {
                    return Ok(value);
                }
                let line = text.line.line();
                let message =
                    format!("{value} in line {line} ({what} {row}) does not fit its type");
                Err(Failure::bad_file(message).row(row as u64))
            }
            Body::Binary { rest, big } => {
                let Some((bytes, more)) = rest.split_at_checked(type_.size()) else {
                    let message = format!("the file ends within {what} {row}");
                    let failure = Failure::bad_file(message).row(row as u64);
                    return Err(failure.remedy("get a whole copy of the file"));
                };
                *rest = more;
                Ok(decode(bytes, type_, *big))
            }
        }
    }
}

fn decode(bytes: &[u8], type_: Type, big: bool) -> f64 {
    let mut word = [0; 8];
    for (i, &byte) in bytes.iter().enumerate().take(8) {
        word[if big { bytes.len() - 1 - i } else { i }] = byte;
    }
    let bits = u64::from_le_bytes(word);
    match type_ {
        Type::I8 => f64::from(bits as u8 as i8),
        Type::U8 => f64::from(bits as u8),
        Type::I16 => f64::from(bits as u16 as i16),
        Type::U16 => f64::from(bits as u16),
        Type::I32 => f64::from(bits as u32 as i32),
        Type::U32 => f64::from(bits as u32),
        Type::F32 => f64::from(f32::from_bits(bits as u32)),
        Type::F64 => f64::from_bits(bits),
    }
}

/// The unit of a column, as our own writer says it.
fn unit_of(name: &str, head: &Head) -> String {
    let said = head.comments.iter().find_map(|comment| {
        let (known, unit) = comment.strip_prefix(COLUMN)?.rsplit_once(' ')?;
        (known == name).then(|| unit.to_owned())
    });
    said.unwrap_or_else(|| UNKNOWN.into())
}

fn vertices(
    sheet: &mut Sheet,
    body: &mut Body<'_>,
    element: &Element,
    rows: usize,
    head: &Head,
    run: &dyn Run,
) -> Result<(), Failure> {
    /// Where a number goes.
    enum To {
        Axis(usize),
        Column(Values),
        Nowhere(Type),
    }
    let to = |property: &Property| match (property.list, property.name.as_str()) {
        (Some(count), _) => To::Nowhere(count),
        (None, "x") => To::Axis(0),
        (None, "y") => To::Axis(1),
        (None, "z") => To::Axis(2),
        _ => To::Column(property.type_.values()),
    };
    for axis in ["x", "y", "z"] {
        let there = |p: &Property| p.name == axis && p.list.is_none();
        if !element.properties.iter().any(there) {
            return Err(Failure::bad_file(format!(
                "the vertices have no property {axis}"
            )));
        }
    }
    let mut targets: Vec<To> = element.properties.iter().map(to).collect();
    sheet.positions.reserve(rows);
    for row in 0..rows {
        poll(run, row)?;
        body.row("vertex", row)?;
        let mut place = [0.0; 3];
        for (property, to) in element.properties.iter().zip(&mut targets) {
            match to {
                To::Axis(axis) => place[*axis] = body.number(property.type_, "vertex", row)?,
                To::Column(values) => values.push(body.number(property.type_, "vertex", row)?),
                To::Nowhere(count) => {
                    let count = body.number(*count, "vertex", row)?;
                    for _ in 0..whole(count, "vertex", row)? {
                        body.number(property.type_, "vertex", row)?;
                    }
                }
            }
        }
        sheet.positions.push(place);
    }
    for (property, to) in element.properties.iter().zip(targets) {
        match to {
            To::Column(values) => sheet.columns.push(Column {
                name: property.name.clone(),
                unit: unit_of(&property.name, head),
                values,
            }),
            To::Nowhere(_) => {
                let name = &property.name;
                sheet
                    .notes
                    .push(format!("The lists {name} of the vertices are not read."));
            }
            To::Axis(_) => {}
        }
    }
    Ok(())
}

fn whole(count: f64, what: &str, row: usize) -> Result<u64, Failure> {
    if count >= 0.0 && count.fract() == 0.0 {
        return Ok(count as u64);
    }
    let message = format!("{what} {row} has a list of {count} numbers");
    Err(Failure::bad_file(message).row(row as u64))
}

fn skip(
    body: &mut Body<'_>,
    properties: &[Property],
    what: &str,
    row: usize,
) -> Result<(), Failure> {
    for property in properties {
        let count = match property.list {
            Some(type_) => whole(body.number(type_, what, row)?, what, row)?,
            None => 1,
        };
        for _ in 0..count {
            body.number(property.type_, what, row)?;
        }
    }
    Ok(())
}

/// Reads the list of corners of each row, and leaves out the other properties.
fn lists(
    body: &mut Body<'_>,
    element: &Element,
    rows: usize,
    run: &dyn Run,
    mut take: impl FnMut(usize, &[i64]) -> Result<(), Failure>,
) -> Result<(), Failure> {
    let what = element.name.as_str();
    let corners = |p: &Property| {
        p.list.is_some() && matches!(p.name.as_str(), "vertex_indices" | "vertex_index")
    };
    let Some(place) = element.properties.iter().position(corners) else {
        if rows == 0 {
            return Ok(());
        }
        let message = format!("the rows of {what} have no list vertex_indices");
        return Err(Failure::bad_file(message));
    };
    let mut list = Vec::new();
    for row in 0..rows {
        poll(run, row)?;
        body.row(what, row)?;
        skip(body, &element.properties[..place], what, row)?;
        let property = &element.properties[place];
        let count = body.number(property.list.unwrap_or(Type::U8), what, row)?;
        list.clear();
        for _ in 0..whole(count, what, row)? {
            let corner = body.number(property.type_, what, row)?;
            list.push(if corner.fract() == 0.0 {
                corner as i64
            } else {
                i64::MIN
            });
        }
        take(row, &list)?;
        skip(body, &element.properties[place + 1..], what, row)?;
    }
    Ok(())
}

fn faces(
    sheet: &mut Sheet,
    body: &mut Body<'_>,
    element: &Element,
    rows: usize,
    run: &dyn Run,
) -> Result<(), Failure> {
    sheet.triangles.reserve(rows);
    let mut small = 0;
    lists(body, element, rows, run, |row, corners| {
        small += usize::from(corners.len() < 3);
        sheet.polygon(row, corners)
    })?;
    if element.properties.len() > 1 {
        sheet
            .notes
            .push("Of the faces only the corners are read.".into());
    }
    if small > 0 {
        sheet.notes.push(format!(
            "{small} faces of less than 3 corners are left out."
        ));
    }
    Ok(())
}

/// Strips of triangles: each corner makes one with the two before it, turned in every other; a
/// negative number begins a new strip.
fn strips(
    sheet: &mut Sheet,
    body: &mut Body<'_>,
    element: &Element,
    rows: usize,
    run: &dyn Run,
) -> Result<(), Failure> {
    lists(body, element, rows, run, |row, corners| {
        for strip in corners.split(|corner| *corner < 0 && *corner != i64::MIN) {
            for (i, window) in strip.windows(3).enumerate() {
                let [a, b, c] = [window[0], window[1], window[2]];
                // Corners that repeat join strips and are no triangles.
                if a != b && b != c && c != a {
                    let corners = if i % 2 == 0 { [a, b, c] } else { [b, a, c] };
                    sheet.polygon(row, &corners)?;
                }
            }
        }
        Ok(())
    })
}
