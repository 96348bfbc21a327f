//! Random numbers: one ChaCha8 stream a purpose and a chunk of work, so that neither the number of
//! threads nor another parameter reshuffles a draw.

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

/// What a stream decides.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Purpose {
    /// Turn and shift of each copy.
    Arrangement = 1,
    /// Which sites are kept.
    Keep = 2,
    /// Which samples of the sites are drawn.
    Draw = 3,
    /// Frames of the samples.
    Frame = 4,
    /// Photon numbers.
    Photons = 5,
    /// Localisation errors.
    Jitter = 6,
    /// Positions of the background sites.
    Background = 7,
}

/// The stream of a purpose and a chunk of the seed's generator.
pub fn stream(seed: u64, purpose: Purpose, background: bool, chunk: u64) -> ChaCha8Rng {
    let mut key = [0; 32];
    key[..8].copy_from_slice(&seed.to_le_bytes());
    let mut random = ChaCha8Rng::from_seed(key);
    let group = purpose as u64 * 2 + u64::from(background);
    random.set_stream((group << 56) | chunk);
    random
}

/// Uniform in [0, 1), 53 bits.
#[inline]
pub fn unit(random: &mut impl Rng) -> f64 {
    (random.next_u64() >> 11) as f64 / (1u64 << 53) as f64
}

/// Uniform over the integers below `n`, without bias; 0 for `n` 0 (Lemire, ACM Trans. Model.
/// Comput. Simul. 29, 2019).
#[inline]
pub fn below(n: u64, random: &mut impl Rng) -> u64 {
    let mut product = u128::from(random.next_u64()) * u128::from(n);
    if (product as u64) < n {
        let threshold = n.wrapping_neg().checked_rem(n).unwrap_or_default();
        while (product as u64) < threshold {
            product = u128::from(random.next_u64()) * u128::from(n);
        }
    }
    (product >> 64) as u64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn streams_differ_by_seed_purpose_kind_and_chunk() {
        let mut firsts: Vec<u64> = [
            stream(1, Purpose::Keep, false, 0),
            stream(2, Purpose::Keep, false, 0),
            stream(1, Purpose::Draw, false, 0),
            stream(1, Purpose::Keep, true, 0),
            stream(1, Purpose::Keep, false, 1),
        ]
        .iter_mut()
        .map(Rng::next_u64)
        .collect();
        assert_eq!(firsts[0], stream(1, Purpose::Keep, false, 0).next_u64());
        firsts.sort_unstable();
        firsts.dedup();
        assert_eq!(firsts.len(), 5);
    }

    #[test]
    fn integers_below_a_bound_are_uniform() {
        let mut random = stream(3, Purpose::Draw, false, 0);
        for n in [1u64, 3, 7, 1 << 20] {
            let bins = n.min(7);
            let mut counts = vec![0f64; bins as usize];
            for _ in 0..70_000 {
                counts[(below(n, &mut random) * bins / n) as usize] += 1.0;
            }
            let mean = 70_000.0 / bins as f64;
            let statistic: f64 = counts.iter().map(|c| (c - mean).powi(2) / mean).sum();
            assert!(statistic < 22.5, "{n}: {counts:?}");
        }
        assert_eq!(below(0, &mut random), 0);
    }
}
