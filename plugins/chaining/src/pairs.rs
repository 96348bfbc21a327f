//! Distances of localisations in successive frames, and which radius and gap they suggest.

use crate::chain::{Chains, most_in_window};
use crate::spots::Spots;
use crate::window::Window;
use puncta_sdk::{Cancelled, Run};

/// Bins of distances.
pub const BINS: usize = 100;
/// Lags, beyond the longest gap, that the background is taken from.
const BACKGROUND: u64 = 10;
/// Localisations between two looks at the cancel button.
const POLL: usize = 1 << 12;

/// Histograms of the distances of pairs, in units of the largest one.
#[derive(Clone, Debug, PartialEq)]
pub struct Distances {
    /// Pairs in successive frames.
    pub successive: Vec<f64>,
    /// Pairs so far apart in time that few are repeats, for one lag.
    pub background: Vec<f64>,
}

/// Counts the pairs within the radius of `spots`: those in successive frames, and those more than
/// `longest` dark frames apart.
///
/// # Errors
/// When cancelled.
pub fn distances(spots: &Spots<'_>, longest: u64, run: &dyn Run) -> Result<Distances, Cancelled> {
    let lags = longest.saturating_add(1 + BACKGROUND);
    let mut window = Window::new(spots, most_in_window(&spots.frames, lags - 1));
    let mut found = Distances {
        successive: vec![0.0; BINS],
        background: vec![0.0; BINS],
    };
    let count = spots.frames.len();
    let mut added = 0;
    for place in 0..count {
        if place % POLL == 0 {
            run.progress(0.5 * place as f64 / count as f64, "measuring distances")?;
        }
        let frame = spots.frames[place];
        while spots.frames[added] < frame {
            window.insert(added);
            added += 1;
        }
        let oldest = frame.saturating_sub_unsigned(lags);
        window.near(place, oldest, &mut |other| {
            let lag = frame.abs_diff(spots.frames[other]);
            let histogram = if lag == 1 {
                &mut found.successive
            } else if lag > longest + 1 {
                &mut found.background
            } else {
                return true;
            };
            let distance = spots.distance(place, other).sqrt() * BINS as f64;
            #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
            if let Some(bin) = histogram.get_mut(distance as usize) {
                *bin += 1.0;
            }
            true
        });
    }
    found
        .background
        .iter_mut()
        .for_each(|bin| *bin /= BACKGROUND as f64);
    Ok(found)
}

impl Distances {
    /// Repeats in each bin: successive pairs above the background.
    #[must_use]
    pub fn excess(&self) -> Vec<f64> {
        let both = self.successive.iter().zip(&self.background);
        both.map(|(all, background)| all - background).collect()
    }

    /// Number of bins up to the radius that makes the fewest errors: repeats beyond it are missed,
    /// background pairs within it are false. None if there are no more pairs than by chance.
    #[must_use]
    pub fn best(&self) -> Option<usize> {
        let (mut sum, mut most, mut best) = (0.0, 0.0, None);
        for (bin, (excess, background)) in self.excess().iter().zip(&self.background).enumerate() {
            sum += excess - background;
            if sum > most {
                (most, best) = (sum, Some(bin + 1));
            }
        }
        // A random histogram exceeds its background by its own fluctuations.
        let chance = 5.0 * self.background.iter().sum::<f64>().sqrt();
        best.filter(|_| most > chance.max(10.0))
    }

    /// Root of the mean square distance along one axis of the repeats in the first `bins` bins, in
    /// units of the largest distance.
    #[must_use]
    pub fn spread(&self, bins: usize) -> f64 {
        let (mut sum, mut weight) = (0.0, 0.0);
        for (bin, excess) in self.excess().iter().take(bins).enumerate() {
            let distance = (bin as f64 + 0.5) / BINS as f64;
            sum += excess * distance * distance;
            weight += excess;
        }
        (sum / weight / 2.0).sqrt()
    }
}

/// Number of links of the chains with each number of dark frames, up to `longest`.
#[must_use]
pub fn dark_frames(spots: &Spots<'_>, chains: &Chains, longest: u64) -> Vec<f64> {
    let mut last: Vec<Option<i64>> = vec![None; chains.sizes.len()];
    let room = usize::try_from(longest)
        .unwrap_or(usize::MAX)
        .saturating_add(1);
    let mut links = vec![0.0; room];
    for (frame, label) in spots.frames.iter().zip(&chains.labels) {
        if let Some(before) = last[*label as usize - 1].replace(*frame) {
            let dark = usize::try_from(frame.abs_diff(before) - 1).unwrap_or(usize::MAX);
            if let Some(slot) = links.get_mut(dark) {
                *slot += 1.0;
            }
        }
    }
    links
}

/// Fewest links, as a share of those without a dark frame, that a longer gap is worth.
const WORTH: f64 = 0.01;

/// The level of links after long dark times (median of the second half), and the longest gap whose
/// links, and those of all shorter ones, are more than twice as many and at least a hundredth of
/// those without a dark frame.
#[must_use]
pub fn gap(links: &[f64]) -> (f64, usize) {
    let mut late = links[links.len() / 2..].to_vec();
    late.sort_by(f64::total_cmp);
    let level = late.get(late.len() / 2).copied().unwrap_or(0.0);
    let least = WORTH * links.first().copied().unwrap_or(0.0);
    let worth = |count: &&f64| **count > 2.0 * level && **count >= least;
    let short = links.iter().take_while(worth).count();
    (level, short.saturating_sub(1))
}
