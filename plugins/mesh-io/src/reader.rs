//! The readers as operations.

use crate::sheet::{Sheet, Values};
use crate::unit::{UNKNOWN, Unit, in_nm};
use crate::{obj, off, ply, stl};
use puncta_sdk::output::ColumnMut;
use puncta_sdk::prelude::*;
use puncta_sdk::serde_json::json;
use std::fs::File;
use std::io::Read;
use std::path::Path;

/// A format that is read.
struct Format {
    name: &'static str,
    recognise: fn(&[u8], u64) -> Result<f64, Failure>,
    read: fn(&[u8], &dyn Run) -> Result<Sheet, Failure>,
}

/// Bytes of a file that `prepare` looks at.
const LOOK: u64 = 1 << 16;

/// What a file of so many bytes needs while it is read.
fn memory(bytes: u64) -> u64 {
    bytes.saturating_mul(4)
}

fn prepare(format: &Format, request: &Request, unit: Unit) -> Result<Plan, Failure> {
    let file = request.file.as_ref();
    let file = file.ok_or_else(|| Failure::internal("the call has no file"))?;
    let path = Path::new(&file.path);
    let fault = |error| Failure::io("read", path, &error);
    let open = File::open(path).map_err(fault)?;
    let length = open.metadata().map_err(fault)?.len();
    let mut head = Vec::new();
    open.take(LOOK).read_to_end(&mut head).map_err(fault)?;
    let confidence = (format.recognise)(&head, length)?;
    let mut plan = Plan {
        interruptible: true,
        memory: memory(length),
        ..Plan::default()
    };
    plan.probe = Some(Probe {
        format: format.name.into(),
        confidence,
    });
    if unit == Unit::File && !says_unit(&head) {
        let name = &file.name;
        plan.notes.push(format!(
            "The unit of x, y, z in {name} is unknown; give unit, such as nm or um."
        ));
    }
    Ok(plan)
}

fn says_unit(head: &[u8]) -> bool {
    let text = String::from_utf8_lossy(head);
    crate::unit::of_comments(text.lines().take(200)).is_some()
}

fn run(format: &Format, job: &Job, unit: Unit) -> Result<(), Failure> {
    let path = Path::new(&job.file()?.path);
    job.progress(0.0, "reading")?;
    let bytes = std::fs::read(path).map_err(|error| Failure::io("read", path, &error))?;
    let mut sheet = (format.read)(&bytes, job)?;
    drop(bytes);
    for note in &sheet.notes {
        job.warn(note);
    }
    let said = unit.name().map(str::to_owned).or_else(|| sheet.unit.take());
    let (unit, factor) = match said.as_deref().and_then(in_nm) {
        Some(factor) => ("nm", factor),
        None => (UNKNOWN, 1.0),
    };
    if factor != 1.0 {
        let places = sheet.positions.as_flattened_mut();
        places.iter_mut().for_each(|x| *x *= factor);
    }
    job.progress(0.9, "storing")?;
    give(format, job, &sheet, unit)
}

fn give(format: &Format, job: &Job, sheet: &Sheet, unit: &str) -> Result<(), Failure> {
    let position = |name: &str| ColumnInfo::new(name, Element::F64, unit).role("position");
    let mut columns = vec![position("x"), position("y"), position("z")];
    for column in &sheet.columns {
        let info = ColumnInfo::new(&column.name, column.values.element(), &column.unit);
        columns.push(info.source(&column.name));
    }
    let (vertices, triangles) = (sheet.positions.len() as u64, sheet.triangles.len() as u64);
    let mut header = Header::mesh("mesh", columns, vertices, triangles);
    header.metadata.insert("format".into(), json!(format.name));
    if !sheet.comments.is_empty() {
        header
            .metadata
            .insert("comments".into(), json!(sheet.comments));
    }
    let mut out = job.begin("mesh", header)?;
    let mut columns = out.columns_mut(0)?.into_iter();
    for (axis, column) in columns.by_ref().take(3).enumerate() {
        if let ColumnMut::F64(to) = column {
            let places = sheet.positions.iter().map(|place| place[axis]);
            to.iter_mut().zip(places).for_each(|(to, x)| *to = x);
        }
    }
    for (column, to) in sheet.columns.iter().zip(columns) {
        store(&column.values, to)?;
    }
    for (corner, column) in out.columns_mut(1)?.into_iter().enumerate() {
        if let ColumnMut::U32(to) = column {
            let corners = sheet.triangles.iter().map(|triangle| triangle[corner]);
            to.iter_mut()
                .zip(corners)
                .for_each(|(to, corner)| *to = corner);
        }
    }
    out.finish()
}

