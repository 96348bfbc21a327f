//! The one place that turns the host's pointers into slices.
#![allow(unsafe_code)]

use puncta_abi as abi;
use puncta_documents::{ColumnType, Element};

/// A column of the host, as long as the job borrows it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct RawColumn(pub(crate) abi::Column);

// SAFETY: the memory behind the pointers is the host's; reads are shared, and writes go through
// `&mut` borrows that `slice_mut` hands out once.
unsafe impl Send for RawColumn {}
// SAFETY: as above.
unsafe impl Sync for RawColumn {}

impl RawColumn {
    /// Type, if this SDK knows it.
    pub(crate) fn type_(self) -> Option<ColumnType> {
        let element = Element::from_code(self.0.kind)?;
        Some(ColumnType {
            element,
            width: self.0.width.max(1),
        })
    }

    fn count(self) -> Option<usize> {
        usize::try_from(self.0.rows)
            .ok()?
            .checked_mul(self.0.width.max(1) as usize)
    }

    /// The numbers, if the host's memory is as the ABI says.
    ///
    /// # Safety
    /// `T` must have the size of the column's element, and the column must outlive `'a`, unwritten.
    pub(crate) unsafe fn slice<'a, T>(self) -> Option<&'a [T]> {
        let count = self.count()?;
        // SAFETY: passed on.
        unsafe { slice(self.0.data.cast::<T>(), count) }
    }

    /// The numbers for writing.
    ///
    /// # Safety
    /// As `slice`, and nothing else may use them during `'a`.
    pub(crate) unsafe fn slice_mut<'a, T>(self) -> Option<&'a mut [T]> {
        let count = self.count()?;
        // SAFETY: passed on.
        unsafe { slice_mut(self.0.data.cast::<T>(), count) }
    }

    /// Offsets of the texts: `rows + 1`, or `entries + 1` for a dictionary.
    ///
    /// # Safety
    /// The column must outlive `'a`, unwritten.
    pub(crate) unsafe fn offsets<'a>(self, texts: u64) -> Option<&'a [u64]> {
        let count = usize::try_from(texts.checked_add(1)?).ok()?;
        // SAFETY: passed on.
        unsafe { slice(self.0.offsets, count) }
    }

    /// Text bytes.
    ///
    /// # Safety
    /// The column must outlive `'a`, unwritten.
    pub(crate) unsafe fn text<'a>(self) -> Option<&'a [u8]> {
        // SAFETY: passed on.
        unsafe { slice(self.0.text, usize::try_from(self.0.text_bytes).ok()?) }
    }

    /// Offsets for writing.
    ///
    /// # Safety
    /// Nothing else may use them during `'a`.
    pub(crate) unsafe fn offsets_mut<'a>(self, texts: u64) -> Option<&'a mut [u64]> {
        let count = usize::try_from(texts.checked_add(1)?).ok()?;
        // SAFETY: passed on.
        unsafe { slice_mut(self.0.offsets, count) }
    }

    /// Text bytes for writing.
    ///
    /// # Safety
    /// Nothing else may use them during `'a`.
    pub(crate) unsafe fn text_mut<'a>(self) -> Option<&'a mut [u8]> {
        // SAFETY: passed on.
        unsafe { slice_mut(self.0.text, usize::try_from(self.0.text_bytes).ok()?) }
    }
}

fn usable<T>(pointer: *const T, count: usize) -> bool {
    !pointer.is_null()
        && pointer.is_aligned()
        && count
            .checked_mul(size_of::<T>())
            .is_some_and(|bytes| isize::try_from(bytes).is_ok())
}

unsafe fn slice<'a, T>(pointer: *const T, count: usize) -> Option<&'a [T]> {
    if count == 0 {
        return Some(&[]);
    }
    // SAFETY: non-null, aligned, of a possible size; the caller answers for content and lifetime.
    usable(pointer, count).then(|| unsafe { std::slice::from_raw_parts(pointer, count) })
}

unsafe fn slice_mut<'a, T>(pointer: *mut T, count: usize) -> Option<&'a mut [T]> {
    if count == 0 {
        return Some(&mut []);
    }
    // SAFETY: as above, and the caller answers for exclusive use.
    usable(pointer, count).then(|| unsafe { std::slice::from_raw_parts_mut(pointer, count) })
}
