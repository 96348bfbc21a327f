//! Which columns a file's fields become.

use crate::fields;
use arrow_schema::{DataType, Field, Schema};
use puncta_sdk::{ColumnInfo, Element, Failure, Header};
use puncta_shared_import::{Mapping, Unit};
use puncta_shared_records::names::{self, Placed, Raw};
use puncta_shared_records::unsupported;

/// How values get into a column.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum How {
    /// As they are.
    Same,
    /// To f64, with a factor; a missing value is NaN.
    Number,
    /// Texts, as such.
    Text,
    /// Texts of which there are few.
    Dictionary,
}

/// A field of the file and the column that it becomes.
#[derive(Clone, Debug)]
pub struct Planned {
    /// Number of the field.
    pub field: usize,
    /// The column.
    pub info: ColumnInfo,
    /// How.
    pub how: How,
    /// For numbers: what they are multiplied with ...
    pub factor: f64,
    /// ... and what is then taken away.
    pub minus: f64,
}

/// A file's columns.
#[derive(Clone, Debug)]
pub struct Plan {
    /// In the order of the file.
    pub columns: Vec<Planned>,
    /// The table, without columns.
    pub header: Header,
    /// For the person.
    pub notes: Vec<String>,
}

impl Plan {
    /// The header of so many rows; `texts` has the bytes and entries of the columns of texts.
    pub fn header(&self, rows: u64, texts: impl Fn(usize) -> (u64, u64)) -> Header {
        let columns = self.columns.iter().enumerate().map(|(place, planned)| {
            let mut info = planned.info.clone();
            let (bytes, entries) = texts(place);
            if matches!(planned.how, How::Text | How::Dictionary) {
                info.text_bytes = Some(bytes);
            }
            if planned.how == How::Dictionary {
                info.entries = Some(entries);
            }
            info
        });
        let mut header = Header::table(&self.header.name, rows, columns.collect());
        header.shape.clone_from(&self.header.shape);
        header.metadata.clone_from(&self.header.metadata);
        header.rest.clone_from(&self.header.rest);
        header
    }
}

/// Plans the columns. `missing` says of a field whether it may have missing values; what the person
/// says wins over what the file says.
pub fn plan(
    file: &str,
    schema: &Schema,
    missing: &dyn Fn(usize) -> bool,
    mapping: &Mapping,
) -> Result<Plan, Failure> {
    let mut header = fields::header(schema);
    let foreign = fields::foreign(schema);
    if !foreign.is_empty() {
        header.metadata.insert("arrow".into(), foreign.into());
    }
    let (mut left, mut gaps, mut found) = (Vec::new(), Vec::new(), Vec::new());
    for (place, field) in schema.fields().iter().enumerate() {
        let may_miss = field.is_nullable() && missing(place);
        match look(place, field, may_miss) {
            Some(one) => {
                if one.how == How::Number && is_whole(field.data_type()) {
                    gaps.push(one.raw.named.name.clone());
                }
                found.push(one);
            }
            None => left.push(format!("{} ({})", field.name(), field.data_type())),
        }
    }
    if found.is_empty() {
        let message = format!("{file} has no column of numbers or texts");
        return Err(unsupported(
            message,
            "flatten its columns and write it again",
        ));
    }
    let raw: Vec<Raw> = found.iter().map(|one| one.raw.clone()).collect();
    let (placed, mut notes) = names::place(file, mapping, &raw)?;
    let silent = *mapping == Mapping::default();
    let columns = placed
        .into_iter()
        .filter_map(|one| Some(planned(found.get(one.place)?, one, silent)));
    let columns = columns.collect();
    if !left.is_empty() {
        let list = left.join(", ");
        notes.push(format!(
            "Left out of {file}, as they are no numbers or texts: {list}."
        ));
    }
    if !gaps.is_empty() {
        let list = gaps.join(", ");
        notes.push(format!(
            "Integers with missing values became f64 with NaN: {list}."
        ));
    }
    Ok(Plan {
        columns,
        header,
        notes,
    })
}

