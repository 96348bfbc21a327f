//! The header.

use crate::sheet::Values;
use crate::text::{Words, lines, shown};
use puncta_sdk::{Failure, FailureCode};

/// How numbers are stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Encoding {
    /// As text.
    Text,
    /// Binary, low byte first.
    Little,
    /// Binary, high byte first.
    Big,
}

/// Type of a number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[allow(missing_docs)]
pub enum Type {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

impl Type {
    fn of(name: &[u8]) -> Option<Type> {
        Some(match name {
            b"char" | b"int8" => Type::I8,
            b"uchar" | b"uint8" => Type::U8,
            b"short" | b"int16" => Type::I16,
            b"ushort" | b"uint16" => Type::U16,
            b"int" | b"int32" => Type::I32,
            b"uint" | b"uint32" => Type::U32,
            b"float" | b"float32" => Type::F32,
            b"double" | b"float64" => Type::F64,
            _ => return None,
        })
    }

    /// Bytes of a number.
    pub fn size(self) -> usize {
        match self {
            Type::I8 | Type::U8 => 1,
            Type::I16 | Type::U16 => 2,
            Type::I32 | Type::U32 | Type::F32 => 4,
            Type::F64 => 8,
        }
    }

    /// No values of this type.
    pub fn values(self) -> Values {
        match self {
            Type::I8 => Values::I8(Vec::new()),
            Type::U8 => Values::U8(Vec::new()),
            Type::I16 => Values::I16(Vec::new()),
            Type::U16 => Values::U16(Vec::new()),
            Type::I32 => Values::I32(Vec::new()),
            Type::U32 => Values::U32(Vec::new()),
            Type::F32 => Values::F32(Vec::new()),
            Type::F64 => Values::F64(Vec::new()),
        }
    }

    /// Whether a number as text can be stored in this type.
    pub fn holds(self, value: f64) -> bool {
        let whole = |low: f64, high: f64| value.fract() == 0.0 && value >= low && value <= high;
        match self {
            Type::I8 => whole(-128.0, 127.0),
            Type::U8 => whole(0.0, 255.0),
            Type::I16 => whole(-32768.0, 32767.0),
            Type::U16 => whole(0.0, 65535.0),
            Type::I32 => whole(-2_147_483_648.0, 2_147_483_647.0),
            Type::U32 => whole(0.0, 4_294_967_295.0),
            Type::F32 | Type::F64 => true,
        }
    }
}

/// A property: its name, its type, and the type of its count if it is a list.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Property {
    /// Name.
    pub name: String,
    /// Type of its numbers.
    pub type_: Type,
    /// Type of the count before a list.
    pub list: Option<Type>,
}

/// An element: rows of properties.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Element {
    /// Name.
    pub name: String,
    /// Rows that the header says.
    pub count: u64,
    /// Properties of a row.
    pub properties: Vec<Property>,
}

impl Element {
    /// Least bytes of a row.
    pub fn least(&self, encoding: Encoding) -> u64 {
        let size = |property: &Property| match encoding {
            Encoding::Text => 2,
            _ => property.list.unwrap_or(property.type_).size(),
        };
        self.properties.iter().map(|p| size(p) as u64).sum()
    }
}

/// What the header says.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Head {
    /// How numbers are stored.
    pub encoding: Encoding,
    /// Elements in the order of the file.
    pub elements: Vec<Element>,
    /// Comments.
    pub comments: Vec<String>,
    /// Byte at which the rows begin.
    pub end: usize,
}

/// Bytes within which a header must end.
const MOST: usize = 1 << 20;

/// Reads the header.
///
/// # Errors
/// When it is none, or cannot be understood.
pub fn read(bytes: &[u8]) -> Result<Head, Failure> {
    if !(bytes.starts_with(b"ply\n") || bytes.starts_with(b"ply\r")) {
        return Err(Failure::new(FailureCode::NotMine, "this is no PLY file"));
    }
    let mut head = Head {
        encoding: Encoding::Text,
        elements: Vec::new(),
        comments: Vec::new(),
        end: 0,
    };
    let mut format = None;
    let limit = &bytes[..bytes.len().min(MOST)];
    for (number, (line, at)) in lines(limit).enumerate().skip(1) {
        let mut words = Words::new(line, 0);
        let fault = || {
            let (line, text) = (number + 1, shown(line));
            Failure::bad_file(format!(
                "line {line} of the PLY header, \"{text}\", has no meaning"
            ))
        };
        match words.next() {
            Some(b"format") => format = Some(encoding(words.next()).ok_or_else(fault)?),
            Some(b"comment" | b"obj_info") => {
                let text = String::from_utf8_lossy(line);
                let text = text
                    .split_once(char::is_whitespace)
                    .map_or("", |pair| pair.1);
                head.comments.push(text.trim().into());
            }
            Some(b"element") => head.elements.push(element(&mut words).ok_or_else(fault)?),
            Some(b"property") => {
                let property = property(&mut words).ok_or_else(fault)?;
                let element = head.elements.last_mut().ok_or_else(fault)?;
                if element
                    .properties
                    .iter()
                    .any(|known| known.name == property.name)
                {
                    return Err(fault());
                }
                element.properties.push(property);
            }
            Some(b"end_header") => {
                head.encoding = format.ok_or_else(|| {
                    Failure::bad_file("the PLY header does not say the format of the file")
                })?;
                head.end = at;
                return Ok(head);
            }
            None => {}
            _ => return Err(fault()),
        }
    }
    let message = "the PLY header has no end";
    Err(Failure::bad_file(message).remedy("get a whole copy of the file"))
}

fn encoding(word: Option<&[u8]>) -> Option<Encoding> {
    Some(match word? {
        b"ascii" => Encoding::Text,
        b"binary_little_endian" => Encoding::Little,
        b"binary_big_endian" => Encoding::Big,
        _ => return None,
    })
}

fn name(word: &[u8]) -> Option<String> {
    std::str::from_utf8(word).ok().map(Into::into)
}

fn element(words: &mut Words<'_>) -> Option<Element> {
    let name = name(words.next()?)?;
    let count = std::str::from_utf8(words.next()?).ok()?.parse().ok()?;
    Some(Element {
        name,
        count,
        properties: Vec::new(),
    })
}

fn property(words: &mut Words<'_>) -> Option<Property> {
    let mut type_ = words.next()?;
    let mut list = None;
    if type_ == b"list" {
        list = Some(Type::of(words.next()?)?);
        type_ = words.next()?;
    }
    Some(Property {
        type_: Type::of(type_)?,
        list,
        name: name(words.next()?)?,
    })
}
