//! Minimum of a function without derivatives.

/// The simplex method (Nelder and Mead, The Computer Journal 7, 308, 1965) from `start`, with first
/// steps `step`, until the values of the simplex agree to 1e-10 or `most` calls were made. Gives the
/// place and its value.
pub fn minimise<const N: usize>(
    start: [f64; N],
    step: f64,
    most: usize,
    value: impl Fn(&[f64; N]) -> f64,
) -> ([f64; N], f64) {
    let mut corners: Vec<([f64; N], f64)> = (0..=N)
        .map(|corner| {
            let mut at = start;
            if let Some(x) = corner.checked_sub(1).and_then(|axis| at.get_mut(axis)) {
                *x += step;
            }
            (at, value(&at))
        })
        .collect();
    let mut calls = N + 1;
    loop {
        corners.sort_by(|a, b| a.1.total_cmp(&b.1));
        let (best, worst) = (corners[0], corners[N]);
        let flat = (worst.1 - best.1).abs() <= 1e-10 * (worst.1.abs() + best.1.abs());
        if flat || calls >= most || !best.1.is_finite() {
            return best;
        }
        let centre: [f64; N] = std::array::from_fn(|axis| {
            corners[..N].iter().map(|(at, _)| at[axis]).sum::<f64>() / N as f64
        });
        let along = |share: f64| -> ([f64; N], f64) {
            let at =
                std::array::from_fn(|axis| centre[axis] + share * (worst.0[axis] - centre[axis]));
            (at, value(&at))
        };
        let reflected = along(-1.0);
        calls += 1;
        let taken = if reflected.1 < best.1 {
            calls += 1;
            let expanded = along(-2.0);
            Some(if expanded.1 < reflected.1 {
                expanded
            } else {
                reflected
            })
        } else if reflected.1 < corners[N - 1].1 {
            Some(reflected)
        } else {
            calls += 1;
            let contracted = along(if reflected.1 < worst.1 { -0.5 } else { 0.5 });
            (contracted.1 < worst.1.min(reflected.1)).then_some(contracted)
        };
        if let Some(taken) = taken {
            corners[N] = taken;
        } else {
            for corner in &mut corners[1..] {
                let at = std::array::from_fn(|axis| 0.5 * (best.0[axis] + corner.0[axis]));
                *corner = (at, value(&at));
            }
            calls += N;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_bent_valley_is_followed() {
        let rosenbrock = |p: &[f64; 2]| (1.0 - p[0]).powi(2) + 100.0 * (p[1] - p[0] * p[0]).powi(2);
        let (at, value) = minimise([-1.2, 1.0], 0.5, 2000, rosenbrock);
        assert!(value < 1e-9 && (at[0] - 1.0).abs() < 1e-4, "{at:?}");
        let (_, value) = minimise([0.0; 3], 1.0, 100, |_| f64::NAN);
        assert!(value.is_nan());
    }
}
