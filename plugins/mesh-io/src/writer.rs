//! The writers as operations.

use crate::ply::Encoding;
use crate::sheet::{Column, Sheet, Values};
use crate::{glb, obj, off, ply, stl, vtp};
use puncta_sdk::documents::call::Read;
use puncta_sdk::input::{ColumnRef, Input};
use puncta_sdk::prelude::*;
use puncta_sdk::serde_json::json;
use std::fs::File;
use std::io::{self, BufWriter, ErrorKind, Write};
use std::path::Path;

/// Polls cancel now and then; a cancelled call is an interrupted one.
///
/// # Errors
/// When cancelled.
#[inline]
pub fn poll(run: &dyn Run, row: usize) -> io::Result<()> {
    if row.is_multiple_of(1 << 13) && run.cancelled() {
        return Err(ErrorKind::Interrupted.into());
    }
    Ok(())
}

fn input_port() -> Ports {
    Ports::mesh("mesh")
        .any_column("x")
        .any_column("y")
        .any_column("z")
        .description("All columns of numbers are written where the format has room")
}

fn prepare(request: &Request) -> Result<Plan, Failure> {
    let input = request.inputs.first();
    let input = input.ok_or_else(|| Failure::bad_input("there is no mesh to write"))?;
    let mut plan = Plan {
        interruptible: true,
        ..Plan::default()
    };
    for (part, group) in input.header.parts.iter().enumerate().take(2) {
        let numbers = group
            .columns
            .iter()
            .filter(|info| !info.type_.element.is_text());
        let columns = numbers.map(|info| info.name.clone());
        let bytes: u64 = group
            .columns
            .iter()
            .map(|info| info.type_.row_bytes() as u64)
            .sum();
        plan.memory = plan
            .memory
            .saturating_add(group.rows.saturating_mul(2 * bytes));
        plan.read.push(Read {
            input: 0,
            part,
            columns: columns.collect(),
        });
    }
    Ok(plan)
}

/// The mesh of the host, and the unit of its positions.
fn sheet(job: &Job) -> Result<(Sheet, String), Failure> {
    let input = job.input("mesh")?;
    let [x, y, z] = [input.f64("x")?, input.f64("y")?, input.f64("z")?];
    let places = x.iter().zip(y.iter()).zip(z.iter());
    let mut sheet = Sheet {
        positions: places.map(|((&x, &y), &z)| [x, y, z]).collect(),
        ..Sheet::default()
    };
    let corner = |name: &str| match input.column(1, name)? {
        ColumnRef::U32(values) => Ok(values),
        _ => Err(Failure::bad_input(format!(
            "column {name} must hold vertex numbers (u32)"
        ))),
    };
    let [a, b, c] = [corner("a")?, corner("b")?, corner("c")?];
    let corners = a.iter().zip(b).zip(c);
    sheet.triangles = corners.map(|((&a, &b), &c)| [a, b, c]).collect();
    let count = sheet.positions.len();
    let wild = |t: &[u32; 3]| t.iter().any(|&v| v as usize >= count);
    if let Some(row) = sheet.triangles.iter().position(wild) {
        let message = format!("triangle {row} names a vertex that does not exist");
        let remedy = "repair the mesh first (puncta.mesh.repair)";
        return Err(Failure::bad_input(message).row(row as u64).remedy(remedy));
    }
    let infos = input
        .header()
        .parts
        .first()
        .map_or(&[][..], |part| &part.columns);
    let mut unit = crate::unit::UNKNOWN.to_owned();
    for info in infos {
        match info.name.as_str() {
            "x" => unit.clone_from(&info.unit),
            "y" | "z" => {}
            name if info.type_.element.is_text() => {
                job.warn(&format!("Column {name} holds texts and is left out."));
            }
            _ => sheet.columns.extend(columns(&input, info)?),
        }
    }
    Ok((sheet, unit))
}

/// A column as those of a file: lists as one for each place, 64-bit integers as f64.
fn columns(input: &Input<'_>, info: &ColumnInfo) -> Result<Vec<Column>, Failure> {
    let width = (info.type_.width as usize).max(1);
    fn every<T: Copy>(values: &[T], width: usize, place: usize) -> Vec<T> {
        values.iter().skip(place).step_by(width).copied().collect()
    }
    let one = |place: usize| {
        let values = match input.column(0, &info.name)? {
            ColumnRef::I8(v) => Values::I8(every(v, width, place)),
            ColumnRef::U8(v) | ColumnRef::Bool(v) => Values::U8(every(v, width, place)),
            ColumnRef::I16(v) => Values::I16(every(v, width, place)),
            ColumnRef::U16(v) => Values::U16(every(v, width, place)),
            ColumnRef::I32(v) => Values::I32(every(v, width, place)),
            ColumnRef::U32(v) => Values::U32(every(v, width, place)),
            ColumnRef::F32(v) => Values::F32(every(v, width, place)),
            _ => Values::F64(every(&input.f64_of(0, &info.name)?, width, place)),
        };
        // Names in files are single words.
        let word = info.name.split_whitespace().collect::<Vec<_>>().join("_");
        Ok(Column {
            name: if width == 1 {
                word
            } else {
                format!("{word}_{place}")
            },
            unit: info.unit.clone(),
            values,
        })
    };
    (0..width).map(one).collect()
}

