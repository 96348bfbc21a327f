//! Bins of distance, decided on squared distances, so that no rounding of a root moves a pair.

/// Bins of equal width from distance 0.
#[derive(Clone, Debug)]
pub struct Bins {
    step: f64,
    count: usize,
    /// Bin k holds `limits[k] < squared distance <= limits[k + 1]`; the last bin holds the rest.
    limits: Vec<f64>,
}

impl Bins {
    /// Bin k holds distances above `k step` and up to `(k + 1) step`; the first also 0.
    #[must_use]
    pub fn up_to(step: f64, count: usize) -> Self {
        let mut limits: Vec<f64> = (0..=count).map(|k| (k as f64 * step).powi(2)).collect();
        limits[0] = -1.0;
        limits.push(f64::INFINITY);
        Self {
            step,
            count,
            limits,
        }
    }

    /// Bin k holds distances from `k step` and below `(k + 1) step`.
    #[must_use]
    pub fn from(step: f64, count: usize) -> Self {
        let mut bins = Self::up_to(step, count);
        for limit in &mut bins.limits[1..=count] {
            *limit = limit.next_down();
        }
        bins
    }

    /// Number of bins, without that of larger distances.
    #[must_use]
    #[allow(clippy::len_without_is_empty)]
    pub fn len(&self) -> usize {
        self.count
    }

    /// Width of a bin, nm.
    #[must_use]
    pub fn step(&self) -> f64 {
        self.step
    }

    /// Upper end of the last bin, nm.
    #[must_use]
    pub fn radius(&self) -> f64 {
        self.step * self.count as f64
    }

    /// Upper end of each bin, nm.
    #[must_use]
    pub fn upper(&self) -> Vec<f64> {
        (1..=self.count).map(|k| k as f64 * self.step).collect()
    }

    /// Largest squared distance that a bin holds.
    #[must_use]
    pub fn limit(&self) -> f64 {
        self.limits[self.count]
    }

    /// Bin of a squared distance; [`Bins::len`] if it is larger than all.
    #[inline]
    #[must_use]
    pub fn bin(&self, squared: f64) -> usize {
        let guess = (squared.sqrt() / self.step).min(self.count as f64);
        self.settle(guess as usize, squared)
    }

    /// The bin, from a guess that is off by at most one.
    #[inline(always)]
    pub(crate) fn settle(&self, guess: usize, squared: f64) -> usize {
        let guess = guess.min(self.count);
        let [low, high] = match self.limits.get(guess..guess + 2) {
            Some(&[low, high]) => [low, high],
            _ => return self.count,
        };
        guess + usize::from(squared > high) - usize::from(squared <= low)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn edges_belong_to_one_bin() {
        for step in [0.1, 0.7, 10.0, 1e-3, 3e5] {
            let (upper, lower) = (Bins::up_to(step, 500), Bins::from(step, 500));
            for k in 1..=500 {
                let edge = (k as f64 * step).powi(2);
                assert_eq!(upper.bin(edge), k - 1, "{step} {k}");
                assert_eq!(upper.bin(edge.next_up()), k);
                assert_eq!(lower.bin(edge), k);
                assert_eq!(lower.bin(edge.next_down()), k - 1);
            }
            assert_eq!((upper.bin(0.0), lower.bin(0.0)), (0, 0));
            assert_eq!(upper.bin(f64::INFINITY), 500);
        }
    }
}
