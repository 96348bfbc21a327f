//! Surfaces and octrees as outputs of a call.

use crate::surface::Surface;
use puncta_sdk::ColumnMut;
use puncta_sdk::prelude::*;
use puncta_shared_octree::Octree;

/// Gives a surface as a mesh.
///
/// # Errors
/// When the host has no room.
pub fn write_mesh(job: &Job, port: &str, surface: &Surface) -> Result<(), Failure> {
    let columns =
        ["x", "y", "z"].map(|name| ColumnInfo::new(name, Element::F64, "nm").role("position"));
    let (rows, triangles) = (
        surface.positions.len() as u64,
        surface.triangles.len() as u64,
    );
    let mut out = job.begin(port, Header::mesh(port, columns.into(), rows, triangles))?;
    out.commit(0, rows)?;
    out.commit(1, triangles)?;
    for (axis, column) in out.f64s_mut(["x", "y", "z"])?.into_iter().enumerate() {
        for (to, from) in column.iter_mut().zip(&surface.positions) {
            *to = from[axis];
        }
    }
    for (k, column) in out.columns_mut(1)?.into_iter().enumerate() {
        if let ColumnMut::U32(column) = column {
            for (to, from) in column.iter_mut().zip(&surface.triangles) {
                *to = from[k];
            }
        }
    }
    out.finish()
}

/// Gives the leaves of an octree as a table of boxes: centre, side, level, localisations, density.
///
/// # Errors
/// When the host has no room.
pub fn write_boxes(job: &Job, port: &str, octree: &Octree) -> Result<(), Failure> {
    let nm = |name| ColumnInfo::new(name, Element::F64, "nm");
    let columns = vec![
        nm("x").role("position").description("Centre of the box"),
        nm("y").role("position").description("Centre of the box"),
        nm("z").role("position").description("Centre of the box"),
        nm("size").description("Side of the box"),
        ColumnInfo::new("level", Element::U8, "1").description("0 for the whole cube"),
        ColumnInfo::new("count", Element::U32, "1").description("Localisations in the box"),
        ColumnInfo::new("density", Element::F64, "nm^-3").description("Localisations per volume"),
    ];
    let mut header = Header::table(port, octree.len() as u64, columns);
    header.shape = Some("boxes".into());
    let mut out = job.begin(port, header)?;
    out.commit(0, octree.len() as u64)?;
    let boxes = octree.boxes();
    let [x, y, z] = &boxes.centre;
    let mut reals = [x, y, z, &boxes.size, &boxes.density].into_iter();
    for column in out.columns_mut(0)? {
        match column {
            ColumnMut::F64(to) => {
                if let Some(from) = reals.next() {
                    to.copy_from_slice(from);
                }
            }
            ColumnMut::U8(to) => to.copy_from_slice(&boxes.level),
            ColumnMut::U32(to) => to.copy_from_slice(&boxes.count),
            _ => {}
        }
    }
    out.finish()
}
