//! What a mesh file holds.

use puncta_sdk::{Cancelled, Element, Failure, Run};

/// Numbers of a column in the type that the file has.
#[derive(Clone, Debug, PartialEq)]
#[allow(missing_docs)]
pub enum Values {
    I8(Vec<i8>),
    U8(Vec<u8>),
    I16(Vec<i16>),
    U16(Vec<u16>),
    I32(Vec<i32>),
    U32(Vec<u32>),
    F32(Vec<f32>),
    F64(Vec<f64>),
}

/// Runs code for the vector of any type of [`Values`].
#[macro_export]
macro_rules! each_type {
    ($values:expr, $vector:ident => $code:expr) => {
        match $values {
            $crate::sheet::Values::I8($vector) => $code,
            $crate::sheet::Values::U8($vector) => $code,
            $crate::sheet::Values::I16($vector) => $code,
            $crate::sheet::Values::U16($vector) => $code,
            $crate::sheet::Values::I32($vector) => $code,
            $crate::sheet::Values::U32($vector) => $code,
            $crate::sheet::Values::F32($vector) => $code,
            $crate::sheet::Values::F64($vector) => $code,
        }
    };
}

impl Values {
    /// Its element in the host.
    #[must_use]
    pub fn element(&self) -> Element {
        match self {
            Values::I8(_) => Element::I8,
            Values::U8(_) => Element::U8,
            Values::I16(_) => Element::I16,
            Values::U16(_) => Element::U16,
            Values::I32(_) => Element::I32,
            Values::U32(_) => Element::U32,
            Values::F32(_) => Element::F32,
            Values::F64(_) => Element::F64,
        }
    }

    /// Value `i` as f64; NaN if there is none.
    #[must_use]
    // One arm of the macro converts f64 to itself.
    #[allow(clippy::useless_conversion)]
    pub fn get(&self, i: usize) -> f64 {
        each_type!(self, vector => vector.get(i).map_or(f64::NAN, |value| f64::from(*value)))
    }

    /// Adds a value that has come out of a field of this type.
    pub fn push(&mut self, value: f64) {
        match self {
            Values::I8(vector) => vector.push(value as i8),
            Values::U8(vector) => vector.push(value as u8),
            Values::I16(vector) => vector.push(value as i16),
            Values::U16(vector) => vector.push(value as u16),
            Values::I32(vector) => vector.push(value as i32),
            Values::U32(vector) => vector.push(value as u32),
            Values::F32(vector) => vector.push(value as f32),
            Values::F64(vector) => vector.push(value),
        }
    }
}

/// A column of the vertices.
#[derive(Clone, Debug, PartialEq)]
pub struct Column {
    /// Name.
    pub name: String,
    /// Unit, or `unknown`.
    pub unit: String,
    /// One value for each vertex.
    pub values: Values,
}

/// Vertices with columns, and triangles.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Sheet {
    /// Positions in the unit.
    pub positions: Vec<[f64; 3]>,
    /// Corners of the triangles.
    pub triangles: Vec<[u32; 3]>,
    /// Further columns of the vertices.
    pub columns: Vec<Column>,
    /// Unit of the positions, if the file says it.
    pub unit: Option<String>,
    /// Comments of the file.
    pub comments: Vec<String>,
    /// What the person should know.
    pub notes: Vec<String>,
}

impl Sheet {
    /// Adds the triangles of a polygon, as a fan; its corners are checked.
    ///
    /// # Errors
    /// When a corner does not exist.
    pub fn polygon(&mut self, row: usize, corners: &[i64]) -> Result<(), Failure> {
        let count = self.positions.len();
        let vertex = |corner: i64| match u32::try_from(corner) {
            Ok(vertex) if (vertex as usize) < count => Ok(vertex),
            _ => {
                let message =
                    format!("face {row} names vertex {corner}, but the file has {count} vertices");
                Err(Failure::bad_file(message).row(row as u64))
            }
        };
        let corners: Vec<u32> = corners
            .iter()
            .map(|&c| vertex(c))
            .collect::<Result<_, _>>()?;
        if let [first, rest @ ..] = &corners[..] {
            let pairs = rest.windows(2);
            self.triangles
                .extend(pairs.map(|pair| [*first, pair[0], pair[1]]));
        }
        Ok(())
    }
}

/// Polls cancel now and then.
///
/// # Errors
/// When cancelled.
#[inline]
pub fn poll(run: &dyn Run, row: usize) -> Result<(), Cancelled> {
    if row.is_multiple_of(1 << 14) && run.cancelled() {
        return Err(Cancelled);
    }
    Ok(())
}

/// Checks that a file of `bytes` more bytes can hold `count` rows of at least `least` bytes.
///
/// # Errors
/// When it cannot: the header lies, or the file is cut off.
pub fn fits(what: &str, count: u64, least: u64, bytes: usize) -> Result<usize, Failure> {
    let room = bytes as u64 / least.max(1);
    if count > room {
        let message = format!(
            "the header says {count} {what}, but the rest of the file has room for at most {room}"
        );
        return Err(Failure::bad_file(message).remedy("get a whole copy of the file"));
    }
    usize::try_from(count).map_err(|_| Failure::bad_file(format!("{count} {what} are too many")))
}