fn is_whole(type_: &DataType) -> bool {
    type_.is_integer() || *type_ == DataType::Boolean
}

fn element(type_: &DataType) -> Option<(Element, How)> {
    use DataType as D;
    Some(match type_ {
        D::UInt8 => (Element::U8, How::Same),
        D::Int8 => (Element::I8, How::Same),
        D::UInt16 => (Element::U16, How::Same),
        D::Int16 => (Element::I16, How::Same),
        D::UInt32 => (Element::U32, How::Same),
        D::Int32 => (Element::I32, How::Same),
        D::UInt64 => (Element::U64, How::Same),
        D::Int64 => (Element::I64, How::Same),
        D::Float16 => (Element::F64, How::Number),
        D::Float32 => (Element::F32, How::Same),
        D::Float64 => (Element::F64, How::Same),
        D::Boolean => (Element::Bool, How::Same),
        D::Utf8 | D::LargeUtf8 | D::Utf8View => (Element::Utf8, How::Text),
        D::Dictionary(_, values) if matches!(**values, D::Utf8 | D::LargeUtf8 | D::Utf8View) => {
            (Element::Dictionary, How::Dictionary)
        }
        _ => return None,
    })
}

/// A field that is read.
struct Found {
    field: usize,
    raw: Raw,
    how: How,
    /// The column that it was in a table of the host.
    own: Option<ColumnInfo>,
}

fn look(place: usize, field: &Field, may_miss: bool) -> Option<Found> {
    let (mut element, mut how, width) = match field.data_type() {
        DataType::FixedSizeList(item, count) => {
            let (element, how) = self::element(item.data_type())?;
            let width = u32::try_from(*count)
                .ok()
                .filter(|n| (2..=4096).contains(n))?;
            if how != How::Same || !matches!(element, Element::F32 | Element::F64) {
                return None;
            }
            (element, how, width)
        }
        type_ => {
            let (element, how) = self::element(type_)?;
            (element, how, 1)
        }
    };
    if may_miss && is_whole(field.data_type()) {
        (element, how) = (Element::F64, How::Number);
    }
    let own = fields::own(field).filter(|_| how != How::Number);
    let mut raw = match &own {
        Some(info) => {
            let description = info.description.as_deref().unwrap_or("");
            Raw::new(&info.name, &info.name, &info.unit, element).described(description)
        }
        None => Raw::named(field.name(), element, stated(field)),
    };
    raw.type_.width = width;
    if matches!(how, How::Text | How::Dictionary)
        || (element == Element::Bool && raw.named.unit.is_none())
    {
        raw.named.unit = Some(Unit::plain("1"));
    }
    Some(Found {
        field: place,
        raw,
        how,
        own,
    })
}

/// The column for a field. Without a word of the person's, a table of the host stays as it was.
fn planned(found: &Found, placed: Placed, silent: bool) -> Planned {
    let converts = placed.converts() || placed.minus != 0.0;
    let mut planned = Planned {
        field: found.field,
        info: placed.info,
        how: found.how,
        factor: placed.factor,
        minus: placed.minus,
    };
    let list = planned.info.type_.width > 1;
    match &found.own {
        Some(own) if silent => {
            planned.info = own.clone();
            (planned.factor, planned.minus) = (1.0, 0.0);
        }
        _ if matches!(found.how, How::Text | How::Dictionary) => planned.info.role = None,
        _ if list && converts => {
            // Lists keep their numbers, and with them their unit.
            let unit = found.raw.named.unit.as_ref();
            let plain = unit.filter(|unit| !unit.converts() && !unit.is_pixel());
            planned.info.unit =
                plain.map_or_else(|| names::UNKNOWN.into(), |unit| unit.name.clone());
        }
        _ if converts && found.how == How::Same => {
            (planned.info.type_.element, planned.how) = (Element::F64, How::Number);
        }
        _ => {}
    }
    planned
}

/// The unit that a field's metadata state.
fn stated(field: &Field) -> Option<&str> {
    let known = |key: &str| field.metadata().get(key).map(|unit| unit.as_str());
    known("unit").or_else(|| known("units"))
}
