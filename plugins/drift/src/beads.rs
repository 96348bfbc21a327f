//! Traces of fiducial markers, and the drift that they share.

use std::collections::HashMap;

use puncta_sdk::{Failure, Run};

use crate::cloud::{Columns, Frames};

/// A marker followed through the frames.
#[derive(Clone, Debug, Default)]
pub struct Trace {
    /// Place of the time in the table's distinct times, increasing.
    pub frames: Vec<u32>,
    /// Position at each, nm.
    pub at: Vec<[f64; 3]>,
    /// Variance at each along x, y, z, nm^2.
    pub variance: Vec<[f64; 3]>,
}

/// How markers are followed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Following {
    /// Farthest from its last position, nm.
    pub radius: f64,
    /// Longest time without it.
    pub gap: f64,
    /// Least share of the distinct times at which it is seen.
    pub share: f64,
}

/// Follows every localisation from frame to frame and keeps those seen often enough.
///
/// # Errors
/// When none is; or cancelled.
pub fn traces(
    columns: &Columns<'_>,
    frames: &Frames,
    following: &Following,
    precision: f64,
    run: &dyn Run,
) -> Result<Vec<Trace>, Failure> {
    let point = |row: usize| {
        [
            columns.x[row],
            columns.y[row],
            columns.z.map_or(0.0, |z| z[row]),
        ]
    };
    let variance = |row: usize, axis: usize| {
        let error = columns.errors[axis].map_or(f64::NAN, |error| error[row]);
        if error > 0.0 && error.is_finite() {
            error * error
        } else {
            precision * precision
        }
    };
    let mut all: Vec<Trace> = Vec::new();
    let mut active: HashMap<[i64; 2], Vec<usize>> = HashMap::new();
    let cell = |p: [f64; 3]| [0, 1].map(|k| (p[k] / following.radius).floor() as i64);
    // Rows of a frame in the order of their position, so that the order of the table has no say.
    let mut rows = frames.rows.clone();
    rows.sort_by(|a, b| {
        let key = |row: u32| (frames.of_row[row as usize], point(row as usize));
        let ((a, p), (b, q)) = (key(*a), key(*b));
        let by = |k: usize| p[k].total_cmp(&q[k]);
        a.cmp(&b)
            .then_with(|| by(0))
            .then_with(|| by(1))
            .then_with(|| by(2))
    });
    for (k, row) in rows.iter().map(|row| *row as usize).enumerate() {
        if k % 1024 == 0 {
            run.progress(0.5 * k as f64 / rows.len() as f64, "following markers")?;
        }
        let (frame, p) = (frames.of_row[row], point(row));
        let time = frames.times[frame as usize];
        let home = cell(p);
        let mut best: Option<(f64, usize)> = None;
        for dy in -1..=1 {
            for dx in -1..=1 {
                let Some(ids) = active.get_mut(&[home[0] + dx, home[1] + dy]) else {
                    continue;
                };
                let last = |id: usize| all[id].frames.last().copied().unwrap_or(0);
                ids.retain(|id| time - frames.times[last(*id) as usize] <= following.gap);
                for id in ids.iter().filter(|id| last(**id) < frame) {
                    let q = all[*id].at.last().copied().unwrap_or_default();
                    let far = (p[0] - q[0]).hypot(p[1] - q[1]);
                    if far <= following.radius && best.is_none_or(|(least, _)| far < least) {
                        best = Some((far, *id));
                    }
                }
            }
        }
        let id = best.map_or(all.len(), |(_, id)| id);
        if id == all.len() {
            all.push(Trace::default());
        } else if let Some(old) = all[id].at.last().map(|q| cell(*q))
            && let Some(ids) = active.get_mut(&old)
        {
            ids.retain(|other| *other != id);
        }
        active.entry(home).or_default().push(id);
        all[id].frames.push(frame);
        all[id].at.push(p);
        all[id]
            .variance
            .push(std::array::from_fn(|axis| variance(row, axis)));
    }
    let least = (following.share * frames.times.len() as f64).max(2.0);
    all.retain(|trace| trace.frames.len() as f64 >= least);
    if all.is_empty() {
        let message = format!(
            "no localisation is seen again within {} nm at {:.0} or more of the {} times, so there \
             is no fiducial marker",
            following.radius,
            least,
            frames.times.len()
        );
        return Err(Failure::bad_input(message).remedy("lower share, raise gap or radius"));
    }
    Ok(all)
}

