//! The operations.

mod halves;
mod result;
mod table;
