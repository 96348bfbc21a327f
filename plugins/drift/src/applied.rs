//! A drift that is known already: samples of it in a table.

use puncta_sdk::Failure;

use crate::curve::Curve;

/// Samples of a drift.
#[derive(Clone, Debug, Default)]
pub struct Samples {
    /// Times, in any order.
    pub times: Vec<f64>,
    /// Drift at each time, nm; NaN is no sample.
    pub values: Vec<[f64; 3]>,
}

impl Samples {
    /// A curve through the samples: those without a number are left out, those of one time are
    /// averaged, and each is replaced by the median of the `window` samples about it.
    ///
    /// # Errors
    /// When there is no sample with a time and a drift.
    pub fn curve(&self, window: usize) -> Result<Curve, Failure> {
        let finite = |(t, v): &(&f64, &[f64; 3])| t.is_finite() && v.iter().all(|v| v.is_finite());
        let mut samples: Vec<(f64, [f64; 3])> = self
            .times
            .iter()
            .zip(&self.values)
            .filter(finite)
            .map(|(t, v)| (*t, *v))
            .collect();
        samples.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut curve = Curve::default();
        for group in samples.chunk_by(|a, b| a.0 == b.0) {
            curve.times.push(group[0].0);
            let mean =
                |axis: usize| group.iter().map(|s| s.1[axis]).sum::<f64>() / group.len() as f64;
            curve.values.push(std::array::from_fn(mean));
        }
        if curve.times.is_empty() {
            return Err(
                Failure::bad_input("the drift has no row with a time and a drift")
                    .remedy("check which columns hold them"),
            );
        }
        if window > 1 {
            curve.values = medians(&curve.values, window);
        }
        Ok(curve)
    }
}

/// The running median of each axis.
fn medians(values: &[[f64; 3]], window: usize) -> Vec<[f64; 3]> {
    let half = window / 2;
    let at = |i: usize| {
        let near = &values[i.saturating_sub(half)..(i + half + 1).min(values.len())];
        std::array::from_fn(|axis| {
            let mut sorted: Vec<f64> = near.iter().map(|v| v[axis]).collect();
            sorted.sort_unstable_by(f64::total_cmp);
            let middle = sorted.len() / 2;
            if sorted.len() % 2 == 1 {
                sorted[middle]
            } else {
                f64::midpoint(sorted[middle - 1], sorted[middle])
            }
        })
    };
    (0..values.len()).map(at).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn samples_in_any_order_make_a_curve() {
        let samples = Samples {
            times: vec![4.0, 0.0, 2.0, 2.0, f64::NAN, 3.0],
            values: vec![
                [4.0; 3],
                [0.0; 3],
                [1.0; 3],
                [3.0; 3],
                [9.0; 3],
                [f64::NAN; 3],
            ],
        };
        let curve = samples.curve(1).unwrap();
        assert_eq!(curve.times, [0.0, 2.0, 4.0]);
        assert_eq!(
            curve.at(&[1.0], crate::curve::Interpolation::Linear),
            [[1.0; 3]]
        );
        assert!(Samples::default().curve(1).is_err());
        let spike = Samples {
            times: (0..9).map(f64::from).collect(),
            values: (0..9)
                .map(|i| [if i == 4 { 500.0 } else { 1.0 }; 3])
                .collect(),
        };
        assert_eq!(spike.curve(3).unwrap().values, [[1.0; 3]; 9]);
    }
}
