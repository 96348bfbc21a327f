//! Fourier transforms of images and volumes on all threads.
//!
//! Sizes are `[z, y, x]` with x fastest; an image has `z = 1`. A spectrum is stored with its axes in
//! the opposite order, `[kx][ky][kz]` with kz fastest, so that no transform has to transpose back:
//! an image's spectrum is `[kx][ky]` with ky fastest. Frequency index k of an axis of n samples means
//! k / n cycles a sample for k <= n / 2, else (k - n) / n. Forward transforms are not scaled, inverse
//! ones by 1 / (z y x). Results do not depend on the number of threads.

mod correlate;
mod passes;
mod rings;
mod size;
mod transform;

pub use correlate::{Correlation, Correlator};
pub use rings::Rings;
pub use rustfft::num_complex::Complex;
pub use size::good_size;
pub use transform::{ComplexFft, Fill, RealFft};

/// Numbers that can be transformed: f32 and f64.
pub trait Real: rustfft::FftNum + Default {
    /// The nearest number of this type.
    fn of(value: f64) -> Self;
    /// The number as f64.
    fn wide(self) -> f64;
}

impl Real for f32 {
    fn of(value: f64) -> f32 {
        value as f32
    }
    fn wide(self) -> f64 {
        self.into()
    }
}

impl Real for f64 {
    fn of(value: f64) -> f64 {
        value
    }
    fn wide(self) -> f64 {
        self
    }
}
