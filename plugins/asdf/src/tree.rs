//! The YAML tree as JSON, within bounds. Tags build nothing, and aliases are refused.

use puncta_sdk::Map;
use puncta_sdk::serde_json::Value;
use saphyr_parser::{Event, Parser, ScalarStyle};

/// Values in the tree.
const MOST_VALUES: usize = 200_000;
const DEEPEST: usize = 64;

enum Open {
    List(Vec<Value>),
    Map(Map, Option<String>),
}

/// The first document of a text.
///
/// # Errors
/// A reason with the line.
pub fn parse(text: &str) -> Result<Value, String> {
    let mut open: Vec<Open> = Vec::new();
    let mut values = 0;
    for event in Parser::new_from_str(text) {
        let (event, span) =
            event.map_err(|error| format!("line {}: {}", error.marker().line(), error.info()))?;
        let refuse = |why: &str| Err(format!("line {}: {why}", span.start.line()));
        values += 1;
        if values > MOST_VALUES {
            return refuse("there are too many values");
        }
        let done = match event {
            Event::Scalar(text, style, ..) => Some(scalar(&text, style)),
            Event::SequenceStart(..) => {
                open.push(Open::List(Vec::new()));
                None
            }
            Event::MappingStart(..) => {
                open.push(Open::Map(Map::new(), None));
                None
            }
            Event::SequenceEnd | Event::MappingEnd => match open.pop() {
                Some(Open::List(list)) => Some(Value::Array(list)),
                Some(Open::Map(map, _)) => Some(Value::Object(map)),
                None => None,
            },
            Event::Alias(_) => return refuse("it has aliases, which are not read"),
            _ => None,
        };
        if open.len() > DEEPEST {
            return refuse("it is nested too deeply");
        }
        let Some(value) = done else { continue };
        match open.last_mut() {
            None => return Ok(value),
            Some(Open::List(list)) => list.push(value),
            Some(Open::Map(map, key)) => match key.take() {
                Some(key) => {
                    map.insert(key, value);
                }
                None => {
                    *key = Some(match value {
                        Value::String(text) => text,
                        other => other.to_string(),
                    });
                }
            },
        }
    }
    Err("the tree ends too early".into())
}

fn scalar(text: &str, style: ScalarStyle) -> Value {
    if style != ScalarStyle::Plain {
        return Value::from(text);
    }
    match text {
        "" | "~" | "null" => Value::Null,
        "true" => Value::from(true),
        "false" => Value::from(false),
        _ => {
            if let Ok(whole) = text.parse::<i64>() {
                return Value::from(whole);
            }
            let digits = text.bytes().any(|byte| byte.is_ascii_digit());
            match text.parse::<f64>() {
                Ok(float) if digits => Value::from(float),
                _ => Value::from(text),
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use puncta_sdk::serde_json::json;

    #[test]
    fn trees_are_json() {
        let text = "%YAML 1.1\n--- !core/a-1.0\na: [1, 2.5, x]\nb: {c: true, d: null}\n...\n";
        let tree = json!({"a": [1, 2.5, "x"], "b": {"c": true, "d": null}});
        assert_eq!(parse(text), Ok(tree));
        assert!(parse("a: &x 1\nb: *x\n").is_err());
        assert!(parse(&"[".repeat(100_000)).is_err());
        assert!(parse("a: [1\n").is_err());
    }
}
