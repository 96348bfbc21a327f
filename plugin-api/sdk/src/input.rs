//! Inputs of a running call.

use crate::raw::RawColumn;
use crate::{Failure, Header};
use puncta_documents::Element;
use std::borrow::Cow;

/// The numbers or texts of an input column.
#[derive(Clone, Copy, Debug)]
#[allow(missing_docs)]
pub enum ColumnRef<'a> {
    U8(&'a [u8]),
    I8(&'a [i8]),
    U16(&'a [u16]),
    I16(&'a [i16]),
    U32(&'a [u32]),
    I32(&'a [i32]),
    U64(&'a [u64]),
    I64(&'a [i64]),
    F32(&'a [f32]),
    F64(&'a [f64]),
    /// 0 or 1.
    Bool(&'a [u8]),
    Utf8(Texts<'a>),
    /// Codes into the texts.
    Dictionary(&'a [u32], Texts<'a>),
}

/// Texts: `offsets[i]..offsets[i + 1]` of `bytes`.
#[derive(Clone, Copy, Debug)]
pub struct Texts<'a> {
    offsets: &'a [u64],
    bytes: &'a [u8],
}

impl<'a> Texts<'a> {
    /// Number of texts.
    #[must_use]
    pub fn len(&self) -> usize {
        self.offsets.len().saturating_sub(1)
    }

    /// Whether there is none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Text `i`; empty if there is none.
    #[must_use]
    pub fn get(&self, i: usize) -> &'a str {
        let place = |i: usize| {
            self.offsets
                .get(i)
                .and_then(|place| usize::try_from(*place).ok())
        };
        let bytes = match (place(i), place(i + 1)) {
            (Some(begin), Some(end)) => self.bytes.get(begin..end).unwrap_or(&[]),
            _ => &[],
        };
        std::str::from_utf8(bytes).unwrap_or("")
    }
}

/// One group of columns of an input, as far as the plan named them.
#[derive(Clone, Debug, Default)]
pub struct InputPart {
    pub(crate) rows: u64,
    pub(crate) names: Vec<String>,
    pub(crate) columns: Vec<RawColumn>,
}

/// An input object.
#[derive(Clone, Debug)]
pub struct Input<'a> {
    pub(crate) header: &'a Header,
    pub(crate) parts: &'a [InputPart],
}

impl<'a> Input<'a> {
    /// What it is.
    #[must_use]
    pub fn header(&self) -> &'a Header {
        self.header
    }

    /// Rows of the first part.
    #[must_use]
    pub fn rows(&self) -> usize {
        usize::try_from(self.header.rows()).unwrap_or(usize::MAX)
    }

    /// Numbers of a column of the first part as f64: borrowed if they are, converted otherwise.
    ///
    /// # Errors
    /// When the plan does not name the column, or it holds texts.
    pub fn f64(&self, name: &str) -> Result<Cow<'a, [f64]>, Failure> {
        self.f64_of(0, name)
    }

    /// As [`Input::f64`], for a part.
    ///
    /// # Errors
    /// When the plan does not name the column, or it holds texts.
    pub fn f64_of(&self, part: usize, name: &str) -> Result<Cow<'a, [f64]>, Failure> {
        #[allow(clippy::cast_precision_loss)]
        Ok(match self.column(part, name)? {
            ColumnRef::F64(values) => Cow::Borrowed(values),
            ColumnRef::F32(values) => values.iter().map(|v| f64::from(*v)).collect(),
            ColumnRef::U8(values) | ColumnRef::Bool(values) => {
                values.iter().map(|v| f64::from(*v)).collect()
            }
            ColumnRef::I8(values) => values.iter().map(|v| f64::from(*v)).collect(),
            ColumnRef::U16(values) => values.iter().map(|v| f64::from(*v)).collect(),
            ColumnRef::I16(values) => values.iter().map(|v| f64::from(*v)).collect(),
            ColumnRef::U32(values) => values.iter().map(|v| f64::from(*v)).collect(),
            ColumnRef::I32(values) => values.iter().map(|v| f64::from(*v)).collect(),
            ColumnRef::U64(values) => values.iter().map(|v| *v as f64).collect(),
            ColumnRef::I64(values) => values.iter().map(|v| *v as f64).collect(),
            ColumnRef::Utf8(_) | ColumnRef::Dictionary(..) => {
                return Err(Failure::bad_input(format!(
                    "column {name} of {} holds texts, not numbers",
                    self.header.name
                )));
            }
        })
    }

    /// A column of a part as it is.
    ///
    /// # Errors
    /// When the plan does not name it, or its type is of a newer version.
    #[allow(unsafe_code)]
    pub fn column(&self, part: usize, name: &str) -> Result<ColumnRef<'a>, Failure> {
        let missing = || {
            let message = format!("there is no column {name} in {}", self.header.name);
            Failure::bad_input(message).remedy("the call's plan must name the columns it reads")
        };
        let group = self.parts.get(part).ok_or_else(missing)?;
        let place = group
            .names
            .iter()
            .position(|known| known == name)
            .ok_or_else(missing)?;
        let raw = *group.columns.get(place).ok_or_else(missing)?;
        let broken = || Failure::internal(format!("the host gave column {name} wrongly"));
        let type_ = raw.type_().ok_or_else(|| {
            Failure::new(
                crate::FailureCode::Unsupported,
                format!("column {name} has a type that this plugin does not know"),
            )
        })?;
        // SAFETY: the element decides the slice's type; inputs stay unchanged while the job lives,
        // and `'a` is a borrow of the job.
        unsafe {
            Ok(match type_.element {
                Element::U8 => ColumnRef::U8(raw.slice().ok_or_else(broken)?),
                Element::I8 => ColumnRef::I8(raw.slice().ok_or_else(broken)?),
                Element::U16 => ColumnRef::U16(raw.slice().ok_or_else(broken)?),
                Element::I16 => ColumnRef::I16(raw.slice().ok_or_else(broken)?),
                Element::U32 => ColumnRef::U32(raw.slice().ok_or_else(broken)?),
                Element::I32 => ColumnRef::I32(raw.slice().ok_or_else(broken)?),
                Element::U64 => ColumnRef::U64(raw.slice().ok_or_else(broken)?),
                Element::I64 => ColumnRef::I64(raw.slice().ok_or_else(broken)?),
                Element::F32 => ColumnRef::F32(raw.slice().ok_or_else(broken)?),
                Element::F64 => ColumnRef::F64(raw.slice().ok_or_else(broken)?),
                Element::Bool => ColumnRef::Bool(raw.slice().ok_or_else(broken)?),
                Element::Utf8 => ColumnRef::Utf8(Texts {
                    offsets: raw.offsets(raw.0.rows).ok_or_else(broken)?,
                    bytes: raw.text().ok_or_else(broken)?,
                }),
                Element::Dictionary => ColumnRef::Dictionary(
                    raw.slice().ok_or_else(broken)?,
                    Texts {
                        offsets: raw.offsets(raw.0.entries).ok_or_else(broken)?,
                        bytes: raw.text().ok_or_else(broken)?,
                    },
                ),
            })
        }
    }

    /// Names of the columns of a part that the plan named, in its order.
    #[must_use]
    pub fn names(&self, part: usize) -> &'a [String] {
        self.parts.get(part).map_or(&[], |group| &group.names)
    }

    /// Rows of a part.
    #[must_use]
    pub fn rows_of(&self, part: usize) -> usize {
        self.parts
            .get(part)
            .map_or(0, |group| usize::try_from(group.rows).unwrap_or(usize::MAX))
    }
}
