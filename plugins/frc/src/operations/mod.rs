//! The operations.

mod decorrelation;
mod halves;
mod images;
mod result;
mod settings;
mod shell;
mod table;
#[cfg(test)]
mod testing;
