//! The stack machine of a pickle, restricted to plain values. Values live in a store and refer to
//! each other by number, so that shared and even circular values cost no copies and no recursion.

use std::borrow::Cow;

use super::literals::{line, little, numpy_scalar, scalar, text};
use super::scan::Operation;

/// Values in the store.
const MAX_NODES: usize = 400_000;
/// Slots of the memo.
const MAX_MEMO: usize = 100_000;

#[derive(Debug, Clone)]
pub(super) enum Node<'a> {
    None,
    Bool(bool),
    Int(i128),
    Float(f64),
    Text(Cow<'a, str>),
    Bytes(Cow<'a, [u8]>),
    /// Lists, tuples and sets.
    List(Vec<usize>),
    Dict(Vec<(usize, usize)>),
    /// A name that is never looked up.
    Global(String, String),
    /// A numpy type such as `f8`, and whether its bytes are big endian.
    Dtype((String, bool)),
}

#[derive(Debug, Default)]
pub(super) struct Store<'a> {
    nodes: Vec<Node<'a>>,
}

impl<'a> Store<'a> {
    pub(super) fn node(&self, index: usize) -> Option<&Node<'a>> {
        self.nodes.get(index)
    }
}

/// Why a pickle was not decoded.
#[derive(Debug)]
pub(super) enum Stop {
    Unsupported(String),
    Malformed,
}

pub(super) type Step<T = ()> = Result<T, Stop>;

struct Machine<'a> {
    bytes: &'a [u8],
    store: Store<'a>,
    stack: Vec<usize>,
    marks: Vec<usize>,
    memo: Vec<Option<usize>>,
}

/// Runs the operations; gives the store and the root value.
pub(super) fn run(bytes: &[u8], operations: Vec<Operation>) -> Step<(Store<'_>, usize)> {
    let mut machine = Machine {
        bytes,
        store: Store::default(),
        stack: Vec::new(),
        marks: Vec::new(),
        memo: Vec::new(),
    };
    for operation in operations {
        machine.step(operation)?;
    }
    match (machine.stack.as_slice(), machine.marks.as_slice()) {
        (&[root], []) => Ok((machine.store, root)),
        _ => Err(Stop::Malformed),
    }
}

impl<'a> Machine<'a> {
    fn step(&mut self, operation: Operation) -> Step {
        let argument = self
            .bytes
            .get(operation.start..operation.end)
            .unwrap_or_default();
        match operation.code {
            0x80 | 0x95 | b'.' => Ok(()),
            b'I' | b'L' | b'K' | b'M' | b'J' | 0x8a | 0x8b | b'F' | b'G' | b'N' | 0x88 | 0x89 => {
                let node = scalar(operation.code, argument)?;
                self.push(node)
            }
            b'S' | b'V' | b'X' | 0x8c | 0x8d | b'U' | b'T' | b'B' | b'C' | 0x8e | 0x96 => {
                let node = text(operation.code, argument)?;
                self.push(node)
            }
            b'p' | b'q' | b'r' | 0x94 | b'g' | b'h' | b'j' => self.memo(operation.code, argument),
            b'c' => {
                let text = std::str::from_utf8(argument).map_err(|_| Stop::Malformed)?;
                let (module, name) = text.split_once('\n').ok_or(Stop::Malformed)?;
                self.push(global(module, name)?)
            }
            0x93 => {
                let (name, module) = (self.pop_text()?, self.pop_text()?);
                self.push(global(&module, &name)?)
            }
            b'R' | 0x81 => self.reduce(),
            b'b' => self.build(),
            b'i' | b'o' | b'P' | b'Q' | 0x82..=0x84 | 0x92 | 0x97 | 0x98 => {
                Err(Stop::Unsupported("holds an object".into()))
            }
            code => self.container(code),
        }
    }

    fn push(&mut self, node: Node<'a>) -> Step {
        if self.store.nodes.len() >= MAX_NODES {
            return Err(Stop::Unsupported("too large".into()));
        }
        self.stack.push(self.store.nodes.len());
        self.store.nodes.push(node);
        Ok(())
    }

    /// Takes one value from above the last mark.
    fn pop(&mut self) -> Step<usize> {
        if self
            .marks
            .last()
            .is_some_and(|&mark| mark >= self.stack.len())
        {
            return Err(Stop::Malformed);
        }
        self.stack.pop().ok_or(Stop::Malformed)
    }

    fn top(&self) -> Step<usize> {
        self.stack.last().copied().ok_or(Stop::Malformed)
    }

    /// Takes all values above the last mark.
    fn pop_marked(&mut self) -> Step<Vec<usize>> {
        let mark = self.marks.pop().ok_or(Stop::Malformed)?;
        if mark > self.stack.len() {
            return Err(Stop::Malformed);
        }
        Ok(self.stack.split_off(mark))
    }

    fn pop_text(&mut self) -> Step<String> {
        let index = self.pop()?;
        match self.store.node(index) {
            Some(Node::Text(text)) => Ok(text.to_string()),
            _ => Err(Stop::Malformed),
        }
    }

