//! Cuts a byte string into pickle operations, without giving them any meaning. A byte string is a
//! pickle exactly when the operations end with STOP at its last byte.

/// An operation: its code and the range of its argument.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Operation {
    pub code: u8,
    pub start: usize,
    pub end: usize,
}

/// Operations of one pickle at most.
const MAX_OPERATIONS: usize = 300_000;

/// How an operation's argument is written.
enum Argument {
    Bytes(usize),
    /// Up to a newline.
    Line,
    /// Up to the second newline.
    TwoLines,
    /// A little-endian length of that many bytes, then the bytes.
    Counted(usize),
}

fn argument(code: u8) -> Option<Argument> {
    use Argument::{Bytes, Counted, Line, TwoLines};
    Some(match code {
        b'('
        | b'.'
        | b'0'
        | b'1'
        | b'2'
        | b'N'
        | b'Q'
        | b'R'
        | b'a'
        | b'b'
        | b'd'
        | b'}'
        | b'e'
        | b'l'
        | b']'
        | b't'
        | b')'
        | b's'
        | b'u'
        | b'o'
        | 0x81
        | 0x85..=0x89
        | 0x8f..=0x94
        | 0x97
        | 0x98 => Bytes(0),
        b'F' | b'I' | b'L' | b'P' | b'S' | b'V' | b'g' | b'p' => Line,
        b'c' | b'i' => TwoLines,
        b'K' | b'h' | b'q' | 0x80 | 0x82 => Bytes(1),
        b'M' | 0x83 => Bytes(2),
        b'J' | b'j' | b'r' | 0x84 => Bytes(4),
        b'G' | 0x95 => Bytes(8),
        b'U' | b'C' | 0x8a | 0x8c => Counted(1),
        b'X' | b'T' | b'B' | 0x8b => Counted(4),
        0x8d | 0x8e | 0x96 => Counted(8),
        _ => return None,
    })
}

/// The operations of a whole pickle, or `None`.
pub(super) fn scan(bytes: &[u8]) -> Option<Vec<Operation>> {
    let (mut at, mut operations) = (0, Vec::new());
    loop {
        let code = *bytes.get(at)?;
        at += 1;
        let rest = bytes.get(at..)?;
        let line = || rest.iter().position(|&b| b == b'\n');
        let (skip, length, after) = match argument(code)? {
            Argument::Bytes(length) => (0, length, 0),
            Argument::Line => (0, line()?, 1),
            Argument::TwoLines => {
                let first = line()?;
                let second = rest.get(first + 1..)?.iter().position(|&b| b == b'\n')?;
                (0, first + 1 + second, 1)
            }
            Argument::Counted(width) => {
                let mut count = [0; 8];
                count.get_mut(..width)?.copy_from_slice(rest.get(..width)?);
                (width, usize::try_from(u64::from_le_bytes(count)).ok()?, 0)
            }
        };
        let start = at + skip;
        let end = start.checked_add(length)?;
        bytes.get(start..end)?;
        operations.push(Operation { code, start, end });
        at = end + after;
        if code == b'.' {
            return (at == bytes.len() && operations.len() > 1).then_some(operations);
        }
        if operations.len() > MAX_OPERATIONS {
            return None;
        }
    }
}
