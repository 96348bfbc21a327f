//! The JSON documents that Puncta's host and its plugins exchange.
//!
//! Each document has a `format` member `puncta.<name>/<n>`. Unknown members are kept and passed
//! on, so that a newer side can talk to an older one. Non-finite numbers are the strings `"inf"`,
//! `"-inf"` and `"nan"`; seeds and 64-bit ids are strings.

pub mod call;
mod canonical;
pub mod element;
pub mod failure;
pub mod findings;
pub mod header;
pub mod manifest;
pub mod number;
pub mod schema;
pub mod units;

pub use call::{FileRef, InputRef, Output, OutputForm, Plan, Probe, Read, Request};
pub use element::{ColumnType, Element};
pub use failure::{Failure, FailureCode};
pub use findings::{Figure, Report, ReportValue, Series};
pub use header::{ColumnInfo, Header, ImageInfo, Kind, Part};
pub use manifest::{
    ColumnNeed, Example, FileRule, Manifest, Operation, OperationKind, Port, TOLERANCE,
};
pub use schema::{Parameter, ParameterKind};
pub use units::Unit;

/// A JSON object.
pub type Map = serde_json::Map<String, serde_json::Value>;

/// Longest text of a document in bytes. Data are in columns; what describes them is small.
pub const MAX_TEXT: usize = 16 << 20;

/// Reads any JSON, of at most [`MAX_TEXT`] bytes, nested at most 127 deep.
///
/// # Errors
/// A sentence that says what is wrong with the text, for a developer.
pub fn json(text: &str) -> Result<serde_json::Value, String> {
    if text.len() > MAX_TEXT {
        let mega = MAX_TEXT >> 20;
        return Err(format!("no document, since it is larger than {mega} MB"));
    }
    serde_json::from_str(text).map_err(|error| format!("no valid JSON: {error}"))
}

/// Reads a document, checking its `format`.
///
/// # Errors
/// A sentence that says what is wrong with the text, for a developer.
pub fn parse<T: serde::de::DeserializeOwned>(text: &str, format: &str) -> Result<T, String> {
    let value = json(text)?;
    match value.get("format").and_then(|found| found.as_str()) {
        Some(found) if found == format => {}
        Some(found) => return Err(format!("a {found} document where {format} was expected")),
        None => return Err(format!("no \"format\": \"{format}\" in it")),
    }
    serde_json::from_value(value).map_err(|error| format!("no valid {format} document: {error}"))
}

/// Writes a document with its `format` as the first member.
#[must_use]
pub fn write<T: serde::Serialize>(document: &T, format: &str) -> String {
    let mut map = Map::new();
    map.insert("format".into(), format.into());
    match serde_json::to_value(document) {
        Ok(serde_json::Value::Object(members)) => map.extend(members),
        Ok(other) => {
            map.insert("value".into(), other);
        }
        // Our own types have string keys only, so that this does not happen; the reader says so.
        Err(error) => {
            map.insert("error".into(), error.to_string().into());
        }
    }
    serde_json::Value::Object(map).to_string()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn large_and_deep_texts_are_refused() {
        let why = json(&" ".repeat(MAX_TEXT + 1)).unwrap_err();
        assert!(why.contains("larger than 16 MB"), "{why}");
        let nested = |depth: usize| "[".repeat(depth) + &"]".repeat(depth);
        assert!(json(&nested(127)).is_ok());
        let why = json(&nested(128)).unwrap_err();
        assert!(why.contains("recursion limit"), "{why}");
        assert!(json(&nested(1 << 20)).is_err());
    }
}