fn run(
    job: &Job,
    write: impl Fn(&mut dyn Write, &Sheet, &str, &dyn Run) -> io::Result<()>,
) -> Result<(), Failure> {
    let (sheet, unit) = sheet(job)?;
    job.progress(0.2, "writing")?;
    let path = Path::new(&job.file()?.path);
    let save = || {
        let mut out = BufWriter::with_capacity(1 << 20, File::create(path)?);
        write(&mut out, &sheet, &unit, job)?;
        out.flush()
    };
    save().map_err(|error| {
        if error.kind() == ErrorKind::Interrupted && job.cancelled() {
            Failure::cancelled()
        } else {
            Failure::io("write", path, &error)
        }
    })
}

macro_rules! writer {
    ($name:ident, $id:literal, $title:literal, $suffixes:expr, $description:literal, $write:expr) => {
        impl Operation for $name {
            const ID: &'static str = $id;

            fn info() -> Info {
                Info::writer($title, $suffixes)
                    .description($description)
                    .input(input_port())
                    .example(json!({}))
                    .example_input("mesh", "puncta.mesh.shape/1", json!({ "edge": 30 }))
            }

            fn prepare(&self, request: &Request) -> Result<Plan, Failure> {
                prepare(request)
            }

            fn run(&self, job: &Job) -> Result<(), Failure> {
                let write: fn(&Self, &mut dyn Write, &Sheet, &str, &dyn Run) -> io::Result<()> =
                    $write;
                run(job, |out, sheet, unit, run| write(self, out, sheet, unit, run))
            }
        }

        register!($name);
    };
}

/// Writes a mesh as STL.
#[derive(Debug, Params)]
pub struct WriteStl {
    /// Write text, which is five times as large.
    #[param(default = false)]
    text: bool,
}

/// How numbers are stored.
#[derive(Choice, Clone, Copy, Debug, PartialEq, Eq)]
pub enum Encodings {
    /// Binary, low byte first
    Little,
    /// Binary, high byte first
    Big,
    /// Text
    Text,
}

/// Writes a mesh as PLY.
#[derive(Debug, Params)]
pub struct WritePly {
    /// How numbers are stored.
    #[param(default = Encodings::Little)]
    encoding: Encodings,
}

/// Writes a mesh as OBJ.
#[derive(Debug, Params)]
pub struct WriteObj {}

/// Writes a mesh as OFF.
#[derive(Debug, Params)]
pub struct WriteOff {}

/// Writes a mesh as glTF.
#[derive(Debug, Params)]
pub struct WriteGlb {}

/// Writes a mesh as VTP.
#[derive(Debug, Params)]
pub struct WriteVtp {}

writer!(
    WriteStl,
    "puncta.mesh-io.stl.write/1",
    "STL meshes",
    &[".stl"],
    "Writes the triangles as STL, which holds neither columns nor shared vertices; coordinates \
     become f32 unless they are written as text.",
    |this, out, sheet, unit, run| {
        if this.text {
            stl::write_text(out, sheet, unit, run)
        } else {
            stl::write(out, sheet, unit, run)
        }
    }
);
writer!(
    WritePly,
    "puncta.mesh-io.ply.write/1",
    "PLY meshes",
    &[".ply"],
    "Writes vertices with all of their columns of numbers, and triangles. Comments hold the units.",
    |this, out, sheet, unit, run| {
        let encoding = match this.encoding {
            Encodings::Little => Encoding::Little,
            Encodings::Big => Encoding::Big,
            Encodings::Text => Encoding::Text,
        };
        ply::write(out, sheet, unit, encoding, run)
    }
);
writer!(
    WriteObj,
    "puncta.mesh-io.obj.write/1",
    "OBJ meshes",
    &[".obj"],
    "Writes vertices and triangles as Wavefront OBJ, without columns.",
    |_, out, sheet, unit, run| obj::write(out, sheet, unit, run)
);
writer!(
    WriteOff,
    "puncta.mesh-io.off.write/1",
    "OFF meshes",
    &[".off"],
    "Writes vertices and triangles as OFF, without columns.",
    |_, out, sheet, unit, run| off::write(out, sheet, unit, run)
);
writer!(
    WriteGlb,
    "puncta.mesh-io.glb.write/1",
    "glTF meshes",
    &[".glb"],
    "Writes a binary glTF 2.0 file for viewers. Columns red, green and blue become the colour, \
     others attributes with a leading underscore.",
    |_, out, sheet, unit, run| glb::write(out, sheet, unit, run)
);
writer!(
    WriteVtp,
    "puncta.mesh-io.vtp.write/1",
    "VTP meshes",
    &[".vtp"],
    "Writes the XML polygons of VTK with all columns as point data, for ParaView.",
    |_, out, sheet, unit, run| vtp::write(out, sheet, unit, run)
);
