//! Transforms of images and volumes.

use crate::passes::{LINES, Plan, gather, go_on, scratch, transform, transpose_and_transform};
use crate::{Complex, Real};
use puncta_sdk::run::{Cancelled, Run, chunks_mut};
use realfft::{ComplexToReal, RealToComplex};
use std::sync::Arc;

/// Fills a row (counted through all planes) and says whether any number of it is not zero.
pub type Fill<'a, T> = &'a (dyn Fn(usize, &mut [T]) -> bool + Sync);

/// Both directions along y and z.
struct Across<T> {
    y: [Plan<T>; 2],
    z: Option<[Plan<T>; 2]>,
}

impl<T: Real> Across<T> {
    fn new(depth: usize, height: usize) -> Across<T> {
        Across {
            y: T::complex_plans(height),
            z: (depth > 1).then(|| T::complex_plans(depth)),
        }
    }

    /// From `[z][y][kx]`, `width` wide, to `[kx][ky][kz]`.
    fn forward(
        &self,
        run: &dyn Run,
        mut rows: Vec<Complex<T>>,
        width: usize,
    ) -> Result<Vec<Complex<T>>, Cancelled> {
        let mut spectrum = scratch(rows.len());
        let plane = width * self.y[0].len();
        for (from, to) in rows.chunks(plane).zip(spectrum.chunks_mut(plane)) {
            transpose_and_transform(run, from, width, to, &self.y[0])?;
        }
        if let Some([forward, _]) = &self.z {
            transpose_and_transform(run, &spectrum, plane, &mut rows, forward)?;
            return Ok(rows);
        }
        Ok(spectrum)
    }

    /// From `[kx][ky][kz]` to `[z][kx][y]`.
    fn inverse(
        &self,
        run: &dyn Run,
        mut spectrum: Vec<Complex<T>>,
    ) -> Result<Vec<Complex<T>>, Cancelled> {
        let Some([_, inverse]) = &self.z else {
            transform(run, &mut spectrum, &self.y[1])?;
            return Ok(spectrum);
        };
        transform(run, &mut spectrum, inverse)?;
        let mut planes = scratch(spectrum.len());
        transpose_and_transform(run, &spectrum, inverse.len(), &mut planes, &self.y[1])?;
        Ok(planes)
    }
}

/// Transforms of real images or volumes of one size.
///
/// A spectrum holds kx = 0 to x / 2 only, [`RealFft::columns`] of them; the rest is the complex
/// conjugate of the opposite frequency.
pub struct RealFft<T: Real> {
    size: [usize; 3],
    forward: Arc<dyn RealToComplex<T>>,
    inverse: Arc<dyn ComplexToReal<T>>,
    across: Across<T>,
}

impl<T: Real> RealFft<T> {
    /// Plans transforms of the size `[z, y, x]`; an axis has at least one sample.
    #[must_use]
    pub fn new(size: [usize; 3]) -> RealFft<T> {
        let size = size.map(|n| n.max(1));
        let (forward, inverse) = T::real_plans(size[2]);
        RealFft {
            size,
            forward,
            inverse,
            across: Across::new(size[0], size[1]),
        }
    }

    /// Plans transforms of images.
    #[must_use]
    pub fn plane(width: usize, height: usize) -> RealFft<T> {
        RealFft::new([1, height, width])
    }

    /// The size `[z, y, x]`.
    #[must_use]
    pub fn size(&self) -> [usize; 3] {
        self.size
    }

    /// Number of values kx that a spectrum holds, x / 2 + 1.
    #[must_use]
    pub fn columns(&self) -> usize {
        self.size[2] / 2 + 1
    }

    /// Number of complex numbers of a spectrum.
    #[must_use]
    pub fn spectrum_len(&self) -> usize {
        self.size[0] * self.size[1] * self.columns()
    }

    /// The spectrum of `values`, x fastest. What is missing at the end counts as zero.
    ///
    /// # Errors
    /// When cancelled.
    pub fn forward(&self, run: &dyn Run, values: &[T]) -> Result<Vec<Complex<T>>, Cancelled> {
        let width = self.size[2];
        self.forward_rows(run, &|row, to| {
            let from = values.get(row * width..).unwrap_or_default();
            let count = from.len().min(width);
            to[..count].copy_from_slice(&from[..count]);
            count > 0
        })
    }

