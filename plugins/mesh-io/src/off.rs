//! OFF: the object file format of Geomview, as text.

use crate::sheet::{Sheet, fits, poll};
use crate::text::{Words, lines, number, shown};
use crate::unit::of_comments;
use puncta_sdk::{Failure, FailureCode, Run};
use std::io::{self, Write};

const KINDS: [&[u8]; 4] = [b"OFF", b"COFF", b"NOFF", b"CNOFF"];

/// Whether the first bytes are those of an OFF file.
///
/// # Errors
/// When they are not.
pub fn recognise(head: &[u8], _length: u64) -> Result<f64, Failure> {
    let first = Words::new(head, 0).next();
    if first.is_some_and(|word| KINDS.contains(&word)) {
        return Ok(0.95);
    }
    Err(Failure::new(FailureCode::NotMine, "this is no OFF file"))
}

/// Reads a file; polygons become fans. Colours and normals are left out.
///
/// # Errors
/// When it is cut off or damaged; or cancelled.
pub fn read(bytes: &[u8], run: &dyn Run) -> Result<Sheet, Failure> {
    let mut sheet = Sheet::default();
    let mut rows = Rows::new(bytes);
    let (vertices, faces) = head(&mut rows)?;
    let vertices = fits("vertices", vertices, 6, rows.left)?;
    sheet.positions.reserve(vertices);
    for row in 0..vertices {
        poll(run, row)?;
        let what = format!("vertex {row}");
        let mut words = Words::new(rows.next(&what)?, 0);
        let mut one = || words.number(&what);
        sheet.positions.push([one()?, one()?, one()?]);
    }
    let faces = fits("faces", faces, 2, rows.left)?;
    sheet.triangles.reserve(faces);
    let mut corners = Vec::new();
    let mut more = false;
    for row in 0..faces {
        poll(run, row)?;
        let what = format!("face {row}");
        let mut words = Words::new(rows.next(&what)?, 0);
        let count = whole(words.number(&what)?, &what)?;
        corners.clear();
        for _ in 0..count {
            corners.push(whole(words.number(&what)?, &what)?);
        }
        more |= words.next().is_some();
        sheet.polygon(row, &corners)?;
    }
    if let Ok(line) = rows.next("the end") {
        let message = format!(
            "\"{}\" follows the last face that the header says",
            shown(line)
        );
        return Err(Failure::bad_file(message).remedy("get a whole copy of the file"));
    }
    if more {
        sheet
            .notes
            .push("Colours of faces of the OFF file are not read.".into());
    }
    sheet.comments = rows.comments;
    sheet.unit = of_comments(sheet.comments.iter().map(String::as_str));
    Ok(sheet)
}

/// Numbers of vertices and faces.
fn head(rows: &mut Rows<'_>) -> Result<(u64, u64), Failure> {
    let first = rows.next("the header")?;
    let mut words: Vec<&[u8]> = Words::new(first, 0).collect();
    if !words.first().is_some_and(|word| KINDS.contains(word)) {
        return Err(Failure::new(FailureCode::NotMine, "this is no OFF file"));
    }
    words.remove(0);
    if words.first() == Some(&&b"BINARY"[..]) {
        let message = "this is a binary OFF file, of which no layout is agreed";
        return Err(Failure::new(FailureCode::Unsupported, message).remedy("save it as text"));
    }
    if words.is_empty() {
        words = Words::new(rows.next("the counts")?, 0).collect();
    }
    let count = |i: usize| -> Result<u64, Failure> {
        let word = words.get(i).copied().unwrap_or_default();
        let value = number(word).filter(|n| *n >= 0.0 && n.fract() == 0.0 && *n < 1e15);
        value.map(|n| n as u64).ok_or_else(|| {
            Failure::bad_file(format!(
                "\"{}\" is no count of vertices or faces",
                shown(word)
            ))
        })
    };
    Ok((count(0)?, count(1)?))
}

fn whole(value: f64, what: &str) -> Result<i64, Failure> {
    if value.fract() == 0.0 && value.abs() < 1e15 {
        return Ok(value as i64);
    }
    Err(Failure::bad_file(format!(
        "{what} has {value} where a whole number must be"
    )))
}

/// Lines with something on them, without comments.
struct Rows<'a> {
    lines: Box<dyn Iterator<Item = (&'a [u8], usize)> + 'a>,
    length: usize,
    left: usize,
    comments: Vec<String>,
}

impl<'a> Rows<'a> {
    fn new(bytes: &'a [u8]) -> Rows<'a> {
        Rows {
            lines: Box::new(lines(bytes)),
            length: bytes.len(),
            left: bytes.len(),
            comments: Vec::new(),
        }
    }

    fn next(&mut self, what: &str) -> Result<&'a [u8], Failure> {
        for (line, at) in self.lines.by_ref() {
            self.left = self.length - at;
            let hash = line.iter().position(|byte| *byte == b'#');
            if let Some(hash) = hash
                && self.comments.len() < 20
            {
                let text = String::from_utf8_lossy(&line[hash + 1..]);
                self.comments.push(text.trim().into());
            }
            let line = line[..hash.unwrap_or(line.len())].trim_ascii();
            if !line.is_empty() {
                return Ok(line);
            }
        }
        let message = format!("the file ends before {what}");
        Err(Failure::bad_file(message).remedy("get a whole copy of the file"))
    }
}

/// Writes vertices and triangles.
///
/// # Errors
/// What the disk says.
pub fn write(out: &mut dyn Write, sheet: &Sheet, unit: &str, run: &dyn Run) -> io::Result<()> {
    let (vertices, faces) = (sheet.positions.len(), sheet.triangles.len());
    writeln!(
        out,
        "OFF\n# {}{unit}\n{vertices} {faces} 0",
        crate::unit::COMMENT
    )?;
    for (row, [x, y, z]) in sheet.positions.iter().enumerate() {
        crate::writer::poll(run, row)?;
        writeln!(out, "{x} {y} {z}")?;
    }
    for (row, [a, b, c]) in sheet.triangles.iter().enumerate() {
        crate::writer::poll(run, row)?;
        writeln!(out, "3 {a} {b} {c}")?;
    }
    Ok(())
}