fn store(values: &Values, to: ColumnMut<'_>) -> Result<(), Failure> {
    match (values, to) {
        (Values::I8(from), ColumnMut::I8(to)) => to.copy_from_slice(from),
        (Values::U8(from), ColumnMut::U8(to)) => to.copy_from_slice(from),
        (Values::I16(from), ColumnMut::I16(to)) => to.copy_from_slice(from),
        (Values::U16(from), ColumnMut::U16(to)) => to.copy_from_slice(from),
        (Values::I32(from), ColumnMut::I32(to)) => to.copy_from_slice(from),
        (Values::U32(from), ColumnMut::U32(to)) => to.copy_from_slice(from),
        (Values::F32(from), ColumnMut::F32(to)) => to.copy_from_slice(from),
        (Values::F64(from), ColumnMut::F64(to)) => to.copy_from_slice(from),
        _ => return Err(Failure::internal("a column changes its type")),
    }
    Ok(())
}

macro_rules! reader {
    ($(#[$text:meta])* $name:ident, $format:ident, $module:ident, $label:literal, $id:literal,
     $suffixes:expr, $magic:expr, $description:literal, $file:literal, $example:expr) => {
        const $format: Format = Format {
            name: $label,
            recognise: $module::recognise,
            read: $module::read,
        };

        $(#[$text])*
        #[derive(Debug, Params)]
        pub struct $name {
            /// Unit of the coordinates.
            #[param(default = Unit::File)]
            unit: Unit,
        }

        impl Operation for $name {
            const ID: &'static str = $id;

            fn info() -> Info {
                Info::reader(concat!($label, " meshes"), $suffixes)
                    .description($description)
                    .formats($magic, &[$label])
                    .output(Ports::mesh("mesh").description("The triangles of the file"))
                    .example(json!({ "unit": "nm" }))
                    .example_text($file, $example)
            }

            fn prepare(&self, request: &Request) -> Result<Plan, Failure> {
                prepare(&$format, request, self.unit)
            }

            fn run(&self, job: &Job) -> Result<(), Failure> {
                run(&$format, job, self.unit)
            }
        }

        register!($name);
    };
}

reader!(
    /// Reads an STL file.
    ReadStl, STL, stl, "STL", "puncta.mesh-io.stl.read/1", &[".stl"], &[],
    "Reads triangles from binary or text STL.\nCorners at the same place become one vertex. The \
     unit is unknown until it is said here.",
    "triangle.stl",
    "solid\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\n\
     endfacet\nendsolid\n"
);
reader!(
    /// Reads a PLY file.
    ReadPly, PLY, ply, "PLY", "puncta.mesh-io.ply.read/1", &[".ply"], &[b"ply\n", b"ply\r"],
    "Reads vertices with all of their numbers, and faces, from text or binary PLY of either byte \
     order.\nPolygons become fans of triangles; strips of triangles are read, too.",
    "triangle.ply",
    "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float \
     z\nproperty uchar red\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n\
     0 0 0 1\n1 0 0 2\n0 1 0 3\n3 0 1 2\n"
);
reader!(
    /// Reads an OBJ file.
    ReadObj, OBJ, obj, "OBJ", "puncta.mesh-io.obj.read/1", &[".obj"], &[],
    "Reads vertices and faces from Wavefront OBJ.\nPolygons become fans of triangles. Normals, \
     texture, groups and materials are left out.",
    "triangle.obj",
    "# a triangle\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"
);
reader!(
    /// Reads an OFF file.
    ReadOff, OFF, off, "OFF", "puncta.mesh-io.off.read/1", &[".off"], &[b"OFF", b"COFF", b"NOFF"],
    "Reads vertices and faces from OFF.\nPolygons become fans of triangles. Colours and normals \
     are left out.",
    "triangle.off",
    "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"
);
