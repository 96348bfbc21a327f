//! Cache keys: equal keys mean equal results.
//!
//! A key is a BLAKE3 hash with a context of its own for each purpose. Texts and lists are preceded
//! by their length and values by their type, so that no two different calls feed the same bytes.
//! Members of objects are hashed in the order of their names, numbers by value.

use blake3::Hasher;
use puncta_documents::Map;
use serde_json::Value;
use std::fmt;

const CALL: &str = "puncta.recipe 2026 call key/1";
const STEP: &str = "puncta.recipe 2026 step key/1";
const OUTPUT: &str = "puncta.recipe 2026 output key/1";
const LIST: &str = "puncta.recipe 2026 list key/1";
const SOURCE: &str = "puncta.recipe 2026 source key/1";

/// What a result depends on, as 32 bytes.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Key([u8; 32]);

impl Key {
    /// The key with these bytes.
    #[must_use]
    pub const fn from_bytes(bytes: [u8; 32]) -> Key {
        Key(bytes)
    }

    /// Its bytes.
    #[must_use]
    pub const fn bytes(&self) -> &[u8; 32] {
        &self.0
    }
}

impl fmt::Display for Key {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.iter().try_for_each(|byte| write!(f, "{byte:02x}"))
    }
}

impl fmt::Debug for Key {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Key({self})")
    }
}

/// The part of a step's key that does not depend on data: operation id, BLAKE3 of the plugin's
/// library, canonical parameters (with the seed). Computed once per check.
#[must_use]
pub fn call_key(operation: &str, library: &[u8; 32], parameters: &Map) -> Key {
    let mut hasher = Hasher::new_derive_key(CALL);
    text(&mut hasher, operation);
    hasher.update(library);
    object(&mut hasher, parameters);
    finish(&hasher)
}

/// The key of a step: of its call, and of what is bound to each port, in the order of the ports.
pub fn step_key<'a>(call: &Key, ports: impl IntoIterator<Item = (&'a str, &'a [Key])>) -> Key {
    let mut hasher = Hasher::new_derive_key(STEP);
    hasher.update(&call.0);
    for (port, keys) in ports {
        text(&mut hasher, port);
        list(&mut hasher, keys);
    }
    finish(&hasher)
}

/// The key of an output of a step, as other steps see it.
#[must_use]
pub fn output_key(step: &Key, output: &str) -> Key {
    let mut hasher = Hasher::new_derive_key(OUTPUT);
    hasher.update(&step.0);
    text(&mut hasher, output);
    finish(&hasher)
}

/// The key of an input that binds several files.
#[must_use]
pub fn list_key(keys: &[Key]) -> Key {
    let mut hasher = Hasher::new_derive_key(LIST);
    list(&mut hasher, keys);
    finish(&hasher)
}

/// The key of an object of a file: reader id, BLAKE3 of the reader's library, canonical options,
/// name of the object in the file (empty for the first of its kind), BLAKE3 of the file's content.
#[must_use]
pub fn source_key(
    reader: &str,
    library: &[u8; 32],
    options: &Map,
    name: &str,
    content: &[u8; 32],
) -> Key {
    let mut hasher = Hasher::new_derive_key(SOURCE);
    text(&mut hasher, reader);
    hasher.update(library);
    object(&mut hasher, options);
    text(&mut hasher, name);
    hasher.update(content);
    finish(&hasher)
}

fn finish(hasher: &Hasher) -> Key {
    Key(*hasher.finalize().as_bytes())
}

fn length(hasher: &mut Hasher, length: usize) {
    hasher.update(&(length as u64).to_le_bytes());
}

fn text(hasher: &mut Hasher, text: &str) {
    length(hasher, text.len());
    hasher.update(text.as_bytes());
}

fn list(hasher: &mut Hasher, keys: &[Key]) {
    length(hasher, keys.len());
    for key in keys {
        hasher.update(&key.0);
    }
}

fn object(hasher: &mut Hasher, map: &Map) {
    // The map's own order depends on how serde_json was built.
    let mut members: Vec<_> = map.iter().collect();
    members.sort_unstable_by(|a, b| a.0.cmp(b.0));
    length(hasher, members.len());
    for (name, member) in members {
        text(hasher, name);
        value(hasher, member);
    }
}

