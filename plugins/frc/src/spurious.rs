//! Correlation of the halves by repeats of one molecule (Nieuwenhuizen et al., Nature Methods 10,
//! 557, 2013, supplementary note on spurious correlations).
//!
//! If molecules are found again Q times on average, the sum of Re F1 F2* over a ring of n
//! frequencies holds n Q W H(q) / 4 that says nothing of the structure, where W is the number of
//! localisations (each with its squared window) and H(q) the mean of exp(-4 pi^2 sigma^2 q^2) over
//! their precisions, times the transfer of the square pixels. The sum over n H(q) falls with the
//! structure and ends in a plateau, from which Q follows.

use crate::curve::Sums;

/// Least H(q) that the plateau is looked for at: beyond, noise is blown up.
const LEAST: f64 = 0.1;
/// Classes of precisions.
const CLASSES: usize = 512;

/// What the repeats are.
#[derive(Clone, Debug, PartialEq)]
pub struct Spurious {
    /// Repeats of a localisation, on average.
    pub q: f64,
    /// The ring sums without their part.
    pub sums: Vec<Sums>,
}

/// H(q) for each ring of `step`; `variances` are the squared precisions along an axis, nm^2, of the
/// localisations; those that are not finite and positive do not count. None without any.
#[must_use]
pub fn decay(variances: &[f64], rings: usize, step: f64, pixel: f64) -> Option<Vec<f64>> {
    let usable = || {
        variances
            .iter()
            .copied()
            .filter(|v| *v > 0.0 && v.is_finite())
    };
    let (low, high) = usable().fold((f64::INFINITY, 0.0_f64), |(l, h), v| (l.min(v), h.max(v)));
    if low > high {
        return None;
    }
    let width = (high / low).ln() / (CLASSES - 1) as f64;
    let mut classes = vec![(0.0, 0.0); CLASSES];
    for variance in usable() {
        let class = if width > 0.0 {
            (variance / low).ln() / width
        } else {
            0.0
        };
        let class = &mut classes[(class as usize).min(CLASSES - 1)];
        class.0 += 1.0;
        class.1 += variance;
    }
    classes.retain(|class| class.0 > 0.0);
    let all: f64 = classes.iter().map(|class| class.0).sum();
    let one = |ring: usize| {
        let q = ring as f64 * step;
        let turn = (std::f64::consts::TAU * q).powi(2);
        let sum: f64 = classes
            .iter()
            .map(|(count, sum)| count * (-turn * sum / count).exp())
            .sum();
        sum / all * pixels(q * pixel)
    };
    Some((0..rings).map(one).collect())
}

/// Mean over all directions of the squared transfer of a square pixel, at `q` cycles a pixel.
fn pixels(q: f64) -> f64 {
    let sinc = |x: f64| {
        let x = std::f64::consts::PI * x;
        if x.abs() < 1e-9 { 1.0 } else { x.sin() / x }
    };
    let angles = 32;
    let sum: f64 = (0..angles)
        .map(|i| {
            let angle = (f64::from(i) + 0.5) / f64::from(angles) * std::f64::consts::FRAC_PI_2;
            (sinc(q * angle.cos()) * sinc(q * angle.sin())).powi(2)
        })
        .sum();
    sum / f64::from(angles)
}

/// Estimates Q from the plateau and takes the repeats out of the ring sums of the splits. `weight`
/// is W, `frequencies` the number of frequencies of each ring. None when H is small everywhere.
#[must_use]
pub fn remove(
    splits: &[Sums],
    frequencies: &[f64],
    decay: &[f64],
    weight: f64,
) -> Option<Spurious> {
    let mean = |ring: usize| {
        let sum: f64 = splits.iter().map(|sums| sums[ring][0]).sum();
        sum / (splits.len() as f64 * frequencies[ring])
    };
    let last = decay.iter().take_while(|h| **h >= LEAST).count();
    // The structure falls with the frequency, so that the least of the means from a ring to the last
    // has the least of it; a quarter of the rings are in each, lest chance decides.
    let (mut sum, mut all, mut plateau) = (0.0, 0.0, None);
    for ring in (1..last).rev() {
        let weight = frequencies[ring] * decay[ring].powi(2);
        sum += weight * mean(ring) / decay[ring];
        all += weight;
        let least = plateau.is_none_or(|least| sum / all < least);
        if ring <= last * 3 / 4 && least {
            plateau = Some(sum / all);
        }
    }
    let plateau = plateau?.max(0.0);
    let without = |sums: &Sums| -> Sums {
        let rings = sums.iter().enumerate();
        rings
            .map(|(ring, all)| {
                let part = plateau * frequencies[ring] * decay[ring];
                all.map(|sum| sum - part)
            })
            .collect()
    };
    Some(Spurious {
        q: 4.0 * plateau / weight,
        sums: splits.iter().map(without).collect(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_decay_of_one_precision() {
        let decay = decay(&[100.0; 50], 20, 1e-3, 1e-6).unwrap();
        for (ring, h) in decay.iter().enumerate() {
            let q = ring as f64 * 1e-3;
            let truth = (-4.0 * std::f64::consts::PI.powi(2) * 100.0 * q * q).exp();
            assert!((h - truth).abs() < 1e-9);
        }
        assert!(super::decay(&[0.0, f64::NAN, -1.0], 5, 1.0, 1.0).is_none());
        // Along an axis the pixel's transfer is sinc^2; its mean over directions is near that of
        // 1 - (pi q)^2 / 3 at low frequency.
        assert!((pixels(0.1) - (1.0 - (std::f64::consts::PI * 0.1).powi(2) / 3.0)).abs() < 1e-3);
    }

    #[test]
    fn a_plateau_is_taken_away() {
        let h: Vec<f64> = (0..300).map(|r| (-f64::from(r * r) / 2e4).exp()).collect();
        let n: Vec<f64> = (0..300).map(|r| 1.0 + 6.0 * f64::from(r)).collect();
        let structure = |r: usize| 500.0 * (-(r as f64) / 15.0).exp();
        let sums: Sums = (0..300)
            .map(|r| {
                let cross = n[r] * (structure(r) + 25.0 * h[r]);
                [cross, cross + 50.0 * n[r], cross + 50.0 * n[r]]
            })
            .collect();
        // W = 100: a plateau of 25 is Q = 1.
        let found = remove(&[sums], &n, &h, 100.0).unwrap();
        assert!((found.q - 1.0).abs() < 0.02, "{}", found.q);
        let left = found.sums[0][150][0] / n[150];
        assert!(left.abs() < 0.5, "{left}");
        assert!(remove(&[], &[], &[], 1.0).is_none());
    }
}
