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

use realfft::{ComplexToReal, RealToComplex};
use rustfft::Fft;
use std::sync::Arc;

pub use correlate::{Correlation, Correlator};
pub use rings::Rings;
pub use rustfft::num_complex::Complex;
pub use size::good_size;
pub use transform::{ComplexFft, Fill, RealFft};

/// Numbers that can be transformed: f32 and f64.
///
/// The plans are made here, so that the code of the transforms is compiled into this crate alone and
/// not into each that uses it.
pub trait Real: rustfft::FftNum + Default {
    /// The nearest number of this type.
    fn of(value: f64) -> Self;
    /// The number as f64.
    fn wide(self) -> f64;
    /// Both directions of a complex transform.
    #[doc(hidden)]
    fn complex_plans(size: usize) -> [Arc<dyn Fft<Self>>; 2];
    /// Both directions of a transform of real numbers.
    #[doc(hidden)]
    fn real_plans(size: usize) -> (Arc<dyn RealToComplex<Self>>, Arc<dyn ComplexToReal<Self>>);
}

macro_rules! real {
    ($type:ty) => {
        impl Real for $type {
            fn of(value: f64) -> $type {
                value as $type
            }
            fn wide(self) -> f64 {
                self.into()
            }
            fn complex_plans(size: usize) -> [Arc<dyn Fft<$type>>; 2] {
                let mut planner = rustfft::FftPlanner::new();
                [
                    planner.plan_fft_forward(size),
                    planner.plan_fft_inverse(size),
                ]
            }
            fn real_plans(
                size: usize,
            ) -> (Arc<dyn RealToComplex<$type>>, Arc<dyn ComplexToReal<$type>>) {
                let mut planner = realfft::RealFftPlanner::new();
                (
                    planner.plan_fft_forward(size),
                    planner.plan_fft_inverse(size),
                )
            }
        }
    };
}

real!(f32);
real!(f64);
