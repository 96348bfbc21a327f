//! Morton keys: the bits of three coordinates, interleaved.

/// Bits of a coordinate, and the deepest level.
pub const BITS: u32 = 20;

/// A Morton key of 60 bits: bit 3 i + a is bit i of coordinate a.
pub type Key = u64;

#[inline]
fn spread(x: u32) -> u64 {
    let mut x = u64::from(x) & 0x1f_ffff;
    x = (x | x << 32) & 0x001f_0000_0000_ffff;
    x = (x | x << 16) & 0x001f_0000_ff00_00ff;
    x = (x | x << 8) & 0x100f_00f0_0f00_f00f;
    x = (x | x << 4) & 0x10c3_0c30_c30c_30c3;
    (x | x << 2) & 0x1249_2492_4924_9249
}

#[inline]
fn gather(x: u64) -> u32 {
    let mut x = x & 0x1249_2492_4924_9249;
    x = (x | x >> 2) & 0x10c3_0c30_c30c_30c3;
    x = (x | x >> 4) & 0x100f_00f0_0f00_f00f;
    x = (x | x >> 8) & 0x001f_0000_ff00_00ff;
    x = (x | x >> 16) & 0x001f_0000_0000_ffff;
    ((x | x >> 32) & 0x1f_ffff) as u32
}

/// The key of three coordinates, each below 2^20.
#[must_use]
#[inline]
pub fn encode([x, y, z]: [u32; 3]) -> Key {
    spread(x) | spread(y) << 1 | spread(z) << 2
}

/// The coordinates of a key.
#[must_use]
#[inline]
pub fn decode(key: Key) -> [u32; 3] {
    [gather(key), gather(key >> 1), gather(key >> 2)]
}

/// How many keys a cell of a level spans, as a power of two.
#[inline]
pub(crate) fn span(level: u32) -> u32 {
    3 * (BITS - level.min(BITS))
}
