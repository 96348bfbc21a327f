//! STL: triangles without indices, binary (f32) or text.

use crate::sheet::{Sheet, fits, poll};
use crate::text::{Words, shown};
use crate::unit::of_comments;
use puncta_sdk::{Failure, FailureCode, Run};
use puncta_shared_mesh::weld::index;
use std::io::{self, Write};

/// Bytes before the first triangle of a binary file.
const HEAD: usize = 84;
/// Bytes of a triangle of a binary file.
const ROW: usize = 50;

/// Whether the first bytes are those of an STL file of this length.
///
/// # Errors
/// When they are not.
pub fn recognise(head: &[u8], length: u64) -> Result<f64, Failure> {
    if let Some(count) = count(head)
        && HEAD as u64 + ROW as u64 * u64::from(count) == length
    {
        return Ok(0.95);
    }
    if is_text(head) {
        return Ok(0.9);
    }
    // Cut off, or the header lies: only the suffix says that it is STL.
    if head.len() >= HEAD && count(head).is_some_and(|count| count > 0) {
        return Ok(0.1);
    }
    Err(Failure::new(FailureCode::NotMine, "this is no STL file"))
}

fn count(head: &[u8]) -> Option<u32> {
    let bytes = head.get(HEAD - 4..HEAD)?;
    bytes.try_into().ok().map(u32::from_le_bytes)
}

fn is_text(head: &[u8]) -> bool {
    let start = head.trim_ascii_start();
    let head = &head[..head.len().min(4096)];
    let facet = head
        .windows(5)
        .any(|window| window == b"facet" || window == b"endso");
    start.starts_with(b"solid") && (facet || head.len() < 64) && !head.contains(&0)
}

/// Reads a file. Corners at the same place become one vertex; normals of the file are not used.
///
/// # Errors
/// When it is cut off or damaged; or cancelled.
pub fn read(bytes: &[u8], run: &dyn Run) -> Result<Sheet, Failure> {
    let (corners, comment) = if is_binary(bytes) {
        (
            binary(bytes, run)?,
            shown(&bytes[..HEAD - 4]) + &tail(bytes),
        )
    } else if is_text(bytes) {
        let line = bytes.trim_ascii_start();
        let end = line
            .iter()
            .position(|byte| *byte == b'\n')
            .unwrap_or(line.len());
        (
            text(bytes, run)?,
            String::from_utf8_lossy(&line[5..end.max(5)]).trim().into(),
        )
    } else {
        binary(bytes, run).map(|corners| (corners, String::new()))?
    };
    run.progress(0.7, "merging corners")?;
    let (positions, triangles) = index(&corners);
    Ok(Sheet {
        positions,
        triangles,
        unit: of_comments([comment.as_str()]),
        comments: if comment.is_empty() {
            Vec::new()
        } else {
            vec![comment]
        },
        ..Sheet::default()
    })
}

/// The header of a binary file beyond what a message shows.
fn tail(bytes: &[u8]) -> String {
    let text = String::from_utf8_lossy(&bytes[24..HEAD - 4]);
    let text: String = text.chars().filter(|c| !c.is_control()).collect();
    text.trim_end().into()
}

fn is_binary(bytes: &[u8]) -> bool {
    let rows = count(bytes).map(u64::from);
    rows.is_some_and(|rows| HEAD as u64 + ROW as u64 * rows == bytes.len() as u64)
}

fn binary(bytes: &[u8], run: &dyn Run) -> Result<Vec<[f64; 3]>, Failure> {
    let Some(rows) = count(bytes) else {
        let message = format!(
            "the file has {} bytes, but an STL header has 84",
            bytes.len()
        );
        return Err(Failure::bad_file(message).remedy("get a whole copy of the file"));
    };
    let body = &bytes[HEAD..];
    let rows = fits("triangles", u64::from(rows), ROW as u64, body.len())?;
    if body.len() > rows * ROW {
        let more = body.len() - rows * ROW;
        let message = format!("the header says {rows} triangles, but {more} bytes follow them");
        return Err(Failure::bad_file(message).remedy("get a whole copy of the file"));
    }
    let mut corners = Vec::with_capacity(rows * 3);
    for (row, record) in body.as_chunks::<ROW>().0.iter().enumerate() {
        poll(run, row)?;
        for corner in record[12..48].as_chunks::<12>().0 {
            let (words, _) = corner.as_chunks::<4>();
            corners.push([0, 1, 2].map(|axis: usize| f64::from(f32::from_le_bytes(words[axis]))));
        }
    }
    Ok(corners)
}

