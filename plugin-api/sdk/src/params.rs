//! Types of parameters.

use puncta_documents::{Failure, Map, Parameter, ParameterKind, number};
use serde_json::Value;
use std::collections::BTreeMap;

/// A struct of parameters. Derive it.
pub trait Params: Sized {
    /// The schema, in the order of the fields.
    fn schema() -> Vec<Parameter>;

    /// Reads canonical values.
    ///
    /// # Errors
    /// When a value is missing or of the wrong kind, which the host's check excludes.
    fn from_values(values: &Map) -> Result<Self, Failure>;
}

/// A type that a parameter can have.
pub trait FromValue: Sized {
    /// A parameter of this kind, without help text and limits.
    fn parameter(name: &str) -> Parameter;
    /// Reads a canonical value.
    fn from_value(value: &Value) -> Option<Self>;
    /// The canonical value.
    fn to_value(&self) -> Value;
}

/// What can be written as `default = ...` of a parameter of type `T`.
pub trait IntoDefault<T> {
    /// The default as the parameter's type.
    fn into_default(self) -> T;
}

/// The JSON value of a default.
#[doc(hidden)]
pub fn default_value<T: FromValue>(value: impl IntoDefault<T>) -> Value {
    value.into_default().to_value()
}

/// Reads the parameter `name`.
///
/// # Errors
/// When it is missing or of the wrong kind.
pub fn read<T: FromValue>(values: &Map, name: &str) -> Result<T, Failure> {
    let value = values.get(name).unwrap_or(&Value::Null);
    T::from_value(value)
        .ok_or_else(|| Failure::bad_parameter(name, format!("parameter {name} cannot be {value}")))
}

macro_rules! scalar {
    ($type:ty, $kind:ident, |$value:ident| $read:expr, |$self:ident| $write:expr $(, min $min:expr)?) => {
        impl FromValue for $type {
            fn parameter(name: &str) -> Parameter {
                #[allow(unused_mut)]
                let mut parameter = Parameter::new(name, ParameterKind::$kind);
                $(parameter.min = Some($min);)?
                parameter
            }
            fn from_value($value: &Value) -> Option<Self> {
                $read
            }
            fn to_value(&$self) -> Value {
                $write
            }
        }
    };
}

scalar!(bool, Bool, |value| value.as_bool(), |self| Value::from(
    *self
));
scalar!(f64, Number, |value| number::from_value(value), |self| {
    number::to_value(*self)
});
scalar!(i64, Integer, |value| value.as_i64(), |self| Value::from(
    *self
));
scalar!(
    i32,
    Integer,
    |value| i32::try_from(value.as_i64()?).ok(),
    |self| Value::from(*self)
);
scalar!(u64, Integer, |value| value.as_u64(), |self| Value::from(*self), min 0.0);
scalar!(u32, Integer, |value| u32::try_from(value.as_u64()?).ok(), |self| Value::from(*self), min 0.0);
scalar!(usize, Integer, |value| usize::try_from(value.as_u64()?).ok(), |self| Value::from(*self), min 0.0);
scalar!(
    String,
    Text,
    |value| value.as_str().map(Into::into),
    |self| Value::from(self.as_str())
);
scalar!(
    Vec<f64>,
    Numbers,
    |value| value.as_array()?.iter().map(number::from_value).collect(),
    |self| self.iter().map(|one| number::to_value(*one)).collect()
);

impl<T: FromValue> FromValue for Option<T> {
    fn parameter(name: &str) -> Parameter {
        let mut parameter = T::parameter(name);
        parameter.optional = true;
        parameter
    }
    fn from_value(value: &Value) -> Option<Self> {
        if value.is_null() {
            Some(None)
        } else {
            T::from_value(value).map(Some)
        }
    }
    fn to_value(&self) -> Value {
        self.as_ref().map_or(Value::Null, FromValue::to_value)
    }
}

/// Name of a column of an input.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Column(pub String);

scalar!(
    Column,
    Column,
    |value| value.as_str().map(|name| Column(name.into())),
    |self| Value::from(self.0.as_str())
);

impl std::ops::Deref for Column {
    type Target = str;
    fn deref(&self) -> &str {
        &self.0
    }
}

/// Names of columns of an input.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Columns(pub Vec<String>);

scalar!(
    Columns,
    Columns,
    |value| value
        .as_array()?
        .iter()
        .map(|name| name.as_str().map(Into::into))
        .collect::<Option<_>>()
        .map(Columns),
    |self| Value::from(self.0.clone())
);

/// Lower and upper limit of each named column, sorted by name.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Ranges(pub BTreeMap<String, [f64; 2]>);

fn range(limits: &Value) -> Option<[f64; 2]> {
    match limits.as_array()?.as_slice() {
        [low, high] => Some([number::from_value(low)?, number::from_value(high)?]),
        _ => None,
    }
}

scalar!(
    Ranges,
    Ranges,
    |value| value
        .as_object()?
        .iter()
        .map(|(column, limits)| Some((column.clone(), range(limits)?)))
        .collect::<Option<_>>()
        .map(Ranges),
    |self| Value::Object(
        self.0
            .iter()
            .map(|(column, limits)| {
                (
                    column.clone(),
                    limits.iter().map(|one| number::to_value(*one)).collect(),
                )
            })
            .collect()
    )
);

/// Texts by name, sorted by name.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Mapping(pub BTreeMap<String, String>);

scalar!(
    Mapping,
    Mapping,
    |value| value
        .as_object()?
        .iter()
        .map(|(name, text)| Some((name.clone(), text.as_str()?.to_owned())))
        .collect::<Option<_>>()
        .map(Mapping),
    |self| Value::Object(
        self.0
            .iter()
            .map(|(name, text)| (name.clone(), Value::from(text.as_str())))
            .collect()
    )
);

/// A seed for random numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Seed(pub u64);

scalar!(
    Seed,
    Seed,
    |value| value.as_str()?.parse().ok().map(Seed),
    |self| Value::from(self.0.to_string())
);

macro_rules! defaults {
    ($($from:ty => $to:ty: |$value:ident| $convert:expr;)*) => {
        $(impl IntoDefault<$to> for $from {
            fn into_default(self) -> $to {
                let $value = self;
                $convert
            }
        })*
    };
}

// An integer literal is an i32 here, so that `default = 5` works for every kind of number.
defaults! {
    bool => bool: |value| value;
    f64 => f64: |value| value;
    f64 => Option<f64>: |value| Some(value);
    i32 => f64: |value| value.into();
    i32 => Option<f64>: |value| Some(value.into());
    i32 => i32: |value| value;
    i32 => i64: |value| value.into();
    i32 => u32: |value| value.unsigned_abs();
    i32 => u64: |value| value.unsigned_abs().into();
    i32 => usize: |value| value.unsigned_abs() as usize;
    i32 => Option<u64>: |value| Some(value.unsigned_abs().into());
    i32 => Seed: |value| Seed(value.unsigned_abs().into());
    &str => String: |value| value.into();
    &str => Option<String>: |value| Some(value.into());
    &str => Column: |value| Column(value.into());
    &str => Option<Column>: |value| Some(Column(value.into()));
    Ranges => Ranges: |value| value;
    Mapping => Mapping: |value| value;
    Columns => Columns: |value| value;
    Vec<f64> => Vec<f64>: |value| value;
}

impl<const N: usize> IntoDefault<Columns> for [&str; N] {
    fn into_default(self) -> Columns {
        Columns(self.map(Into::into).into())
    }
}

impl<const N: usize> IntoDefault<Vec<f64>> for [f64; N] {
    fn into_default(self) -> Vec<f64> {
        self.into()
    }
}
