//! VTP: the XML polygons of VTK, with raw appended data, for ParaView.

use crate::sheet::{Sheet, Values};
use puncta_sdk::Run;
use std::io::{self, Write};

fn type_name(values: &Values) -> &'static str {
    match values {
        Values::I8(_) => "Int8",
        Values::U8(_) => "UInt8",
        Values::I16(_) => "Int16",
        Values::U16(_) => "UInt16",
        Values::I32(_) => "Int32",
        Values::U32(_) => "UInt32",
        Values::F32(_) => "Float32",
        Values::F64(_) => "Float64",
    }
}

fn escaped(text: &str) -> String {
    let mut out = String::new();
    for c in text.chars() {
        match c {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            c if c.is_control() => out.push(' '),
            c => out.push(c),
        }
    }
    out
}

/// Writes triangles with the columns of their vertices as point data.
///
/// # Errors
/// What the disk says.
pub fn write(out: &mut dyn Write, sheet: &Sheet, unit: &str, run: &dyn Run) -> io::Result<()> {
    let (points, polygons) = (sheet.positions.len(), sheet.triangles.len());
    let mut offset = 0_u64;
    let mut array = |type_: &str, name: &str, width: usize, bytes: usize| {
        let text = format!(
            "<DataArray type=\"{type_}\" Name=\"{}\" NumberOfComponents=\"{width}\" \
             format=\"appended\" offset=\"{offset}\"/>",
            escaped(name)
        );
        offset += 8 + bytes as u64;
        text
    };
    writeln!(
        out,
        "<?xml version=\"1.0\"?>\n<!-- {}{unit} -->",
        crate::unit::COMMENT
    )?;
    writeln!(
        out,
        "<VTKFile type=\"PolyData\" version=\"1.0\" byte_order=\"LittleEndian\" \
         header_type=\"UInt64\"><PolyData><Piece NumberOfPoints=\"{points}\" \
         NumberOfVerts=\"0\" NumberOfLines=\"0\" NumberOfStrips=\"0\" NumberOfPolys=\"{polygons}\">"
    )?;
    writeln!(
        out,
        "<Points>{}</Points>",
        array("Float64", "Points", 3, points * 24)
    )?;
    writeln!(out, "<PointData>")?;
    for column in &sheet.columns {
        let bytes = crate::each_type!(&column.values, vector => size_of_val(vector.as_slice()));
        writeln!(
            out,
            "{}",
            array(type_name(&column.values), &column.name, 1, bytes)
        )?;
    }
    writeln!(out, "</PointData>")?;
    let connectivity = array("Int64", "connectivity", 1, polygons * 24);
    let offsets = array("Int64", "offsets", 1, polygons * 8);
    writeln!(out, "<Polys>{connectivity}{offsets}</Polys>")?;
    write!(out, "</Piece></PolyData><AppendedData encoding=\"raw\">\n_")?;
    data(out, sheet, run)?;
    writeln!(out, "\n</AppendedData></VTKFile>")
}

fn data(out: &mut dyn Write, sheet: &Sheet, run: &dyn Run) -> io::Result<()> {
    let length = |out: &mut dyn Write, bytes: usize| out.write_all(&(bytes as u64).to_le_bytes());
    length(out, sheet.positions.len() * 24)?;
    for (row, place) in sheet.positions.iter().enumerate() {
        crate::writer::poll(run, row)?;
        for x in place {
            out.write_all(&x.to_le_bytes())?;
        }
    }
    for column in &sheet.columns {
        crate::each_type!(&column.values, vector => {
            length(out, size_of_val(vector.as_slice()))?;
            for (row, value) in vector.iter().enumerate() {
                crate::writer::poll(run, row)?;
                out.write_all(&value.to_le_bytes())?;
            }
        });
    }
    length(out, sheet.triangles.len() * 24)?;
    for (row, triangle) in sheet.triangles.iter().enumerate() {
        crate::writer::poll(run, row)?;
        for corner in triangle {
            out.write_all(&i64::from(*corner).to_le_bytes())?;
        }
    }
    length(out, sheet.triangles.len() * 8)?;
    for row in 0..sheet.triangles.len() {
        out.write_all(&(3 * (row as i64 + 1)).to_le_bytes())?;
    }
    Ok(())
}
