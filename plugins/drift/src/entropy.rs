//! Drift of least entropy: the one under which the localisations lie most densely.
//!
//! As Cnossen et al. (2021) the drift of each bin of time is moved to where the density that the
//! localisations give each other is largest; here it is the quadratic (Renyi) form, whose gradient
//! has no noise from the density itself: S = sum over pairs of different bins of
//! g_i g_j (1 - d_ij^2 / R^2)^3, with g_i = 1 / sqrt(1 + n_i) from the number n_i of neighbours
//! within R, so that dense clusters do not outweigh everything else. The kernel curves at its top as
//! a Gaussian of variance R^2 / 8 that is 1.4 times as wide as the displacement between two
//! localisations of a molecule; with it the error is least, both for dense and sparse data.
//!
//! A round is one step of Newton's method with the curvature of all bins together; Anderson's method
//! speeds it up.

use puncta_sdk::run::map;
use puncta_sdk::{Failure, Run};

use crate::anderson::Anderson;
use crate::cloud::{Cloud, hash};
use crate::coarse::moved;
use crate::pairs::{Pairs, TASKS, affordable};

/// Radius of the kernel, in standard deviations of a localisation.
pub const RADIUS: f64 = 5.6;
/// The list of neighbours reaches further than the kernel by this share of its radius; a bin that
/// moves further needs a new list.
const MARGIN: f64 = 0.15;
/// Least stiffness that is believed.
const FLOOR: f64 = 0.1;
/// Most rounds.
const ROUNDS: usize = 30;
/// Root mean square of the last step, in standard deviations of a localisation, that ends it.
const STEP: f64 = 1e-2;

/// Moves the drift of each bin to where the entropy is least, near `start`. At most `most`
/// localisations take part. A bin without neighbours keeps its drift.
///
/// # Errors
/// When cancelled.
pub fn refine(
    cloud: &Cloud,
    bin_of_frame: &[u32],
    start: &[[f64; 3]],
    most: usize,
    seed: u64,
    run: &dyn Run,
) -> Result<Vec<[f64; 3]>, Failure> {
    let radius = RADIUS * cloud.sigma;
    let reach = (radius * (1.0 + MARGIN)) as f32;
    let group = |cloud: &Cloud| -> Vec<u32> {
        let bin = |frame: &u32| bin_of_frame[*frame as usize];
        cloud.frame.iter().map(bin).collect()
    };
    let mut some = cloud.thinned(most, seed);
    let at = moved(&some, &group(&some), start);
    let most = affordable(&at, reach, run);
    if most < some.len() {
        some = some.thinned(most, hash(5, seed));
    }
    let group = group(&some);
    let mut drift = start.to_vec();
    let mut rounds = 0;
    // New lists of neighbours until no bin leaves the reach of its list.
    while rounds < ROUNDS {
        let at = moved(&some, &group, &drift);
        let pairs = Pairs::new(&at, &group, reach, run)?;
        let problem = Problem {
            group: &group,
            at: &at,
            pairs: &pairs,
            radius,
            least: STEP * cloud.sigma,
        };
        let shift = if cloud.axes == 3 {
            settle::<3>(&problem, drift.len(), &mut rounds, run)?
        } else {
            settle::<2>(&problem, drift.len(), &mut rounds, run)?
        };
        let mut far = 0.0_f64;
        for (drift, shift) in drift.iter_mut().zip(&shift) {
            for axis in 0..3 {
                drift[axis] += shift[axis];
                far = far.max(shift[axis].abs());
            }
        }
        if far < MARGIN * radius {
            break;
        }
    }
    Ok(drift)
}

/// What a round needs of a localisation.
#[derive(Clone, Copy)]
struct Node<const D: usize> {
    at: [f32; D],
    /// 1 / sqrt(1 + number of neighbours).
    weight: f32,
}

/// Localisations, their bins and positions, and their neighbours.
struct Problem<'a> {
    group: &'a [u32],
    at: &'a [[f32; 3]],
    pairs: &'a Pairs,
    radius: f64,
    /// A step that is small enough, nm.
    least: f64,
}