    /// The spectrum of an image whose rows `fill` writes; each comes as zeros. Windows and margins
    /// of zeros need no image of their own that way.
    ///
    /// # Errors
    /// When cancelled.
    pub fn forward_rows(
        &self,
        run: &dyn Run,
        fill: Fill<'_, T>,
    ) -> Result<Vec<Complex<T>>, Cancelled> {
        let (width, columns) = (self.size[2], self.columns());
        let mut rows = scratch(self.spectrum_len());
        chunks_mut(run, &mut rows, LINES * columns, &|i, rows| {
            if run.cancelled() {
                return;
            }
            let mut values = vec![T::default(); width];
            let mut room = scratch(self.forward.get_scratch_len());
            for (j, to) in rows.chunks_exact_mut(columns).enumerate() {
                values.fill(T::default());
                if fill(i * LINES + j, &mut values) {
                    let done = self
                        .forward
                        .process_with_scratch(&mut values, to, &mut room);
                    debug_assert!(done.is_ok(), "all lengths come from the plan");
                }
            }
        });
        go_on(run)?;
        self.across.forward(run, rows, columns)
    }

    /// The image or volume of a spectrum, x fastest. A spectrum of another length counts as zero
    /// where it is too short.
    ///
    /// # Errors
    /// When cancelled.
    pub fn inverse(
        &self,
        run: &dyn Run,
        mut spectrum: Vec<Complex<T>>,
    ) -> Result<Vec<T>, Cancelled> {
        spectrum.resize(self.spectrum_len(), Complex::default());
        let [depth, height, width] = self.size;
        let columns = self.columns();
        let scale = T::of(1.0 / (depth as f64 * height as f64 * width as f64));
        let planes = self.across.inverse(run, spectrum)?;
        let mut values = vec![T::default(); depth * height * width];
        for (from, to) in planes
            .chunks(columns * height)
            .zip(values.chunks_mut(width * height))
        {
            chunks_mut(run, to, LINES * width, &|i, to| {
                if run.cancelled() {
                    return;
                }
                let mut lines = scratch(to.len() / width * columns);
                gather(from, height, i * LINES, &mut lines);
                let mut room = scratch(self.inverse.get_scratch_len());
                for (line, to) in lines.chunks_exact_mut(columns).zip(to.chunks_mut(width)) {
                    self.row_back(line, to, &mut room);
                    to.iter_mut().for_each(|value| *value = *value * scale);
                }
            });
            go_on(run)?;
        }
        Ok(values)
    }

    fn row_back(&self, line: &mut [Complex<T>], to: &mut [T], room: &mut [Complex<T>]) {
        // These are real in the spectrum of real numbers; what rounding left would be refused.
        if let Some(first) = line.first_mut() {
            first.im = T::zero();
        }
        if self.size[2].is_multiple_of(2)
            && let Some(last) = line.last_mut()
        {
            last.im = T::zero();
        }
        let done = self.inverse.process_with_scratch(line, to, room);
        debug_assert!(done.is_ok(), "all lengths come from the plan");
    }
}

/// Transforms of complex images or volumes of one size.
pub struct ComplexFft<T: Real> {
    size: [usize; 3],
    x: [Plan<T>; 2],
    across: Across<T>,
}

impl<T: Real> ComplexFft<T> {
    /// Plans transforms of the size `[z, y, x]`; an axis has at least one sample.
    #[must_use]
    pub fn new(size: [usize; 3]) -> ComplexFft<T> {
        let size = size.map(|n| n.max(1));
        ComplexFft {
            size,
            x: T::complex_plans(size[2]),
            across: Across::new(size[0], size[1]),
        }
    }

    /// The spectrum, `[kx][ky][kz]` with kz fastest, of `values`, x fastest. What is missing at the
    /// end counts as zero.
    ///
    /// # Errors
    /// When cancelled.
    pub fn forward(
        &self,
        run: &dyn Run,
        mut values: Vec<Complex<T>>,
    ) -> Result<Vec<Complex<T>>, Cancelled> {
        values.resize(self.size.iter().product(), Complex::default());
        transform(run, &mut values, &self.x[0])?;
        self.across.forward(run, values, self.size[2])
    }

    /// The image or volume, x fastest, of a spectrum.
    ///
    /// # Errors
    /// When cancelled.
    pub fn inverse(
        &self,
        run: &dyn Run,
        mut spectrum: Vec<Complex<T>>,
    ) -> Result<Vec<Complex<T>>, Cancelled> {
        let [_, height, width] = self.size;
        let all: usize = self.size.iter().product();
        spectrum.resize(all, Complex::default());
        let planes = self.across.inverse(run, spectrum)?;
        let mut values = scratch(all);
        let plane = width * height;
        for (from, to) in planes.chunks(plane).zip(values.chunks_mut(plane)) {
            transpose_and_transform(run, from, height, to, &self.x[1])?;
        }
        let scale = T::of(1.0 / all as f64);
        chunks_mut(run, &mut values, 1 << 16, &|_, values| {
            values.iter_mut().for_each(|value| *value = *value * scale);
        });
        Ok(values)
    }
}

#[cfg(test)]
mod tests;
