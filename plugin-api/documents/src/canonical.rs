//! Values of parameters in their canonical form.

use crate::{Failure, Map, Parameter, ParameterKind, number, units};
use serde_json::Value;

impl Parameter {
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

    pub(crate) fn refuse(&self, what: impl std::fmt::Display) -> Failure {
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