/// The drift that traces share.
#[derive(Clone, Debug, Default)]
pub struct Shared {
    /// Distinct times at which a marker was seen, and the drift and its variance there.
    pub frames: Vec<u32>,
    /// Drift at each, before smoothing.
    pub drift: Vec<[f64; 3]>,
    /// Its variance.
    pub variance: Vec<[f64; 3]>,
    /// Mean position of each trace.
    pub origin: Vec<[f64; 3]>,
    /// Root mean square of the residuals of each trace.
    pub residual: Vec<[f64; 3]>,
    /// Whether a trace was used: it overlaps in time with the others.
    pub used: Vec<bool>,
}

/// Rounds of the alternating fit.
const ROUNDS: usize = 200;
/// Residuals beyond this many standard deviations count less (Huber).
const HUBER: f64 = 2.5;

/// Fits position(marker, frame) = origin(marker) + drift(frame), each weighted by its precision.
///
/// # Errors
/// When cancelled.
pub fn shared(traces: &[Trace], axes: usize, run: &dyn Run) -> Result<Shared, Failure> {
    let used = overlapping(traces);
    let kept = || {
        traces
            .iter()
            .zip(&used)
            .filter(|(_, used)| **used)
            .map(|(t, _)| t)
    };
    let mut frames: Vec<u32> = kept().flat_map(|t| t.frames.iter().copied()).collect();
    frames.sort_unstable();
    frames.dedup();
    let place = |frame: u32| frames.binary_search(&frame).unwrap_or(0);
    let places: Vec<Vec<usize>> = traces
        .iter()
        .map(|t| t.frames.iter().map(|f| place(*f)).collect())
        .collect();
    let mut out = Shared {
        drift: vec![[0.0; 3]; frames.len()],
        variance: vec![[0.0; 3]; frames.len()],
        origin: vec![[0.0; 3]; traces.len()],
        residual: vec![[0.0; 3]; traces.len()],
        used,
        frames,
    };
    for axis in 0..axes {
        fit(traces, &places, &mut out, axis, run)?;
    }
    Ok(out)
}

fn fit(
    traces: &[Trace],
    places: &[Vec<usize>],
    out: &mut Shared,
    axis: usize,
    run: &dyn Run,
) -> Result<(), Failure> {
    let count = out.frames.len();
    let mut drift = vec![0.0; count];
    let mut weight = vec![0.0; count];
    for round in 0..ROUNDS {
        run.progress(0.5 + 0.5 * round as f64 / ROUNDS as f64, "aligning traces")?;
        let mut moved = 0.0_f64;
        for (k, trace) in traces.iter().enumerate() {
            let (mut sum, mut total) = (0.0, 0.0);
            for (i, place) in places[k].iter().enumerate() {
                let w = 1.0 / trace.variance[i][axis];
                sum += w * (trace.at[i][axis] - drift[*place]);
                total += w;
            }
            let origin = sum / total;
            moved = moved.max((origin - out.origin[k][axis]).abs());
            out.origin[k][axis] = origin;
        }
        if round > 0 && moved < 1e-4 {
            break;
        }
        let mut sum = vec![0.0; count];
        weight = vec![0.0; count];
        for (k, trace) in traces.iter().enumerate().filter(|(k, _)| out.used[*k]) {
            for (i, place) in places[k].iter().enumerate() {
                let value = trace.at[i][axis] - out.origin[k][axis];
                let sigma = trace.variance[i][axis].sqrt();
                let off = (value - drift[*place]).abs() / sigma;
                let huber = if round == 0 {
                    1.0
                } else {
                    (HUBER / off.max(HUBER)).min(1.0)
                };
                let w = huber / (sigma * sigma);
                sum[*place] += w * value;
                weight[*place] += w;
            }
        }
        for (drift, (sum, weight)) in drift.iter_mut().zip(sum.iter().zip(&weight)) {
            *drift = sum / weight.max(f64::MIN_POSITIVE);
        }
    }
    for (k, trace) in traces.iter().enumerate() {
        let miss =
            |(i, p): (usize, &usize)| (trace.at[i][axis] - out.origin[k][axis] - drift[*p]).powi(2);
        let sum: f64 = places[k].iter().enumerate().map(miss).sum();
        out.residual[k][axis] = (sum / places[k].len().max(1) as f64).sqrt();
    }
    for (i, drift) in drift.iter().enumerate() {
        out.drift[i][axis] = *drift;
        out.variance[i][axis] = 1.0 / weight[i].max(f64::MIN_POSITIVE);
    }
    Ok(())
}

