//! The rule by which localisations become chains.
//!
//! Frame by frame, a localisation continues a chain when it lies within the radius of the chain's
//! last localisation, which is at most `gap` dark frames back. Where several could, the closest pair
//! (distance in units of the radius) is joined first, then the next among those left; equal
//! distances in the order of frames and rows. So each localisation joins one chain at most, and each
//! chain takes one localisation of a frame at most.

use crate::spots::Spots;
use crate::window::Window;
use puncta_sdk::{Cancelled, Failure, Run};

/// Localisations between two looks at the cancel button.
const POLL: usize = 1 << 14;
/// Most pairs of one frame that are compared.
const MOST_PAIRS: usize = 1 << 24;

/// The chains of a table.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Chains {
    /// Number of the chain of each localisation (in the order of [`Spots`]), from 1 in the order of
    /// the first localisations.
    pub labels: Vec<u32>,
    /// Localisations of each chain, the one numbered 1 first.
    pub sizes: Vec<u32>,
}

/// Chains `spots` with at most `gap` dark frames within a chain.
///
/// # Errors
/// When cancelled, or when so many localisations of one frame lie within the radius that they cannot
/// be compared.
pub fn chain(spots: &Spots<'_>, gap: u64, run: &dyn Run) -> Result<Chains, Failure> {
    let count = spots.frames.len();
    let mut chains = Chains {
        labels: vec![0; count],
        sizes: Vec::new(),
    };
    let mut window = Window::new(spots, most_in_window(&spots.frames, gap));
    // Whether a localisation is no longer the last of its chain.
    let mut taken = vec![false; count];
    let mut pairs: Vec<(f64, u32, u32)> = Vec::new();
    let mut polled = 0;
    let mut from = 0;
    while from < count {
        let frame = spots.frames[from];
        let oldest = frame.saturating_sub(1).saturating_sub_unsigned(gap);
        pairs.clear();
        let mut to = from;
        while to < count && spots.frames[to] == frame {
            polled += 1;
            if polled % POLL == 0 {
                run.progress(to as f64 / count as f64, "chaining")?;
            }
            candidates(&mut window, spots, &taken, to, oldest, &mut pairs, run)?;
            to += 1;
        }
        pairs.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then((a.1, a.2).cmp(&(b.1, b.2))));
        for &(_, last, new) in &pairs {
            let (last, new) = (last as usize, new as usize);
            if !taken[last] && chains.labels[new] == 0 {
                taken[last] = true;
                chains.labels[new] = chains.labels[last];
            }
        }
        for place in from..to {
            chains.count(place);
            window.insert(place);
        }
        from = to;
    }
    Ok(chains)
}

impl Chains {
    /// Counts the localisation in its chain, or in a new one.
    pub(crate) fn count(&mut self, place: usize) {
        let label = &mut self.labels[place];
        if *label == 0 {
            self.sizes.push(0);
            #[allow(clippy::cast_possible_truncation)]
            let number = self.sizes.len() as u32;
            *label = number;
        }
        self.sizes[*label as usize - 1] += 1;
    }
}

/// Adds the pairs of the localisation at `new` with the ends of chains near it.
fn candidates(
    window: &mut Window<'_>,
    spots: &Spots<'_>,
    taken: &[bool],
    new: usize,
    oldest: i64,
    pairs: &mut Vec<(f64, u32, u32)>,
    run: &dyn Run,
) -> Result<(), Failure> {
    let before = pairs.len();
    window.near(new, oldest, &mut |last| {
        if taken[last] {
            return false;
        }
        let distance = spots.distance(last, new);
        if distance <= 1.0 && pairs.len() < MOST_PAIRS {
            #[allow(clippy::cast_possible_truncation)]
            pairs.push((distance, last as u32, new as u32));
        }
        true
    });
    if pairs.len() >= MOST_PAIRS {
        return Err(too_many(spots.frames[new]));
    }
    if pairs.len() - before > POLL && run.cancelled() {
        return Err(Cancelled.into());
    }
    Ok(())
}

fn too_many(frame: i64) -> Failure {
    Failure::bad_parameter(
        "radius",
        format!(
            "more than {MOST_PAIRS} pairs of localisations lie within the radius in frame {frame}"
        ),
    )
    .remedy("lower the radius or its scale, or the gap")
}

/// The largest number of localisations that a search may have to look at.
pub(crate) fn most_in_window(frames: &[i64], gap: u64) -> usize {
    let (mut most, mut from) = (0, 0);
    for (to, frame) in frames.iter().enumerate() {
        while frames[from] < frame.saturating_sub(1).saturating_sub_unsigned(gap) {
            from += 1;
        }
        most = most.max(to + 1 - from);
    }
    most
}

#[cfg(test)]
mod tests;
