//! The operations.

mod frames;
mod nena;
mod photons;
#[cfg(test)]
mod testing;
mod theory;
