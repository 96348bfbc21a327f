//! The few calls into libhdf5 for which the safe binding has no equivalent: types known only at
//! run time, blocks of records of such a type, and attribute values as stored. All `unsafe` of
//! this crate is here and in its part `blocks`. Each call holds the binding's lock, because the bundled library is not
//! thread-safe, and each buffer is checked against the size that the library itself reports.
#![allow(unsafe_code)]

use std::ffi::{CStr, c_void};
use std::ptr::null;

use hdf5::sync::sync;
use hdf5::{Attribute, Container, Dataset, Datatype};
use hdf5_sys::h5::H5free_memory;
use hdf5_sys::h5a::H5Aread;
use hdf5_sys::h5d::H5Dread;
use hdf5_sys::h5i::hid_t;
use hdf5_sys::h5p::H5P_DEFAULT;
use hdf5_sys::h5s::{H5S_SELECT_SET, H5Sclose, H5Screate_simple, H5Sselect_hyperslab};
use hdf5_sys::h5t::{
    H5T_class_t, H5T_order_t, H5T_sign_t, H5Tclose, H5Tdetect_class, H5Tget_array_dims2,
    H5Tget_array_ndims, H5Tget_class, H5Tget_fields, H5Tget_member_name, H5Tget_member_offset,
    H5Tget_member_type, H5Tget_nmembers, H5Tget_offset, H5Tget_order, H5Tget_precision,
    H5Tget_sign, H5Tget_size, H5Tget_super, H5Tis_variable_str,
};

mod blocks;

pub(crate) use blocks::{read_slab, write_attribute, write_records};

/// Nesting beyond which a type is called `Other`.
const MAX_TYPE_DEPTH: usize = 8;
/// Members of one compound that are looked at.
const MAX_MEMBERS: usize = 4096;

/// A type as stored in the file.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum StoredType {
    /// Integer of `size` bytes that uses all its bits.
    Int {
        size: usize,
        signed: bool,
        big_endian: bool,
    },
    /// IEEE 754 number of 2, 4 or 8 bytes.
    Float {
        size: usize,
        big_endian: bool,
    },
    /// One byte that holds a truth value (8-bit field, or enumeration FALSE, TRUE).
    Bool,
    /// Text of a fixed number of bytes.
    Text {
        size: usize,
    },
    /// Text kept outside the record.
    VarText,
    Compound {
        size: usize,
        members: Vec<Member>,
    },
    Array {
        element: Box<StoredType>,
        dims: Vec<u64>,
    },
    /// Anything else, in words.
    Other {
        size: usize,
        name: &'static str,
    },
}

/// A member of a compound type.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Member {
    pub name: String,
    pub offset: usize,
    pub stored: StoredType,
}

struct TypeId(hid_t);

impl Drop for TypeId {
    fn drop(&mut self) {
        if self.0 > 0 {
            // SAFETY: the id came from a call that hands over ownership, and is closed once.
            sync(|| unsafe { H5Tclose(self.0) });
        }
    }
}

struct SpaceId(hid_t);

impl Drop for SpaceId {
    fn drop(&mut self) {
        if self.0 > 0 {
            // SAFETY: the id came from H5Screate_simple, and is closed once.
            sync(|| unsafe { H5Sclose(self.0) });
        }
    }
}

/// The element type of a dataset or attribute, and its size in bytes.
pub(crate) fn stored_type(container: &Container) -> hdf5::Result<(StoredType, usize)> {
    let dtype: Datatype = container.dtype()?;
    let size = dtype.size();
    Ok((describe(dtype.id(), 0), size))
}

fn describe(id: hid_t, depth: usize) -> StoredType {
    use H5T_class_t as C;
    // SAFETY: `id` is a live type for the whole call; these functions only read it.
    let (class, size) = sync(|| unsafe { (H5Tget_class(id), H5Tget_size(id)) });
    let other = |name| StoredType::Other { size, name };
    if depth > MAX_TYPE_DEPTH {
        return other("deeply nested record");
    }
    match class {
        C::H5T_INTEGER => integer(id, size),
        C::H5T_FLOAT => float(id, size),
        C::H5T_BITFIELD if size == 1 => StoredType::Bool,
        C::H5T_BITFIELD => other("bit field"),
        C::H5T_STRING => {
            // SAFETY: as above.
            let variable = sync(|| unsafe { H5Tis_variable_str(id) });
            if variable > 0 {
                StoredType::VarText
            } else {
                StoredType::Text { size }
            }
        }
        C::H5T_ENUM => enumeration(id, size, depth),
        C::H5T_COMPOUND => compound(id, size, depth),
        C::H5T_ARRAY => array(id, size, depth),
        C::H5T_VLEN => other("variable-length list"),
        C::H5T_REFERENCE => other("reference"),
        C::H5T_OPAQUE => other("opaque bytes"),
        C::H5T_TIME => other("HDF5 time"),
        _ => other("unknown type"),
    }
}

