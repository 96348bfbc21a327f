//! The precision that photon counting allows.

/// How positions were fitted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Estimator {
    /// Least squares of a Gaussian (Mortensen et al., Nature Methods 7, 377, 2010, equation 6).
    LeastSquares,
    /// Maximum likelihood (Rieger and Stallinga, ChemPhysChem 15, 664, 2014).
    MaximumLikelihood,
}

/// Standard deviation of a position, in the unit of `spot` and `pixel`.
///
/// `photons` were counted in a spot of standard deviation `spot` on pixels of side `pixel` with
/// `background` photons each. With sa^2 = s^2 + a^2/12 and tau = 2 pi sa^2 b / (N a^2) it is
/// sa^2/N (16/9 + 4 tau) for least squares, sa^2/N (1 + 4 tau + sqrt(2 tau / (1 + 4 tau))) for maximum
/// likelihood. An electron-multiplying camera doubles the variance. NaN unless photons, spot and
/// pixel are positive and the background is not negative.
#[must_use]
pub fn precision(
    estimator: Estimator,
    photons: f64,
    spot: f64,
    pixel: f64,
    background: f64,
    multiplied: bool,
) -> f64 {
    let sound = photons > 0.0 && spot > 0.0 && pixel > 0.0 && background >= 0.0;
    if !sound {
        return f64::NAN;
    }
    let square = spot * spot + pixel * pixel / 12.0;
    let tau = std::f64::consts::TAU * square * background / (photons * pixel * pixel);
    let factor = match estimator {
        Estimator::LeastSquares => 16.0 / 9.0 + 4.0 * tau,
        Estimator::MaximumLikelihood => 1.0 + 4.0 * tau + (2.0 * tau / (1.0 + 4.0 * tau)).sqrt(),
    };
    let excess = if multiplied { 2.0 } else { 1.0 };
    (excess * square / photons * factor).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn published_limits() {
        // Without background, least squares is 4/3 of the limit, maximum likelihood reaches it.
        let limit = (130.0_f64.powi(2) + 100.0_f64.powi(2) / 12.0).sqrt() / 1000.0_f64.sqrt();
        let of = |e, b| precision(e, 1000.0, 130.0, 100.0, b, false);
        assert!((of(Estimator::LeastSquares, 0.0) / limit - 4.0 / 3.0).abs() < 1e-12);
        assert!((of(Estimator::MaximumLikelihood, 0.0) / limit - 1.0).abs() < 1e-12);
        // By hand: sa^2 = 17733.33, tau = 2 pi 17733.33 10 / 1e7 = 0.111422;
        // variance 17.73333 (1.777778 + 0.445687) = 39.4295.
        assert!((of(Estimator::LeastSquares, 10.0).powi(2) - 39.4295).abs() < 1e-3);
        // 17.73333 (1 + 0.445687 + sqrt(0.222843 / 1.445687)) = 32.5994.
        assert!((of(Estimator::MaximumLikelihood, 10.0).powi(2) - 32.5994).abs() < 1e-3);
        let doubled = precision(Estimator::LeastSquares, 1000.0, 130.0, 100.0, 0.0, true);
        assert!((doubled / limit - 2.0_f64.sqrt() * 4.0 / 3.0).abs() < 1e-12);
        for (n, s, b) in [(0.0, 1.0, 0.0), (1.0, f64::NAN, 0.0), (1.0, 1.0, -1.0)] {
            assert!(precision(Estimator::LeastSquares, n, s, 1.0, b, false).is_nan());
        }
    }
}
