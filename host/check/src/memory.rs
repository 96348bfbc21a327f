//! Memory for columns whose surroundings tell who touched them.
#![allow(unsafe_code)]

use rustix::mm::{MapFlags, MprotectFlags, ProtFlags};

const PAGE: usize = 4096;
/// Columns begin and are padded on this boundary.
const ALIGN: usize = 64;
/// Room behind a block without guards, so that a plugin that strays a little is found by the check
/// for it and by no other.
const SLACK: usize = 1 << 16;
/// What padding holds.
const POISON: u8 = 0xA5;

/// How the surroundings of a block are.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Around {
    /// Room that nobody looks at.
    #[default]
    Slack,
    /// Poisoned padding, then pages that nobody may touch.
    Guarded,
}

/// A mapped block: an unmapped page, the content at the end of its pages, an unmapped page.
#[derive(Debug)]
pub struct Block {
    base: *mut u8,
    length: usize,
    /// First byte of the content, from the base.
    begin: usize,
    bytes: usize,
    around: Around,
}

// SAFETY: plain memory; who writes when is the caller's concern, as with every buffer of a call.
unsafe impl Send for Block {}
// SAFETY: as above.
unsafe impl Sync for Block {}

impl Block {
    /// A block of `bytes` bytes that hold `fill`; `None` if the system has no room.
    pub fn new(bytes: usize, fill: u8, around: Around) -> Option<Block> {
        let padded = bytes.checked_next_multiple_of(ALIGN)?;
        let slack = if around == Around::Slack { SLACK } else { 0 };
        let inner = padded.checked_add(slack)?.checked_next_multiple_of(PAGE)?;
        let length = inner.checked_add(2 * PAGE)?;
        let flags = MapFlags::PRIVATE | MapFlags::NORESERVE;
        let protection = ProtFlags::READ | ProtFlags::WRITE;
        // SAFETY: a fresh mapping; then its own first and last page.
        let base = unsafe {
            let base =
                rustix::mm::mmap_anonymous(std::ptr::null_mut(), length, protection, flags).ok()?;
            let last = base.cast::<u8>().add(length - PAGE).cast();
            rustix::mm::mprotect(base, PAGE, MprotectFlags::empty()).ok()?;
            rustix::mm::mprotect(last, PAGE, MprotectFlags::empty()).ok()?;
            base.cast::<u8>()
        };
        let begin = match around {
            Around::Slack => PAGE,
            Around::Guarded => PAGE + inner - padded,
        };
        let mut block = Block {
            base,
            length,
            begin,
            bytes,
            around,
        };
        if around == Around::Guarded {
            block.inner().fill(POISON);
        }
        if fill != 0 || around == Around::Guarded {
            block.content_mut().fill(fill);
        }
        Some(block)
    }

    /// A block with this content.
    pub fn of(content: &[u8], around: Around) -> Option<Block> {
        let mut block = Block::new(content.len(), 0, around)?;
        block.content_mut().copy_from_slice(content);
        Some(block)
    }

    fn inner(&mut self) -> &mut [u8] {
        // SAFETY: the mapping between its two guards.
        unsafe { std::slice::from_raw_parts_mut(self.base.add(PAGE), self.length - 2 * PAGE) }
    }

    fn content_mut(&mut self) -> &mut [u8] {
        // SAFETY: within the mapping.
        unsafe { std::slice::from_raw_parts_mut(self.pointer(), self.bytes) }
    }

    /// The content.
    pub fn content(&self) -> &[u8] {
        // SAFETY: within the mapping.
        unsafe { std::slice::from_raw_parts(self.pointer(), self.bytes) }
    }

    /// First byte of the content.
    pub fn pointer(&self) -> *mut u8 {
        self.base.wrapping_add(self.begin)
    }

    /// Makes every write to it end the process.
    pub fn protect(&self) {
        // SAFETY: its own pages between the guards. If the system refuses, a write is found by comparing.
        let _ = unsafe {
            let first = self.base.add(PAGE).cast();
            rustix::mm::mprotect(first, self.length - 2 * PAGE, MprotectFlags::READ)
        };
    }

    /// Whether the poison around a guarded block is as it was.
    pub fn whole(&self) -> bool {
        if self.around == Around::Slack {
            return true;
        }
        // SAFETY: within the mapping.
        let inner =
            unsafe { std::slice::from_raw_parts(self.base.add(PAGE), self.length - 2 * PAGE) };
        let begin = self.begin - PAGE;
        let (before, rest) = inner.split_at(begin);
        let clean = |bytes: &[u8]| bytes.iter().all(|byte| *byte == POISON);
        clean(before) && clean(&rest[self.bytes..])
    }
}

impl Drop for Block {
    fn drop(&mut self) {
        // SAFETY: exactly its own mapping.
        let _ = unsafe { rustix::mm::munmap(self.base.cast(), self.length) };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stray_byte_is_seen() {
        let block = Block::of(&[1, 2, 3], Around::Guarded).unwrap();
        assert!(block.whole() && block.content() == [1, 2, 3]);
        assert_eq!(block.pointer() as usize % ALIGN, 0);
        // SAFETY: the padding of the block's own page.
        unsafe { block.pointer().add(3).write(0) };
        assert!(!block.whole());
        let empty = Block::new(0, 7, Around::Guarded).unwrap();
        assert!(empty.whole() && empty.content().is_empty());
        assert!(Block::new(usize::MAX - 10, 0, Around::Slack).is_none());
    }
}
