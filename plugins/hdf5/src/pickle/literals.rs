//! Arguments of pickle operations: numbers, texts and their escapes, numpy scalars.

use std::borrow::Cow;

use super::machine::{Node, Step, Stop};

pub(super) fn line(argument: &[u8]) -> Option<&str> {
    std::str::from_utf8(argument).ok()
}

/// Little-endian unsigned number of up to eight bytes.
pub(super) fn little(argument: &[u8]) -> u64 {
    argument
        .iter()
        .take(8)
        .rev()
        .fold(0, |sum, &byte| sum << 8 | u64::from(byte))
}

pub(super) fn scalar<'a>(code: u8, argument: &[u8]) -> Step<Node<'a>> {
    let number = || line(argument).map(str::trim).ok_or(Stop::Malformed);
    Ok(match code {
        b'N' => Node::None,
        0x88 => Node::Bool(true),
        0x89 => Node::Bool(false),
        b'I' if argument == b"01" => Node::Bool(true),
        b'I' if argument == b"00" => Node::Bool(false),
        b'I' | b'L' => {
            let digits = number()?;
            let digits = digits.strip_suffix('L').unwrap_or(digits);
            Node::Int(digits.parse().map_err(|_| Stop::Malformed)?)
        }
        b'K' | b'M' => Node::Int(i128::from(little(argument))),
        b'J' => Node::Int(i128::from(little(argument) as u32 as i32)),
        0x8a | 0x8b => Node::Int(two_complement(argument)?),
        b'F' => {
            let digits = number()?;
            Node::Float(digits.parse().map_err(|_| Stop::Malformed)?)
        }
        _ => {
            let bytes = argument.first_chunk::<8>().ok_or(Stop::Malformed)?;
            Node::Float(f64::from_be_bytes(*bytes))
        }
    })
}

fn two_complement(argument: &[u8]) -> Step<i128> {
    if argument.len() > 16 {
        return Err(Stop::Unsupported("holds a very long integer".into()));
    }
    let negative = argument.last().is_some_and(|&byte| byte & 0x80 != 0);
    let mut bytes = [if negative { 0xff } else { 0 }; 16];
    for (to, &from) in bytes.iter_mut().zip(argument) {
        *to = from;
    }
    Ok(i128::from_le_bytes(bytes))
}

pub(super) fn text(code: u8, argument: &[u8]) -> Step<Node<'_>> {
    Ok(match code {
        b'S' => {
            let inner = match argument {
                [b'\'', inner @ .., b'\''] | [b'"', inner @ .., b'"'] => inner,
                _ => return Err(Stop::Malformed),
            };
            let bytes = unescape(inner, false)?
                .into_iter()
                .map(|c| u8::try_from(c).unwrap_or(b'?'));
            Node::Text(Cow::Owned(
                String::from_utf8_lossy(&bytes.collect::<Vec<_>>()).into_owned(),
            ))
        }
        b'V' => Node::Text(Cow::Owned(unescape(argument, true)?.into_iter().collect())),
        b'X' | 0x8c | 0x8d => Node::Text(Cow::Borrowed(
            std::str::from_utf8(argument).map_err(|_| Stop::Malformed)?,
        )),
        // Python 2 text of unknown encoding.
        b'U' | b'T' => Node::Text(String::from_utf8_lossy(argument)),
        _ => Node::Bytes(Cow::Borrowed(argument)),
    })
}

/// Backslash escapes: all of Python's in byte strings, only `\u` and `\U` in raw unicode.
fn unescape(bytes: &[u8], unicode: bool) -> Step<Vec<char>> {
    let (mut out, mut at) = (Vec::new(), 0);
    while let Some(&byte) = bytes.get(at) {
        at += 1;
        let next = bytes.get(at).copied();
        let digits = match (byte, next, unicode) {
            (b'\\', Some(b'u'), true) => 4,
            (b'\\', Some(b'U'), true) => 8,
            (b'\\', Some(b'x'), false) => 2,
            (b'\\', Some(simple), false) => {
                at += 1;
                out.push(match simple {
                    b'n' => '\n',
                    b'r' => '\r',
                    b't' => '\t',
                    b'\\' | b'\'' | b'"' => char::from(simple),
                    _ => return Err(Stop::Malformed),
                });
                continue;
            }
            _ => {
                out.push(char::from(byte));
                continue;
            }
        };
        let hex = bytes
            .get(at + 1..at + 1 + digits)
            .and_then(line)
            .ok_or(Stop::Malformed)?;
        let code = u32::from_str_radix(hex, 16).map_err(|_| Stop::Malformed)?;
        out.push(char::from_u32(code).unwrap_or('\u{fffd}'));
        at += 1 + digits;
    }
    Ok(out)
}

pub(super) fn numpy_scalar<'a>(dtype: &(String, bool), bytes: &[u8]) -> Step<Node<'a>> {
    let mut bytes = bytes.to_vec();
    if dtype.1 {
        bytes.reverse();
    }
    let single = || {
        bytes
            .first_chunk::<4>()
            .map(|b| f64::from(f32::from_le_bytes(*b)))
    };
    let double = || bytes.first_chunk::<8>().map(|b| f64::from_le_bytes(*b));
    let node = match (dtype.0.as_str(), bytes.len()) {
        ("f4", 4) => single().map(Node::Float),
        ("f8", 8) => double().map(Node::Float),
        ("b1", 1) => bytes.first().map(|&b| Node::Bool(b != 0)),
        ("i1", 1) | ("i2", 2) | ("i4", 4) | ("i8", 8) => Some(Node::Int(two_complement(&bytes)?)),
        ("u1", 1) | ("u2", 2) | ("u4", 4) | ("u8", 8) => {
            Some(Node::Int(i128::from(little(&bytes))))
        }
        _ => None,
    };
    node.ok_or_else(|| Stop::Unsupported(format!("needs numpy type {}", dtype.0.escape_debug())))
}
