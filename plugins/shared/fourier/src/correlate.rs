//! Cross-correlation of images and volumes.

use crate::{Complex, Fill, Real, RealFft, good_size};
use puncta_sdk::run::{Cancelled, Run, chunks_mut};

/// Cross-correlations of images or volumes of one size, for shifts up to a largest one.
///
/// The images are padded with zeros so that no shift up to the largest wraps around.
pub struct Correlator<T: Real> {
    size: [usize; 3],
    reach: [usize; 3],
    plan: RealFft<T>,
}

/// Cross-correlation by shift; x fastest, shift 0 in the middle.
#[derive(Clone, Debug, PartialEq)]
pub struct Correlation<T> {
    /// Largest shift along z, y, x; an axis has `2 reach + 1` values.
    pub reach: [usize; 3],
    /// The sums of products.
    pub values: Vec<T>,
}

impl<T: Real> Correlator<T> {
    /// For images or volumes of `size` `[z, y, x]` and shifts up to `reach` samples along each axis
    /// (at most the size less one).
    #[must_use]
    pub fn new(size: [usize; 3], reach: [usize; 3]) -> Correlator<T> {
        let size = size.map(|n| n.max(1));
        let mut padded = [1; 3];
        let mut kept = [0; 3];
        for axis in 0..3 {
            kept[axis] = reach[axis].min(size[axis] - 1);
            if size[axis] > 1 {
                padded[axis] = good_size(size[axis] + kept[axis]);
            }
        }
        Correlator {
            size,
            reach: kept,
            plan: RealFft::new(padded),
        }
    }

    /// The size that is transformed, `[z, y, x]`.
    #[must_use]
    pub fn padded(&self) -> [usize; 3] {
        self.plan.size()
    }

    /// Bytes of one spectrum.
    #[must_use]
    pub fn spectrum_bytes(&self) -> usize {
        self.plan.spectrum_len() * size_of::<Complex<T>>()
    }

    /// The spectrum of an image, x fastest.
    ///
    /// # Errors
    /// When cancelled.
    pub fn spectrum(&self, run: &dyn Run, values: &[T]) -> Result<Vec<Complex<T>>, Cancelled> {
        let width = self.size[2];
        self.spectrum_rows(run, &|row, to| {
            let from = values.get(row * width..).unwrap_or_default();
            let count = from.len().min(width);
            to[..count].copy_from_slice(&from[..count]);
            count > 0
        })
    }

    /// The spectrum of an image whose rows (of the unpadded size, counted through all planes)
    /// `fill` writes; each comes as zeros.
    ///
    /// # Errors
    /// When cancelled.
    pub fn spectrum_rows(
        &self,
        run: &dyn Run,
        fill: Fill<'_, T>,
    ) -> Result<Vec<Complex<T>>, Cancelled> {
        let [depth, height, width] = self.size;
        let padded = self.plan.size()[1];
        self.plan.forward_rows(run, &|row, to| {
            let (z, y) = (row / padded, row % padded);
            z < depth && y < height && fill(z * height + y, &mut to[..width])
        })
    }

    /// The correlation of two spectra: its value at shift d is the sum over i of a[i + d] b[i], so
    /// that its maximum is at d when a is b moved by d.
    ///
    /// # Errors
    /// When cancelled.
    pub fn correlate(
        &self,
        run: &dyn Run,
        a: &[Complex<T>],
        b: &[Complex<T>],
    ) -> Result<Correlation<T>, Cancelled> {
        let mut product = vec![Complex::default(); self.plan.spectrum_len()];
        const CHUNK: usize = 1 << 15;
        chunks_mut(run, &mut product, CHUNK, &|i, to| {
            let (a, b) = (a.get(i * CHUNK..), b.get(i * CHUNK..));
            let pairs = a.unwrap_or_default().iter().zip(b.unwrap_or_default());
            for (to, (a, b)) in to.iter_mut().zip(pairs) {
                *to = *a * b.conj();
            }
        });
        let whole = self.plan.inverse(run, product)?;
        Ok(self.crop(&whole))
    }

    fn crop(&self, whole: &[T]) -> Correlation<T> {
        let padded = self.plan.size();
        let places = |axis: usize| {
            let (n, reach) = (padded[axis], self.reach[axis]);
            (0..=2 * reach).map(move |i| (i + n - reach) % n)
        };
        let mut values = Vec::with_capacity(self.reach.iter().map(|r| 2 * r + 1).product());
        for z in places(0) {
            for y in places(1) {
                let row = (z * padded[1] + y) * padded[2];
                values.extend(places(2).map(|x| whole[row + x]));
            }
        }
        Correlation {
            reach: self.reach,
            values,
        }
    }
}

