//! What readers of binary formats share: records of numbers into columns, many rows at a time, on
//! all threads and in bounded memory; names of columns; archives; failures worded alike.

pub mod archive;
pub mod file;
pub mod fill;
pub mod minflux;
pub mod names;
pub mod number;
pub mod split;
#[cfg(test)]
mod tests;
pub mod texts;

pub use file::{Opened, damaged, not_mine, open, unsupported};
pub use fill::{Pass, Source, fill, read_at};
pub use number::{Number, Stored};
pub use split::{Field, Pick};
