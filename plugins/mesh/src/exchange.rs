//! Meshes of the host as those of the library, and back.

use crate::columns::{copied, copy};
use puncta_sdk::documents::call::Read;
use puncta_sdk::input::ColumnRef;
use puncta_sdk::operation::default_plan;
use puncta_sdk::output::{ColumnMut, OutputObject};
use puncta_sdk::prelude::*;
use puncta_shared_mesh::{Mesh, Point};

/// Name of the port of a mesh.
pub const MESH: &str = "mesh";

/// Bytes that a call needs for each vertex and triangle, roughly.
const BYTES: u64 = 400;

/// The input port of a mesh.
#[must_use]
pub fn port() -> Ports {
    Ports::mesh(MESH)
        .column("x", "nm")
        .column("y", "nm")
        .column("z", "nm")
}

/// The plan that reads positions and triangles, and the other columns of the vertices if they are
/// `kept`.
#[must_use]
pub fn plan<O: Operation>(request: &Request, kept: bool) -> Plan {
    let mut plan = default_plan::<O>(request);
    for (place, input) in request.inputs.iter().enumerate() {
        if input.header.kind != Kind::Mesh {
            continue;
        }
        if kept && let Some(read) = plan.read.iter_mut().find(|read| read.input == place) {
            let more = copied(&input.header, &[]);
            read.columns.extend(more.into_iter().map(|info| info.name));
        }
        plan.read.push(Read {
            input: place,
            part: 1,
            columns: ["a", "b", "c"].map(Into::into).into(),
        });
        let rows: u64 = input.header.parts.iter().map(|part| part.rows).sum();
        plan.memory = plan.memory.saturating_add(rows.saturating_mul(BYTES));
    }
    plan
}

/// Positions and triangles of the mesh on the port `mesh`, whatever they are.
///
/// # Errors
/// When the plan does not read them.
pub fn raw(job: &Job) -> Result<(Vec<Point>, Vec<[u32; 3]>), Failure> {
    let input = job.input(MESH)?;
    let [x, y, z] = [input.f64("x")?, input.f64("y")?, input.f64("z")?];
    let points = x.iter().zip(y.iter()).zip(z.iter());
    let positions = points.map(|((&x, &y), &z)| [x, y, z]).collect();
    let corner = |name: &str| match input.column(1, name)? {
        ColumnRef::U32(values) => Ok(values),
        _ => Err(Failure::bad_input(format!(
            "column {name} of the triangles must hold vertex numbers (u32)"
        ))),
    };
    let [a, b, c] = [corner("a")?, corner("b")?, corner("c")?];
    let triangles = a.iter().zip(b).zip(c).map(|((&a, &b), &c)| [a, b, c]);
    Ok((positions, triangles.collect()))
}

/// The mesh on the port `mesh`.
///
/// # Errors
/// When a position is not finite, or its triangles are no oriented manifold.
pub fn read(job: &Job) -> Result<Mesh, Failure> {
    let (positions, triangles) = raw(job)?;
    let unplaced = positions
        .iter()
        .position(|p| !p.iter().all(|x| x.is_finite()));
    if let Some(row) = unplaced {
        let message = format!("the position of vertex {row} is not finite");
        return Err(Failure::bad_input(message)
            .row(row as u64)
            .remedy("repair the mesh first (puncta.mesh.repair)"));
    }
    Mesh::new(positions, &triangles)
}

/// Columns of a position.
#[must_use]
pub fn positions() -> Vec<ColumnInfo> {
    let corner = |name: &str| ColumnInfo::new(name, Element::F64, "nm").role("position");
    vec![corner("x"), corner("y"), corner("z")]
}

/// A mesh to be given out.
pub struct Out<'a> {
    /// The mesh, compact.
    pub mesh: &'a Mesh,
    /// Rows of the input that its vertices stand for: then the other columns of the input are
    /// copied. `None`: the vertices are new.
    pub origin: Option<&'a [u32]>,
    /// New columns of f64 with a value for each vertex.
    pub columns: Vec<(ColumnInfo, Vec<f64>)>,
}

impl Out<'_> {
    /// Begins the output `mesh`, fills and finishes it.
    ///
    /// # Errors
    /// When the host has no room.
    pub fn give(self, job: &Job) -> Result<(), Failure> {
        let input = job.input(MESH).ok();
        let new: Vec<&str> = self
            .columns
            .iter()
            .map(|(info, _)| info.name.as_str())
            .collect();
        let kept = match (&input, self.origin) {
            (Some(input), Some(_)) => copied(input.header(), &new),
            _ => Vec::new(),
        };
        let mut columns = positions();
        columns.extend(kept.iter().cloned());
        columns.extend(self.columns.iter().map(|(info, _)| info.clone()));
        let name = input.as_ref().map_or(MESH, |input| &input.header().name);
        let (vertices, triangles) = (self.mesh.positions(), self.mesh.stored_triangles());
        let mut header = Header::mesh(name, columns, vertices.len() as u64, triangles.len() as u64);
        if let Some(input) = &input {
            header.metadata.clone_from(&input.header().metadata);
        }
        let mut out = job.begin(MESH, header)?;
        {
            let mut columns = out.columns_mut(0)?.into_iter();
            for (axis, column) in columns.by_ref().take(3).enumerate() {
                fill(column, vertices.iter().map(|p| p[axis]))?;
            }
            if let Some(input) = &input {
                for (info, column) in kept.iter().zip(columns.by_ref()) {
                    copy(input, info, column, self.origin)?;
                }
            }
            for ((_, values), column) in self.columns.iter().zip(columns) {
                fill(column, values.iter().copied())?;
            }
        }
        corners(&mut out, triangles)?;
        out.finish()
    }
}

fn fill(column: ColumnMut<'_>, values: impl Iterator<Item = f64>) -> Result<(), Failure> {
    match column {
        ColumnMut::F64(out) => {
            out.iter_mut()
                .zip(values)
                .for_each(|(out, value)| *out = value);
            Ok(())
        }
        _ => Err(Failure::internal("a column of f64 has another type")),
    }
}

fn corners(out: &mut OutputObject<'_>, triangles: &[[u32; 3]]) -> Result<(), Failure> {
    for (i, column) in out.columns_mut(1)?.into_iter().enumerate() {
        match column {
            ColumnMut::U32(out) => {
                let values = triangles.iter().map(|triangle| triangle[i]);
                out.iter_mut()
                    .zip(values)
                    .for_each(|(out, value)| *out = value);
            }
            _ => return Err(Failure::internal("the corners of triangles must be u32")),
        }
    }
    Ok(())
}
