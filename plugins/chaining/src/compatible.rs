//! The rule of PYME's clump finding, for those who compare results with it.
//!
//! In the order of frames a localisation takes the number of the earliest one before it, at most
//! `gap + 1` frames back or in the same frame, whose distance in x and y is below twice its own
//! radius; all in 32-bit arithmetic. The radius is a constant, or the scale times the column, without
//! the other localisation's. No row is ever made up.

use crate::chain::Chains;
use crate::spots::{Radius, Rows, Spots};
use crate::window::Window;
use puncta_sdk::{Failure, Run};

/// Localisations between two looks at the cancel button.
const POLL: usize = 1 << 12;

/// Chains `spots`, which come from `rows`.
///
/// # Errors
/// When cancelled.
pub fn chain(
    rows: &Rows<'_>,
    spots: &Spots<'_>,
    gap: u64,
    run: &dyn Run,
) -> Result<Chains, Failure> {
    let count = spots.frames.len();
    let radius = |place: usize| match rows.radius {
        Radius::Constant(radius) => radius as f32,
        Radius::Combined { sigma, scale } => (scale * sigma[spots.row(place)]) as f32,
    };
    let square = |place: usize| 4.0 * radius(place) * radius(place);
    // The search takes the sum of two shares: twice the square is enough for any other's share.
    let wide = Spots {
        order: None,
        frames: spots.frames.clone(),
        x: (&spots.x[..]).into(),
        y: (&spots.y[..]).into(),
        share: (0..count)
            .map(|place| f64::from(square(place)) * 1.01)
            .collect(),
        axial: None,
    };
    let mut window = Window::new(&wide, crate::chain::most_in_window(&wide.frames, gap));
    let mut chains = Chains {
        labels: vec![0; count],
        sizes: Vec::new(),
    };
    for place in 0..count {
        if place % POLL == 0 {
            run.progress(place as f64 / count as f64, "chaining")?;
        }
        let oldest = wide.frames[place]
            .saturating_sub(1)
            .saturating_sub_unsigned(gap);
        let limit = square(place);
        let mut first = usize::MAX;
        window.near(place, oldest, &mut |other| {
            let dx = wide.x[place] as f32 - wide.x[other] as f32;
            let dy = wide.y[place] as f32 - wide.y[other] as f32;
            if dx * dx + dy * dy < limit {
                first = first.min(other);
            }
            true
        });
        if first != usize::MAX {
            chains.labels[place] = chains.labels[first];
        }
        chains.count(place);
        window.insert(place);
    }
    Ok(chains)
}
