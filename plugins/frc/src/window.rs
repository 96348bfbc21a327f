//! The window that takes the field to zero at its edges.

/// Tukey's window of `size` samples: cosine flanks over the share `taper` of the samples (half of
/// it at each end), 1 between.
#[must_use]
pub fn tukey(size: usize, taper: f64) -> Vec<f64> {
    let flank = 0.5 * taper.clamp(0.0, 1.0) * size as f64;
    (0..size)
        .map(|i| {
            // Symmetric, and no sample is lost: the ends lie half a sample outside.
            let depth = (i as f64 + 0.5).min(size as f64 - i as f64 - 0.5);
            if depth < flank {
                0.5 - 0.5 * (std::f64::consts::PI * depth / flank).cos()
            } else {
                1.0
            }
        })
        .collect()
}

/// Windows of the axes z, y, x, and what they do to the statistics of a transform.
#[derive(Clone, Debug)]
pub struct Window {
    /// The weights along each axis; their product weighs a voxel.
    pub axes: [Vec<f64>; 3],
}

impl Window {
    /// Tukey's window over each axis that has more than one sample.
    #[must_use]
    pub fn new(size: [usize; 3], taper: f64) -> Window {
        let axes = size.map(|n| if n > 1 { tukey(n, taper) } else { vec![1.0] });
        Window { axes }
    }

    /// The weights along x of the row of voxels `line` (counted through all planes) are the axis's
    /// times this.
    #[must_use]
    pub fn line(&self, line: usize) -> f64 {
        let [z, y, _] = &self.axes;
        z[line / y.len()] * y[line % y.len()]
    }

    /// Sum of the n-th powers of all weights.
    #[must_use]
    pub fn power(&self, n: i32) -> f64 {
        let sum = |axis: &Vec<f64>| axis.iter().map(|w| w.powi(n)).sum::<f64>();
        self.axes.iter().map(sum).product()
    }

    /// Independent frequencies for each frequency of a ring of a transform of `all` samples.
    ///
    /// Neighbouring frequencies are correlated by the window, and by zeros around it: of all
    /// frequencies (sum w^2)^2 / (all sum w^4) are independent. A ring is one frequency thick, so
    /// that only the correlation along it counts: d - 1 of d dimensions.
    #[must_use]
    pub fn independent(&self, all: usize) -> f64 {
        let whole = self.power(2).powi(2) / (all as f64 * self.power(4));
        let dimensions = self
            .axes
            .iter()
            .filter(|axis| axis.len() > 1)
            .count()
            .max(1) as f64;
        whole.powf((dimensions - 1.0) / dimensions)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_window_is_symmetric_and_flat_between_its_flanks() {
        for (size, taper) in [(16, 0.25), (17, 0.5), (40, 1.0), (9, 0.0)] {
            let window = tukey(size, taper);
            for (a, b) in window.iter().zip(window.iter().rev()) {
                assert!((a - b).abs() < 1e-15 && *a > 0.0 && *a <= 1.0);
            }
            let flat = window.iter().filter(|w| **w == 1.0).count();
            assert!(
                flat as f64 >= (1.0 - taper) * size as f64 - 1.0,
                "{window:?}"
            );
        }
        assert!((tukey(1000, 0.5).iter().sum::<f64>() - 750.0).abs() < 1e-9);
    }

    #[test]
    fn zeros_and_flanks_cost_independent_frequencies() {
        let flat = Window::new([1, 20, 30], 0.0);
        assert!((flat.independent(600) - 1.0).abs() < 1e-12);
        assert!((flat.independent(1200) - 0.5_f64.sqrt()).abs() < 1e-12);
        let tapered = Window::new([1, 200, 300], 0.25);
        assert!((0.8..0.95).contains(&tapered.independent(60_000)));
        assert_eq!(tapered.line(3), tapered.axes[1][3]);
    }
}
