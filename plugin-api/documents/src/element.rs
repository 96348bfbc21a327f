//! Types of columns.

use serde::{Deserialize, Deserializer, Serialize, Serializer};
use std::fmt;

/// Type of the numbers or texts of a column.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[allow(missing_docs)]
pub enum Element {
    U8,
    I8,
    U16,
    I16,
    U32,
    I32,
    U64,
    I64,
    F32,
    F64,
    Bool,
    Utf8,
    Dictionary,
}

const ELEMENTS: &[(Element, &str, u32, usize)] = &[
    (Element::U8, "u8", 1, 1),
    (Element::I8, "i8", 2, 1),
    (Element::U16, "u16", 3, 2),
    (Element::I16, "i16", 4, 2),
    (Element::U32, "u32", 5, 4),
    (Element::I32, "i32", 6, 4),
    (Element::U64, "u64", 7, 8),
    (Element::I64, "i64", 8, 8),
    (Element::F32, "f32", 9, 4),
    (Element::F64, "f64", 10, 8),
    (Element::Bool, "bool", 11, 1),
    (Element::Utf8, "utf8", 12, 0),
    (Element::Dictionary, "dictionary", 13, 4),
];

impl Element {
    fn row(self) -> &'static (Element, &'static str, u32, usize) {
        ELEMENTS
            .iter()
            .find(|row| row.0 == self)
            .unwrap_or(&ELEMENTS[0])
    }

    /// Name in documents, such as `f64`.
    #[must_use]
    pub fn name(self) -> &'static str {
        self.row().1
    }

    /// The `KIND_` number of the ABI.
    #[must_use]
    pub fn code(self) -> u32 {
        self.row().2
    }

    /// Bytes of one number or code; 0 for UTF-8.
    #[must_use]
    pub fn bytes(self) -> usize {
        self.row().3
    }

    /// The element with this ABI number.
    #[must_use]
    pub fn from_code(code: u32) -> Option<Element> {
        ELEMENTS.iter().find(|row| row.2 == code).map(|row| row.0)
    }

    /// The element with this name.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Element> {
        ELEMENTS.iter().find(|row| row.1 == name).map(|row| row.0)
    }

    /// Whether rows are texts.
    #[must_use]
    pub fn is_text(self) -> bool {
        matches!(self, Element::Utf8 | Element::Dictionary)
    }
}

/// Type of a column: an element, and how many of them a row has.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct ColumnType {
    /// Element.
    pub element: Element,
    /// Elements per row: 1, or the length of a fixed-size list.
    pub width: u32,
}

impl ColumnType {
    /// One element per row.
    #[must_use]
    pub const fn scalar(element: Element) -> ColumnType {
        ColumnType { element, width: 1 }
    }

    /// Bytes of one row in `data`; 0 for UTF-8.
    #[must_use]
    pub fn row_bytes(self) -> usize {
        self.element.bytes() * self.width as usize
    }
}

impl fmt::Display for ColumnType {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.element.name())?;
        if self.width == 1 {
            Ok(())
        } else {
            write!(f, "[{}]", self.width)
        }
    }
}

impl std::str::FromStr for ColumnType {
    type Err = String;

    fn from_str(text: &str) -> Result<ColumnType, String> {
        let unknown = || format!("\"{text}\" is no column type");
        let (name, width) = match text.split_once('[') {
            Some((name, rest)) => {
                let width = rest.strip_suffix(']').and_then(|width| width.parse().ok());
                (
                    name,
                    width
                        .filter(|width| (2..=4096).contains(width))
                        .ok_or_else(unknown)?,
                )
            }
            None => (text, 1),
        };
        let element = Element::from_name(name).ok_or_else(unknown)?;
        if width != 1 && !matches!(element, Element::F32 | Element::F64) {
            return Err(unknown());
        }
        Ok(ColumnType { element, width })
    }
}

impl Serialize for ColumnType {
    fn serialize<S: Serializer>(&self, out: S) -> Result<S::Ok, S::Error> {
        out.collect_str(self)
    }
}

impl<'de> Deserialize<'de> for ColumnType {
    fn deserialize<D: Deserializer<'de>>(from: D) -> Result<ColumnType, D::Error> {
        String::deserialize(from)?
            .parse()
            .map_err(serde::de::Error::custom)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn column_types_round_trip() {
        for text in ["f64", "f32[3]", "utf8", "dictionary", "bool", "i64"] {
            assert_eq!(text.parse::<ColumnType>().unwrap().to_string(), text);
        }
        for text in [
            "",
            "f16",
            "f32[1]",
            "i32[3]",
            "f32[",
            "f32[x]",
            "f64[100000]",
        ] {
            assert!(text.parse::<ColumnType>().is_err(), "{text}");
        }
    }
}