fn full_width(id: hid_t, size: usize) -> bool {
    // SAFETY: `id` is a live atomic type; both calls only read it.
    sync(|| unsafe { H5Tget_precision(id) == size * 8 && H5Tget_offset(id) == 0 })
}

/// `Some(true)` for big endian, `None` for mixed orders.
fn big_endian(id: hid_t) -> Option<bool> {
    // SAFETY: `id` is a live atomic type.
    match sync(|| unsafe { H5Tget_order(id) }) {
        H5T_order_t::H5T_ORDER_LE | H5T_order_t::H5T_ORDER_NONE => Some(false),
        H5T_order_t::H5T_ORDER_BE => Some(true),
        _ => None,
    }
}

fn integer(id: hid_t, size: usize) -> StoredType {
    // SAFETY: `id` is a live integer type.
    let sign = sync(|| unsafe { H5Tget_sign(id) });
    match big_endian(id) {
        Some(big_endian) if matches!(size, 1 | 2 | 4 | 8) && full_width(id, size) => {
            StoredType::Int {
                size,
                signed: sign == H5T_sign_t::H5T_SGN_2,
                big_endian,
            }
        }
        _ => StoredType::Other {
            size,
            name: "unusual integer",
        },
    }
}

fn float(id: hid_t, size: usize) -> StoredType {
    let (mut sign, mut exp, mut exp_size, mut man, mut man_size) = (0, 0, 0, 0, 0);
    // SAFETY: `id` is a live float type, and the five pointers are to local numbers.
    let known = sync(|| unsafe {
        H5Tget_fields(
            id,
            &mut sign,
            &mut exp,
            &mut exp_size,
            &mut man,
            &mut man_size,
        )
    });
    let layout = (size, sign, exp, exp_size, man, man_size);
    let ieee = matches!(
        layout,
        (2, 15, 10, 5, 0, 10) | (4, 31, 23, 8, 0, 23) | (8, 63, 52, 11, 0, 52)
    );
    match big_endian(id) {
        Some(big_endian) if known >= 0 && ieee && full_width(id, size) => {
            StoredType::Float { size, big_endian }
        }
        _ => StoredType::Other {
            size,
            name: "unusual floating-point number",
        },
    }
}

fn parent(id: hid_t) -> Option<TypeId> {
    // SAFETY: `id` is a live type; the new id is owned by the returned guard.
    let id = sync(|| unsafe { H5Tget_super(id) });
    (id > 0).then_some(TypeId(id))
}

fn member_name(id: hid_t, index: u32) -> Option<String> {
    sync(|| {
        // SAFETY: `index` is below the member count; the library returns a NUL-terminated
        // string that is ours to free, or null.
        let text = unsafe { H5Tget_member_name(id, index) };
        if text.is_null() {
            return None;
        }
        // SAFETY: not null, NUL-terminated, copied before it is freed once.
        let name = unsafe { CStr::from_ptr(text) }
            .to_string_lossy()
            .into_owned();
        // SAFETY: as above.
        unsafe { H5free_memory(text.cast::<c_void>()) };
        Some(name)
    })
}

fn member_count(id: hid_t) -> usize {
    // SAFETY: `id` is a live type.
    let count = sync(|| unsafe { H5Tget_nmembers(id) });
    usize::try_from(count).unwrap_or(0).min(MAX_MEMBERS)
}

fn enumeration(id: hid_t, size: usize, depth: usize) -> StoredType {
    let mut names: Vec<String> = (0..member_count(id).min(3))
        .filter_map(|i| member_name(id, i as u32))
        .collect();
    names.sort();
    if size == 1 && names == ["FALSE", "TRUE"] {
        return StoredType::Bool;
    }
    match parent(id) {
        Some(base) => describe(base.0, depth + 1),
        None => StoredType::Other {
            size,
            name: "enumeration",
        },
    }
}

fn compound(id: hid_t, size: usize, depth: usize) -> StoredType {
    let mut members = Vec::new();
    for index in 0..member_count(id) as u32 {
        // SAFETY: `index` is below the member count; the new id is owned by the guard.
        let (offset, member) = sync(|| unsafe {
            (
                H5Tget_member_offset(id, index),
                TypeId(H5Tget_member_type(id, index)),
            )
        });
        let Some(name) = member_name(id, index) else {
            continue;
        };
        if member.0 > 0 {
            members.push(Member {
                name,
                offset,
                stored: describe(member.0, depth + 1),
            });
        }
    }
    StoredType::Compound { size, members }
}

