//! Monte-Carlo envelopes and global tests.
//!
//! The p-values compare the largest and the summed squared deviation of H from the mean of all
//! curves, the observed one included, so that all curves are exchangeable under the null hypothesis
//! and p is uniform (MAD and DCLF tests; Baddeley et al., Ecol. Monogr. 84, 477, 2014).

use crate::bins::Bins;
use crate::ripley::{Curves, Edges, Sets, rings};
use crate::simulate::{Null, draw};
use crate::window::Window;
use puncta_sdk::run::{Run, map};
use puncta_sdk::{Cancelled, Failure};

/// How patterns are simulated.
#[derive(Clone, Copy, Debug)]
pub struct Simulation {
    /// What "no structure" means.
    pub null: Null,
    /// Number of patterns.
    pub count: usize,
    /// Share of patterns without structure that may leave an envelope.
    pub significance: f64,
    /// Seed.
    pub seed: u64,
}

/// Where H of patterns without structure lies.
#[derive(Clone, Debug, PartialEq)]
pub struct Envelope {
    /// Lower end for each radius alone.
    pub low: Vec<f64>,
    /// Upper end for each radius alone.
    pub high: Vec<f64>,
    /// Lower end for all radii together.
    pub global_low: Vec<f64>,
    /// Upper end for all radii together.
    pub global_high: Vec<f64>,
    /// p-value of the largest deviation.
    pub p_largest: f64,
    /// p-value of the summed squared deviation.
    pub p_summed: f64,
}

/// One thread of a call: simulations run beside each other, each on one.
struct Alone<'a>(&'a dyn Run);

impl Run for Alone<'_> {
    fn parallel(&self, count: usize, task: &(dyn Fn(usize) + Sync)) {
        (0..count).for_each(task);
    }
    fn threads(&self) -> usize {
        1
    }
    fn progress(&self, _: f64, _: &str) -> Result<(), Cancelled> {
        if self.0.cancelled() {
            Err(Cancelled)
        } else {
            Ok(())
        }
    }
    fn cancelled(&self) -> bool {
        self.0.cancelled()
    }
}

/// H of simulated patterns.
///
/// # Errors
/// When cancelled.
pub fn simulated<const D: usize>(
    sets: &Sets<D>,
    window: &dyn Window<D>,
    edges: Edges,
    bins: &Bins,
    simulation: &Simulation,
    run: &dyn Run,
) -> Result<Vec<Vec<f64>>, Failure> {
    let mut curves = Vec::with_capacity(simulation.count);
    let batch = 4 * run.threads().max(1);
    while curves.len() < simulation.count {
        let done = curves.len();
        run.progress(done as f64 / simulation.count as f64, "simulating")?;
        let these = map(run, batch.min(simulation.count - done), &|i| {
            if run.cancelled() {
                return Err(Failure::cancelled());
            }
            let number = (done + i) as u64;
            let drawn = draw(
                simulation.null,
                sets,
                window,
                simulation.seed,
                number,
                &|| !run.cancelled(),
            );
            let rings = rings(&drawn.sets(), window, edges, bins, &Alone(run))?;
            Ok(Curves::new(&rings, bins, D).h)
        });
        for curve in these {
            curves.push(curve?);
        }
    }
    Ok(curves)
}

/// Envelopes and p-values of an observed curve among simulated ones.
///
/// # Errors
/// When there are too few simulations for the significance.
pub fn envelope(
    observed: &[f64],
    simulated: &[Vec<f64>],
    significance: f64,
) -> Result<Envelope, Failure> {
    let count = simulated.len();
    check(count, significance)?;
    let all = (count + 1) as f64;
    let column = |k: usize| simulated.iter().map(move |curve| curve[k]);
    let radii = 0..observed.len();
    // Rank of the curve that still belongs to the envelope, from either end and from the largest.
    let rank = |share: f64| ((share * all + 1e-9) as usize).max(1) - 1;
    let (mut low, mut high) = (Vec::new(), Vec::new());
    for k in radii.clone() {
        let mut values: Vec<f64> = column(k).collect();
        values.sort_by(f64::total_cmp);
        let place = rank(significance / 2.0);
        low.push(values[place]);
        high.push(values[count - 1 - place]);
    }
    let mean: Vec<f64> = radii
        .clone()
        .map(|k| (column(k).sum::<f64>() + observed[k]) / all)
        .collect();
    let largest = |curve: &[f64]| {
        curve
            .iter()
            .zip(&mean)
            .fold(0.0_f64, |most, (h, mean)| most.max((h - mean).abs()))
    };
    let summed = |curve: &[f64]| {
        curve
            .iter()
            .zip(&mean)
            .map(|(h, mean)| (h - mean).powi(2))
            .sum::<f64>()
    };
    let p = |measure: &dyn Fn(&[f64]) -> f64| {
        let value = measure(observed);
        let above = simulated.iter().filter(|curve| measure(curve) >= value);
        (1.0 + above.count() as f64) / all
    };
    let centre: Vec<f64> = radii
        .map(|k| column(k).sum::<f64>() / count as f64)
        .collect();
    let mut deviations: Vec<f64> = simulated.iter().map(|curve| largest(curve)).collect();
    deviations.sort_by(|a, b| b.total_cmp(a));
    let width = deviations[rank(significance)];
    Ok(Envelope {
        low,
        high,
        global_low: centre.iter().map(|h| h - width).collect(),
        global_high: centre.iter().map(|h| h + width).collect(),
        p_largest: p(&largest),
        p_summed: p(&summed),
    })
}

/// Checks that there are enough simulations for the significance.
///
/// # Errors
/// When the envelope would need a part of a simulation.
pub fn check(count: usize, significance: f64) -> Result<(), Failure> {
    let least = (2.0 / significance - 1e-6).ceil() as usize - 1;
    if count < least {
        let message = format!(
            "{count} simulations cannot show a significance of {significance} on two sides"
        );
        return Err(
            Failure::bad_parameter("simulations", message).remedy(format!("take {least} or more"))
        );
    }
    Ok(())
}

#[cfg(test)]
mod tests;
