//! OBJ: the vertices and faces of Wavefront's text files.

use crate::sheet::{Sheet, poll};
use crate::text::{Words, lines, shown};
use crate::unit::of_comments;
use puncta_sdk::{Failure, FailureCode, Run};
use std::io::{self, Write};

/// Whether the first bytes are those of an OBJ file.
///
/// # Errors
/// When they are not.
pub fn recognise(head: &[u8], _length: u64) -> Result<f64, Failure> {
    let vertex = |line: &[u8]| {
        let mut words = Words::new(line, 0);
        let known = words.next() == Some(b"v");
        known && (0..3).all(|_| words.number("").is_ok())
    };
    if !head.contains(&0) && lines(head).any(|(line, _)| vertex(line)) {
        return Ok(0.6);
    }
    Err(Failure::new(FailureCode::NotMine, "this is no OBJ file"))
}

/// Reads a file: vertices (v) and faces (f) with positive or negative numbers; polygons become
/// fans. Normals, texture, groups and materials are left out.
///
/// # Errors
/// When a line cannot be read; or cancelled.
pub fn read(bytes: &[u8], run: &dyn Run) -> Result<Sheet, Failure> {
    let mut sheet = Sheet::default();
    let mut corners: Vec<i64> = Vec::new();
    let (mut faces, mut others, mut small) = (0, false, 0);
    for (number, (line, _)) in lines(bytes).enumerate() {
        poll(run, number)?;
        let mut words = Words::new(line, 0);
        let fault = |fault: Failure| fault.context(format!("line {}", number + 1));
        match words.next() {
            Some(b"v") => {
                let what = "a vertex";
                let mut one = || words.number(what).map_err(fault);
                sheet.positions.push([one()?, one()?, one()?]);
            }
            Some(b"f") => {
                corners.clear();
                for word in words {
                    corners.push(corner(word, sheet.positions.len()).ok_or_else(|| {
                        let (line, word) = (number + 1, shown(word));
                        Failure::bad_file(format!("\"{word}\" in line {line} is no corner"))
                    })?);
                }
                sheet.polygon(faces, &corners)?;
                faces += 1;
                small += usize::from(corners.len() < 3);
            }
            Some(word) if word.starts_with(b"#") => comment(line, &mut sheet.comments),
            Some(b"vn" | b"vt" | b"vp" | b"g" | b"o" | b"s" | b"usemtl" | b"mtllib") => {
                others = true;
            }
            Some(b"l" | b"p") => small += 1,
            Some(word) if word.iter().any(|byte| !byte.is_ascii_graphic()) => {
                let (line, word) = (number + 1, shown(word));
                return Err(Failure::bad_file(format!(
                    "\"{word}\" begins line {line}: the file is damaged"
                )));
            }
            _ => {}
        }
    }
    sheet.unit = of_comments(sheet.comments.iter().map(String::as_str));
    if others {
        let note = "Normals, texture, groups and materials of the OBJ file are not read.";
        sheet.notes.push(note.into());
    }
    if small > 0 {
        sheet.notes.push(format!(
            "{small} points and lines of the OBJ file are not read."
        ));
    }
    Ok(sheet)
}

/// Keeps the first comments.
fn comment(line: &[u8], comments: &mut Vec<String>) {
    if comments.len() < 20 {
        let text = String::from_utf8_lossy(line);
        comments.push(text.trim_start_matches('#').trim().into());
    }
}

/// The vertex of a corner such as 7, 7/1 or -1//3, from 0.
fn corner(word: &[u8], vertices: usize) -> Option<i64> {
    let end = word
        .iter()
        .position(|byte| *byte == b'/')
        .unwrap_or(word.len());
    let number: i64 = std::str::from_utf8(&word[..end]).ok()?.parse().ok()?;
    match number {
        0 => None,
        1.. => Some(number - 1),
        _ => Some(i64::try_from(vertices).ok()?.saturating_add(number)),
    }
}

/// Writes vertices and triangles.
///
/// # Errors
/// What the disk says.
pub fn write(out: &mut dyn Write, sheet: &Sheet, unit: &str, run: &dyn Run) -> io::Result<()> {
    writeln!(out, "# {}{unit}", crate::unit::COMMENT)?;
    for (row, [x, y, z]) in sheet.positions.iter().enumerate() {
        crate::writer::poll(run, row)?;
        writeln!(out, "v {x} {y} {z}")?;
    }
    for (row, triangle) in sheet.triangles.iter().enumerate() {
        crate::writer::poll(run, row)?;
        let [a, b, c] = triangle.map(|v| u64::from(v) + 1);
        writeln!(out, "f {a} {b} {c}")?;
    }
    Ok(())
}
