//! Decodes the part of Python's pickle format that holds plain values: numbers, text, truth
//! values, lists, tuples, dictionaries, sets and numpy scalars, protocols 0 to 5.
//!
//! Nothing is ever imported, called or built: the few constructors that numpy scalars need are
//! known by name, and any other global makes the value undecodable. Input, memo, depth and the
//! size of the result are bounded, so that a hostile value costs at most a few milliseconds.

use serde_json::{Map, Number, Value};

mod literals;
mod machine;
mod scan;

use machine::{Node, Store};

/// Longest pickle that is looked at.
const MAX_INPUT: usize = 1 << 20;
/// Values in the finished tree; shared values count once for each place.
const MAX_VALUES: usize = 50_000;
/// Bytes of text in the finished tree.
const MAX_TEXT: usize = 4 << 20;
/// Nesting of the finished tree.
const MAX_DEPTH: usize = 32;

/// What a byte string is.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Decoded {
    /// A pickle of plain values.
    Value(Value),
    /// A pickle that holds something else, in words.
    Undecoded(String),
    /// No pickle.
    NotPickle,
}

/// Decodes a pickle without executing anything.
///
/// Tuples and sets become lists, keys become text, bytes that are UTF-8 become text, and
/// infinities and NaN become the texts `inf`, `-inf` and `nan`.
pub(crate) fn decode(bytes: &[u8]) -> Decoded {
    if bytes.len() > MAX_INPUT {
        return Decoded::NotPickle;
    }
    let Some(operations) = scan::scan(bytes) else {
        return Decoded::NotPickle;
    };
    let explicit = bytes.first() == Some(&0x80);
    match machine::run(bytes, operations) {
        Ok((store, root)) => match Finish::new(&store).value(root, 0) {
            Some(value) => Decoded::Value(value),
            None => Decoded::Undecoded("too large or nested too deeply".into()),
        },
        Err(machine::Stop::Unsupported(what)) => Decoded::Undecoded(what),
        Err(machine::Stop::Malformed) if explicit => Decoded::Undecoded("malformed".into()),
        Err(machine::Stop::Malformed) => Decoded::NotPickle,
    }
}

/// Turns nodes into JSON within the bounds.
struct Finish<'a> {
    store: &'a Store<'a>,
    values: usize,
    text: usize,
}

impl<'a> Finish<'a> {
    fn new(store: &'a Store<'a>) -> Self {
        Self {
            store,
            values: 0,
            text: 0,
        }
    }

    fn text(&mut self, text: String) -> Option<String> {
        self.text += text.len();
        (self.text <= MAX_TEXT).then_some(text)
    }

    fn value(&mut self, node: usize, depth: usize) -> Option<Value> {
        self.values += 1;
        if self.values > MAX_VALUES || depth > MAX_DEPTH {
            return None;
        }
        Some(match self.store.node(node)? {
            Node::None => Value::Null,
            Node::Bool(value) => Value::Bool(*value),
            Node::Int(value) => match i64::try_from(*value) {
                Ok(value) => Value::from(value),
                Err(_) => match u64::try_from(*value) {
                    Ok(value) => Value::from(value),
                    Err(_) => Value::String(self.text(value.to_string())?),
                },
            },
            Node::Float(value) => float(*value),
            Node::Text(text) => Value::String(self.text(text.to_string())?),
            Node::Bytes(bytes) => Value::String(self.text(bytes_text(bytes))?),
            Node::List(items) => {
                let mut list = Vec::new();
                for &item in items {
                    list.push(self.value(item, depth + 1)?);
                }
                Value::Array(list)
            }
            Node::Dict(pairs) => {
                let mut map = Map::new();
                for &(key, item) in pairs {
                    let key = match self.value(key, depth + 1)? {
                        Value::String(text) => text,
                        other => self.text(other.to_string())?,
                    };
                    let item = self.value(item, depth + 1)?;
                    map.insert(key, item);
                }
                Value::Object(map)
            }
            Node::Global(..) | Node::Dtype(_) => return None,
        })
    }
}

