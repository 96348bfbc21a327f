//! Which columns a file's fields become.

use crate::fields;
use arrow_schema::{DataType, Field, Schema};
use puncta_sdk::{ColumnInfo, Element, Failure, Header};
use puncta_shared_records::names;
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
    /// For numbers.
    pub factor: f64,
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

/// Plans the columns. `missing` says of a field whether it may have missing values; `lengths` is
/// the unit of lengths that have none.
pub fn plan(
    file: &str,
    schema: &Schema,
    missing: &dyn Fn(usize) -> bool,
    lengths: &str,
) -> Result<Plan, Failure> {
    let mut header = fields::header(schema);
    let foreign = fields::foreign(schema);
    if !foreign.is_empty() {
        header.metadata.insert("arrow".into(), foreign.into());
    }
    let mut plan = Plan {
        columns: Vec::new(),
        header,
        notes: Vec::new(),
    };
    let (mut left, mut gaps) = (Vec::new(), Vec::new());
    for (place, field) in schema.fields().iter().enumerate() {
        let may_miss = field.is_nullable() && missing(place);
        match planned(place, field, may_miss, lengths) {
            Some(column) => {
                let whole = column.how == How::Number && is_whole(field.data_type());
                if whole && may_miss {
                    gaps.push(column.info.name.clone());
                }
                plan.columns.push(column);
            }
            None => left.push(format!("{} ({})", field.name(), field.data_type())),
        }
    }
    if plan.columns.is_empty() {
        let message = format!("{file} has no column of numbers or texts");
        return Err(unsupported(
            message,
            "flatten its columns and write it again",
        ));
    }
    names::unique(plan.columns.iter_mut().map(|column| &mut column.info));
    if !left.is_empty() {
        let list = left.join(", ");
        plan.notes.push(format!(
            "Left out of {file}, as they are no numbers or texts: {list}."
        ));
    }
    if !gaps.is_empty() {
        let list = gaps.join(", ");
        plan.notes.push(format!(
            "Integers with missing values became f64 with NaN: {list}."
        ));
    }
    let infos = plan.columns.iter().map(|column| &column.info);
    plan.notes
        .extend(names::unit_note(file, infos, "unit, such as nm or um"));
    Ok(plan)
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

fn planned(place: usize, field: &Field, may_miss: bool, lengths: &str) -> Option<Planned> {
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
    if let Some(info) = fields::own(field).filter(|_| how != How::Number) {
        return Some(Planned {
            field: place,
            info,
            how,
            factor: 1.0,
        });
    }
    let (mut info, factor) = names::column(field.name(), element, stated(field), lengths);
    info.type_.width = width;
    let place_ = matches!(info.role.as_deref(), Some("position" | "error")) && width == 1;
    if matches!(how, How::Text | How::Dictionary) {
        (info.unit, info.role) = ("1".into(), None);
    } else if width > 1 && factor != 1.0 {
        // Lists keep their unit.
        info.unit = stated(field).unwrap_or(names::UNKNOWN).into();
    } else if (factor != 1.0 || place_) && how == How::Same && element != Element::Bool {
        (info.type_.element, how) = (Element::F64, How::Number);
    }
    if element == Element::Bool && info.unit == names::UNKNOWN {
        info.unit = "1".into();
    }
    Some(Planned {
        field: place,
        info,
        how,
        factor: if how == How::Number { factor } else { 1.0 },
    })
}

/// The unit that a field's metadata state.
fn stated(field: &Field) -> Option<&str> {
    let known = |key: &str| field.metadata().get(key).map(|unit| unit.as_str());
    known("unit").or_else(|| known("units"))
}
