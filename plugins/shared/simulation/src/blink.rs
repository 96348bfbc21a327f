//! When a site is seen: bursts of consecutive frames.
//!
//! A site with k localisations shows them in bursts whose lengths are geometric, at least one frame,
//! with the given mean; the last burst is cut when the k are used up. Bursts lie at random frames,
//! at least one dark frame apart, so a site is never seen twice in one frame.

use rand_chacha::rand_core::Rng;

use crate::random::{below, unit};

/// Draws the frames in which sites are seen.
pub struct Bursts {
    total: u32,
    /// ln of the probability that a burst goes on for another frame.
    on: f64,
    lengths: Vec<u32>,
    starts: Vec<u32>,
    frames: Vec<u32>,
}

impl Bursts {
    /// Bursts of `mean_on` (>= 1) frames on average within the frames `0..total`.
    pub fn new(total: u32, mean_on: f64) -> Self {
        let on = (-1.0 / mean_on).ln_1p();
        Self {
            total,
            on,
            lengths: vec![],
            starts: vec![],
            frames: vec![],
        }
    }

    /// The `count` increasing frames in which a site is seen; `total` is at least `2 count`.
    pub fn draw(&mut self, count: u32, random: &mut impl Rng) -> &[u32] {
        self.lengths.clear();
        self.starts.clear();
        self.frames.clear();
        let mut left = count;
        while left > 0 {
            let length = self.length(left, random);
            self.lengths.push(length);
            left -= length;
        }
        // Bursts and the dark frames between them are taken out of the total; what remains is
        // shared out before the bursts.
        let gaps = (self.lengths.len() as u32).saturating_sub(1);
        let free = u64::from(self.total.saturating_sub(count + gaps)) + 1;
        self.starts
            .extend(self.lengths.iter().map(|_| below(free, random) as u32));
        self.starts.sort_unstable();
        let mut used = 0;
        for (start, length) in self.starts.iter().zip(&self.lengths) {
            self.frames.extend((start + used)..(start + used + length));
            used += length + 1;
        }
        &self.frames
    }

    /// A geometric number of frames, 1 to `most`, by inversion.
    fn length(&self, most: u32, random: &mut impl Rng) -> u32 {
        if most == 1 || self.on == f64::NEG_INFINITY {
            return 1;
        }
        let more = ((1.0 - unit(random)).ln() / self.on).floor();
        1 + more.min(f64::from(most - 1)) as u32
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::{Purpose, stream};

    #[test]
    fn frames_are_distinct_and_inside() {
        let mut random = stream(1, Purpose::Frame, false, 0);
        for (count, total) in [(0, 0), (1, 2), (10, 20), (10, 19), (7, 1000)] {
            for mean_on in [1.0, 2.5, 50.0] {
                for _ in 0..500 {
                    let mut bursts = Bursts::new(total, mean_on);
                    let seen = bursts.draw(count, &mut random);
                    assert_eq!(seen.len(), count as usize);
                    assert!(seen.windows(2).all(|pair| pair[0] < pair[1]));
                    assert!(seen.iter().all(|frame| *frame < total));
                }
            }
        }
    }

    #[test]
    fn burst_lengths_are_geometric_and_frames_uniform() {
        let mut random = stream(2, Purpose::Frame, false, 0);
        let (mean, draws) = (2.5, 40_000);
        let mut bursts = Bursts::new(1000, mean);
        let lengths: Vec<f64> = (0..draws)
            .map(|_| f64::from(bursts.length(u32::MAX, &mut random)))
            .collect();
        let average = lengths.iter().sum::<f64>() / f64::from(draws);
        // Variance mean (mean - 1).
        assert!((average - mean).abs() < 5.0 * (mean * (mean - 1.0) / f64::from(draws)).sqrt());
        let ones = lengths.iter().filter(|length| **length == 1.0).count() as f64;
        assert!((ones / f64::from(draws) - 1.0 / mean).abs() < 0.0125);

        let mut bins = [0f64; 10];
        for _ in 0..20_000 {
            let seen = bursts.draw(1, &mut random);
            bins[seen[0] as usize / 100] += 1.0;
        }
        let statistic: f64 = bins.iter().map(|n| (n - 2000.0).powi(2) / 2000.0).sum();
        assert!(statistic < 27.9, "{bins:?}");
    }

    #[test]
    fn a_mean_of_one_frame_leaves_dark_frames_between() {
        let mut random = stream(3, Purpose::Frame, false, 0);
        let mut bursts = Bursts::new(19, 1.0);
        assert_eq!(
            bursts.draw(10, &mut random),
            (0..19).step_by(2).collect::<Vec<_>>()
        );
    }
}
