//! What the metadata of fields and of the schema hold.

use arrow_schema::{DataType, Field, Schema};
use puncta_sdk::{ColumnInfo, Element, Failure, Header, Map};
use serde_json::Value;
use std::collections::HashMap;
use std::sync::Arc;

/// The column as the host describes it, in the field's metadata. Says that the file is our own.
pub const COLUMN: &str = "puncta.column";
/// The rest of the table's header, in the schema's metadata.
pub const TABLE: &str = "puncta.table";

/// The schema of a table that is written.
pub fn schema(header: &Header) -> Result<Schema, Failure> {
    let columns = header.parts.first().map_or(&[][..], |part| &part.columns);
    let fields: Result<Vec<Field>, Failure> = columns.iter().map(field).collect();
    let mut bare = header.clone();
    bare.parts.clear();
    let text = serde_json::to_string(&bare)
        .map_err(|error| Failure::internal(format!("the header is no JSON: {error}")))?;
    Ok(Schema::new_with_metadata(
        fields?,
        HashMap::from([(TABLE.to_owned(), text)]),
    ))
}

fn field(info: &ColumnInfo) -> Result<Field, Failure> {
    let type_ = data_type(info)?;
    let mut metadata = HashMap::from([("unit".to_owned(), info.unit.clone())]);
    if let Some(role) = &info.role {
        metadata.insert("role".into(), role.clone());
    }
    if let Some(description) = &info.description {
        metadata.insert("description".into(), description.clone());
    }
    let mut bare = info.clone();
    (bare.text_bytes, bare.entries) = (None, None);
    let text = serde_json::to_string(&bare)
        .map_err(|error| Failure::internal(format!("a column is no JSON: {error}")))?;
    metadata.insert(COLUMN.into(), text);
    Ok(Field::new(&info.name, type_, false).with_metadata(metadata))
}

fn data_type(info: &ColumnInfo) -> Result<DataType, Failure> {
    let one = match info.type_.element {
        Element::U8 => DataType::UInt8,
        Element::I8 => DataType::Int8,
        Element::U16 => DataType::UInt16,
        Element::I16 => DataType::Int16,
        Element::U32 => DataType::UInt32,
        Element::I32 => DataType::Int32,
        Element::U64 => DataType::UInt64,
        Element::I64 => DataType::Int64,
        Element::F32 => DataType::Float32,
        Element::F64 => DataType::Float64,
        Element::Bool => DataType::Boolean,
        Element::Utf8 => DataType::Utf8,
        Element::Dictionary => {
            DataType::Dictionary(Box::new(DataType::UInt32), Box::new(DataType::Utf8))
        }
    };
    if info.type_.width == 1 {
        return Ok(one);
    }
    let width = i32::try_from(info.type_.width)
        .map_err(|_| Failure::bad_input(format!("column {} is too wide", info.name)))?;
    Ok(DataType::FixedSizeList(
        Arc::new(Field::new("item", one, false)),
        width,
    ))
}

/// The column that a field of ours was, if it still has the type that it had.
pub fn own(field: &Field) -> Option<ColumnInfo> {
    let info: ColumnInfo = serde_json::from_str(field.metadata().get(COLUMN)?).ok()?;
    let same = data_type(&info).ok().is_some_and(|type_| {
        let alike = |a: &DataType, b: &DataType| match (a, b) {
            (DataType::FixedSizeList(a, n), DataType::FixedSizeList(b, m)) => {
                n == m && a.data_type() == b.data_type()
            }
            (a, b) => a == b,
        };
        alike(&type_, field.data_type())
    });
    let named = info.name == *field.name();
    (same && named).then_some(info)
}

/// The table's header without its columns.
pub fn header(schema: &Schema) -> Header {
    let own = schema.metadata().get(TABLE);
    let own = own.and_then(|text| serde_json::from_str::<Header>(text).ok());
    let mut header = own
        .filter(|header| header.kind == puncta_sdk::Kind::Table)
        .unwrap_or_else(|| Header::table("localisations", 0, Vec::new()));
    header.parts.clear();
    header
}

/// What other programs left in the schema's metadata: JSON as a tree, other texts as they are.
pub fn foreign(schema: &Schema) -> Map {
    let mut tree = Map::new();
    let mut keys: Vec<(&String, &String)> = schema.metadata().iter().collect();
    keys.sort();
    for (key, text) in keys {
        if key == TABLE || key == "ARROW:schema" || key == "pandas" {
            continue;
        }
        let value = serde_json::from_str(text).unwrap_or_else(|_| Value::from(text.as_str()));
        tree.insert(key.clone(), value);
    }
    tree
}
