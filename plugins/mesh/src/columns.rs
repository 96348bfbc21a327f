//! Columns of vertices that go with them into a new mesh.

use puncta_sdk::input::{ColumnRef, Input};
use puncta_sdk::output::ColumnMut;
use puncta_sdk::prelude::*;
use puncta_shared_mesh::NONE;

/// Whether a column of vertices is copied: all numbers but the position itself.
#[must_use]
pub fn is_copied(info: &ColumnInfo) -> bool {
    !matches!(info.name.as_str(), "x" | "y" | "z") && !info.type_.element.is_text()
}

/// The columns of the vertices of an input that are copied, without those of `new`.
#[must_use]
pub fn copied(header: &Header, new: &[&str]) -> Vec<ColumnInfo> {
    let columns = header.parts.first().map_or(&[][..], |part| &part.columns);
    let wanted = |info: &&ColumnInfo| is_copied(info) && !new.contains(&info.name.as_str());
    columns.iter().filter(wanted).cloned().collect()
}

trait Missing: Copy {
    /// What a vertex that is new has.
    const MISSING: Self;
}

macro_rules! missing {
    ($($type:ty: $value:expr;)*) => {
        $(impl Missing for $type {
            const MISSING: Self = $value;
        })*
    };
}

missing! {
    u8: 0; i8: 0; u16: 0; i16: 0; u32: 0; i32: 0; u64: 0; i64: 0; f32: f32::NAN; f64: f64::NAN;
}

fn gather<T: Missing>(from: &[T], to: &mut [T], width: usize, origin: Option<&[u32]>) {
    let Some(origin) = origin else {
        to.iter_mut().zip(from).for_each(|(to, from)| *to = *from);
        return;
    };
    for (to, &row) in to.chunks_mut(width).zip(origin) {
        let first = row as usize * width;
        let values = if row == NONE {
            None
        } else {
            from.get(first..first + to.len())
        };
        match values {
            Some(values) => to.copy_from_slice(values),
            None => to.fill(T::MISSING),
        }
    }
}

/// Copies a column of vertices: `origin` says the row of the input for each vertex, [`NONE`] for
/// new ones; without it rows stay as they are.
///
/// # Errors
/// When the columns differ in type.
pub fn copy(
    input: &Input<'_>,
    info: &ColumnInfo,
    to: ColumnMut<'_>,
    origin: Option<&[u32]>,
) -> Result<(), Failure> {
    let width = (info.type_.width as usize).max(1);
    match (input.column(0, &info.name)?, to) {
        (ColumnRef::U8(from), ColumnMut::U8(to)) => gather(from, to, width, origin),
        (ColumnRef::Bool(from), ColumnMut::Bool(to)) => gather(from, to, width, origin),
        (ColumnRef::I8(from), ColumnMut::I8(to)) => gather(from, to, width, origin),
        (ColumnRef::U16(from), ColumnMut::U16(to)) => gather(from, to, width, origin),
        (ColumnRef::I16(from), ColumnMut::I16(to)) => gather(from, to, width, origin),
        (ColumnRef::U32(from), ColumnMut::U32(to)) => gather(from, to, width, origin),
        (ColumnRef::I32(from), ColumnMut::I32(to)) => gather(from, to, width, origin),
        (ColumnRef::U64(from), ColumnMut::U64(to)) => gather(from, to, width, origin),
        (ColumnRef::I64(from), ColumnMut::I64(to)) => gather(from, to, width, origin),
        (ColumnRef::F32(from), ColumnMut::F32(to)) => gather(from, to, width, origin),
        (ColumnRef::F64(from), ColumnMut::F64(to)) => gather(from, to, width, origin),
        _ => {
            let name = &info.name;
            return Err(Failure::internal(format!("column {name} changes its type")));
        }
    }
    Ok(())
}
