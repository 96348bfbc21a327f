//! Parameters: one schema drives forms, command-line flags, recipe checks, provenance and docs.

use crate::{Failure, Map, number, units};
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

    /// Brings a value from a recipe, a form or a command line to its canonical form: numbers in the
    /// schema's unit, seeds as text, limits as pairs.
    ///
    /// # Errors
    /// A sentence that says what is wrong and what values are possible.
    pub fn canonical(&self, value: &Value) -> Result<Value, Failure> {
        if value.is_null() {
            if self.optional {
                return Ok(Value::Null);
            }
            return Err(self.refuse("needs a value"));
        }
        match &self.kind {
            ParameterKind::Bool => match value {
                Value::Bool(_) => Ok(value.clone()),
                Value::String(text) if text == "true" => Ok(true.into()),
                Value::String(text) if text == "false" => Ok(false.into()),
                other => Err(self.refuse(format!("is true or false, not {other}"))),
            },
            ParameterKind::Integer => self.integer(value),
            ParameterKind::Number => self.number(value).map(number::to_value),
            ParameterKind::Numbers => self.numbers(value),
            ParameterKind::Text | ParameterKind::Column => match value {
                Value::String(_) => Ok(value.clone()),
                other => Err(self.refuse(format!("is a text, not {other}"))),
            },
            ParameterKind::Choice => self.choice(value),
            ParameterKind::Columns => self.columns(value),
            ParameterKind::Ranges => self.ranges(value),
            ParameterKind::Mapping => self.mapping(value),
            ParameterKind::Seed => self.seed(value),
            ParameterKind::Other(kind) => Err(self.refuse(format!(
                "is of the kind \"{kind}\", which this version does not know; update Puncta"
            ))),
        }
    }

    fn refuse(&self, what: impl std::fmt::Display) -> Failure {
        Failure::bad_parameter(&self.name, format!("parameter {} {what}", self.name))
    }

    fn limits(&self, number: f64) -> Result<f64, Failure> {
        let unit = self.unit.as_deref().unwrap_or("1");
        let unit = if unit == "1" { "" } else { unit };
        let shown = |limit: f64| format!("{limit} {unit}").trim_end().to_owned();
        if number.is_nan() {
            return Err(self.refuse("is not a number"));
        }
        if let Some(min) = self.min
            && number < min
        {
            return Err(self.refuse(format!("is {}, below {}", shown(number), shown(min))));
        }
        if let Some(max) = self.max
            && number > max
        {
            return Err(self.refuse(format!("is {}, above {}", shown(number), shown(max))));
        }
        Ok(number)
    }

    fn number(&self, value: &Value) -> Result<f64, Failure> {
        self.limits(self.raw_number(value)?)
    }

    fn raw_number(&self, value: &Value) -> Result<f64, Failure> {
        if let Some(number) = number::from_value(value) {
            return Ok(number);
        }
        match value {
            Value::String(text) => units::quantity(text, self.unit.as_deref().unwrap_or("1"))
                .map_err(|why| self.refuse(format!("cannot be read: {why}"))),
            other => Err(self.refuse(format!("is a number, not {other}"))),
        }
    }

    fn integer(&self, value: &Value) -> Result<Value, Failure> {
        let number = match value {
            Value::Number(number) if number.is_i64() => number.as_i64(),
            Value::Number(number) => number.as_f64().and_then(whole),
            Value::String(text) => text.trim().parse().ok(),
            _ => None,
        };
        let number =
            number.ok_or_else(|| self.refuse(format!("is a whole number, not {value}")))?;
        #[allow(clippy::cast_precision_loss)]
        self.limits(number as f64)?;
        Ok(number.into())
    }

    fn numbers(&self, value: &Value) -> Result<Value, Failure> {
        let texts: Vec<Value>;
        let list = match value {
            Value::Array(list) => list,
            Value::String(text) => {
                texts = text.split(',').map(|one| one.trim().into()).collect();
                &texts
            }
            other => return Err(self.refuse(format!("is a list of numbers, not {other}"))),
        };
        let read = |one: &Value| match one {
            Value::String(text) if text.parse::<f64>().is_ok() => self
                .limits(text.parse().unwrap_or(f64::NAN))
                .map(number::to_value),
            other => self.number(other).map(number::to_value),
        };
        list.iter()
            .map(read)
            .collect::<Result<Vec<_>, _>>()
            .map(Value::from)
    }

    fn choice(&self, value: &Value) -> Result<Value, Failure> {
        let known = |text: &str| self.choices.iter().any(|choice| choice.value == text);
        match value {
            Value::String(text) if known(text) => Ok(value.clone()),
            other => {
                let names: Vec<&str> = self
                    .choices
                    .iter()
                    .map(|choice| choice.value.as_str())
                    .collect();
                Err(self.refuse(format!("is one of {}, not {other}", names.join(", "))))
            }
        }
    }

    fn columns(&self, value: &Value) -> Result<Value, Failure> {
        match value {
            Value::Array(list) if list.iter().all(Value::is_string) => Ok(value.clone()),
            Value::String(text) => Ok(text
                .split(',')
                .map(str::trim)
                .filter(|name| !name.is_empty())
                .collect::<Vec<_>>()
                .into()),
            other => Err(self.refuse(format!("is a list of column names, not {other}"))),
        }
    }

    fn ranges(&self, value: &Value) -> Result<Value, Failure> {
        let mut out = Map::new();
        match value {
            Value::Object(map) => {
                for (column, limits) in map {
                    out.insert(column.clone(), self.range(column, limits)?);
                }
            }
            // On the command line: error_x=0..15,t=500..
            Value::String(text) => {
                for term in text
                    .split(',')
                    .map(str::trim)
                    .filter(|term| !term.is_empty())
                {
                    let (column, limits) = term
                        .split_once('=')
                        .ok_or_else(|| self.refuse("is written column=low..high,column=low.."))?;
                    let (low, high) = limits
                        .split_once("..")
                        .ok_or_else(|| self.refuse("is written column=low..high,column=low.."))?;
                    let pick = |text: &str, open: &str| -> Value {
                        if text.trim().is_empty() {
                            open
                        } else {
                            text.trim()
                        }
                        .into()
                    };
                    let limits = Value::from(vec![pick(low, "-inf"), pick(high, "inf")]);
                    out.insert(column.trim().into(), self.range(column.trim(), &limits)?);
                }
            }
            other => {
                return Err(self.refuse(format!(
                    "gives each column a list [low, high], as {{ error_x = [0, 15] }}, not {other}"
                )));
            }
        }
        Ok(Value::Object(out))
    }

    fn range(&self, column: &str, limits: &Value) -> Result<Value, Failure> {
        let pair = limits
            .as_array()
            .filter(|list| list.len() == 2)
            .ok_or_else(|| self.refuse(format!("needs [low, high] for {column}, not {limits}")))?;
        let read = |one: &Value| -> Result<Value, Failure> {
            match one {
                // The column's unit is known only when the recipe runs; the host converts then.
                Value::String(text) if number::from_value(one).is_none() => {
                    match text.trim().parse::<f64>() {
                        Ok(number) => Ok(number::to_value(number)),
                        Err(_) => Ok(text.trim().into()),
                    }
                }
                other => Ok(number::to_value(self.raw_number(other)?)),
            }
        };
        let (low, high) = (read(&pair[0])?, read(&pair[1])?);
        if let (Some(a), Some(b)) = (number::from_value(&low), number::from_value(&high)) {
            if a.is_nan() || b.is_nan() {
                return Err(self.refuse(format!("has a limit of {column} that is not a number")));
            }
            if a > b {
                return Err(self.refuse(format!(
                    "has limits of {column} the wrong way round: {a} is above {b}"
                )));
            }
        }
        Ok(Value::from(vec![low, high]))
    }

    fn mapping(&self, value: &Value) -> Result<Value, Failure> {
        match value {
            Value::Object(map) if map.values().all(Value::is_string) => Ok(value.clone()),
            Value::String(text) => {
                let mut out = Map::new();
                for term in text
                    .split(',')
                    .map(str::trim)
                    .filter(|term| !term.is_empty())
                {
                    let (name, text) = term
                        .split_once('=')
                        .ok_or_else(|| self.refuse("is written name=text,name=text"))?;
                    out.insert(name.trim().into(), text.trim().into());
                }
                Ok(Value::Object(out))
            }
            other => Err(self.refuse(format!("gives texts by name, not {other}"))),
        }
    }

    fn seed(&self, value: &Value) -> Result<Value, Failure> {
        let seed = match value {
            Value::Number(number) => number.as_u64(),
            Value::String(text) => text.trim().parse().ok(),
            _ => None,
        };
        seed.map(|seed| seed.to_string().into())
            .ok_or_else(|| self.refuse(format!("is a whole number from 0, not {value}")))
    }
}

fn whole(number: f64) -> Option<i64> {
    #[allow(clippy::cast_possible_truncation)]
    (number.fract() == 0.0 && number.abs() < 9.0e15).then_some(number as i64)
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