/// Iterates to the optimum on one list of neighbours. Gives the shift of each bin.
fn settle<const D: usize>(
    problem: &Problem<'_>,
    bins: usize,
    rounds: &mut usize,
    run: &dyn Run,
) -> Result<Vec<[f64; 3]>, Failure> {
    let pairs = problem.pairs;
    let group: Vec<u32> = pairs
        .order
        .iter()
        .map(|i| problem.group[*i as usize])
        .collect();
    let base = nodes::<D>(problem);
    let mut nodes = base.clone();
    let mut weights = vec![0.0; bins];
    group.iter().for_each(|bin| weights[*bin as usize] += 1.0);
    let mut anderson = Anderson::new(bins * D, |k| weights[k / D]);
    let mut shift = vec![0.0; bins * D];
    loop {
        run.progress(*rounds as f64 / ROUNDS as f64, "refining the drift")?;
        let sums = forces(&nodes, &group, problem, bins, run)?;
        let step = steps::<D>(&sums, 0.2 * problem.radius);
        let size = anderson.norm(&step);
        *rounds += 1;
        anderson.advance(&mut shift, &step);
        for (node, (base, bin)) in nodes.iter_mut().zip(base.iter().zip(&group)) {
            let own = &shift[*bin as usize * D..][..D];
            node.at = std::array::from_fn(|axis| base.at[axis] - own[axis] as f32);
        }
        let far = shift.iter().fold(0.0, |far: f64, s| far.max(s.abs()));
        if size < problem.least || far > MARGIN * problem.radius || *rounds >= ROUNDS {
            break;
        }
    }
    let of = |bin: usize| std::array::from_fn(|k| if k < D { shift[bin * D + k] } else { 0.0 });
    Ok((0..bins).map(of).collect())
}

/// The localisations in the order of the pairs.
fn nodes<const D: usize>(problem: &Problem<'_>) -> Vec<Node<D>> {
    let pairs = problem.pairs;
    let mut nodes = Vec::with_capacity(pairs.order.len());
    for task in &pairs.tasks {
        let mut begin = 0;
        for (i, end) in pairs.order[task.first..].iter().zip(&task.ends) {
            let count = end - begin;
            begin = *end;
            nodes.push(Node {
                at: std::array::from_fn(|axis| problem.at[*i as usize][axis]),
                weight: 1.0 / (1.0 + count as f32).sqrt(),
            });
        }
    }
    nodes
}

/// Sums over the pairs of each bin: weighted displacements, their weight, and what it loses.
fn forces<const D: usize>(
    nodes: &[Node<D>],
    group: &[u32],
    problem: &Problem<'_>,
    bins: usize,
    run: &dyn Run,
) -> Result<Vec<f64>, Failure> {
    let inverse = (1.0 / (problem.radius * problem.radius)) as f32;
    let parts = map(run, TASKS, &|task| {
        let mut sums = vec![0.0; bins * (D + 2)];
        let task = &problem.pairs.tasks[task];
        let mut begin = 0;
        for (k, &end) in task.ends.iter().enumerate() {
            if k % 4096 == 0 && run.cancelled() {
                break;
            }
            let own = nodes[task.first + k];
            let others = &task.others[begin as usize..end as usize];
            begin = end;
            let (force, weight) = force(&own, others, nodes, inverse);
            let sums = &mut sums[group[task.first + k] as usize * (D + 2)..][..D + 2];
            for axis in 0..D {
                sums[axis] += f64::from(own.weight * force[axis]);
            }
            sums[D] += f64::from(own.weight * weight[0]);
            sums[D + 1] += f64::from(own.weight * weight[1]);
        }
        sums
    });
    if run.cancelled() {
        return Err(Failure::cancelled());
    }
    let mut total = vec![0.0; bins * (D + 2)];
    for sums in parts {
        total.iter_mut().zip(sums).for_each(|(t, s)| *t += s);
    }
    Ok(total)
}

/// Weighted displacements of a localisation from its neighbours, their weight, and what it loses
/// off the kernel's top, as a mean over the axes.
#[inline]
fn force<const D: usize>(
    own: &Node<D>,
    others: &[u32],
    nodes: &[Node<D>],
    inverse: f32,
) -> ([f32; D], [f32; 2]) {
    let (mut force, mut weight) = ([0.0; D], [0.0; 2]);
    for &j in others {
        let other = &nodes[j as usize];
        let d: [f32; D] = std::array::from_fn(|axis| own.at[axis] - other.at[axis]);
        let square: f32 = d.iter().map(|d| d * d).sum();
        let inside = (1.0 - square * inverse).max(0.0);
        let w = other.weight * inside;
        for axis in 0..D {
            force[axis] += w * inside * d[axis];
        }
        weight[0] += w * inside;
        weight[1] += w * (1.0 - inside);
    }
    weight[1] *= 4.0 / D as f32;
    (force, weight)
}

/// The step of each bin: its mean weighted displacement over the stiffness, the share of the
/// weights by which the pairs hold a bin back. That is nearly the same for all bins and taken from
/// all of them, as it is noisy in each.
fn steps<const D: usize>(sums: &[f64], most: f64) -> Vec<f64> {
    let all = |k: usize| sums.chunks(D + 2).map(|sums| sums[k]).sum::<f64>();
    let weight = all(D);
    let stiffness = (1.0 - all(D + 1) / weight.max(f64::MIN_POSITIVE)).max(FLOOR);
    let mut steps = vec![0.0; sums.len() / (D + 2) * D];
    for (step, sums) in steps.chunks_mut(D).zip(sums.chunks(D + 2)) {
        if sums[D] > 0.0 {
            for (step, force) in step.iter_mut().zip(sums) {
                *step = (force / sums[D] / stiffness).clamp(-most, most);
            }
        }
    }
    steps
}
