//! Ranges of sealed segments, as numbers.
#![allow(unsafe_code)]

use super::segment::Segment;
use puncta_documents::Failure;
use std::sync::Arc;

/// A range of a sealed segment.
#[derive(Clone, Debug)]
pub struct Region {
    segment: Arc<Segment>,
    offset: u64,
    bytes: u64,
}

impl Region {
    /// A range of a segment.
    ///
    /// # Errors
    /// When it does not lie inside.
    pub fn new(segment: &Arc<Segment>, offset: u64, bytes: u64) -> Result<Region, Failure> {
        match offset.checked_add(bytes) {
            Some(end) if end <= segment.bytes() => Ok(Region {
                segment: Arc::clone(segment),
                offset,
                bytes,
            }),
            _ => Err(Failure::internal("a column lies outside its memory")),
        }
    }

    /// The segment.
    #[must_use]
    pub fn segment(&self) -> &Arc<Segment> {
        &self.segment
    }

    /// First byte within the segment.
    #[must_use]
    pub fn offset(&self) -> u64 {
        self.offset
    }

    /// Number of bytes.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        self.bytes
    }

    /// Address of the first byte.
    #[must_use]
    pub fn pointer(&self) -> *mut u8 {
        // Inside the mapping, as `new` checked; an empty region may dangle but is never read.
        self.segment.base().wrapping_add(self.offset as usize)
    }

    /// The bytes as numbers.
    #[must_use]
    pub fn slice<T: Number>(&self) -> &[T] {
        let count = self.bytes as usize / size_of::<T>();
        let pointer = self.pointer().cast::<T>();
        if count == 0 || !pointer.is_aligned() {
            return &[];
        }
        // SAFETY: inside the mapping, aligned, sealed, and alive as long as `self`; every bit
        // pattern is a value of a `Number`.
        unsafe { std::slice::from_raw_parts(pointer, count) }
    }
}

/// Types for which every bit pattern is a value.
///
/// # Safety
/// That must be so.
pub unsafe trait Number: Copy + Send + Sync + 'static {}
macro_rules! numbers {
    ($($type:ty),*) => {
        $(
            // SAFETY: every bit pattern is a value.
            unsafe impl Number for $type {}
        )*
    };
}
numbers!(u8, i8, u16, i16, u32, i32, u64, i64, f32, f64);

/// The bytes of a writable segment as numbers.
///
/// # Safety
/// The range must lie in the segment, and nothing else may use it during `'a`.
#[must_use]
pub unsafe fn writable<'a, T: Number>(base: *mut u8, offset: u64, count: usize) -> &'a mut [T] {
    let pointer = base.wrapping_add(offset as usize).cast::<T>();
    if count == 0 || base.is_null() || !pointer.is_aligned() {
        return &mut [];
    }
    // SAFETY: the caller's promise; aligned as checked.
    unsafe { std::slice::from_raw_parts_mut(pointer, count) }
}
