//! Reads a multi-document YAML file into JSON values within bounds. Aliases are copied while a
//! budget lasts, unknown tags never build anything.

use std::borrow::Cow;
use std::collections::HashMap;

use saphyr_parser::{Event, Parser, ScalarStyle, Tag};
use serde_json::{Map, Number, Value};

use crate::pickle::float;

/// Longest text that is looked at.
pub(crate) const MAX_INPUT: u64 = 16 << 20;
/// Values in all documents together; an alias counts all that it stands for.
const MAX_VALUES: usize = 500_000;
/// Bytes of text in all documents together, aliases included.
const MAX_TEXT: usize = 64 << 20;
const MAX_DEPTH: usize = 64;

/// The documents of a YAML text.
///
/// # Errors
/// A short reason with the line, for a text that is no YAML or is out of bounds.
pub(crate) fn documents(text: &str) -> Result<Vec<Value>, String> {
    let mut build = Build::default();
    for event in Parser::new_from_str(text) {
        let (event, span) =
            event.map_err(|error| format!("line {}: {}", error.marker().line(), error.info()))?;
        build
            .event(event)
            .map_err(|why| format!("line {}: {why}", span.start.line()))?;
    }
    Ok(build.documents)
}

/// A list or mapping that is being filled.
enum Open {
    List(Vec<Value>),
    Map(Map<String, Value>, Option<String>),
}

/// A value kept for aliases, with what a copy costs.
struct Anchored {
    value: Value,
    values: usize,
    text: usize,
}

#[derive(Default)]
struct Build {
    documents: Vec<Value>,
    open: Vec<(Open, usize, usize, usize)>,
    anchors: HashMap<usize, Anchored>,
    root: Option<Value>,
    values: usize,
    text: usize,
}

impl Build {
    fn event(&mut self, event: Event<'_>) -> Result<(), String> {
        match event {
            Event::DocumentStart(_) => self.root = None,
            Event::DocumentEnd => {
                self.documents.push(self.root.take().unwrap_or(Value::Null));
                self.anchors.clear();
            }
            Event::Scalar(text, style, anchor, tag) => {
                let before = (self.values, self.text);
                self.spend(1, text.len())?;
                let value = scalar(text, style, tag.as_deref());
                self.keep(anchor, &value, before);
                self.place(value);
            }
            Event::SequenceStart(anchor, _) => self.start(Open::List(Vec::new()), anchor)?,
            Event::MappingStart(anchor, _) => self.start(Open::Map(Map::new(), None), anchor)?,
            Event::SequenceEnd | Event::MappingEnd => self.end(),
            Event::Alias(anchor) => {
                let Some(kept) = self.anchors.get(&anchor) else {
                    return Err("an alias to a value that is not complete".into());
                };
                let (values, text) = (kept.values, kept.text);
                // Checked before the copy is made.
                self.spend(values, text)?;
                let value = self.anchors.get(&anchor).map(|kept| kept.value.clone());
                self.place(value.unwrap_or_default());
            }
            _ => {}
        }
        Ok(())
    }

    fn spend(&mut self, values: usize, text: usize) -> Result<(), String> {
        self.values = self.values.saturating_add(values);
        self.text = self.text.saturating_add(text);
        if self.values > MAX_VALUES || self.text > MAX_TEXT {
            return Err(format!("more than {MAX_VALUES} values"));
        }
        Ok(())
    }

    fn start(&mut self, open: Open, anchor: usize) -> Result<(), String> {
        let before = (self.values, self.text);
        self.spend(1, 0)?;
        if self.open.len() >= MAX_DEPTH {
            return Err(format!("nested deeper than {MAX_DEPTH} levels"));
        }
        self.open.push((open, anchor, before.0, before.1));
        Ok(())
    }

    fn end(&mut self) {
        let Some((open, anchor, values, text)) = self.open.pop() else {
            return;
        };
        let value = match open {
            Open::List(list) => Value::Array(list),
            Open::Map(map, _) => Value::Object(map),
        };
        self.keep(anchor, &value, (values, text));
        self.place(value);
    }

    fn keep(&mut self, anchor: usize, value: &Value, before: (usize, usize)) {
        if anchor > 0 {
            let (values, text) = (self.values - before.0, self.text - before.1);
            // The copy that is kept counts as well.
            self.values += values;
            self.text += text;
            self.anchors.insert(
                anchor,
                Anchored {
                    value: value.clone(),
                    values,
                    text,
                },
            );
        }
    }