/// The largest group of traces that share times, directly or through others.
fn overlapping(traces: &[Trace]) -> Vec<bool> {
    let mut group: Vec<usize> = (0..traces.len()).collect();
    let mut at_frame: HashMap<u32, usize> = HashMap::new();
    for (k, trace) in traces.iter().enumerate() {
        for frame in &trace.frames {
            let other = *at_frame.entry(*frame).or_insert(k);
            let (from, to) = (group[k], group[other]);
            if from != to {
                group
                    .iter_mut()
                    .filter(|g| **g == from)
                    .for_each(|g| *g = to);
            }
        }
    }
    let size = |of: usize| -> usize {
        let own = traces.iter().zip(&group).filter(|(_, g)| **g == of);
        own.map(|(t, _)| t.frames.len()).sum()
    };
    let best = group
        .iter()
        .copied()
        .max_by_key(|g| (size(*g), usize::MAX - g));
    group.iter().map(|g| Some(*g) == best).collect()
}

/// Smooths values at times by a Gaussian of standard deviation `width`, weighted by precision.
/// Gives values and variances.
pub fn smooth(
    times: &[f64],
    values: &[[f64; 3]],
    variance: &[[f64; 3]],
    width: f64,
) -> (Vec<[f64; 3]>, Vec<[f64; 3]>) {
    if width <= 0.0 {
        return (values.to_vec(), variance.to_vec());
    }
    let mut first = 0;
    let mut out = (
        Vec::with_capacity(times.len()),
        Vec::with_capacity(times.len()),
    );
    for t in times {
        while times[first] < t - 3.0 * width {
            first += 1;
        }
        let (mut sum, mut total, mut squares) = ([0.0; 3], [0.0; 3], [0.0; 3]);
        for i in first..times.len() {
            let u = (times[i] - t) / width;
            if u > 3.0 {
                break;
            }
            for axis in 0..3 {
                let g = (-0.5 * u * u).exp() / variance[i][axis].max(1e-12);
                sum[axis] += g * values[i][axis];
                total[axis] += g;
                squares[axis] += g * g * variance[i][axis];
            }
        }
        out.0.push(std::array::from_fn(|k| sum[k] / total[k]));
        out.1
            .push(std::array::from_fn(|k| squares[k] / (total[k] * total[k])));
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::normal;
    use puncta_testkit::Threads;

    #[test]
    fn traces_with_gaps_and_outliers_give_the_drift() {
        // Three markers; each is missing for a while, one has gross errors.
        let drift = |t: f64| [0.2 * t, -30.0 * (t / 80.0).sin()];
        let (mut x, mut y, mut t) = (vec![], vec![], vec![]);
        for frame in 0..400u32 {
            for bead in 0..3u32 {
                if frame / 20 % 7 == 2 * bead {
                    continue;
                }
                let time = f64::from(frame);
                let id = u64::from(3 * frame + bead);
                let gross = if bead == 1 && frame % 50 == 7 {
                    90.0
                } else {
                    0.0
                };
                x.push(1000.0 * f64::from(bead) + drift(time)[0] + 3.0 * normal(id, 1) + gross);
                y.push(500.0 + drift(time)[1] + 3.0 * normal(id, 2));
                t.push(time);
            }
        }
        let columns = Columns {
            x: &x,
            y: &y,
            t: &t,
            ..Columns::default()
        };
        let run = Threads(1);
        let frames = Frames::new(&columns, &run).unwrap();
        let following = Following {
            radius: 150.0,
            gap: 25.0,
            share: 0.3,
        };
        let traces = traces(&columns, &frames, &following, 3.0, &run).unwrap();
        assert_eq!(traces.len(), 3);
        let found = shared(&traces, 2, &run).unwrap();
        assert_eq!(found.used, [true; 3]);
        let times: Vec<f64> = found
            .frames
            .iter()
            .map(|f| frames.times[*f as usize])
            .collect();
        let (smoothed, variance) = smooth(&times, &found.drift, &found.variance, 4.0);
        for axis in [0, 1] {
            let miss = |i: usize| smoothed[i][axis] - drift(times[i])[axis];
            let mean = (0..times.len()).map(miss).sum::<f64>() / times.len() as f64;
            let square = |i: usize| (miss(i) - mean).powi(2);
            let rms = ((0..times.len()).map(square).sum::<f64>() / times.len() as f64).sqrt();
            assert!(rms < 1.2, "{rms}");
        }
        assert!(variance[200][0].sqrt() < 1.0);
        assert!(found.residual[0][1] < 4.0);
        let far = Following {
            radius: 1.0,
            ..following
        };
        assert!(super::traces(&columns, &frames, &far, 3.0, &run).is_err());
    }
}
