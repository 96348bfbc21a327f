//! Writing.

use super::Encoding;
use crate::sheet::{Sheet, Values};
use crate::unit::{COLUMN, COMMENT};
use crate::writer::poll;
use puncta_sdk::Run;
use std::io::{self, Write};

fn type_name(values: &Values) -> &'static str {
    match values {
        Values::I8(_) => "char",
        Values::U8(_) => "uchar",
        Values::I16(_) => "short",
        Values::U16(_) => "ushort",
        Values::I32(_) => "int",
        Values::U32(_) => "uint",
        Values::F32(_) => "float",
        Values::F64(_) => "double",
    }
}

/// Writes vertices with their columns, and triangles.
///
/// # Errors
/// What the disk says.
pub fn write(
    out: &mut dyn Write,
    sheet: &Sheet,
    unit: &str,
    encoding: Encoding,
    run: &dyn Run,
) -> io::Result<()> {
    head(out, sheet, unit, encoding)?;
    for (row, place) in sheet.positions.iter().enumerate() {
        poll(run, row)?;
        if encoding == Encoding::Text {
            let [x, y, z] = place;
            write!(out, "{x} {y} {z}")?;
            for column in &sheet.columns {
                crate::each_type!(&column.values, vector => write!(out, " {}", vector[row])?);
            }
            writeln!(out)?;
            continue;
        }
        let big = encoding == Encoding::Big;
        for x in place {
            out.write_all(&if big {
                x.to_be_bytes()
            } else {
                x.to_le_bytes()
            })?;
        }
        for column in &sheet.columns {
            crate::each_type!(&column.values, vector => {
                let value = vector[row];
                out.write_all(&if big { value.to_be_bytes() } else { value.to_le_bytes() })?;
            });
        }
    }
    for (row, triangle) in sheet.triangles.iter().enumerate() {
        poll(run, row)?;
        let [a, b, c] = triangle;
        if encoding == Encoding::Text {
            writeln!(out, "3 {a} {b} {c}")?;
            continue;
        }
        out.write_all(&[3])?;
        for corner in triangle {
            out.write_all(&match encoding {
                Encoding::Big => corner.to_be_bytes(),
                _ => corner.to_le_bytes(),
            })?;
        }
    }
    Ok(())
}

fn head(out: &mut dyn Write, sheet: &Sheet, unit: &str, encoding: Encoding) -> io::Result<()> {
    let format = match encoding {
        Encoding::Text => "ascii",
        Encoding::Little => "binary_little_endian",
        Encoding::Big => "binary_big_endian",
    };
    writeln!(out, "ply\nformat {format} 1.0\ncomment {COMMENT}{unit}")?;
    for column in &sheet.columns {
        writeln!(out, "comment {COLUMN}{} {}", column.name, column.unit)?;
    }
    writeln!(out, "element vertex {}", sheet.positions.len())?;
    for axis in ["x", "y", "z"] {
        writeln!(out, "property double {axis}")?;
    }
    for column in &sheet.columns {
        writeln!(
            out,
            "property {} {}",
            type_name(&column.values),
            column.name
        )?;
    }
    writeln!(out, "element face {}", sheet.triangles.len())?;
    writeln!(out, "property list uchar int vertex_indices\nend_header")
}