impl<T: Real> Correlation<T> {
    /// Number of values along z, y, x.
    #[must_use]
    pub fn size(&self) -> [usize; 3] {
        self.reach.map(|reach| 2 * reach + 1)
    }

    /// The shift of value `i`, `[z, y, x]`.
    #[must_use]
    pub fn shift(&self, i: usize) -> [isize; 3] {
        let [_, height, width] = self.size();
        let place = [i / (width * height), i / width % height, i % width];
        std::array::from_fn(|axis| place[axis] as isize - self.reach[axis] as isize)
    }

    /// Index of the largest value, the first of equal ones; none when all are NaN.
    #[must_use]
    pub fn peak(&self) -> Option<usize> {
        let mut best: Option<usize> = None;
        for (i, value) in self.values.iter().enumerate() {
            let larger = best.is_none_or(|best| value.wide() > self.values[best].wide());
            if larger && !value.wide().is_nan() {
                best = Some(i);
            }
        }
        best
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use puncta_testkit::{Stopped, Threads};

    fn image(size: [usize; 3]) -> Vec<f64> {
        (0..size.iter().product::<usize>() as u64)
            .map(|i| ((i + 1).wrapping_mul(0x9E37_79B9_7F4A_7C15) >> 40) as f64 / 1e6 % 1.0)
            .collect()
    }

    fn at(values: &[f64], size: [usize; 3], place: [isize; 3]) -> f64 {
        let inside = (0..3).all(|a| (0..size[a] as isize).contains(&place[a]));
        if !inside {
            return 0.0;
        }
        let [z, y, x] = place.map(|p| p as usize);
        values[(z * size[1] + y) * size[2] + x]
    }

    #[test]
    fn as_by_definition() {
        for (size, reach) in [
            ([1, 9, 7], [0, 3, 2]),
            ([1, 5, 6], [9, 9, 9]),
            ([4, 3, 5], [1, 2, 4]),
        ] {
            let (a, b) = (
                image(size),
                image(size).into_iter().rev().collect::<Vec<_>>(),
            );
            let correlator = Correlator::new(size, reach);
            let spectrum = |v: &[f64]| correlator.spectrum(&Threads(2), v).unwrap();
            let found = correlator
                .correlate(&Threads(2), &spectrum(&a), &spectrum(&b))
                .unwrap();
            assert_eq!(found.values.len(), found.size().iter().product::<usize>());
            for (i, value) in found.values.iter().enumerate() {
                let shift = found.shift(i);
                let mut sum = 0.0;
                for (place, b) in b.iter().enumerate() {
                    let here = [
                        (place / (size[1] * size[2])) as isize,
                        (place / size[2] % size[1]) as isize,
                        (place % size[2]) as isize,
                    ];
                    let moved = std::array::from_fn(|axis| here[axis] + shift[axis]);
                    sum += b * at(&a, size, moved);
                }
                assert!((value - sum).abs() < 1e-12, "{shift:?} {value} {sum}");
            }
        }
    }

    #[test]
    fn the_peak_is_the_shift() {
        let size = [1, 40, 50];
        let b = image(size);
        let moved: Vec<f64> = (0..2000)
            .map(|i| at(&b, size, [0, i / 50 - 3, i % 50 + 7]))
            .collect();
        let correlator = Correlator::new(size, [0, 10, 10]);
        let spectrum = |v: &[f64]| correlator.spectrum(&Threads(2), v).unwrap();
        let mean = b.iter().sum::<f64>() / 2000.0;
        let flat = |v: &[f64]| v.iter().map(|v| v - mean).collect::<Vec<f64>>();
        let found = correlator
            .correlate(&Threads(2), &spectrum(&flat(&moved)), &spectrum(&flat(&b)))
            .unwrap();
        assert_eq!(found.shift(found.peak().unwrap()), [0, 3, -7]);
        assert!(correlator.spectrum(&Stopped, &b).is_err());
        let empty = Correlation {
            reach: [0; 3],
            values: vec![f64::NAN],
        };
        assert_eq!(empty.peak(), None);
    }
}