fn value(hasher: &mut Hasher, from: &Value) {
    match from {
        Value::Null => {
            hasher.update(b"n");
        }
        Value::Bool(flag) => {
            hasher.update(if *flag { b"t" } else { b"f" });
        }
        Value::Number(number) => self::number(hasher, number),
        Value::String(string) => {
            hasher.update(b"s");
            text(hasher, string);
        }
        Value::Array(items) => {
            hasher.update(b"a");
            length(hasher, items.len());
            items.iter().for_each(|item| value(hasher, item));
        }
        Value::Object(map) => {
            hasher.update(b"o");
            object(hasher, map);
        }
    }
}

fn number(hasher: &mut Hasher, number: &serde_json::Number) {
    // 2 and 2.0 are one number.
    let whole = |float: f64| {
        #[allow(clippy::cast_possible_truncation)]
        (float.fract() == 0.0 && float.abs() < 9_007_199_254_740_992.0).then_some(float as i64)
    };
    let float = || number.as_f64().unwrap_or(f64::NAN);
    if let Some(signed) = number.as_i64().or_else(|| whole(float())) {
        hasher.update(b"i").update(&signed.to_le_bytes());
    } else if let Some(unsigned) = number.as_u64() {
        hasher.update(b"u").update(&unsigned.to_le_bytes());
    } else {
        hasher.update(b"d").update(&float().to_bits().to_le_bytes());
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn map(value: Value) -> Map {
        value.as_object().cloned().unwrap()
    }

    fn call(parameters: Value) -> Key {
        call_key("puncta.filter.range/1", &[7; 32], &map(parameters))
    }

    #[test]
    fn keys_never_change() {
        // Results on people's disks are found by these: a change needs new context strings.
        let call = call(json!({
            "ranges": {"t": [500, "inf"], "error_x": [0, 15.5]}, "keep": true, "seed": "7",
            "none": null, "list": [1, -2, 1e300, 18446744073709551615_u64]
        }));
        let source = source_key(
            "puncta.text/1",
            &[1; 32],
            &map(json!({"skip": 1})),
            "a",
            &[2; 32],
        );
        let step = step_key(&call, [("table", &[source][..]), ("others", &[])]);
        assert_eq!(
            [
                call,
                source,
                step,
                output_key(&step, "table"),
                list_key(&[source, step])
            ]
            .map(|key| key.to_string()),
            [
                "3c34cfbd3339d0dcd40a94b172142b59f7ac0277c65deaaa5e5ae0e72a1b4dae",
                "cb3403146e4593bc01687757098b30584d22b5171b6d2dc68b98cf869bf22c50",
                "0440cc80dbb4b069e94278f46d55b278ab719bc3c41a6f35ecf33deb8c2213c8",
                "960f183fae40a351ca35eae270f5d9310e6d286eee617ae2c7df7a7db2f0f266",
                "9438bb048f5339f523cfd360f5023108789e0a29a95652aadb5459cf6e61e5a0",
            ]
        );
    }

    #[test]
    fn spelling_and_order_do_not_matter() {
        assert_eq!(
            call(json!({"a": 2, "b": 1})),
            call(json!({"b": 1.0, "a": 2.0}))
        );
        assert_ne!(call(json!({"a": 2})), call(json!({"a": "2"})));
        assert_ne!(call(json!({"a": 2})), call(json!({"a": [2]})));
        assert_ne!(call(json!({"a": null})), call(json!({})));
        assert_ne!(
            call(json!({"a": 9007199254740993_i64})),
            call(json!({"a": 9007199254740992_i64}))
        );
    }

    #[test]
    fn neighbouring_fields_do_not_run_together() {
        let none = Map::new();
        assert_ne!(
            call_key("ab", &[0; 32], &none),
            call_key("a", &[0; 32], &none)
        );
        assert_ne!(call(json!({"a": "bc"})), call(json!({"ab": "c"})));
        assert_ne!(call(json!({"a": ["b", "c"]})), call(json!({"a": ["bc"]})));
        let (one, two) = (call(json!({})), call(json!({"a": 1})));
        let step = |ports: &[(&'static str, &[Key])]| step_key(&one, ports.iter().copied());
        assert_ne!(
            step(&[("a", &[one, two])]),
            step(&[("a", &[one]), ("a", &[two])])
        );
        assert_ne!(
            step(&[("a", &[one]), ("b", &[two])]),
            step(&[("a", &[two]), ("b", &[one])])
        );
        assert_ne!(list_key(&[one]), one);
        assert_ne!(output_key(&one, "a"), output_key(&one, "b"));
    }
}
