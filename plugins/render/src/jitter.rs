//! What the two jittered triangulations share: parameters, jitter, and what the report tells.

use crate::channels::{Channel, Want};
use crate::grid::Axis;
use crate::output::Entry;
use crate::samples::{Cloud, Sampling, neighbour_distances};
use puncta_sdk::prelude::*;

/// Bytes of a pixel's sum while samples are drawn.
pub(crate) const SUMS: u64 = 8;

/// How the localisations are jittered and sampled.
#[derive(Params)]
pub struct Jitter {
    /// Column with the standard deviation of the jitter, such as error_x; the distance from a neighbour if left out.
    jitter: Option<Column>,
    /// Which neighbour, counted from the nearest, gives the distance; 4 in a plane and 8 in a volume if left out.
    #[param(min = 1, max = 1000, advanced)]
    neighbour: Option<u32>,
    /// Factor on the jitter; 0 for none.
    #[param(default = 1, min = 0, max = 1e6)]
    jitter_scale: f64,
    /// Smallest jitter; half a pixel if left out, and none where the factor is 0.
    #[param(min = 0, max = 1e9, unit = "nm", advanced)]
    jitter_min: Option<f64>,
    /// Number of samples that are averaged.
    #[param(default = 10, min = 1, max = 10000)]
    samples: u32,
    /// Probability that a localisation is in a sample (Monte-Carlo subsets).
    #[param(default = 1, min = 0.001, max = 1)]
    keep: f64,
    /// Seed of the jitter and the subsets.
    #[param(default = 1)]
    seed: Seed,
}

impl Jitter {
    /// The column of the jitter, if one is named.
    pub(crate) fn want(&self) -> Option<Want> {
        let column = self.jitter.as_ref();
        column.map(|name| Want::named(name, "jitter", Some("nm")))
    }

    /// How the samples are drawn.
    pub(crate) fn sampling(&self) -> Sampling {
        Sampling {
            samples: self.samples,
            keep: self.keep,
            seed: self.seed.0,
        }
    }

    /// The localisations of a channel, whose first columns are their positions, then the jitter's.
    pub(crate) fn cloud<const D: usize>(
        &self,
        channel: &Channel<'_>,
        axes: &[Axis; D],
        run: &dyn Run,
    ) -> Result<Cloud<D>, Failure> {
        let columns: [&[f64]; D] = std::array::from_fn(|i| &*channel.columns[i]);
        let (scale, least) = (self.jitter_scale, self.least(axes[0].size()));
        if let Some(jitter) = channel.columns.get(D) {
            return Ok(Cloud::new(columns, jitter, scale, least, axes));
        }
        if scale == 0.0 {
            return Ok(Cloud::new(
                columns,
                &vec![0.0; columns[0].len()],
                scale,
                least,
                axes,
            ));
        }
        run.progress(0.0, "measuring distances from neighbours")?;
        let neighbour = self.neighbour.unwrap_or(if D == 2 { 4 } else { 8 });
        let mut jitter = neighbour_distances(columns, neighbour as usize, run)?;
        // A single localisation has no neighbour, and no triangle either.
        jitter
            .iter_mut()
            .filter(|v| v.is_infinite())
            .for_each(|v| *v = 0.0);
        Ok(Cloud::new(columns, &jitter, scale, least, axes))
    }

    fn least(&self, pixel_size: f64) -> f64 {
        let usual = if self.jitter_scale == 0.0 {
            0.0
        } else {
            0.5 * pixel_size
        };
        self.jitter_min.unwrap_or(usual)
    }
}

/// What the report tells of a channel.
pub(crate) fn entries(rendered: usize, shown: f64, invalid: u64, out: &[f32]) -> Vec<Entry> {
    vec![
        ("rendered", rendered as f64, "Rows that were triangulated"),
        (
            "shown",
            shown,
            "Rows that are corners of a sample, over the probability, on average",
        ),
        (
            "invalid",
            invalid as f64,
            "Rows without a finite position and jitter, left out",
        ),
        (
            "sum",
            out.iter().map(|v| f64::from(*v)).sum(),
            "Sum of the image",
        ),
    ]
}

/// Refuses localisations without a triangle.
pub(crate) fn none(channel: &str, least: usize, on: &str) -> Failure {
    let message = format!(
        "{channel} has no {least} localisations that do not lie on a {on}, so that there is nothing to triangulate"
    );
    Failure::bad_input(message).remedy("choose more localisations, or render them as Gaussians")
}
