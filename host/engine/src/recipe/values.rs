//! TOML values as JSON, and back as text.

use puncta_documents::{Map, number};
use serde_json::Value;
use std::ops::Range;
use toml::Spanned;
use toml::de::{DeTable, DeValue};

/// A value that a recipe cannot hold.
pub(crate) struct BadValue {
    pub span: Range<usize>,
    pub message: String,
    pub remedy: &'static str,
}

/// A TOML value as JSON; infinities and NaN are the strings of `puncta_documents::number`.
pub(crate) fn to_json(value: &Spanned<DeValue<'_>>) -> Result<Value, BadValue> {
    let bad = |message: String, remedy| {
        Err(BadValue {
            span: value.span(),
            message,
            remedy,
        })
    };
    match value.get_ref() {
        DeValue::String(text) => Ok(Value::from(text.as_ref())),
        DeValue::Boolean(flag) => Ok((*flag).into()),
        DeValue::Integer(integer) => {
            let (digits, radix) = (integer.as_str(), integer.radix());
            if let Ok(signed) = i64::from_str_radix(digits, radix) {
                return Ok(signed.into());
            }
            match u64::from_str_radix(digits, radix) {
                Ok(unsigned) => Ok(unsigned.into()),
                Err(_) => bad(
                    format!("the whole number {} has more than 64 bits", short(digits)),
                    "write it with a decimal point, or as text in double quotes",
                ),
            }
        }
        DeValue::Float(float) => {
            let text = float.as_str();
            match text.parse::<f64>() {
                Ok(found) if found.is_infinite() && !text.contains("inf") => bad(
                    format!("the number {} is too large", short(text)),
                    "write inf if no limit is meant",
                ),
                Ok(found) => Ok(number::to_value(found)),
                Err(_) => bad(
                    format!("{} is no number", short(text)),
                    "write it as 1.5 or 2e-3",
                ),
            }
        }
        DeValue::Datetime(when) => bad(
            format!("{when} is a date, which no parameter takes"),
            "put it into double quotes",
        ),
        DeValue::Array(list) => list
            .iter()
            .map(to_json)
            .collect::<Result<_, _>>()
            .map(Value::Array),
        DeValue::Table(table) => to_map(table).map(Value::Object),
    }
}

/// A TOML table as a JSON object.
pub(crate) fn to_map(table: &DeTable<'_>) -> Result<Map, BadValue> {
    let pair = |(key, value): (&Spanned<_>, &Spanned<DeValue<'_>>)| {
        let name: &std::borrow::Cow<'_, str> = key.get_ref();
        Ok((name.to_string(), to_json(value)?))
    };
    table.iter().map(pair).collect()
}

fn short(text: &str) -> String {
    if text.len() <= 40 {
        return text.to_owned();
    }
    text.chars().take(37).chain("...".chars()).collect()
}

/// A JSON value as TOML text on one line. `null` has none.
pub(crate) fn to_toml(value: &Value) -> Option<String> {
    Some(match value {
        Value::Null => return None,
        Value::Bool(flag) => flag.to_string(),
        Value::Number(found) => toml_number(found),
        // Read back they are the same strings, and a person expects a number here.
        Value::String(text) if matches!(text.as_str(), "inf" | "-inf" | "nan") => text.clone(),
        Value::String(text) => quoted(text),
        Value::Array(list) => {
            format!(
                "[{}]",
                list.iter()
                    .map(to_toml)
                    .collect::<Option<Vec<_>>>()?
                    .join(", ")
            )
        }
        Value::Object(map) if map.is_empty() => "{}".into(),
        Value::Object(map) => {
            let pair = |(name, value): (&String, &Value)| {
                Some(format!("{} = {}", toml_key(name), to_toml(value)?))
            };
            format!(
                "{{ {} }}",
                map.iter().map(pair).collect::<Option<Vec<_>>>()?.join(", ")
            )
        }
    })
}

fn toml_number(number: &serde_json::Number) -> String {
    match number.as_f64() {
        // Rust's shortest text that reads back as the same number is also TOML.
        Some(float) if number.is_f64() => format!("{float:?}"),
        _ => number.to_string(),
    }
}

/// A key, quoted where it has to be.
pub(crate) fn toml_key(name: &str) -> String {
    let plain = |c: char| c.is_ascii_alphanumeric() || c == '_' || c == '-';
    if !name.is_empty() && name.chars().all(plain) {
        name.to_owned()
    } else {
        quoted(name)
    }
}

/// A text in double quotes. JSON's escapes are TOML's, except that TOML escapes DEL as well.
pub(crate) fn quoted(text: &str) -> String {
    Value::from(text).to_string().replace('\u{7f}', "\\u007f")
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn values_survive_the_way_to_toml_and_back() {
        let value = json!({
            "n": [1, -2, 0.1, 1e300, 5e-324, 1e16, "inf", "-inf", "nan", 18446744073709551615_u64],
            "t": ["", "a\"b\\c\n\t\u{7f}\u{1}\u{b5}\u{1F600}", "15 nm"],
            "": true, "a b": {"c.d": {}, "e": []}
        });
        let text = format!("v = {}", to_toml(&value).unwrap());
        let table = DeTable::parse(&text).unwrap();
        let Ok(found) = to_map(table.get_ref()) else {
            panic!("{text}")
        };
        assert_eq!(found["v"], value, "{text}");
        assert!(to_toml(&json!([null])).is_none());
    }

    #[test]
    fn numbers_beyond_the_types_and_dates_are_refused() {
        for (text, word) in [
            ("v = 99999999999999999999", "64 bits"),
            ("v = 1e999", "too large"),
            ("v = 2020-01-01", "date"),
        ] {
            let table = DeTable::parse(text).unwrap();
            let Err(bad) = to_map(table.get_ref()) else {
                panic!("{text}")
            };
            assert!(bad.message.contains(word), "{}", bad.message);
        }
    }
}
