//! Decorrelation analysis (Descloux, Grussmayer and Radenovic, Nature Methods 16, 918, 2019).
//!
//! The spectrum I is correlated with its normalised self I / |I| inside a growing disc:
//!
//! d(r) = sum over |k| < r of |I| / sqrt(sum of |I|^2 times number of |k| < r)
//!
//! While the disc takes in signal d grows, while it takes in noise it falls; so the maximum is where
//! the signal ends. Of images that are high-passed more and more, the maximum farthest out counts.

/// A maximum counts if the curve falls by this much behind it.
const FALL: f64 = 5e-4;

/// High-passed copies in each of the two passes.
const FILTERS: usize = 10;

/// Sums over the rings of a spectrum: |I|, |I|^2, and the number of frequencies.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Amplitudes {
    /// Sum of |I|.
    pub first: Vec<f64>,
    /// Sum of |I|^2.
    pub second: Vec<f64>,
    /// Number of frequencies.
    pub count: Vec<f64>,
    /// Distance of two rings, cycles per pixel.
    pub step: f64,
}

/// The maximum of a curve.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Peak {
    /// Width of the Gaussian that was taken away, pixels; infinite for the image as it is.
    pub sigma: f64,
    /// Ring of the maximum; NaN if there is none.
    pub ring: f64,
    /// Its height; NaN if there is none.
    pub height: f64,
}

impl Amplitudes {
    /// d(r) after the image was high-passed by taking its Gaussian blur of `sigma` pixels away.
    #[must_use]
    pub fn curve(&self, sigma: f64) -> Vec<f64> {
        let filter = |ring: usize| {
            let q = ring as f64 * self.step;
            let blur = (-2.0 * (std::f64::consts::PI * sigma * q).powi(2)).exp();
            if sigma.is_finite() { 1.0 - blur } else { 1.0 }
        };
        let rings = || 1..self.count.len();
        let power: f64 = rings().map(|i| self.second[i] * filter(i).powi(2)).sum();
        let (mut sum, mut count) = (0.0, 0.0);
        let mut curve = vec![0.0];
        for i in rings() {
            sum += self.first[i] * filter(i);
            count += self.count[i];
            let norm = (power * count).sqrt();
            curve.push(if norm > 0.0 { sum / norm } else { 0.0 });
        }
        curve
    }

    fn peak(&self, sigma: f64) -> Peak {
        let (ring, height) = maximum(&self.curve(sigma)).unwrap_or((f64::NAN, f64::NAN));
        Peak {
            sigma,
            ring,
            height,
        }
    }

    /// The maxima of the image as it is and of its high-passed copies, in that order, and which of
    /// them lies farthest out.
    #[must_use]
    pub fn peaks(&self) -> (Vec<Peak>, Option<usize>) {
        let mut peaks = vec![self.peak(f64::INFINITY)];
        let nyquist = self.count.len().saturating_sub(1) as f64;
        let start = peaks[0].ring / nyquist;
        let size = 1.0 / self.step;
        // Taking away a blur that is wide against the finest detail changes little.
        let widest = if start > 0.0 { 2.0 / start } else { size / 4.0 };
        let widths = |from: f64, to: f64| {
            let share = move |i: usize| i as f64 / (FILTERS - 1) as f64;
            (0..FILTERS).map(move |i| (from.ln() + (to / from).ln() * share(i)).exp())
        };
        peaks.extend(widths(widest.max(0.2), 0.15).map(|sigma| self.peak(sigma)));
        if let Some(best) = farthest(&peaks) {
            let near = |i: usize| peaks.get(i).map(|p| p.sigma).filter(|s| s.is_finite());
            let from = near(best.saturating_sub(1)).unwrap_or(2.0 * widest);
            let to = near(best + 1).unwrap_or(0.15);
            peaks.extend(widths(from, to).map(|sigma| self.peak(sigma)));
        }
        let best = farthest(&peaks);
        (peaks, best)
    }
}

fn farthest(peaks: &[Peak]) -> Option<usize> {
    let mut best: Option<usize> = None;
    for (i, peak) in peaks.iter().enumerate() {
        let farther = best.is_none_or(|best| peak.ring > peaks[best].ring);
        if peak.ring.is_finite() && farther {
            best = Some(i);
        }
    }
    best
}

/// The highest point behind which the curve falls by [`FALL`], refined by a parabola through its
/// neighbours.
fn maximum(curve: &[f64]) -> Option<(f64, f64)> {
    let mut lowest = f64::INFINITY;
    let mut best: Option<usize> = None;
    for i in (1..curve.len()).rev() {
        lowest = lowest.min(curve[i]);
        let higher = best.is_none_or(|best| curve[i] >= curve[best]);
        if curve[i] - lowest >= FALL && higher {
            best = Some(i);
        }
    }
    let i = best?;
    let (before, at, behind) = (curve[i - 1], curve[i], curve.get(i + 1).copied()?);
    let bend = before - 2.0 * at + behind;
    let aside = if bend < 0.0 {
        (0.5 * (before - behind) / bend).clamp(-0.5, 0.5)
    } else {
        0.0
    };
    Some((i as f64 + aside, at))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rings of a spectrum with mean amplitude `amplitude(ring)`.
    fn amplitudes(amplitude: impl Fn(f64) -> f64) -> Amplitudes {
        let mut out = Amplitudes {
            step: 1.0 / 512.0,
            ..Amplitudes::default()
        };
        for ring in 0..=256 {
            let count = if ring == 0 {
                1.0
            } else {
                std::f64::consts::TAU * f64::from(ring)
            };
            let a = amplitude(f64::from(ring));
            // Rayleigh: the mean square is 4 / pi times the square of the mean.
            out.first.push(count * a);
            out.second.push(count * a * a * 4.0 / std::f64::consts::PI);
            out.count.push(count);
        }
        out
    }

    #[test]
    fn the_end_of_a_band_is_found() {
        for end in [60.0, 130.0, 200.0] {
            let band = amplitudes(|ring| if ring <= end { 1.0 } else { 0.1 });
            let (peaks, best) = band.peaks();
            let found = peaks[best.unwrap()].ring;
            assert!((found - end).abs() <= 1.0, "{found} {end}");
        }
    }

    #[test]
    fn high_passes_find_weak_detail_behind_strong_coarse_structure() {
        let soft =
            amplitudes(|ring| (-ring / 12.0).exp() + if ring <= 120.0 { 1e-2 } else { 1e-3 });
        let (peaks, best) = soft.peaks();
        assert!(peaks[0].ring < 60.0, "{:?}", peaks[0]);
        let found = peaks[best.unwrap()].ring;
        assert!((found - 120.0).abs() < 3.0, "{found}");
    }

    #[test]
    fn noise_has_no_maximum() {
        let (peaks, best) = amplitudes(|_| 1.0).peaks();
        assert!(best.is_none() && peaks.iter().all(|p| p.ring.is_nan()));
        assert!(Amplitudes::default().peaks().1.is_none());
        assert!(amplitudes(|_| 0.0).peaks().1.is_none());
    }

    #[test]
    fn the_maximum_is_refined() {
        let curve: Vec<f64> = (0..50)
            .map(|i| 1.0 - (f64::from(i) - 20.3).powi(2) / 400.0)
            .collect();
        let (at, height) = maximum(&curve).unwrap();
        assert!((at - 20.3).abs() < 1e-9 && height > 0.999);
        assert!(maximum(&[0.0, 0.5, 1.0]).is_none());
    }
}