fn array(id: hid_t, size: usize, depth: usize) -> StoredType {
    let Some(base) = parent(id) else {
        return StoredType::Other {
            size,
            name: "array",
        };
    };
    // SAFETY: `id` is a live array type.
    let rank = sync(|| unsafe { H5Tget_array_ndims(id) });
    let mut dims = vec![0; usize::try_from(rank).unwrap_or(0)];
    // SAFETY: `dims` has exactly the rank that the library reported.
    let got = sync(|| unsafe { H5Tget_array_dims2(id, dims.as_mut_ptr()) });
    if got < 0 || dims.is_empty() {
        return StoredType::Other {
            size,
            name: "array",
        };
    }
    StoredType::Array {
        element: Box::new(describe(base.0, depth + 1)),
        dims,
    }
}

/// Whether the type holds pointers in memory (then its bytes must not be read as they are).
fn holds_pointers(id: hid_t) -> bool {
    use H5T_class_t as C;
    // SAFETY: `id` is a live type; the calls only read it. H5Tdetect_class also finds
    // variable-length strings and looks inside compounds and arrays.
    sync(|| unsafe {
        H5Tdetect_class(id, C::H5T_VLEN) != 0
            || H5Tdetect_class(id, C::H5T_REFERENCE) != 0
            || H5Tis_variable_str(id) != 0
            || H5Tdetect_class(id, C::H5T_STRING) != 0 && has_variable_text(id, 0)
    })
}

fn has_variable_text(id: hid_t, depth: usize) -> bool {
    fn inside(stored: &StoredType) -> bool {
        match stored {
            StoredType::VarText => true,
            StoredType::Compound { members, .. } => members.iter().any(|m| inside(&m.stored)),
            StoredType::Array { element, .. } => inside(element),
            StoredType::Other { name, .. } => *name == "deeply nested record",
            _ => false,
        }
    }
    inside(&describe(id, depth))
}

/// Reads `count` records from row `start` of a one-dimensional dataset, bytes as stored.
///
/// # Errors
/// HDF5's own, or a short text when the buffer, the shape or the type does not fit.
pub(crate) fn read_records(
    dataset: &Dataset,
    start: u64,
    count: usize,
    buffer: &mut [u8],
) -> hdf5::Result<()> {
    let dtype = dataset.dtype()?;
    let shape = dataset.shape();
    let end = start.checked_add(count as u64);
    let fits = shape.len() == 1 && end.is_some_and(|end| end <= shape[0] as u64);
    if !fits || count.checked_mul(dtype.size()) != Some(buffer.len()) {
        return Err("block outside the dataset".into());
    }
    if holds_pointers(dtype.id()) {
        return Err("records with variable-length members".into());
    }
    let space = dataset.space()?;
    let length = count as u64;
    let read = sync(|| {
        // SAFETY: the file space is a private copy of rank 1, the block lies inside it, and the
        // buffer holds `count` records of the type that is passed as memory type. The type has
        // no pointers, so each byte of the buffer is plain data.
        unsafe {
            if H5Sselect_hyperslab(space.id(), H5S_SELECT_SET, &start, null(), &length, null()) < 0
            {
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

/// Reads an attribute's value, bytes as stored; at most `limit` bytes.
///
/// # Errors
/// HDF5's own, or a short text when the value is too large or holds pointers.
pub(crate) fn read_attribute(attribute: &Attribute, limit: usize) -> hdf5::Result<Vec<u8>> {
    let dtype = attribute.dtype()?;
    let elements = if attribute.space()?.is_null() {
        0
    } else {
        attribute.size()
    };
    let bytes = elements.checked_mul(dtype.size()).filter(|&n| n <= limit);
    let Some(bytes) = bytes else {
        return Err("value too large".into());
    };
    if holds_pointers(dtype.id()) {
        return Err("value with variable-length members".into());
    }
    let mut buffer = vec![0u8; bytes];
    if bytes > 0 {
        // SAFETY: the buffer holds all elements of the attribute in the type that is passed as
        // memory type, which has no pointers.
        let read =
            sync(|| unsafe { H5Aread(attribute.id(), dtype.id(), buffer.as_mut_ptr().cast()) });
        if read < 0 {
            return Err(hdf5::Error::query()?);
        }
    }
    Ok(buffer)
}
