//! Parameters: one schema drives forms, command-line flags, recipe checks, provenance and docs.

use crate::{Failure, Map, number};
use serde::{Deserialize, Serialize};
use serde_json::Value;

/// What values a parameter takes.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ParameterKind {
    /// true or false.
    Bool,
    /// A whole number.
    Integer,
    /// A number in the schema's unit.
    Number,
    /// Any text.
    Text,
    /// One of `choices`.
    Choice,
    /// Name of a column of an input.
    Column,
    /// Names of columns of an input.
    Columns,
    /// For each named column a lower and an upper limit.
    Ranges,
    /// A list of numbers.
    Numbers,
    /// Texts by name.
    Mapping,
    /// A seed: an unsigned 64-bit number, in documents as text.
    Seed,
    /// A kind of a newer version.
    #[serde(untagged)]
    Other(String),
}

/// One of a choice's values.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Choice {
    /// Value in recipes.
    pub value: String,
    /// One line.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub help: String,
}

/// A parameter of an operation.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Parameter {
    /// Name in recipes and on the command line.
    pub name: String,
    /// What values it takes.
    pub kind: ParameterKind,
    /// Name for people; the name with spaces if absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub label: Option<String>,
    /// One line of meaning.
    #[serde(default)]
    pub help: String,
    /// Unit of numbers and limits.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub unit: Option<String>,
    /// Value when nothing is said; null with `optional` means "none". Absent: must be given.
    #[serde(
        default,
        skip_serializing_if = "Option::is_none",
        deserialize_with = "present"
    )]
    pub default: Option<Value>,
    /// Least value.
    #[serde(
        default,
        with = "number::maybe",
        skip_serializing_if = "Option::is_none"
    )]
    pub min: Option<f64>,
    /// Greatest value.
    #[serde(
        default,
        with = "number::maybe",
        skip_serializing_if = "Option::is_none"
    )]
    pub max: Option<f64>,
    /// Values of a choice.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub choices: Vec<Choice>,
    /// Whether it may be null.
    #[serde(default)]
    pub optional: bool,
    /// Whether forms hide it at first.
    #[serde(default)]
    pub advanced: bool,
    /// Column kinds: the input port; the first if absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub input: Option<String>,
    /// Members that this version does not know.
    #[serde(flatten)]
    pub rest: Map,
}

/// Keeps `null` apart from "not there".
fn present<'de, D: serde::Deserializer<'de>>(from: D) -> Result<Option<Value>, D::Error> {
    Value::deserialize(from).map(Some)
}

impl Parameter {
    /// A parameter without default and limits.
    pub fn new(name: impl Into<String>, kind: ParameterKind) -> Parameter {
        Parameter {
            name: name.into(),
            kind,
            label: None,
            help: String::new(),
            unit: None,
            default: None,
            min: None,
            max: None,
            choices: Vec::new(),
            optional: false,
            advanced: false,
            input: None,
            rest: Map::new(),
        }
    }
}

/// Brings given parameters to their canonical form: every parameter there, in the schema's order.
///
/// # Errors
/// A sentence for an unknown name, a missing value or a wrong value.
pub fn canonical(schema: &[Parameter], given: &Map) -> Result<Map, Failure> {
    for name in given.keys() {
        if !schema.iter().any(|parameter| &parameter.name == name) {
            return Err(unknown(schema, name));
        }
    }
    let mut out = Map::new();
    for parameter in schema {
        let value = match (given.get(&parameter.name), &parameter.default) {
            (Some(value), _) => parameter.canonical(value)?,
            (None, Some(default)) => parameter.canonical(default)?,
            (None, None) if parameter.optional => Value::Null,
            (None, None) => return Err(parameter.refuse("needs a value")),
        };
        out.insert(parameter.name.clone(), value);
    }
    Ok(out)
}

fn unknown(schema: &[Parameter], name: &str) -> Failure {
    let names: Vec<&str> = schema
        .iter()
        .map(|parameter| parameter.name.as_str())
        .collect();
    let known = if names.is_empty() {
        "there are none".to_owned()
    } else {
        format!("there are {}", names.join(", "))
    };
    Failure::bad_parameter(name, format!("there is no parameter {name}")).remedy(known)
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn number_parameter() -> Parameter {
        let mut parameter = Parameter::new("pixel_size", ParameterKind::Number);
        parameter.unit = Some("nm".into());
        parameter.default = Some(json!(5));
        parameter.min = Some(0.1);
        parameter.max = Some(1e4);
        parameter
    }

    fn map(value: Value) -> Map {
        value.as_object().cloned().unwrap_or_default()
    }

    #[test]
    fn defaults_and_units_are_applied() {
        let schema = [number_parameter()];
        assert_eq!(
            Value::Object(canonical(&schema, &Map::new()).unwrap()),
            json!({"pixel_size": 5})
        );
        for text in ["10 nm", "0.01 um", "1e1"] {
            let out = canonical(&schema, &map(json!({"pixel_size": text}))).unwrap();
            assert_eq!(out["pixel_size"], json!(10), "{text}");
        }
    }

    #[test]
    fn wrong_values_are_named() {
        let schema = [number_parameter()];
        for (given, word) in [
            (json!({"pixel_size": 0}), "below 0.1 nm"),
            (json!({"pixel_size": "nan"}), "not a number"),
            (json!({"pixel_size": "3 s"}), "same kind as nm"),
            (json!({"pixel_size": []}), "is a number"),
            (json!({"pixel_size": null}), "needs a value"),
            (
                json!({"pixels": 1}),
                "no parameter pixels; there are pixel_size",
            ),
        ] {
            let failure = canonical(&schema, &map(given.clone())).unwrap_err();
            assert!(failure.to_string().contains(word), "{given}: {failure}");
        }
    }

    #[test]
    fn limits_of_columns_in_both_spellings() {
        let parameter = Parameter::new("ranges", ParameterKind::Ranges);
        let a = parameter
            .canonical(&json!({"error_x": [0, 15.0], "t": [500, "inf"]}))
            .unwrap();
        let b = parameter
            .canonical(&json!("error_x=0..15,t=500.."))
            .unwrap();
        assert_eq!(a, b);
        assert_eq!(a.to_string(), r#"{"error_x":[0,15],"t":[500,"inf"]}"#);
        assert!(parameter.canonical(&json!({"t": [2, 1]})).is_err());
        assert!(parameter.canonical(&json!({"t": [2]})).is_err());
        assert!(parameter.canonical(&json!("t")).is_err());
    }

    #[test]
    fn seeds_are_texts() {
        let parameter = Parameter::new("seed", ParameterKind::Seed);
        assert_eq!(parameter.canonical(&json!(7)).unwrap(), json!("7"));
        assert_eq!(
            parameter.canonical(&json!("18446744073709551615")).unwrap(),
            json!("18446744073709551615")
        );
        assert!(parameter.canonical(&json!(-1)).is_err());
    }

    #[test]
    fn integers_keep_out_fractions() {
        let parameter = Parameter::new("n", ParameterKind::Integer);
        assert_eq!(parameter.canonical(&json!(3.0)).unwrap(), json!(3));
        assert_eq!(parameter.canonical(&json!("3")).unwrap(), json!(3));
        assert!(parameter.canonical(&json!(3.5)).is_err());
    }
}
