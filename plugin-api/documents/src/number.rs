//! Numbers in documents: JSON has no infinities and no NaN, so those are strings.

use serde_json::Value;

/// The JSON value of a number.
#[must_use]
pub fn to_value(number: f64) -> Value {
    if number.is_nan() {
        "nan".into()
    } else if number.is_infinite() {
        if number > 0.0 { "inf" } else { "-inf" }.into()
    } else {
        // 2 and 2.0 are the same number, so they get the same text and the same cache key.
        #[allow(clippy::cast_possible_truncation)]
        if number.fract() == 0.0 && number.abs() < 9_007_199_254_740_992.0 {
            Value::from(number as i64)
        } else {
            Value::from(number)
        }
    }
}

/// The number of a JSON value: a number, or one of the strings for those that JSON lacks.
#[must_use]
pub fn from_value(value: &Value) -> Option<f64> {
    match value {
        Value::Number(number) => number.as_f64(),
        Value::String(text) => match text.trim() {
            "inf" | "+inf" => Some(f64::INFINITY),
            "-inf" => Some(f64::NEG_INFINITY),
            "nan" => Some(f64::NAN),
            _ => None,
        },
        _ => None,
    }
}

/// For `#[serde(with = "puncta_documents::number::maybe")]` on an `Option<f64>`.
pub mod maybe {
    use serde::{Deserialize, Deserializer, Serialize, Serializer};

    /// Writes the number.
    ///
    /// # Errors
    /// Those of the serializer.
    #[allow(clippy::ref_option)]
    pub fn serialize<S: Serializer>(number: &Option<f64>, out: S) -> Result<S::Ok, S::Error> {
        number.map(super::to_value).serialize(out)
    }

    /// Reads the number.
    ///
    /// # Errors
    /// When it is neither a number nor one of the known strings.
    pub fn deserialize<'de, D: Deserializer<'de>>(from: D) -> Result<Option<f64>, D::Error> {
        let value = Option::<serde_json::Value>::deserialize(from)?;
        match value {
            None | Some(serde_json::Value::Null) => Ok(None),
            Some(value) => super::from_value(&value)
                .map(Some)
                .ok_or_else(|| serde::de::Error::custom(format!("{value} is no number"))),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_number_survives() {
        for number in [
            0.0,
            -0.0,
            1.0,
            0.1,
            f64::MIN_POSITIVE,
            5e-324,
            f64::MAX,
            f64::INFINITY,
            f64::NEG_INFINITY,
            9_007_199_254_740_993.0,
        ] {
            let text = to_value(number).to_string();
            let value: Value = serde_json::from_str(&text).unwrap();
            assert_eq!(from_value(&value), Some(number), "{text}");
        }
        assert!(from_value(&to_value(f64::NAN)).unwrap().is_nan());
        assert_eq!(to_value(2.0).to_string(), "2");
        assert_eq!(from_value(&"3 nm".into()), None);
    }
}