fn bytes_text(bytes: &[u8]) -> String {
    match std::str::from_utf8(bytes) {
        Ok(text) => text.to_owned(),
        Err(_) => format!("{} undecoded bytes", bytes.len()),
    }
}

/// A JSON number, or `nan`, `inf` or `-inf` as text.
pub(crate) fn float(value: f64) -> Value {
    match Number::from_f64(value) {
        Some(number) => Value::Number(number),
        None if value.is_nan() => Value::from("nan"),
        None if value > 0.0 => Value::from("inf"),
        None => Value::from("-inf"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn value(bytes: &[u8]) -> Value {
        match decode(bytes) {
            Decoded::Value(value) => value,
            other => panic!("{other:?}"),
        }
    }

    /// Bytes as PyTables stores them, and the values that Python's own `pickle.loads` gives.
    #[test]
    fn protocol_0_as_found_in_files() {
        assert_eq!(value(b"(I0\nI0\ntp1\n."), json!([0, 0]));
        assert_eq!(value(b"L100L\n."), json!(100));
        assert_eq!(
            value(b"(L770L\nL1076L\nL1090L\nL1374L\ntp1\n."),
            json!([770, 1076, 1090, 1374])
        );
        assert_eq!(
            value(b"(lp1\n(lp2\nValpha-tubulin\np3\naVATTO655\np4\naa."),
            json!([["alpha-tubulin", "ATTO655"]])
        );
        assert_eq!(
            value(b"(dp0\nVa\np1\nI01\nsVb\np2\nNsVc\np3\nF1.5\ns."),
            json!({"a": true, "b": null, "c": 1.5})
        );
        assert_eq!(value(b"S'it\\'s\\x41\\n'\np0\n."), json!("it'sA\n"));
        assert_eq!(value(b"V\\u00b5m\np0\n."), json!("\u{b5}m"));
        assert_eq!(value(b"Finf\n."), json!("inf"));
    }

    #[test]
    fn binary_protocols() {
        // pickle.dumps([1, -2, 300, 70000, 2**40, 1.5, None, True, 'x', b'y', (1, 2), {'k': []}], 2)
        let two = b"\x80\x02]q\x00(K\x01J\xfe\xff\xff\xffM\x2c\x01Jp\x11\x01\x00\x8a\x06\x00\x00\x00\x00\x00\x01\
            G\x3f\xf8\x00\x00\x00\x00\x00\x00N\x88X\x01\x00\x00\x00xq\x01c_codecs\nencode\nq\x02\
            X\x01\x00\x00\x00yq\x03X\x06\x00\x00\x00latin1q\x04\x86q\x05Rq\x06K\x01K\x02\x86q\x07}q\x08\
            X\x01\x00\x00\x00kq\x09]q\x0ase.";
        assert_eq!(
            value(two),
            json!([1, -2, 300, 70000, 1_i64 << 40, 1.5, null, true, "x", "y", [1, 2], {"k": []}])
        );
        // pickle.dumps({'a': (1, 2, 3), 'b': {4}}, 4)
        let four = b"\x80\x04\x95\x18\x00\x00\x00\x00\x00\x00\x00}\x94(\x8c\x01a\x94K\x01K\x02K\x03\x87\x94\
            \x8c\x01b\x94\x8f\x94(K\x04\x90u.";
        assert_eq!(value(four), json!({"a": [1, 2, 3], "b": [4]}));
    }

    #[test]
    fn numpy_scalars() {
        // pickle.dumps(numpy.float64(2.5), 2)
        let two = b"\x80\x02cnumpy.core.multiarray\nscalar\nq\x00cnumpy\ndtype\nq\x01X\x02\x00\x00\x00f8q\x02\
            K\x00K\x01\x87q\x03Rq\x04(K\x03X\x01\x00\x00\x00<q\x05NNNJ\xff\xff\xff\xffJ\xff\xff\xff\xffK\x00tq\x06b\
            C\x08\x00\x00\x00\x00\x00\x00\x04@q\x07\x86q\x08Rq\x09.";
        assert_eq!(value(two), json!(2.5));
    }

    #[test]
    fn other_globals_are_named_and_not_followed() {
        assert_eq!(
            decode(b"cos\nsystem\n(S'echo'\ntR."),
            Decoded::Undecoded("needs os.system".into())
        );
        assert_eq!(
            decode(b"\x80\x04\x8c\x05posix\x8c\x06system\x93\x8c\x02ls\x85R."),
            Decoded::Undecoded("needs posix.system".into())
        );
    }

    #[test]
    fn ordinary_texts_are_no_pickles() {
        for text in [
            "",
            ".",
            "Hello world.",
            "N",
            "Zyla 4.2.",
            "(.",
            "l.",
            "0.",
            "1.5",
            "I x.",
            "LatGaussFitFR",
        ] {
            assert_eq!(decode(text.as_bytes()), Decoded::NotPickle, "{text}");
        }
    }

    #[test]
    fn bombs_are_bounded() {
        // A list of two references to a list of two references ... 2^40 leaves.
        let mut bomb = b"(lp0\nI1\na".to_vec();
        for level in 1..40 {
            bomb.extend(format!("0(lp{level}\ng{0}\nag{0}\na", level - 1).bytes());
        }
        bomb.push(b'.');
        assert!(matches!(decode(&bomb), Decoded::Undecoded(_)));
        // A list that holds itself.
        assert!(matches!(decode(b"(lp0\ng0\na."), Decoded::Undecoded(_)));
        // A million opening marks, and lists nested a hundred thousand deep.
        let mut marks = vec![b'('; 500_000];
        marks.extend(vec![b'l'; 499_999]);
        marks.push(b'.');
        assert!(!matches!(decode(&marks), Decoded::Value(_)));
        let mut deep = vec![0x80, 2];
        deep.extend(vec![b']'; 100_000]);
        deep.extend(vec![b'a'; 99_999]);
        deep.push(b'.');
        assert!(matches!(decode(&deep), Decoded::Undecoded(_)));
    }

    #[test]
    fn mutated_pickles_never_panic() {
        let seeds: [&[u8]; 3] = [
            b"(lp1\n(lp2\nValpha-tubulin\np3\naVATTO655\np4\naa.",
            b"\x80\x04\x95\x18\x00\x00\x00\x00\x00\x00\x00}\x94(\x8c\x01a\x94K\x01K\x02K\x03\x87\x94\x8c\x01b\x94\x8f\x94(K\x04\x90u.",
            b"\x80\x02cnumpy.core.multiarray\nscalar\nq\x00cnumpy\ndtype\nq\x01X\x02\x00\x00\x00f8q\x02K\x00K\x01\x87q\x03Rq\x04(K\x03X\x01\x00\x00\x00<q\x05NNNJ\xff\xff\xff\xffJ\xff\xff\xff\xffK\x00tq\x06bC\x08\x00\x00\x00\x00\x00\x00\x04@q\x07\x86q\x08Rq\x09.",
        ];
        let mut state = 0x9e37_79b9_7f4a_7c15_u64;
        let mut random = || {
            state ^= state << 13;
            state ^= state >> 7;
            state ^= state << 17;
            state as usize
        };
        let mut decoded = 0;
        for round in 0..60_000 {
            let mut bytes = seeds[round % seeds.len()].to_vec();
            for _ in 0..1 + random() % 4 {
                let at = random() % bytes.len();
                match random() % 3 {
                    0 => bytes[at] = random() as u8,
                    1 => drop(bytes.remove(at)),
                    _ => bytes.insert(at, random() as u8),
                }
            }
            decoded += usize::from(matches!(decode(&bytes), Decoded::Value(_)));
        }
        assert!(
            decoded > 100,
            "mutations must also reach whole values: {decoded}"
        );
    }
}