    fn place(&mut self, value: Value) {
        match self.open.last_mut() {
            None => self.root = Some(value),
            Some((Open::List(list), ..)) => list.push(value),
            Some((Open::Map(map, key), ..)) => match key.take() {
                Some(name) => {
                    map.insert(name, value);
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
}

/// A scalar by the rules that PyYAML writes by: plain numbers, truth values and nulls.
fn scalar(text: Cow<'_, str>, style: ScalarStyle, tag: Option<&Tag>) -> Value {
    const KNOWN: [&str; 6] = ["bool", "float", "int", "null", "str", "timestamp"];
    if let Some(tag) = tag.filter(|tag| !KNOWN.contains(&tag.suffix.as_str())) {
        return Value::from(format!("{text} ({})", tag.suffix));
    }
    if style != ScalarStyle::Plain || tag.is_some_and(|tag| tag.suffix == "str") {
        return Value::String(text.into_owned());
    }
    match &*text {
        "" | "~" | "null" | "Null" | "NULL" => return Value::Null,
        "true" | "True" | "TRUE" | "yes" | "Yes" | "on" | "On" => return Value::Bool(true),
        "false" | "False" | "FALSE" | "no" | "No" | "off" | "Off" => return Value::Bool(false),
        ".inf" | "+.inf" | ".Inf" => return Value::from("inf"),
        "-.inf" | "-.Inf" => return Value::from("-inf"),
        ".nan" | ".NaN" => return Value::from("nan"),
        _ => {}
    }
    let numeric = text.starts_with(|c: char| c.is_ascii_digit() || "+-.".contains(c))
        && text
            .chars()
            .all(|c| c.is_ascii_digit() || "+-.eE".contains(c));
    if numeric {
        if let Ok(value) = text.parse::<i64>() {
            return Value::Number(Number::from(value));
        }
        if let Ok(value) = text.parse::<f64>() {
            return float(value);
        }
    }
    Value::String(text.into_owned())
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn documents_as_pyyaml_writes_them() {
        let text = "Byte Order: <\nPixelsize: 130\nk: 30000000.0\ne: 1.71e-17\nROI: null\nt: '5000'\n\
            c: &id001\n- 1\n- -2.5\nd: *id001\nnan: .nan\nb: true\nn:\n  x: {y: [a, b]}\n---\nq: 1\n";
        assert_eq!(
            documents(text),
            Ok(vec![
                json!({"Byte Order": "<", "Pixelsize": 130, "k": 3e7, "e": 1.71e-17, "ROI": null,
                    "t": "5000", "c": [1, -2.5], "d": [1, -2.5], "nan": "nan", "b": true,
                    "n": {"x": {"y": ["a", "b"]}}}),
                json!({"q": 1})
            ])
        );
    }

    #[test]
    fn tags_build_nothing() {
        let text = "a: !!python/object/apply:os.system ['echo']\nb: !!python/name:os.system x\n";
        assert_eq!(
            documents(text),
            Ok(vec![
                json!({"a": ["echo"], "b": "x (python/name:os.system)"})
            ])
        );
    }

    #[test]
    fn alias_bombs_and_deep_nesting_are_refused() {
        let mut bomb = String::from("a0: &a0 [x, x, x, x, x, x, x, x, x, x]\n");
        for level in 1..12 {
            let row = vec![format!("*a{}", level - 1); 10].join(", ");
            bomb += &format!("a{level}: &a{level} [{row}]\n");
        }
        assert!(documents(&bomb).is_err_and(|why| why.contains("values")));
        let deep = format!("{}{}", "[".repeat(100_000), "]".repeat(100_000));
        assert!(documents(&deep).is_err());
        assert!(documents("a: &a [*a]").is_err());
        assert!(documents("a: [1, 2").is_err());
    }

    #[test]
    fn a_quarter_megabyte_is_quick_and_whole() {
        let list = vec!["1.000000"; 26_000].join(",");
        let text = format!("Spots: {list}\nWidth: 128\n");
        let found = documents(&text).unwrap();
        assert_eq!(found[0]["Width"], 128);
        assert_eq!(found[0]["Spots"].as_str().map(str::len), Some(list.len()));
    }
}