fn text(bytes: &[u8], run: &dyn Run) -> Result<Vec<[f64; 3]>, Failure> {
    let mut words = Words::new(bytes, 0);
    let mut corners = Vec::new();
    let mut open = None;
    let mut ended = false;
    while let Some(word) = words.next() {
        match word {
            b"facet" => {
                open = Some(corners.len());
                poll(run, corners.len() / 3)?;
            }
            b"vertex" => {
                let what = "a corner";
                corners.push([
                    words.number(what)?,
                    words.number(what)?,
                    words.number(what)?,
                ]);
            }
            b"endfacet" if open.take() != corners.len().checked_sub(3) => {
                let line = words.line();
                let message = format!("the facet that ends in line {line} has no 3 corners");
                return Err(Failure::bad_file(message));
            }
            b"endsolid" => ended = true,
            b"solid" => ended = false,
            _ => {}
        }
    }
    if !ended || open.is_some() {
        let message = format!(
            "the file ends after {} triangles without endsolid",
            corners.len() / 3
        );
        return Err(Failure::bad_file(message).remedy("get a whole copy of the file"));
    }
    if !corners.len().is_multiple_of(3) {
        return Err(Failure::bad_file("a corner lies outside of the facets"));
    }
    Ok(corners)
}

fn corners(sheet: &Sheet, triangle: [u32; 3]) -> [[f64; 3]; 3] {
    triangle.map(|v| {
        sheet
            .positions
            .get(v as usize)
            .copied()
            .unwrap_or([f64::NAN; 3])
    })
}

fn normal(corners: [[f64; 3]; 3]) -> [f64; 3] {
    puncta_shared_mesh::vector::unit(puncta_shared_mesh::vector::area_vector(corners))
}

/// Writes a binary file: coordinates become f32.
///
/// # Errors
/// What the disk says.
pub fn write(out: &mut dyn Write, sheet: &Sheet, unit: &str, run: &dyn Run) -> io::Result<()> {
    let mut head = format!("{}{unit}", crate::unit::COMMENT).into_bytes();
    head.resize(HEAD - 4, b' ');
    out.write_all(&head)?;
    let rows = u32::try_from(sheet.triangles.len());
    let rows = rows.map_err(|_| io::Error::other("STL holds at most 2^32 - 1 triangles"))?;
    out.write_all(&rows.to_le_bytes())?;
    for (row, &triangle) in sheet.triangles.iter().enumerate() {
        crate::writer::poll(run, row)?;
        let corners = corners(sheet, triangle);
        let mut record = [0; ROW];
        let numbers = [normal(corners), corners[0], corners[1], corners[2]];
        let places = record.as_chunks_mut::<4>().0.iter_mut();
        for (place, number) in places.zip(numbers.as_flattened()) {
            *place = (*number as f32).to_le_bytes();
        }
        out.write_all(&record)?;
    }
    Ok(())
}

/// Writes a text file.
///
/// # Errors
/// What the disk says.
pub fn write_text(out: &mut dyn Write, sheet: &Sheet, unit: &str, run: &dyn Run) -> io::Result<()> {
    writeln!(out, "solid {}{unit}", crate::unit::COMMENT)?;
    for (row, &triangle) in sheet.triangles.iter().enumerate() {
        crate::writer::poll(run, row)?;
        let corners = corners(sheet, triangle);
        let [x, y, z] = normal(corners);
        writeln!(out, "facet normal {x} {y} {z}\n outer loop")?;
        for [x, y, z] in corners {
            writeln!(out, "  vertex {x} {y} {z}")?;
        }
        writeln!(out, " endloop\nendfacet")?;
    }
    writeln!(out, "endsolid")
}
