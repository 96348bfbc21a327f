//! Sizes and offsets of every table, for the layout snapshot, the door and the C header's test.

use crate::{Call1, Column, Data1, DeviceCore1, Host, Job1, Plan, Plugin, Str};
use core::mem::{align_of, offset_of, size_of};

/// A member of a table.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FieldLayout {
    /// Name, as in C.
    pub name: &'static str,
    /// Bytes from the beginning of the table.
    pub offset: usize,
}

/// A table.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TableLayout {
    /// Name, as in Rust; the C name is `puncta_` with underscores.
    pub name: &'static str,
    /// Bytes.
    pub size: usize,
    /// Bytes.
    pub align: usize,
    /// Members in order.
    pub fields: &'static [FieldLayout],
}

macro_rules! layout {
    ($table:ident { $($field:ident),* $(,)? }) => {{
        // A member that the list leaves out does not compile.
        const fn _complete(table: $table) {
            let $table { $($field: _),* } = table;
        }
        TableLayout {
            name: stringify!($table),
            size: size_of::<$table>(),
            align: align_of::<$table>(),
            fields: &[$(FieldLayout {
                name: stringify!($field),
                offset: offset_of!($table, $field),
            }),*],
        }
    }};
}

/// Every table of this ABI.
pub const LAYOUTS: &[TableLayout] = &[
    layout!(Str { ptr, len }),
    layout!(Plugin {
        size,
        major,
        minor,
        number,
        describe,
        create,
        destroy,
        get
    }),
    layout!(Host {
        size,
        major,
        minor,
        number,
        get
    }),
    layout!(Plan { handle, document }),
    layout!(Call1 {
        size,
        reserved,
        prepare,
        run,
        drop
    }),
    layout!(Column {
        data,
        offsets,
        text,
        rows,
        entries,
        text_bytes,
        kind,
        width
    }),
    layout!(Data1 {
        size,
        reserved,
        columns,
        begin,
        grow,
        commit,
        finish,
        emit
    }),
    layout!(Job1 {
        size,
        reserved,
        progress,
        cancelled,
        fail,
        log,
        threads,
        parallel_for
    }),
    layout!(DeviceCore1 {
        size,
        reserved,
        open,
        describe,
        read,
        start,
        poll,
        halt,
        safe_state,
        close
    }),
];
