//! Sums over rings and shells of equal spatial frequency.

use puncta_sdk::run::{Cancelled, Run, map};

/// Rings (images) or shells (volumes) of the spectrum of a real image.
///
/// Ring r holds the frequencies within half a step of r steps, where a step is the distance of two
/// frequencies of the axis that has the fewest for its length; the last ring lies at or below the
/// Nyquist frequency of every axis. Frequencies beyond belong to no ring.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rings {
    size: [usize; 3],
    /// Frequency of index 1 of each axis, in rings.
    axes: [f64; 3],
    step: f64,
    count: usize,
}

impl Rings {
    /// Rings of the spectrum of an image of `size` `[z, y, x]` with voxels of `voxel` (same order,
    /// any unit of length). Axes of one sample do not count.
    #[must_use]
    pub fn new(size: [usize; 3], voxel: [f64; 3]) -> Rings {
        let size = size.map(|n| n.max(1));
        let used = || (0..3).filter(|axis| size[*axis] > 1);
        let frequency = |axis: usize| 1.0 / (size[axis] as f64 * voxel[axis]);
        let step = used().map(frequency).fold(0.0, f64::max);
        let nyquist = used()
            .map(|axis| (size[axis] / 2) as f64 * frequency(axis))
            .fold(f64::INFINITY, f64::min);
        let axes = std::array::from_fn(|axis| {
            if size[axis] > 1 {
                frequency(axis) / step
            } else {
                0.0
            }
        });
        // The sum of a rounded quotient and a little, so that n / 2 steps are n / 2 rings.
        let last = (nyquist / step + 1e-9).floor();
        let last = if last.is_finite() && last > 0.0 {
            last
        } else {
            0.0
        };
        Rings {
            size,
            axes,
            step,
            count: last as usize + 1,
        }
    }

    /// Number of rings, with that of frequency 0.
    #[must_use]
    pub fn count(&self) -> usize {
        self.count
    }

    /// Distance of two rings, in cycles per unit of length.
    #[must_use]
    pub fn step(&self) -> f64 {
        self.step
    }

    /// The frequency of index `k` of `axis` (0 = z), in rings.
    fn place(&self, axis: usize, k: usize) -> f64 {
        let n = self.size[axis];
        let k = if 2 * k > n { n - k } else { k };
        k as f64 * self.axes[axis]
    }

    /// Sums `term(i)` over each ring, where i is the place in the spectrum of
    /// [`crate::RealFft`]; frequencies that the spectrum leaves out count with their conjugate
    /// twin's term. Gives the sums and the number of frequencies of each ring.
    ///
    /// # Errors
    /// When cancelled.
    pub fn sum<const K: usize>(
        &self,
        run: &dyn Run,
        term: &(impl Fn(usize) -> [f64; K] + Sync),
    ) -> Result<(Vec<[f64; K]>, Vec<f64>), Cancelled> {
        let [depth, height, width] = self.size;
        let columns = width / 2 + 1;
        // As many tasks for any number of threads: the order of a sum is part of its bits.
        let block = columns.div_ceil(64);
        let parts = map(run, columns.div_ceil(block), &|task| {
            let mut sums = vec![[0.0; K]; self.count];
            let mut counts = vec![0.0; self.count];
            for kx in task * block..columns.min((task + 1) * block) {
                if run.cancelled() {
                    break;
                }
                let alone = kx == 0 || 2 * kx == width;
                let weight = if alone { 1.0 } else { 2.0 };
                let x = self.place(2, kx);
                for ky in 0..height {
                    let y = self.place(1, ky);
                    let line = (kx * height + ky) * depth;
                    for kz in 0..depth {
                        let z = self.place(0, kz);
                        let ring = ((x * x + y * y + z * z).sqrt() + 0.5) as usize;
                        if ring < self.count {
                            counts[ring] += weight;
                            let term = term(line + kz);
                            for (sum, term) in sums[ring].iter_mut().zip(term) {
                                *sum += weight * term;
                            }
                        }
                    }
                }
            }
            (sums, counts)
        });
        if run.cancelled() {
            return Err(Cancelled);
        }
        let mut sums = vec![[0.0; K]; self.count];
        let mut counts = vec![0.0; self.count];
        for (part, numbers) in parts {
            for (sum, part) in sums.iter_mut().flatten().zip(part.into_iter().flatten()) {
                *sum += part;
            }
            for (count, number) in counts.iter_mut().zip(numbers) {
                *count += number;
            }
        }
        Ok((sums, counts))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::RealFft;
    use puncta_testkit::{Stopped, Threads};

    #[test]
    fn every_frequency_counts_once() {
        for size in [[1, 16, 16], [1, 15, 15], [1, 9, 20], [8, 8, 8], [7, 12, 10]] {
            let rings = Rings::new(size, [3.0, 3.0, 3.0]);
            let (_, counts) = rings.sum::<0>(&Threads(2), &|_| []).unwrap();
            let mut expected = vec![0.0; rings.count()];
            let signed = |k: usize, n: usize| {
                (if 2 * k > n {
                    k as f64 - n as f64
                } else {
                    k as f64
                }) / (3.0 * n as f64)
            };
            for i in 0..size.iter().product::<usize>() {
                let (z, y, x) = (i / (size[1] * size[2]), i / size[2] % size[1], i % size[2]);
                let q = [signed(z, size[0]), signed(y, size[1]), signed(x, size[2])];
                let q = q.iter().map(|q| q * q).sum::<f64>().sqrt();
                let ring = (q / rings.step()).round() as usize;
                if ring < expected.len() {
                    expected[ring] += 1.0;
                }
            }
            assert_eq!(counts, expected, "{size:?}");
        }
    }

    #[test]
    fn a_wave_is_in_its_ring() {
        let (width, height) = (48, 32);
        let wave: Vec<f64> = (0..width * height)
            .map(|i| {
                let (x, y) = ((i % width) as f64, (i / width) as f64);
                // 9 and 4 periods: frequencies 9/48 and 4/32 a pixel.
                (std::f64::consts::TAU * (9.0 * x / 48.0 + 4.0 * y / 32.0)).cos()
            })
            .collect();
        let spectrum = RealFft::plane(width, height)
            .forward(&Threads(2), &wave)
            .unwrap();
        let rings = Rings::new([1, height, width], [1.0, 5.0, 5.0]);
        let (sums, _) = rings
            .sum(&Threads(2), &|i| [spectrum[i].norm_sqr()])
            .unwrap();
        let all: f64 = sums.iter().map(|s| s[0]).sum();
        // sqrt((9/48)^2 + (4/32)^2) * 32 = 7.2 rings of 1/32.
        assert!((sums[7][0] / all - 1.0).abs() < 1e-12);
        assert!((rings.step() - 1.0 / 160.0).abs() < 1e-15);
        assert_eq!(rings.count(), 17);
    }

    #[test]
    fn threads_do_not_change_a_bit_and_a_stop_stops() {
        let rings = Rings::new([1, 300, 301], [1.0; 3]);
        let sums = [1, 2, 3].map(|n| {
            rings
                .sum(&Threads(n), &|i| [(i as f64).sqrt(), 1.0 / (i + 1) as f64])
                .unwrap()
        });
        assert!(sums[0] == sums[1] && sums[1] == sums[2]);
        assert!(rings.sum::<0>(&Stopped, &|_| []).is_err());
        assert_eq!(Rings::new([0, 0, 0], [1.0; 3]).count(), 1);
    }
}
