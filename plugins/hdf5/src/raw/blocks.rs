//! Blocks of any number of dimensions, and what is written.

use std::ffi::c_void;
use std::ptr::null;

use hdf5::sync::sync;
use hdf5::{Attribute, Dataset};
use hdf5_sys::h5a::H5Awrite;
use hdf5_sys::h5d::{H5Dread, H5Dwrite};
use hdf5_sys::h5p::H5P_DEFAULT;
use hdf5_sys::h5s::{H5S_SELECT_SET, H5Screate_simple, H5Sselect_hyperslab};

use super::{SpaceId, holds_pointers};

/// Reads a block of a dataset of any number of dimensions, bytes as stored.
///
/// # Errors
/// HDF5's own, or a short text when the buffer, the shape or the type does not fit.
pub(crate) fn read_slab(
    dataset: &Dataset,
    start: &[u64],
    count: &[u64],
    buffer: &mut [u8],
) -> hdf5::Result<()> {
    let dtype = dataset.dtype()?;
    let shape = dataset.shape();
    let inside = |((start, count), size): ((&u64, &u64), &usize)| {
        start
            .checked_add(*count)
            .is_some_and(|end| end <= *size as u64)
    };
    let fits = start.len() == shape.len()
        && count.len() == shape.len()
        && !shape.is_empty()
        && start.iter().zip(count).zip(&shape).all(inside);
    let elements = count.iter().try_fold(1_u64, |n, c| n.checked_mul(*c));
    let bytes = elements.and_then(|n| n.checked_mul(dtype.size() as u64));
    if !fits || bytes != Some(buffer.len() as u64) {
        return Err("block outside the dataset".into());
    }
    if holds_pointers(dtype.id()) {
        return Err("numbers with variable-length members".into());
    }
    if buffer.is_empty() {
        return Ok(());
    }
    let space = dataset.space()?;
    let length = elements.unwrap_or(0);
    let read = sync(|| {
        // SAFETY: the file space is a private copy of the rank of `start` and `count`, the block
        // lies inside it, and the buffer holds its elements in the type that is passed as memory
        // type. The type has no pointers, so each byte of the buffer is plain data.
        unsafe {
            let (first, size) = (start.as_ptr(), count.as_ptr());
            if H5Sselect_hyperslab(space.id(), H5S_SELECT_SET, first, null(), size, null()) < 0 {
                return -1;
            }
            let memory = SpaceId(H5Screate_simple(1, &length, null()));
            if memory.0 < 0 {
                return -1;
            }
            let target = buffer.as_mut_ptr().cast::<c_void>();
            H5Dread(
                dataset.id(),
                dtype.id(),
                memory.0,
                space.id(),
                H5P_DEFAULT,
                target,
            )
        }
    });
    if read < 0 {
        Err(hdf5::Error::query()?)
    } else {
        Ok(())
    }
}

/// Writes `count` records from row `start` of a one-dimensional dataset of plain records.
///
/// # Errors
/// HDF5's own, or a short text when the buffer, the shape or the type does not fit.
pub(crate) fn write_records(
    dataset: &Dataset,
    start: u64,
    count: usize,
    bytes: &[u8],
) -> hdf5::Result<()> {
    let dtype = dataset.dtype()?;
    let shape = dataset.shape();
    let end = start.checked_add(count as u64);
    let fits = shape.len() == 1 && end.is_some_and(|end| end <= shape[0] as u64);
    if !fits || count.checked_mul(dtype.size()) != Some(bytes.len()) || holds_pointers(dtype.id()) {
        return Err("block outside the dataset".into());
    }
    let space = dataset.space()?;
    let length = count as u64;
    let written = sync(|| {
        // SAFETY: as in `read_records`: the block lies inside the dataset, and the bytes are `count`
        // records of the type that is passed as memory type, which has no pointers.
        unsafe {
            if H5Sselect_hyperslab(space.id(), H5S_SELECT_SET, &start, null(), &length, null()) < 0
            {
                return -1;
            }
            let memory = SpaceId(H5Screate_simple(1, &length, null()));
            if memory.0 < 0 {
                return -1;
            }
            let from = bytes.as_ptr().cast::<c_void>();
            H5Dwrite(
                dataset.id(),
                dtype.id(),
                memory.0,
                space.id(),
                H5P_DEFAULT,
                from,
            )
        }
    });
    if written < 0 {
        Err(hdf5::Error::query()?)
    } else {
        Ok(())
    }
}

/// Writes the value of an attribute of a plain type, bytes as stored.
///
/// # Errors
/// HDF5's own, or a short text when the bytes do not fit.
pub(crate) fn write_attribute(attribute: &Attribute, bytes: &[u8]) -> hdf5::Result<()> {
    let dtype = attribute.dtype()?;
    let fits = attribute.size().checked_mul(dtype.size()) == Some(bytes.len());
    if !fits || holds_pointers(dtype.id()) {
        return Err("value of another size".into());
    }
    // SAFETY: the bytes are all elements of the attribute in the type that is passed as memory
    // type, which has no pointers.
    let written = sync(|| unsafe { H5Awrite(attribute.id(), dtype.id(), bytes.as_ptr().cast()) });
    if written < 0 {
        Err(hdf5::Error::query()?)
    } else {
        Ok(())
    }
}