    fn memo(&mut self, code: u8, argument: &[u8]) -> Step {
        let slot = match code {
            0x94 => Some(self.memo.len()),
            b'p' | b'g' => line(argument).and_then(|text| text.trim().parse().ok()),
            _ => Some(little(argument) as usize),
        };
        let slot = slot
            .filter(|&slot| slot < MAX_MEMO)
            .ok_or(Stop::Malformed)?;
        if matches!(code, b'g' | b'h' | b'j') {
            let node = self
                .memo
                .get(slot)
                .copied()
                .flatten()
                .ok_or(Stop::Malformed)?;
            self.stack.push(node);
            return Ok(());
        }
        let node = self.top()?;
        if slot >= self.memo.len() {
            self.memo.resize(slot + 1, None);
        }
        if let Some(place) = self.memo.get_mut(slot) {
            *place = Some(node);
        }
        Ok(())
    }

    fn container(&mut self, code: u8) -> Step {
        match code {
            b'(' => {
                self.marks.push(self.stack.len());
                Ok(())
            }
            b'0' => self.pop().map(drop),
            b'1' => self.pop_marked().map(drop),
            b'2' => {
                let node = self.top()?;
                self.stack.push(node);
                Ok(())
            }
            b']' | b')' | 0x8f => self.push(Node::List(Vec::new())),
            b'}' => self.push(Node::Dict(Vec::new())),
            b'l' | b't' | 0x91 => {
                let items = self.pop_marked()?;
                self.push(Node::List(items))
            }
            0x85..=0x87 => {
                let mut items = Vec::new();
                for _ in 0..=code - 0x85 {
                    items.push(self.pop()?);
                }
                items.reverse();
                self.push(Node::List(items))
            }
            b'd' => {
                let items = self.pop_marked()?;
                self.push(Node::Dict(pairs(&items)?))
            }
            b'a' => {
                let item = self.pop()?;
                self.extend(&[item])
            }
            b'e' | 0x90 => {
                let items = self.pop_marked()?;
                self.extend(&items)
            }
            b's' => {
                let (item, key) = (self.pop()?, self.pop()?);
                self.extend(&[key, item])
            }
            b'u' => {
                let items = self.pop_marked()?;
                self.extend(&items)
            }
            _ => Err(Stop::Malformed),
        }
    }

    /// Adds to the list or dictionary on top of the stack.
    fn extend(&mut self, items: &[usize]) -> Step {
        let top = self.top()?;
        match self.store.nodes.get_mut(top) {
            Some(Node::List(list)) => list.extend_from_slice(items),
            Some(Node::Dict(dict)) => dict.extend(pairs(items)?),
            _ => return Err(Stop::Malformed),
        }
        Ok(())
    }

    /// Calls of the few known constructors, done here by hand.
    fn reduce(&mut self) -> Step {
        let (arguments, function) = (self.pop()?, self.pop()?);
        let Some(Node::List(list)) = self.store.node(arguments) else {
            return Err(Stop::Malformed);
        };
        let Some(Node::Global(module, name)) = self.store.node(function) else {
            return Err(Stop::Malformed);
        };
        let values: Vec<_> = list
            .iter()
            .take(3)
            .filter_map(|&i| self.store.node(i))
            .collect();
        let node = match (module.as_str(), name.as_str(), values.as_slice()) {
            ("_codecs", "encode", [Node::Text(text), ..]) => {
                let bytes: Result<Vec<u8>, _> = text.chars().map(u8::try_from).collect();
                Node::Bytes(Cow::Owned(bytes.map_err(|_| Stop::Malformed)?))
            }
            ("collections", "OrderedDict", []) => Node::Dict(Vec::new()),
            (_, "dtype", [Node::Text(code), ..]) => Node::Dtype((code.to_string(), false)),
            (_, "scalar", [Node::Dtype(dtype), Node::Bytes(bytes)]) => numpy_scalar(dtype, bytes)?,
            _ => return Err(Stop::Unsupported(format!("needs {module}.{name}"))),
        };
        self.push(node)
    }

    /// The state of a numpy type carries its byte order.
    fn build(&mut self) -> Step {
        let (state, top) = (self.pop()?, self.top()?);
        let big = match self.store.node(state) {
            Some(Node::List(items)) => items.get(1).is_some_and(
                |&order| matches!(self.store.node(order), Some(Node::Text(order)) if order == ">"),
            ),
            _ => false,
        };
        match self.store.nodes.get_mut(top) {
            Some(Node::Dtype((_, big_endian))) => *big_endian = big,
            _ => return Err(Stop::Unsupported("holds an object".into())),
        }
        Ok(())
    }
}

fn pairs(items: &[usize]) -> Step<Vec<(usize, usize)>> {
    let (pairs, rest) = items.as_chunks::<2>();
    if rest.is_empty() {
        Ok(pairs.iter().map(|&[k, v]| (k, v)).collect())
    } else {
        Err(Stop::Malformed)
    }
}

/// Names that stand for plain values; all others stop the decoding at once.
fn global<'a>(module: &str, name: &str) -> Step<Node<'a>> {
    match (module, name) {
        ("numpy.core.multiarray" | "numpy._core.multiarray", "scalar")
        | ("numpy", "dtype")
        | ("_codecs", "encode")
        | ("collections", "OrderedDict") => Ok(Node::Global(module.into(), name.into())),
        _ => {
            let short = |text: &str| text.chars().take(60).collect::<String>();
            Err(Stop::Unsupported(format!(
                "needs {}.{}",
                short(module),
                short(name)
            )))
        }
    }
}
