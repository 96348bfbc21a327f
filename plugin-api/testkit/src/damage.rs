//! Damaged files: what a reader must refuse or read, but never break on.

use crate::Random;

/// The first so many bytes of `whole`, at 64 places spread over it, its begin and end among them.
pub fn cuts(whole: &[u8]) -> impl Iterator<Item = &[u8]> {
    let last = whole.len().saturating_sub(1);
    (0..64).map(move |i| &whole[..last * i / 63])
}

/// `whole` with one byte changed, 200 times; every second change is within the first `head` bytes.
pub fn flips(whole: &[u8], head: usize) -> impl Iterator<Item = (usize, Vec<u8>)> {
    let mut random = Random(7);
    (0..200).filter_map(move |i| {
        let reach = if i % 2 == 0 {
            head.min(whole.len())
        } else {
            whole.len()
        };
        let place = (random.next() % (reach as u64).max(1)) as usize;
        let mut changed = whole.to_vec();
        let byte = changed.get_mut(place)?;
        *byte = [0, 0xff, *byte ^ 1, *byte ^ 0x80, random.next() as u8][i % 5];
        Some((place, changed))
    })
}
