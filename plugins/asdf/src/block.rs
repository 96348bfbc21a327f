//! Blocks of bytes behind the tree.

use puncta_sdk::Failure;
use puncta_shared_records::{damaged, read_at, unsupported};
use std::fs::File;

/// What a block begins with; no UTF-8 has these bytes.
pub const MAGIC: &[u8] = b"\xd3BLK";
/// Deflate cannot expand beyond 1032 to 1.
const EXPANSION: u64 = 1032;

/// A block's bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Block {
    /// Where they begin in the file.
    pub begin: u64,
    /// Bytes in the file.
    pub used: u64,
    /// Bytes there are.
    pub size: u64,
    /// Whether they are compressed with zlib.
    pub packed: bool,
}

/// The block of a number; the first begins at `at`.
pub fn find(
    name: &str,
    file: &File,
    length: u64,
    mut at: u64,
    number: u64,
) -> Result<Block, Failure> {
    for place in 0..=number {
        let broken = |what: &str| damaged(format!("block {place} of {name} {what}"));
        let mut head = [0; 54];
        read_at(file, at, &mut head).map_err(|_| broken("is missing"))?;
        let word = |at: usize| {
            let bytes = head.get(at..).and_then(|bytes| bytes.first_chunk::<8>());
            bytes.map_or(0, |bytes| u64::from_be_bytes(*bytes))
        };
        let (compression, allocated, used, size) = (&head[10..14], word(14), word(22), word(30));
        let header = u64::from(u16::from_be_bytes([head[4], head[5]]));
        if !head.starts_with(MAGIC) || header < 48 {
            return Err(broken("does not begin as one"));
        }
        let begin = at + 6 + header;
        let streamed = head[9] & 1 == 1;
        let (allocated, used, size) = if streamed {
            let rest = length.saturating_sub(begin);
            (rest, rest, rest)
        } else {
            (allocated, used, size)
        };
        let next = begin.checked_add(allocated).filter(|next| *next <= length);
        let next = next.ok_or_else(|| broken("goes beyond the end of the file"))?;
        if place < number {
            at = next;
            continue;
        }
        let packed = match compression {
            [0, 0, 0, 0] => false,
            b"zlib" => true,
            other => {
                let what = String::from_utf8_lossy(other).into_owned();
                let message = format!("{name} is compressed with {what}");
                return Err(unsupported(
                    message,
                    "save it with zlib or without compression",
                ));
            }
        };
        let most = if packed {
            used.saturating_mul(EXPANSION).saturating_add(64)
        } else {
            used
        };
        if used > allocated || size > most {
            return Err(broken("lies about its size"));
        }
        return Ok(Block {
            begin,
            used,
            size,
            packed,
        });
    }
    Err(damaged(format!("{name} has no block {number}")))
}
